"""The shapes a component can have, each in the component's own frame.

Parametric solids stand on the plane ``z = 0`` with the z axis through the centre of their
footprint, so a box spans ``[-sx/2, sx/2] x [-sy/2, sy/2] x [0, sz]``.
"""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Box:
    """A solid block of the given size (x, y, z) [m]."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class Tube:
    """A hollow (or, with ``inner_diameter = 0``, full) cylinder along z [m]."""

    outer_diameter: float
    inner_diameter: float
    length: float


@dataclass(frozen=True)
class Plate:
    """A plate in the x-y plane with ribs on its upper side [m].

    Attributes:
        size: Length x, width y and thickness z of the plate itself.
        rib_height: Height of the ribs above the plate; zero for a plain plate.
        ribs_x: Number of ribs that run along x, spread evenly over the width.
        ribs_y: Number of ribs that run along y, spread evenly over the length.
    """

    size: tuple[float, float, float]
    rib_height: float = 0.0
    rib_thickness: float = 0.0
    ribs_x: int = 0
    ribs_y: int = 0


@dataclass(frozen=True)
class HollowColumn:
    """A closed rectangular column with internal ribs: what most cast or welded columns are [m].

    Attributes:
        size: Outer size x, y, z.
        wall: Thickness of the four side walls.
        cap: Thickness of the bottom and top plate.
        rib: Thickness of every internal rib.
        ribs_z: Number of horizontal ribs (plates normal to z), evenly spread between the caps.
        ribs_x: Number of vertical ribs normal to x, evenly spread between the walls.
        ribs_y: Number of vertical ribs normal to y, evenly spread between the walls.
        core_hole: Diameter of the round core hole through every rib and cap cell; zero for none.
    """

    size: tuple[float, float, float]
    wall: float
    cap: float
    rib: float = 0.0
    ribs_z: int = 0
    ribs_x: int = 0
    ribs_y: int = 0
    core_hole: float = 0.0


@dataclass(frozen=True)
class StepFile:
    """A solid read from a STEP file; units come from the file's own header.

    Attributes:
        solid: Index or name of the solid when the file holds several.
    """

    path: Path
    solid: int | str | None = None


@dataclass(frozen=True)
class MeshFile:
    """A solid given as a finished mesh, in a format of ``meshing/formats.py``.

    Attributes:
        unit: Length of one unit of the file's coordinates [m].
        beside: Absolute paths of the files that hold its arrays (XDMF).
        solid: Name of the set of cells of the file that the solid is; None for all of one material, ``*``
            for all of whatever material.
    """

    path: Path
    unit: float = 1.0
    beside: tuple[Path, ...] = ()
    solid: str | None = None


@dataclass(frozen=True)
class SuperelementFile:
    """Reduced matrices: in Headstock's own HDF5 layout, or those of another program.

    Attributes:
        path: Where it is; of matrices in several files that of the stiffness.
        points: Bulk data with the places of its nodes, where they are not in ``path``.
        supported: It is held to ground, and has no rigid motions.
    """

    path: Path
    points: Path | None = None
    supported: bool = False


@dataclass(frozen=True)
class PointMass:
    """A rigid body without a shape, its centre of mass at the origin; its one face is ``center``.

    Attributes:
        mass: [kg].
        inertia: About the component's x, y and z axes, which are principal ones [kg m^2]; a body
            without any does not resist rotations.
    """

    mass: float
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)


CENTER_FACE = "center"
# solids that are made of their dimensions
ParametricSolid = Box | Tube | Plate | HollowColumn
# solids that are not
Imported = StepFile | MeshFile | SuperelementFile | PointMass
Solid = ParametricSolid | Imported
