"""Contacts of an assembly: where faces of two solids touch, or nearly."""

from dataclasses import dataclass
from typing import Literal

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import Vector


@dataclass(frozen=True, eq=False)
class Contact:
    """Two faces, or groups of faces of one surface each, of two solids that touch, or nearly.

    Attributes:
        solids: Numbers of the solids, the smaller first.
        kind: Surface on which they touch.
        faces: Numbers of the faces of each solid, as ``face:N`` counts those of its part's first
            solid, which is the one that is meshed.
        gap: Distance of the surfaces [m]; of a cylinder the difference of the radii. Negative: they
            overlap by as much.
        area: Of the overlap [m^2]; of cylinders on the first solid's.
        center: Centroid of the overlap, in the coordinates of the file [m].
        axis: Unit normal of a plane, out of the first solid; axis of a cylinder.
        radius: Of the first solid's cylinder [m]; None for a plane.
        length: Of the overlap along the axis of a cylinder [m]; None for a plane.
        outlines: Closed outlines ``(n, 3)`` of the overlap on a plane [m], outer ones and holes; none
            for a cylinder.
        wide: Farther apart than solids that touch: the air of a guide.
        covered: Share of each of these faces that lies in the overlap.
        solid_holes: Indices of the outlines of holes where a solid itself has none, or a smaller one.
    """

    solids: tuple[int, int]
    kind: Literal["plane", "cylinder"]
    faces: tuple[tuple[int, ...], tuple[int, ...]]
    gap: float
    area: float
    center: Vector
    axis: Vector
    radius: float | None = None
    length: float | None = None
    outlines: tuple[FloatArray, ...] = ()
    wide: bool = False
    covered: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    solid_holes: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
