"""Schema of what a machine is built from: materials, solids, interfaces and components."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from headstock.scene.schema.types import (
    Angle,
    Between,
    Count,
    CountFromZero,
    Direction,
    Exceptions,
    Flag,
    JsonForm,
    Length,
    LossFactor,
    Name,
    NotNegativeInertia,
    NotNegativeLength,
    NotNegativeRate,
    NotNegativeTime,
    Number,
    OrForm,
    Position,
    PositiveDensity,
    PositiveFrequency,
    PositiveLength,
    PositiveMass,
    PositivePressure,
    RibCount,
    Size,
    StrictTable,
    Text,
    not_both,
    one_of,
    problem,
)

LOCKING_POISSON_RATIO = 0.495


def _check_poisson_ratio(value: float) -> float:
    if not -1.0 < value < 0.5:
        raise problem(
            f"is {value:g} but a Poisson ratio lies above -1 and below 0.5; write for example 0.3"
        )
    if value >= LOCKING_POISSON_RATIO:
        raise problem(
            f"is {value:g}: nearly incompressible, where displacement elements lock and come out far too stiff (volumetric "
            f"locking); write a value below {LOCKING_POISSON_RATIO}"
        )
    return value


class MaterialTable(StrictTable):
    """An isotropic, linear elastic material."""

    E: PositivePressure
    nu: Annotated[
        Number,
        AfterValidator(_check_poisson_ratio),
        JsonForm(
            {"type": "number", "exclusiveMinimum": -1.0, "exclusiveMaximum": LOCKING_POISSON_RATIO}
        ),
    ]
    rho: PositiveDensity
    loss_factor: LossFactor = 0.0


class TubeTable(StrictTable):
    """A hollow or full cylinder along z."""

    outer: PositiveLength
    inner: NotNegativeLength = 0.0
    length: PositiveLength

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.inner >= self.outer:
            raise problem(
                f"inner diameter {1e3 * self.inner:.6g} mm is not smaller than the outer diameter {1e3 * self.outer:.6g} mm"
            )
        return self


class PlateTable(StrictTable):
    """A plate in the x-y plane, with ribs on its upper side if wanted."""

    size: Size
    rib_height: NotNegativeLength = 0.0
    rib: NotNegativeLength = 0.0
    ribs_x: RibCount = 0
    ribs_y: RibCount = 0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.ribs_x or self.ribs_y) and not (self.rib > 0.0 and self.rib_height > 0.0):
            raise problem(
                'ribs need a height and a thickness; write rib_height = "40 mm" and rib = "10 mm"'
            )
        for count, space, axis in (
            (self.ribs_x, self.size[1], "y"),
            (self.ribs_y, self.size[0], "x"),
        ):
            if count * self.rib > space:
                raise problem(
                    f"{count} ribs of {1e3 * self.rib:.6g} mm do not fit into {1e3 * space:.6g} mm along {axis}; take fewer or thinner ribs"
                )
        return self


class ColumnTable(StrictTable):
    """A closed rectangular column with internal ribs."""

    size: Size
    wall: PositiveLength
    cap: PositiveLength
    rib: NotNegativeLength = 0.0
    ribs_z: RibCount = 0
    ribs_x: RibCount = 0
    ribs_y: RibCount = 0
    core_hole: NotNegativeLength = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.ribs_x or self.ribs_y or self.ribs_z) and not self.rib > 0.0:
            raise problem('ribs need a thickness; write rib = "10 mm"')
        rows = ((self.wall, self.ribs_x), (self.wall, self.ribs_y), (self.cap, self.ribs_z))
        for (sheet, ribs), size, axis in zip(rows, self.size, "xyz", strict=True):
            name = "cap" if axis == "z" else "wall"
            if 2.0 * sheet >= size:
                raise problem(
                    f"two {name}s of {1e3 * sheet:.6g} mm are thicker than the column: {1e3 * size:.6g} mm along {axis}; take thinner ones"
                )
            if ribs * self.rib >= size - 2.0 * sheet:
                raise problem(
                    f"{ribs} ribs of {1e3 * self.rib:.6g} mm fill the {1e3 * (size - 2.0 * sheet):.6g} mm between the {name}s along {axis}"
                )
        if self.core_hole >= min(self.size[0], self.size[1]) - 2.0 * self.wall:
            raise problem(
                f"core_hole of {1e3 * self.core_hole:.6g} mm reaches the walls; take a smaller one"
            )
        return self


ROUNDING = 1e-9
SOLID_KINDS = ("box", "tube", "plate", "column", "step", "mesh", "superelement", "point_mass")


class SolidTable(StrictTable):
    """Exactly one of box, tube, plate, column, step, mesh, superelement, point_mass; `solid` goes
    with step and mesh, `unit` with mesh, `inertia` with point_mass.
    """

    model_config = one_of(*SOLID_KINDS)

    box: Size | None = None
    tube: TubeTable | None = None
    plate: PlateTable | None = None
    column: ColumnTable | None = None
    step: Text | None = None
    mesh: Text | None = None
    superelement: Text | None = None
    point_mass: PositiveMass | None = None
    inertia: Annotated[list[NotNegativeInertia], Field(min_length=3, max_length=3)] | None = None
    solid: Count | Text | None = None
    unit: PositiveLength | None = None

    @property
    def kind(self) -> str:
        """Which of the shapes was given."""
        return next(kind for kind in SOLID_KINDS if getattr(self, kind) is not None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = [kind for kind in SOLID_KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none"
            raise problem(f"needs exactly one of {', '.join(SOLID_KINDS)}; found {found}")
        if self.solid is not None and self.step is None and self.mesh is None:
            raise problem(
                '`solid` chooses a solid of a file; write solid = { step = "part.step", solid = 1 }, or with mesh = the name '
                "of a set of its cells"
            )
        if self.unit is not None and self.mesh is None:
            raise problem(
                '`unit` is the length unit of a mesh file; write solid = { mesh = "part.inp", unit = "1 mm" }'
            )
        if self.inertia is not None:
            if self.point_mass is None:
                raise problem("`inertia` goes with point_mass; other solids bring their own")
            low, middle, high = sorted(self.inertia)
            if high > (low + middle) * (1.0 + ROUNDING):
                raise problem(
                    f"its largest moment of inertia, {high:g} kg m^2, is more than the sum of the others; no body has such"
                )
        return self


InPlane = Annotated[list[Length], Field(min_length=2, max_length=3)]


class DiskTable(StrictTable):
    """A round patch; `center` in component coordinates: the two in-plane ones in the order x y z,
    or all three.
    """

    diameter: PositiveLength
    center: InPlane | None = None


class RectTable(StrictTable):
    """A rectangular patch; `size` along the two in-plane axes in the order x y z."""

    size: Annotated[list[PositiveLength], Field(min_length=2, max_length=2)]
    center: InPlane | None = None


class StripTable(StrictTable):
    """A patch that crosses the whole face along one in-plane axis."""

    width: PositiveLength
    along: Literal["x", "y", "z"]
    center: InPlane | None = None


Places = list[InPlane] | dict[Name, InPlane]


class PatchTable(StrictTable):
    """A face, or a disk, rect or strip on it."""

    face: Text
    disk: DiskTable | None = None
    rect: RectTable | None = None
    strip: StripTable | None = None
    places: Places | None = None
    each: Exceptions = {}

    @model_validator(mode="after")
    def _check(self) -> Self:
        _refuse_two_shapes(self.disk, self.rect, self.strip)
        return self


class RailTable(StrictTable):
    """Makes an interface a rail: carriages hold on to it anywhere along an axis of the
    component.
    """

    along: Literal["x", "y", "z"]
    control_points: Annotated[Count, Between(4, 1000)] | None = None


AUTO_SHAPES = 24


class FlexibleTable(StrictTable):
    """An interface that keeps deformation shapes besides its rigid motions."""

    flexible: Annotated[Count, Between(3, 300)] | Literal["auto"]
    form: Literal["strong", "weak"] = "strong"


class InterfaceTable(StrictTable):
    """An area that joints hold on to: one patch written directly, or several in `patches`."""

    model_config = one_of("face", "patches")

    face: Text | None = None
    disk: DiskTable | None = None
    rect: RectTable | None = None
    strip: StripTable | None = None
    patches: Annotated[list[PatchTable], Field(min_length=1, max_length=1000)] | None = None
    places: Places | None = None
    each: Exceptions = {}
    coupling: Literal["rigid", "average"] | FlexibleTable = "rigid"
    allow_singular: Flag = False
    rail: RailTable | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        _refuse_two_shapes(self.disk, self.rect, self.strip)
        if self.rail is not None and self.flexible:
            raise problem(
                "is a rail, which has a longer basis of its own; remove coupling, or write control_points"
            )
        if (
            self.rail is not None
            and self.coupling == "rigid"
            and "coupling" in self.model_fields_set
        ):
            raise problem(
                'is a rail, and a rigid coupling would stiffen it over its whole length; remove coupling or write "average"'
            )
        if self.patches is None and self.face is None:
            raise problem('describes no patch; write face = "z+" or patches = [{ face = "z+" }]')
        if self.patches is not None and (self.face or self.disk or self.rect or self.strip):
            raise problem("gives both a face and patches; move the face into the list of patches")
        return self

    @property
    def kind(self) -> Literal["rigid", "average"]:
        """Of two flexible forms the strong one fixes points as `rigid` does, the weak one means."""
        if isinstance(self.coupling, FlexibleTable):
            return "rigid" if self.coupling.form == "strong" else "average"
        return self.coupling

    @property
    def flexible(self) -> int:
        """Most deformation shapes besides the rigid motions; where an accuracy chooses them, those
        without one.
        """
        if not isinstance(self.coupling, FlexibleTable):
            return 0
        return AUTO_SHAPES if self.auto else int(self.coupling.flexible)

    @property
    def auto(self) -> bool:
        """A stated accuracy chooses the number of deformation shapes."""
        return isinstance(self.coupling, FlexibleTable) and self.coupling.flexible == "auto"

    @property
    def open_kind(self) -> bool:
        """A stated accuracy may choose what is not written: shapes or none, or their form."""
        if isinstance(self.coupling, FlexibleTable):
            return self.auto and "form" not in self.coupling.model_fields_set
        return "coupling" not in self.model_fields_set

    def patch_tables(self) -> tuple[PatchTable, ...]:
        """The patches, also when a single one was written directly."""
        if self.patches is not None:
            return tuple(self.patches)
        return (PatchTable(face=self.face or "", disk=self.disk, rect=self.rect, strip=self.strip),)


def _refuse_two_shapes(*shapes: object) -> None:
    if sum(shape is not None for shape in shapes) > 1:
        raise problem(
            "a patch is one of disk, rect, strip; write several patches as patches = [{...}, {...}]"
        )


class RotationTable(StrictTable):
    """A rotation about an axis through the component's origin."""

    axis: Direction
    angle: Angle


class MeshTable(StrictTable):
    """How a component is meshed."""

    size: PositiveLength | None = None
    order: Literal[1, 2] = 2
    cells: Literal["tet", "hex"] = "tet"
    across_patches: Annotated[Count, Between(1, 100)] = 4
    growth: Annotated[Number, Between(0.05, 2.0)] | None = None
    rim_size: PositiveLength | None = None
    smallest: PositiveLength | None = None
    leave_out: PositiveLength | None = None
    details: NotNegativeLength | None = None
    sizes: Text | None = None
    allow_locking: Flag = False


class ReductionTable(StrictTable):
    """Which fixed-interface modes are kept: up to a frequency or a count."""

    model_config = not_both("modes_to", "modes")

    modes_to: PositiveFrequency | None = None
    modes: CountFromZero | None = None
    verify: Flag = False
    eigensolver: Literal["block_lanczos", "krylov_schur"] = "block_lanczos"
    solver: Literal["auto", "direct", "iterative"] = "auto"
    correct_mesh: Flag = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.verify and self.solver == "iterative":
            raise problem(
                'verify counts modes by factors, which solver = "iterative" has not; keep one'
            )
        if self.modes_to is not None and self.modes is not None:
            raise problem("gives both modes_to and modes; keep one")
        return self


class SegmentsTable(StrictTable):
    """Into how many segments a component is cut, and along which of its axes; by default
    along the longest side.
    """

    count: Annotated[Count, Between(1, 1000)] = 10
    along: Literal["x", "y", "z"] | None = None


def _wrap_rotation(value: object) -> object:
    return [value] if isinstance(value, dict) else value


Rotations = Annotated[
    list[RotationTable], BeforeValidator(_wrap_rotation), Field(max_length=20), OrForm()
]


class RayleighTable(StrictTable):
    """Viscous damping by mass and stiffness: the damping ratio of a mode is `alpha / (2 omega) +
    beta omega / 2`.
    """

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    alpha: NotNegativeRate = 0.0
    beta: NotNegativeTime = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.model_fields_set:
            raise problem('is empty; write rayleigh = { alpha = "2 1/s", beta = "1e-5 s" }, or one')
        return self


class ComponentTable(StrictTable):
    """One body of the machine."""

    solid: SolidTable
    material: Text | None = None
    mass: PositiveMass | None = None
    at: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    places: list[Position] | dict[Name, Position] | None = None
    each: Exceptions = {}
    rotate: Rotations = Field(default=[], validate_default=False)
    fidelity: Literal["rigid", "segmented", "polynomial", "elastic"] = "elastic"
    mesh: MeshTable = MeshTable()
    reduction: ReductionTable = ReductionTable()
    segments: SegmentsTable = SegmentsTable()
    interfaces: dict[Name, InterfaceTable] = {}
    rayleigh: RayleighTable | None = None
    free: Flag = False


class OrientationTable(StrictTable):
    """Set-up of the whole machine in the world; gravity does not turn with it."""

    at: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    rotate: Rotations = Field(default=[], validate_default=False)
