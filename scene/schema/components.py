"""Schema of what a machine is built from: materials, solids, interfaces and components."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from headstock.scene.schema import types
from headstock.scene.schema.patches import PatchTable, Places, ShapedTable

LOCKING_POISSON_RATIO = 0.495


def find_poisson_fault(value: float) -> str:
    """Say why a number is no Poisson ratio; empty where it is one."""
    if not -1.0 < value < 0.5:
        return (
            f"is {value:g} but a Poisson ratio lies above -1 and below 0.5; write for example 0.3"
        )
    return ""


def _find_locking_fault(value: float) -> str:
    if value < LOCKING_POISSON_RATIO:
        return find_poisson_fault(value)
    return find_poisson_fault(value) or (
        f"is {value:g}: nearly incompressible, where displacement elements lock and come out far too stiff (volumetric "
        f"locking); write a value below {LOCKING_POISSON_RATIO}"
    )


class MaterialTable(types.StrictTable):
    """An isotropic, linear elastic material."""

    E: types.PositivePressure
    """Young's modulus"""
    nu: Annotated[
        types.Number,
        types.without_fault(_find_locking_fault),
        types.JsonForm(
            {"type": "number", "exclusiveMinimum": -1.0, "exclusiveMaximum": LOCKING_POISSON_RATIO}
        ),
    ]
    """Poisson's ratio; nearly incompressible materials lock"""
    rho: types.PositiveDensity
    """mass density"""
    loss_factor: types.LossFactor = 0.0
    """structural damping: the modulus is `E (1 + i loss_factor)`; used with the effect `damping`"""


class _TubeTable(types.StrictTable):
    """A hollow or full cylinder along z."""

    outer: types.PositiveLength
    """outer diameter"""
    inner: types.NotNegativeLength = 0.0
    """inner diameter, smaller than the outer; 0 for a full cylinder"""
    length: types.PositiveLength
    """length along z"""


class _PlateTable(types.StrictTable):
    """A plate in the x-y plane, with ribs on its upper side if wanted."""

    size: types.Size
    """sizes along x, y, and the thickness"""
    rib_height: types.NotNegativeLength = 0.0
    """height of the ribs above the plate"""
    rib: types.NotNegativeLength = 0.0
    """thickness of the ribs"""
    ribs_x: types.RibCount = 0
    """number of ribs along x"""
    ribs_y: types.RibCount = 0
    """number of ribs along y"""


class _ColumnTable(types.StrictTable):
    """A closed rectangular column with internal ribs."""

    size: types.Size
    """outer sizes along x, y, z"""
    wall: types.PositiveLength
    """thickness of the four walls"""
    cap: types.PositiveLength
    """thickness of bottom and top"""
    rib: types.NotNegativeLength = 0.0
    """thickness of the ribs inside"""
    ribs_z: types.RibCount = 0
    """number of ribs across z"""
    ribs_x: types.RibCount = 0
    """number of ribs across x"""
    ribs_y: types.RibCount = 0
    """number of ribs across y"""
    core_hole: types.NotNegativeLength = 0.0
    """diameter of a round hole through every rib across z"""


ROUNDING = 1e-9
SOLID_KINDS = ("box", "tube", "plate", "column", "step", "mesh", "superelement", "point_mass")


class SolidTable(types.StrictTable):
    """Exactly one of box, tube, plate, column, step, mesh, superelement, point_mass; `solid` goes
    with step and mesh, `unit` with mesh, `points` and `supported` with superelement, `inertia` with
    point_mass.
    """

    model_config = types.one_of(*SOLID_KINDS)

    box: types.Size | None = None
    """sizes along x, y, z"""
    tube: _TubeTable | None = None
    """hollow or full cylinder along z"""
    plate: _PlateTable | None = None
    """plate in the x-y plane, with or without ribs"""
    column: _ColumnTable | None = None
    """closed rectangular column with walls and ribs"""
    step: types.Text | None = None
    """STEP file; the unit is the file's own; `headstock show` numbers its faces"""
    mesh: types.Text | None = None
    """finished mesh: gmsh `.msh`, Abaqus `.inp`, Nastran `.bdf`, XDMF `.xdmf`, MED `.med`, Exodus `.exo`"""
    superelement: types.Text | None = None
    """reduced matrices: `.h5` as `headstock export` writes them, Nastran `.op4`, or `.bdf` with DMIG, Abaqus `NAME_STIF1.mtx`,
    Matrix Market `NAME_K.mtx`, CalculiX `.sti`; see [matrices of other programs](exchange.md)"""
    points: types.Text | None = None
    """bulk data with the GRID cards of the nodes of a superelement; default: its own file"""
    supported: types.Flag = False
    """accept a superelement that is supported, which rigid motions strain"""
    point_mass: types.PositiveMass | None = None
    """mass of a rigid body without a shape: its centre is its origin, its only face and interface is `center`"""
    inertia: Annotated[list[types.NotNegativeInertia], Field(min_length=3, max_length=3)] | None = (
        None
    )
    """moments of inertia of a point mass about its x, y and z axes, which are principal ones; default: none, rotations do not accelerate
    it"""
    solid: types.Count | types.Text | None = None
    """which solid of a STEP file, by number from 1 or by name; of a mesh file the set of its cells, by name, or `*` for all where it has
    several materials; default: the only one, required where there are several"""
    unit: types.PositiveLength | None = None
    """length of one unit of a mesh file; default: 1 m"""

    @property
    def kind(self) -> str:
        """Kind of the shape that was given."""
        return next(iter(self.given(SOLID_KINDS)))

    def _faults(self) -> Iterator[str]:
        given = self.given(SOLID_KINDS)
        if len(given) != 1:
            yield f"needs exactly one of {', '.join(SOLID_KINDS)}; found {' and '.join(given) or 'none'}"
        if self.solid is not None and self.step is None and self.mesh is None:
            yield (
                '`solid` chooses a solid of a file; write solid = { step = "part.step", solid = 1 }, or with mesh = the name '
                "of a set of its cells"
            )
        if self.unit is not None and self.mesh is None:
            yield '`unit` is the length unit of a mesh file; write solid = { mesh = "part.inp", unit = "1 mm" }'
        if (self.points is not None or self.supported) and self.superelement is None:
            yield '`points` and `supported` go with matrices of other programs; write solid = { superelement = "part.op4", points = "part.bdf" }'
        if self.inertia is not None:
            if self.point_mass is None:
                yield "`inertia` goes with point_mass; other solids bring their own"
            low, middle, high = sorted(self.inertia)
            if high > (low + middle) * (1.0 + ROUNDING):
                yield f"its largest moment of inertia, {high:g} kg m^2, is more than the sum of the others; no body has such"


class RailTable(types.StrictTable):
    """Makes an interface a rail: carriages hold on to it anywhere along an axis of the
    component.
    """

    along: Literal["x", "y", "z"]
    """axis of the component that the rail runs along"""
    control_points: Annotated[types.WholeNumber, types.Between(4, 1000)] | None = None
    """control points of the spline that describes its motion, 4 dofs each; default: 2.5 intervals per length of the shortest carriage"""


AUTO_SHAPES = 24


class _FlexibleTable(types.StrictTable):
    """An interface that keeps deformation shapes besides its rigid motions."""

    flexible: Annotated[types.WholeNumber, types.Between(3, 300)] | Literal["auto"]
    """most deformation shapes besides the six rigid motions; whole levels of polynomials over the patch, as many as fit; a rigid joint
    makes those of both sides one; `"auto"`: as many as the [accuracy](accuracy.md) needs, 24 without one; what they leave out is then a
    part of every ±"""
    form: Literal["strong", "weak"] = "strong"
    """`strong` for a part that ends on the face of another: the area moves in its shapes alone, frequencies converge from above; `weak` for
    a joint that covers the section of both parts: only the moments of the shapes are joined, frequencies converge from below; with `"auto"`
    an accuracy chooses it"""


class InterfaceTable(ShapedTable):
    """An area that joints hold on to: one patch written directly, or several in `patches`."""

    model_config = types.one_of("face", "patches")

    face: types.Text | None = None
    """`x- x+ y- y+ z- z+` (plane faces at that end), `face:N` (as `headstock show` numbers them), `outer`, `inner` (tubes), `set:NAME` (of
    a mesh file)"""
    patches: Annotated[list[PatchTable], Field(min_length=1, max_length=1000)] | None = None
    """several areas as one interface: `[{ face = "face:10" }, { face = "face:11" }]`"""
    places: Places | None = None
    """in place of the shape's `center`: one interface at each, named as joints with `places` are"""
    each: types.Exceptions = {}
    """what is different at single places, dotted keys and values"""
    coupling: Literal["rigid", "average"] | _FlexibleTable = "rigid"
    """`rigid`: the area moves as a rigid body (RBE2); `average`: the frame follows the area's mean motion (RBE3); `{ flexible = 24 }`: it
    also deforms, for large areas"""
    allow_singular: types.Flag = False
    """accept a point- or line-like area although its compliance depends on the mesh"""
    rail: RailTable | None = None
    """carriages act at any position along it, see [guideways](guideways.md)"""

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.rail is not None and self.flexible:
            yield "is a rail, which has a longer basis of its own; remove coupling, or write control_points"
        if (
            self.rail is not None
            and self.coupling == "rigid"
            and "coupling" in self.model_fields_set
        ):
            yield 'is a rail, and a rigid coupling would stiffen it over its whole length; remove coupling or write "average"'
        if self.patches is None and self.face is None:
            yield 'describes no patch; write face = "z+" or patches = [{ face = "z+" }]'
        if self.patches is not None and (self.face or self.shapes):
            yield "gives both a face and patches; move the face into the list of patches"

    @property
    def kind(self) -> Literal["rigid", "average"]:
        """Of two flexible forms the strong one fixes points as `rigid` does, the weak one means."""
        if isinstance(self.coupling, _FlexibleTable):
            return "rigid" if self.coupling.form == "strong" else "average"
        return self.coupling

    @property
    def flexible(self) -> int:
        """Most deformation shapes besides the rigid motions; where an accuracy chooses them, those
        without one.
        """
        if not isinstance(self.coupling, _FlexibleTable):
            return 0
        return AUTO_SHAPES if self.auto else int(self.coupling.flexible)

    @property
    def auto(self) -> bool:
        """A stated accuracy chooses the number of deformation shapes."""
        return isinstance(self.coupling, _FlexibleTable) and self.coupling.flexible == "auto"

    @property
    def open_kind(self) -> bool:
        """A stated accuracy may choose what is not written: shapes or none, or their form."""
        if isinstance(self.coupling, _FlexibleTable):
            return self.auto and "form" not in self.coupling.model_fields_set
        return "coupling" not in self.model_fields_set

    def patch_tables(self) -> tuple[PatchTable, ...]:
        """The patches, also when a single one was written directly."""
        if self.patches is not None:
            return tuple(self.patches)
        return (PatchTable.model_validate({"face": self.face or "", **self.shapes}),)


class RotationTable(types.StrictTable):
    """A rotation about an axis through the component's origin."""

    axis: types.Direction
    """axis of the rotation, through the origin of the component"""
    angle: types.Angle
    """angle, right-handed about the axis"""


class MeshTable(types.StrictTable):
    """How a component is meshed."""

    size: types.PositiveLength | None = None
    """target element size; default: from the solid's shape"""
    order: Literal[1, 2] = 2
    """polynomial order of the elements; order 1 locks in bending and is refused or warned of"""
    cells: Literal["tet", "hex"] = "tet"
    """shape of the elements; `hex` for boxes only"""
    across_patches: Annotated[types.WholeNumber, types.Between(1, 100)] = 4
    """minimum number of elements across a patch on a face; elements grow with the distance from it"""
    growth: Annotated[types.Number, types.Between(0.05, 2.0)] | None = None
    """tets only: growth of the element size per distance from a patch's rim, `0.3` for smooth, `0.6` for coarse grading; default: even
    growth up to the next edge of the face, which takes more elements"""
    rim_size: types.PositiveLength | None = None
    """element size at the rims of rigid interfaces, where stresses are singular; with `growth`, and smaller than `size`; default: as
    elsewhere on the face"""
    smallest: types.PositiveLength | None = None
    """minimum element size at curved faces and short edges; round holes keep seven edges; default: a twentieth of `size`"""
    leave_out: types.PositiveLength | None = None
    """STEP parts only: fillets, holes and pins with radii up to this are taken off before meshing"""
    details: types.NotNegativeLength | None = None
    """STEP parts only: holes, recesses and pads in plane faces up to this width are left out of the mesh; what they change is part of ±;
    `"0 mm"` keeps them all; default: half of `size`"""
    sizes: types.Text | None = None
    """element sizes from place to place, in place of `size`, `growth` and `rim_size`: a view of gmsh (`.pos`) of scalar tetrahedra in m,
    such as a search for an accuracy writes into its folder of results"""
    allow_locking: types.Flag = False
    """accept elements of order 1 where they lock (stretched elements, thin parts), in order to study locking"""


class _ReductionTable(types.StrictTable):
    """Which fixed-interface modes are kept: up to a frequency or a count."""

    model_config = types.not_both("modes_to", "modes")

    modes_to: types.PositiveFrequency | None = None
    """keep fixed-interface modes up to this frequency; default: as far as the analyses need them"""
    modes: types.CountFromZero | None = None
    """keep this number of fixed-interface modes, in place of `modes_to`; default: as many as the analyses need"""
    verify: types.Flag = False
    """count the modes below the highest one by a Sturm sequence check: none is missing"""
    eigensolver: Literal["block_lanczos", "krylov_schur"] = "block_lanczos"
    """solver for fixed-interface modes (both of SLEPc); block Lanczos is faster and misses no repeated mode"""
    solver: Literal["auto", "direct", "iterative"] = "auto"
    """`direct`: one factorisation; `iterative`: conjugate gradients and LOBPCG on a multigrid, slower in a fraction of the memory; `auto`:
    direct as far as the factors fit, see `plan`"""
    correct_mesh: types.Flag = False
    """take what the mesh is estimated to miss out of the reduced stiffness: ± is then a third, of either sign; `accuracy` does so"""

    def _faults(self) -> Iterator[str]:
        if self.verify and self.solver == "iterative":
            yield 'verify counts modes by factors, which solver = "iterative" has not; keep one'
        if self.modes_to is not None and self.modes is not None:
            yield "gives both modes_to and modes; keep one"


class _SegmentsTable(types.StrictTable):
    """Into how many segments a component is cut, and along which of its axes; by default
    along the longest side.
    """

    count: Annotated[types.WholeNumber, types.Between(1, 1000)] = 10
    """number of segments"""
    along: Literal["x", "y", "z"] | None = None
    """axis of the component along which it is cut; default: the longest side"""
    bending: types.PositiveNumber = 1.0
    """factor on the bending stiffness E I of the section"""
    torsion: types.PositiveNumber = 1.0
    """factor on the torsional stiffness G J of the section"""


def _wrap_rotation(value: object) -> object:
    return [value] if isinstance(value, dict) else value


Rotations = Annotated[
    list[RotationTable], BeforeValidator(_wrap_rotation), Field(max_length=20), types.OrForm()
]


class _RayleighTable(types.StrictTable):
    """Viscous damping by mass and stiffness: the damping ratio of a mode is `alpha / (2 omega) +
    beta omega / 2`.
    """

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    alpha: types.NotNegativeRate = 0.0
    """damping in proportion to mass: damping ratio `alpha / (2 omega)`"""
    beta: types.NotNegativeTime = 0.0
    """damping in proportion to stiffness: damping ratio `beta omega / 2`"""

    def _faults(self) -> Iterator[str]:
        if not self.model_fields_set:
            yield 'is empty; write rayleigh = { alpha = "2 1/s", beta = "1e-5 s" }, or one'


class ComponentTable(types.StrictTable):
    """One body of the machine."""

    solid: SolidTable
    """its shape, in its own frame: parametric solids stand on `z = 0`, centred in x and y"""
    material: types.Text | None = None
    """name of a material; not needed for superelements, which bring their mass"""
    mass: types.PositiveMass | None = None
    """total mass, to which the density is scaled; default: density times volume"""
    at: types.Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """position of its origin in the machine frame, all axes at zero"""
    places: list[types.Position] | dict[types.Name, types.Position] | None = None
    """in place of `at`: one component at each, named as joints with `places` are"""
    each: types.Exceptions = {}
    """what is different at single places, dotted keys and values"""
    rotate: Rotations = Field(default=[], validate_default=False)
    """rotations about its origin, one after the other"""
    fidelity: Literal["rigid", "segmented", "polynomial", "elastic"] = "elastic"
    """`rigid`: 6 dofs, no mesh; `segmented`: a row of rigid segments on beam springs; `polynomial`: a box, plain plate or tube without a
    mesh, its displacements polynomials; `elastic`: FE and Craig–Bampton"""
    mesh: MeshTable = Field(default_factory=MeshTable.model_construct)
    """mesh of an elastic component"""
    reduction: _ReductionTable = Field(default_factory=_ReductionTable.model_construct)
    """modes kept of an elastic component; without it the planner keeps them as far as the analyses need them"""
    segments: _SegmentsTable = Field(default_factory=_SegmentsTable.model_construct)
    """division of a segmented component"""
    interfaces: dict[types.Name, InterfaceTable] = {}
    """areas at which joints act"""
    rayleigh: _RayleighTable | None = None
    """viscous damping `alpha M + beta K` by its own mass and stiffness; used with the effect `damping`"""
    free: types.Flag = False
    """accept that this body is not connected to ground"""


class OrientationTable(types.StrictTable):
    """Set-up of the whole machine in the world; gravity does not turn with it."""

    at: types.Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """position of the machine's origin"""
    rotate: Rotations = Field(default=[], validate_default=False)
    """rotations of the machine, one after the other"""
