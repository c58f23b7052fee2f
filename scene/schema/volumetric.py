"""Schema of the volumetric analysis."""

from headstock.scene.schema.types import Names, RequestTable, Text


class VolumetricTable(RequestTable):
    """Position error of the tool over the poses of a sweep along two or three axes: three components
    and three angles, by source.
    """

    at: Names | None = None
    """points at which it is computed; default: all of them"""
    sweep: Text
    """a sweep of `axes` in which two or three have several positions, at most 20 000 poses"""
