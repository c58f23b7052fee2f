"""Schema of the volumetric analysis."""

from headstock.scene.schema.types import Names, RequestTable, Text


class VolumetricTable(RequestTable):
    """Position error of the tool over the poses of a sweep along two or three axes: three components
    and three angles, by source.
    """

    at: Names | None = None
    sweep: Text
