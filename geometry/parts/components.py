"""Components of a machine: solid, material, mesh settings, and the interfaces at which they meet
others.
"""

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from headstock.geometry.frames import Frame
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import Solid

Fidelity = Literal["rigid", "segmented", "polynomial", "elastic"]
CouplingKind = Literal["rigid", "average"]
CellShape = Literal["tet", "hex"]
ShapeName = Literal["whole", "disk", "rect", "strip", "band", "ring", "outline"]


@dataclass(frozen=True)
class Material:
    """An isotropic, linear elastic material.

    Attributes:
        youngs_modulus: E [Pa].
        poisson_ratio: nu [-].
        density: rho [kg/m^3].
        loss_factor: Structural damping eta: the complex modulus is ``E (1 + i eta)`` [-].
    """

    name: str
    youngs_modulus: float
    poisson_ratio: float
    density: float
    loss_factor: float = 0.0


def weigh_modes(youngs_modulus: float, poisson_ratio: float, density: float) -> float:
    """Return the natural frequencies of a body below a frequency, over its volume and the cube of
    that frequency [1 / (m^3 Hz^3)], for many of them.

    Args:
        youngs_modulus: E [Pa].
        poisson_ratio: nu, above -1 and at most 0.5.
        density: rho [kg/m^3].

    Source: Weyl's law for elastic bodies, Dupuis, Mazo and Onsager (1960): ``4 pi / 3 (1 / c_l^3 +
    2 / c_t^3)``.
    """
    transverse = math.sqrt(youngs_modulus / (2.0 * (1.0 + poisson_ratio) * density))
    # (c_t / c_l)^2, zero for incompressible bodies
    squared_ratio = (1.0 - 2.0 * poisson_ratio) / (2.0 - 2.0 * poisson_ratio)
    return 4.0 * math.pi / 3.0 * (2.0 + squared_ratio * math.sqrt(squared_ratio)) / transverse**3


@dataclass(frozen=True)
class RayleighDamping:
    """Viscous damping ``C = alpha M + beta K``: the damping ratio of a mode is ``alpha / (2 omega) +
    beta omega / 2``.

    Attributes:
        alpha: Of the mass [1/s].
        beta: Of the stiffness [s].

    Source: Rayleigh (1877), The Theory of Sound, section 97.
    """

    alpha: float = 0.0
    beta: float = 0.0

    def __bool__(self) -> bool:
        return self.alpha != 0.0 or self.beta != 0.0


@dataclass(frozen=True)
class Patch:
    """A part of a component's surface, chosen by geometry.

    Attributes:
        face: ``x- x+ y- y+ z- z+`` (the planar face(s) at that end of the bounding box), ``face:N``
            (the N-th CAD face, counted from 1 as ``show`` numbers them), ``outer`` / ``inner``
            (curved faces of a tube) or ``set:NAME`` (a named surface set of an imported mesh).
        shape: ``whole`` face, or what is imprinted on it.
        center: Centre of the imprint in component coordinates [m]; its component along the face
            normal is ignored.
        size: ``(diameter,)`` of a disk, ``(outer, inner)`` diameter of a ring, ``(a, b)`` of a rect
            along the two in-plane axes in the order x y z without the normal, ``(width,)`` of a strip
            that crosses the face and of a band around it; none of an outline.
        along: In-plane axis a strip runs along (``x``, ``y`` or ``z``).
        angle: By which a rect is turned from the first in-plane axis towards the second [rad].
        corners: Of an outline, in its order, in component coordinates [m].
    """

    face: str
    shape: ShapeName = "whole"
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    size: tuple[float, ...] = ()
    along: str | None = None
    angle: float = 0.0
    corners: tuple[tuple[float, float, float], ...] = ()

    @property
    def is_grid_aligned(self) -> bool:
        """Return whether it is made of rectangles along the axes on a face across one."""
        return self.shape in ("whole", "rect", "strip") and not self.angle


@dataclass(frozen=True)
class RailSettings:
    """What makes an interface a rail: carriages hold on to it anywhere along an axis of the
    component.

    Attributes:
        along: Axis of the component the rail runs along.
        control_points: Control points of the cubic spline that its motion is fitted by, four dofs each.
    """

    along: Literal["x", "y", "z"]
    control_points: int


@dataclass(frozen=True)
class Interface:
    """An area of a component with a 6-dof frame at its centroid, axes parallel to the component's.

    Attributes:
        patches: One or several patches that together make up the area.
        coupling: ``rigid`` (RBE2) or ``average`` (RBE3); a rail always averages.
        flexible: Most deformation shapes that it keeps besides its rigid motions: with the coupling
            ``rigid`` it moves in them alone, with ``average`` they are its moments.
        auto: A stated accuracy chooses the number of shapes.
        open_kind: A stated accuracy may choose what is not written: shapes in place of six motions,
            or the form of shapes.
        allow_singular: Accept a point- or line-like patch although its compliance depends on the mesh.
        rail: Carriages slide along it; None for a fixed interface.
    """

    name: str
    patches: tuple[Patch, ...]
    coupling: CouplingKind = "rigid"
    allow_singular: bool = False
    rail: RailSettings | None = None
    flexible: int = 0
    auto: bool = False
    open_kind: bool = False


MESH_LENGTHS = ("size", "rim_size", "smallest", "leave_out", "details")  # of mesh settings


@dataclass(frozen=True)
class MeshSettings:
    """Settings of a component's mesh: target element size [m] (None: from the solid), order 1 or 2,
    cell shape.

    ``across_patches`` is the least number of elements across a patch that is imprinted on a face.
    ``allow_locking`` accepts elements of order 1 where they lock so much that they are refused otherwise.
    With a ``growth`` elements grow from the rims of such patches by that share of the distance;
    without one, evenly up to the next edge of the face. ``rim_size`` is their size at the rims of
    rigid interfaces [m], whole faces included, where stresses are singular. ``details`` is the width
    up to which holes, recesses and pads in plane faces of STEP parts are left out [m] (None: half
    the size; 0: none). ``sizes`` from place to place take the place of size and growth; their largest
    is the size.
    """

    size: float | None = None
    order: int = 2
    cells: CellShape = "tet"
    allow_locking: bool = False
    across_patches: int = 4
    growth: float | None = None
    rim_size: float | None = None
    smallest: float | None = None
    leave_out: float | None = None
    details: float | None = None
    sizes: SizeField | None = None

    def resize(self, size: float) -> str:
        """Return what a scene writes for these settings with another, smaller element size [m]:
        ``mesh = { size = "20 mm", across_patches = 2 }``; what would no longer fit is left out.
        """
        rim_size = self.rim_size if self.rim_size and self.rim_size < size else None
        changed = dataclasses.replace(
            self,
            size=size,
            sizes=None,
            rim_size=rim_size,
            growth=self.growth if rim_size == self.rim_size else None,
            smallest=self.smallest if self.smallest and self.smallest <= size else None,
        )
        entries = []
        for setting in dataclasses.fields(self):
            value = getattr(changed, setting.name)
            if setting.name == "size" or value != setting.default:
                if isinstance(value, bool):
                    value = str(value).lower()
                elif isinstance(value, str):
                    value = f'"{value}"'
                elif setting.name in MESH_LENGTHS:
                    value = f'"{1e3 * value:.6g} mm"'
                entries.append(f"{setting.name} = {value}")
        return f"mesh = {{ {', '.join(entries)} }}"


Eigensolver = Literal["block_lanczos", "krylov_schur"]
DEFAULT_EIGENSOLVER: Eigensolver = "block_lanczos"
# by the factors of the stiffness, or by iterations on a multigrid
SolverMethod = Literal["direct", "iterative"]
LinearSolver = Literal["auto", "direct", "iterative"]


@dataclass(frozen=True)
class ReductionSettings:
    """Fixed-interface modes that are kept: up to a frequency [Hz], a count, or with both whichever
    are fewer.

    With neither the planner decides. With ``verify`` a second factorisation counts the modes
    (Sturm), so that none can be missing. ``eigensolver`` is the method that finds them on the factors
    of the stiffness; ``solver`` says whether there are factors, ``auto`` where they fit.
    ``correct_mesh`` takes what the mesh is estimated to miss out of the reduced stiffness.
    """

    modes_to_hz: float | None = None
    modes: int | None = None
    verify: bool = False
    eigensolver: Eigensolver = DEFAULT_EIGENSOLVER
    solver: LinearSolver = "auto"
    correct_mesh: bool = False


@dataclass(frozen=True)
class SegmentSettings:
    """Into how many rigid segments a component is cut, and along which of its axes (None: the
    longest side).

    Attributes:
        bending: Factor on the bending stiffness of the section.
        torsion: Factor on its torsional stiffness.
    """

    count: int = 10
    along: Literal["x", "y", "z"] | None = None
    bending: float = 1.0
    torsion: float = 1.0


NORMAL = "normal"
SUPPORT_GROUP, EDGE_GROUP = "support:", "|edge"
# of a component: ``x``, ``y``, ``z``, a unit vector, or ``normal`` to the face at every point
FixedDirection = str | tuple[float, float, float]


@dataclass(frozen=True)
class Support:
    """Pointwise support of whole patches of one component, or of the edge where two meet.

    Attributes:
        directions: Fixed displacement directions in the component's axes.
        edge: With these, the support is the edge where the patches meet them; empty for an area.
    """

    name: str
    component: str
    patches: tuple[Patch, ...]
    directions: tuple[FixedDirection, ...]
    edge: tuple[Patch, ...] = ()

    @property
    def groups(self) -> dict[str, tuple[Patch, ...]]:
        """Its patches by the name of their group in a mesh."""
        area = f"{SUPPORT_GROUP}{self.name}"
        return {area: self.patches} | ({f"{area}{EDGE_GROUP}": self.edge} if self.edge else {})


def show_fixed(direction: FixedDirection) -> str:
    """Return a fixed direction as a scene has it."""
    if isinstance(direction, str):
        return direction
    return f"[{', '.join(f'{number:.4g}' for number in direction)}]"


@dataclass(frozen=True)
class Load:
    """A static load on one component, in the machine frame's axes.

    Attributes:
        kind: ``traction`` [Pa] (uniform over patches, ``vector``), ``pressure`` [Pa] (along the
            inward normal, ``magnitude``), ``body`` [m/s^2 acceleration field, ``vector``],
            ``force`` [N, N m] at an interface (``vector`` of 6).
        patches: Loaded area for traction and pressure.
        interface: Interface name for ``force``.
        magnitude: Pressure [Pa].
    """

    name: str
    component: str
    kind: Literal["traction", "pressure", "body", "force"]
    patches: tuple[Patch, ...] = ()
    interface: str | None = None
    vector: tuple[float, ...] = ()
    magnitude: float = 0.0


@dataclass(frozen=True, eq=False)
class Component:
    """One body of a machine.

    Attributes:
        solid: Its shape in its own frame.
        placement: Its own frame in the machine frame at zero axis positions.
        fidelity: ``rigid``, ``segmented``, ``polynomial`` or ``elastic``.
        reduction: Which fixed-interface modes to keep.
        segments: How a segmented component is cut.
        mass: Overrides the solid's mass [kg]: the density is scaled so that the mass comes out.
        free: Declared free-floating: a missing connection to ground is not an error.
        rayleigh: Viscous damping by its own mass and stiffness.
    """

    name: str
    solid: Solid
    material: Material
    placement: Frame = field(default_factory=Frame)
    interfaces: dict[str, Interface] = field(default_factory=dict)
    fidelity: Fidelity = "elastic"
    mesh: MeshSettings = field(default_factory=MeshSettings)
    reduction: ReductionSettings = field(default_factory=ReductionSettings)
    mass: float | None = None
    free: bool = False
    segments: SegmentSettings = field(default_factory=SegmentSettings)
    rayleigh: RayleighDamping = field(default_factory=RayleighDamping)


def with_loaded_areas(component: Component, loads: Iterable[Load]) -> Component:
    """Return a component with the area of each traction on it as a further interface,
    ``load:NAME``, so that its centroid and size are known without a mesh.
    """
    areas = {
        f"load:{load.name}": Interface(f"load:{load.name}", load.patches)
        for load in loads
        if load.component == component.name and load.kind == "traction"
    }
    return dataclasses.replace(component, interfaces=component.interfaces | areas)
