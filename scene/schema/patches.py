"""Schema of patches: faces, and the shapes that take a part of one."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema import types

InPlane = Annotated[list[types.Length], Field(min_length=2, max_length=3)]
Places = list[InPlane] | dict[types.Name, InPlane]


class ShapeTable(types.StrictTable):
    """A part of a face; the names of its keys are those of the fields of a ``Patch``."""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Its size as a ``Patch`` has it [m]."""
        return ()

    @property
    def points(self) -> tuple[tuple[float, float, float], ...]:
        """Corners ``(x, y, z)`` of an outline [m]; none of other shapes."""
        return ()


class _CenteredTable(ShapeTable):
    center: InPlane | None = None
    """centre of the patch; default: the middle of the face"""


class DiskTable(_CenteredTable):
    """A round patch; `center` in component coordinates: the two in-plane ones in the order x y z,
    or all three.
    """

    diameter: types.PositiveLength
    """diameter of the patch"""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Diameter."""
        return (self.diameter,)


class RectTable(_CenteredTable):
    """A rectangular patch; `size` along the two in-plane axes in the order x y z."""

    size: Annotated[list[types.PositiveLength], Field(min_length=2, max_length=2)]
    """sizes along the two directions of the face in the order x, y, z"""
    angle: types.Angle = 0.0
    """angle by which it is turned about its centre, from the first of these directions towards the second"""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Both sides."""
        return tuple(self.size)


class StripTable(_CenteredTable):
    """A patch that crosses the whole face along one in-plane axis."""

    width: types.PositiveLength
    """width of the patch"""
    along: Literal["x", "y", "z"]
    """axis of the component along which it crosses the face"""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Width."""
        return (self.width,)


class BandTable(_CenteredTable):
    """A patch around a cylinder, or around another face of revolution, as far as the face goes."""

    width: types.PositiveLength
    """width of the patch along the axis, half of it on either side of `center`"""

    @property
    def lengths(self) -> tuple[float, ...]:
        """Width."""
        return (self.width,)


class RingTable(_CenteredTable):
    """A round patch with a round hole in its middle, as below the head of a screw."""

    diameter: types.PositiveLength
    """outer diameter of the patch"""
    inner: types.PositiveLength
    """diameter of its hole, smaller than the outer"""

    def _faults(self) -> Iterator[str]:
        if self.inner >= self.diameter:
            yield "has an inner diameter that is not smaller than the outer; write a smaller `inner`, or a disk"

    @property
    def lengths(self) -> tuple[float, ...]:
        """Outer and inner diameter."""
        return self.diameter, self.inner


class OutlineTable(ShapeTable):
    """A patch on a plane face inside a closed outline, without holes."""

    model_config = types.one_of("corners", "file")

    corners: Annotated[list[types.Position], Field(min_length=3, max_length=1000)] | None = None
    """corners `[x, y, z]` of the outline in their order, at least three; the last is joined to the first"""
    file: types.Text | None = None
    """a `.csv` table of them in the folder of the scene: columns `x`, `y`, `z` in m"""

    def _faults(self) -> Iterator[str]:
        if (self.corners is None) == (self.file is None):
            yield 'needs either corners = [["0 mm", "0 mm", "0 mm"], ...] or file = "corners.csv"'

    @property
    def points(self) -> tuple[tuple[float, float, float], ...]:
        """Corners."""
        return tuple((x, y, z) for x, y, z in self.corners or ())


class ShapedTable(types.StrictTable):
    """A face, or a part of one."""

    face: types.Text | None = None
    disk: DiskTable | None = None
    """only this round part of the face; default: the whole face"""
    rect: RectTable | None = None
    """only this rectangular part of the face; default: the whole face"""
    strip: StripTable | None = None
    """only this strip of the face; default: the whole face"""
    band: BandTable | None = None
    """only this part around a cylinder; default: the whole face"""
    ring: RingTable | None = None
    """only this ring on the face; default: the whole face"""
    outline: OutlineTable | None = None
    """only the part of a plane face inside this outline; default: the whole face"""

    @property
    def shapes(self) -> dict[str, ShapeTable]:
        """The shape that is given, by its name; empty for the whole face."""
        return self.given(SHAPES)

    def _faults(self) -> Iterator[str]:
        if len(self.shapes) > 1:
            yield (
                f"gives {' and '.join(self.shapes)}, but a patch is one of {', '.join(SHAPES)}; keep one, and write several "
                "patches as patches = [{...}, {...}]"
            )


SHAPES = tuple(ShapedTable.model_fields)[1:]
CENTERED_SHAPES = SHAPES[:-1]


class PatchTable(ShapedTable):
    """A face, or a disk, rect, strip, band, ring or outline on it."""

    face: types.Text
    """face that it lies on, as in an interface"""
    places: Places | None = None
    """in place of the shape's `center`: one patch at each"""
    each: types.Exceptions = {}
    """what is different at single places, dotted keys and values"""
