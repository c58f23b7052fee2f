"""Target files: the tables of what was measured in which variants and poses and which scene keys may be
fitted to it, and what is made of them, in SI units.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from headstock.reduction.coupling.slopes import ObservedDof
from headstock.scene.reading import units
from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.keys import NUMBER
from headstock.scene.reading.units import COMPLIANCE, DIMENSIONS, Dimension, Quantity
from headstock.scene.schema.types import (
    Between,
    Count,
    CountFromZero,
    Flag,
    Force,
    InUnits,
    JsonForm,
    Length,
    Name,
    Names,
    Number,
    OrForm,
    PositiveFrequency,
    PositiveNumber,
    QuantityOf,
    StrictTable,
    Text,
    problem,
    read_quantity,
)
from headstock.solvers.second_order import ComplexArray
from headstock.studies.identification.records import LineFit

MAX_STARTS = 4096
VECTOR_TOLERANCE = 0.1  # of the square root of 1 - MAC of a measured shape
Measured = Annotated[Quantity, QuantityOf((units.FREQUENCY, COMPLIANCE))]
Compliance = Annotated[float, InUnits((COMPLIANCE,))]
Letter = Literal["x", "y", "z", "-x", "-y", "-z"]
_ALONE = OrForm({"type": "string", "description": "scene key"})


def _read_any(value: object) -> Quantity:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Quantity(float(value), NUMBER)
    return read_quantity(value, *DIMENSIONS)


def _require_spread(found: Quantity) -> Quantity:
    if not found.value > 0.0:
        raise problem(f"is {found.value:g} but a standard deviation is above zero")
    return found


AnyQuantity = Annotated[
    Quantity,
    BeforeValidator(_read_any),
    JsonForm({"type": ["string", "number"], "pattern": units.quantity_pattern(*DIMENSIONS)}),
]
FrequencySpread = Annotated[
    Quantity, QuantityOf((units.RATIO, units.FREQUENCY)), AfterValidator(_require_spread)
]
ComplianceSpread = Annotated[
    Quantity, QuantityOf((units.RATIO, COMPLIANCE)), AfterValidator(_require_spread)
]
RatioSpread = Annotated[Quantity, QuantityOf((units.RATIO,)), AfterValidator(_require_spread)]


def _read_motion(value: object) -> complex | None:
    """Read a motion of a mode shape: a number, its real and imaginary part, or none."""
    if value == "-":
        return None
    parts = value if isinstance(value, list) and len(value) == 2 else [value]
    numbers = [float(part) for part in parts if isinstance(part, int | float)]
    if len(numbers) < len(parts) or not np.isfinite(numbers).all():
        raise problem(f'is {value!r}; write a number, [re, im], or "-" where nothing was measured')
    return complex(*numbers)


_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
_MeasuredMotion = Annotated[
    complex | None,
    BeforeValidator(_read_motion),
    JsonForm({"anyOf": [{"type": "number"}, {"const": "-"}, _NUMBERS]}),
]


class _BodyMoveTable(StrictTable):
    """Bodies that move alike in a mode: turn about an axis or shift along one, ``-`` for the other
    way round.
    """

    bodies: Names
    """components that move alike"""
    rotation: Letter | None = None
    """axis they turn about; `-` for the opposite sense of the first motion"""
    translation: Letter | None = None
    """axis they move along; `-` for the opposite sense of the first motion"""

    @property
    def dof(self) -> int:
        """Return the dof, 0 to 5."""
        letter = self.rotation or self.translation or ""
        return "xyz".index(letter[-1]) + (3 if self.rotation else 0)

    @property
    def sign(self) -> float:
        """Return 1, or -1 for the opposite sense."""
        return -1.0 if (self.rotation or self.translation or "").startswith("-") else 1.0

    def _faults(self) -> Iterator[str]:
        if (self.rotation is None) == (self.translation is None):
            yield 'needs either rotation = "y" or translation = "x"'


class ModeTargetTable(StrictTable):
    """One measured natural frequency, with the shape where it is known."""

    frequency: PositiveFrequency
    """measured natural frequency"""
    tolerance: FrequencySpread | None = None
    """its standard deviation"""
    damping: Annotated[Quantity | None, QuantityOf((units.RATIO,), "positive")] = None
    """measured damping ratio"""
    damping_tolerance: RatioSpread | None = None
    """relative standard deviation of the damping ratio"""
    weight: PositiveNumber = 1.0
    """multiplies the squared residuals"""
    name: Text = ""
    """in tables; a case that is `like` another one pairs modes of the same name"""
    moves: Annotated[list[_BodyMoveTable], Field(min_length=1, max_length=100)] | None = None
    """mode shape in words: which bodies move together, and how"""
    ignore: Names | None = None
    """bodies that the description says nothing about"""
    vectors: (
        Annotated[
            dict[Text, Annotated[list[_MeasuredMotion], Field(min_length=3, max_length=3)]],
            Field(min_length=1),
        ]
        | None
    ) = None
    """measured motion `[x, y, z]` of points, by name; `[re, im]` for a complex one, `"-"` for one that was not measured"""
    shape_tolerance: Annotated[PositiveNumber, Between(0.0, 10.0)] | None = None
    """standard deviation of the square root of 1 - MAC"""
    insist: Flag = False
    """fit the shape in words even where no mode is like it (MAC below 0.5)"""
    hold_out: Flag = False
    """compared, but not fitted"""

    @property
    def motions(self) -> dict[tuple[str, int], complex]:
        """Return what was measured of the shape, by sensor and dof."""
        return {
            (observer, dof): value
            for observer, vector in (self.vectors or {}).items()
            for dof, value in enumerate(vector)
            if value is not None
        }

    def _faults(self) -> Iterator[str]:
        if self.moves is not None and self.vectors is not None:
            yield "gives both moves and vectors; keep one description of the shape"
        if self.ignore is not None and self.moves is None:
            yield "`ignore` names bodies that moves says nothing about; it goes with moves"
        if self.insist and self.moves is None:
            yield "`insist` keeps a shape in words; it goes with moves"
        if self.damping_tolerance is not None and self.damping is None:
            yield "`damping_tolerance` goes with damping, which is not given"


class _ComplianceTargetTable(StrictTable):
    """A measured compliance: motion at a point in one direction per unit force in another, at the
    same point or elsewhere.
    """

    point: Text
    """where the motion was measured"""
    motion: Literal["x", "y", "z"]
    """direction of the motion"""
    force: Literal["x", "y", "z"]
    """direction of the force"""
    force_at: Text | None = None
    """where the force acts; default: the same point"""
    value: Compliance | None = None
    """motion per force"""
    record: (
        Annotated[list[tuple[Force, Length]], Field(min_length=3, max_length=10_000)] | Text | None
    ) = None
    """in place of `value`: measured forces and displacements, `["100 N", "15 um"]` each, in their order, or a CSV file of columns
    `force [N]` and `displacement [um]` in the folder of the target file; a line is fitted"""
    tolerance: ComplianceSpread | None = None
    """its standard deviation; of a record the standard error of its line"""
    weight: PositiveNumber = 1.0
    """multiplies the squared residual"""
    either_sign: Flag = False
    """only the magnitude was measured"""
    hold_out: Flag = False
    """compared, but not fitted"""

    def _faults(self) -> Iterator[str]:
        if (self.value is None) == (self.record is None):
            yield 'needs either value = "66 um/kN" or a record'
        if self.value == 0.0:
            yield "is zero; leave an entry that should vanish out, or give what was measured"


class ResponseTargetTable(StrictTable):
    """A measured frequency response: motion at a point in one direction per unit force in another."""

    point: Text | None = None
    """where the motion was measured"""
    motion: Literal["x", "y", "z"] | None = None
    """direction of the motion"""
    force: Literal["x", "y", "z"] | None = None
    """direction of the force"""
    force_at: Text | None = None
    """where the force acts; default: the same point"""
    lines: Annotated[
        list[tuple[PositiveFrequency, Compliance, Compliance]], Field(max_length=1000)
    ] = []
    """frequency, real and imaginary part of displacement over force"""
    file: Text | None = None
    """in place of these: a file of [test data](test_data.md) in the folder of the target file, all of whose responses count"""
    sensors: Text = ""
    """table of sensors with the names of its points; default: sensors have these names"""
    band: Annotated[list[PositiveFrequency], Field(min_length=2, max_length=2)] | None = None
    """lowest and highest frequency taken of the file"""
    count: Annotated[Count, Between(1, 1000)] = 40
    """most lines taken of each response of the file"""
    tolerance: RatioSpread | None = None
    """standard deviation of each line, relative to its size"""
    noise: Flag = False
    """in place of `tolerance`: lines of a file count by their noise (coherence, or scatter of neighbours); modes only lead the fit to them"""
    weight: PositiveNumber = 1.0
    """multiplies the squared residuals"""
    hold_out: Flag = False
    """compared, but not fitted"""

    def _faults(self) -> Iterator[str]:
        if self.noise and (self.file is None or self.tolerance is not None):
            yield "`noise` takes deviations from a file, in place of a tolerance; keep one of them"
        if any(line[1] == line[2] == 0.0 for line in self.lines):
            yield "has a line that is zero; leave it out"
        given = [self.point, self.motion, self.force, self.lines or None]
        if given.count(None) != (0 if self.file is None else len(given)):
            yield 'needs either point, motion, force and lines, or file = "test.uff"'


class _AtMostTable(StrictTable):
    """At most so many modes (above `modes_above`) below a frequency."""

    modes: CountFromZero
    """maximum number of modes"""
    below: PositiveFrequency
    """below this frequency"""
    tolerance: RatioSpread | None = None
    """relative standard deviation of the frequency"""


class CaseTable(StrictTable):
    """What was measured in one variant and pose."""

    scene: Text | None = None
    """scene file of another machine, beside the target file; default: the one that is fitted"""
    variant: Text | None = None
    """variant of the scene; default: as written"""
    pose: Text | None = None
    """pose of the scene; default: the first"""
    sensors: Annotated[dict[Name, dict[Text, Any]], Field(max_length=10_000)] = {}
    """sensors of the test, as in a scene: the variant gets them, and keeps its others"""
    like: Name | None = None
    """case of the machine before it was modified: modes of one name are paired by shape with its modes, not by frequency"""
    modes_above: PositiveFrequency | None = None
    """modes below this frequency are left out (a machine on its air springs)"""
    tolerance: RatioSpread | None = None
    """standard deviation of every target without its own"""
    frequencies: Annotated[list[PositiveFrequency], Field(min_length=1, max_length=1000)] | None = (
        None
    )
    """all measured natural frequencies in their range"""
    modes: Annotated[list[ModeTargetTable], Field(min_length=1, max_length=1000)] | None = None
    """measured natural frequencies with shapes"""
    compliances: (
        Annotated[list[_ComplianceTargetTable], Field(min_length=1, max_length=1000)] | None
    ) = None
    """measured compliances"""
    responses: Annotated[list[ResponseTargetTable], Field(min_length=1, max_length=1000)] | None = (
        None
    )
    """measured frequency responses"""
    numbers: Annotated[dict[Text, Measured], Field(min_length=1, max_length=1000)] | None = None
    """measured values of numbers by name: `frequency(mode=3)`, `compliance(point=tcp,direction=x)`"""
    at_most: _AtMostTable | None = None
    """a limit on the number of modes"""
    hold_out: Flag = False
    """compared, but not fitted"""

    @property
    def machine(self) -> "MachineKey":
        """Return which machine it was measured on."""
        return self.scene or "", self.variant

    def _faults(self) -> Iterator[str]:
        if not (
            self.frequencies or self.modes or self.compliances or self.responses or self.numbers
        ):
            yield 'holds no target; write frequencies = ["80 Hz"], modes = [{ ... }] or compliances = [{ ... }]'


def _read_rule(value: object) -> object:
    return {"key": value} if isinstance(value, str) else value


class SetRuleTable(StrictTable):
    """A scene key that takes the parameter's value, times `factor`, plus `offset`."""

    key: Text
    """dotted key of the scene; `*` stands for any text"""
    factor: Number = 1.0
    """times the value"""
    offset: AnyQuantity | None = None
    """added to it"""


class PowerRuleTable(StrictTable):
    """A scene key whose value is multiplied by the parameter over its reference, to a power."""

    key: Text
    """dotted key of the scene; `*` stands for any text"""
    power: Number = 1.0
    """exponent of the ratio"""


class ShiftRuleTable(StrictTable):
    """A scene key that moves by `factor` times the parameter's change from its reference."""

    key: Text
    """dotted key of the scene; `*` stands for any text"""
    factor: Number = 1.0
    """times the change"""


class ParameterTable(StrictTable):
    """A number that is fitted, and the scene keys that follow it."""

    keys: Annotated[
        list[Annotated[SetRuleTable, BeforeValidator(_read_rule), _ALONE]], Field(max_length=1000)
    ] = []
    """scene keys that take the value"""
    multiplies: Annotated[
        list[Annotated[PowerRuleTable, BeforeValidator(_read_rule), _ALONE]], Field(max_length=1000)
    ] = []
    """scene keys that are multiplied by the value over its reference"""
    shifts: Annotated[
        list[Annotated[ShiftRuleTable, BeforeValidator(_read_rule), _ALONE]], Field(max_length=1000)
    ] = []
    """scene keys to which the change from the reference is added"""
    bounds: Annotated[list[AnyQuantity], Field(min_length=2, max_length=2)]
    """lowest and highest value"""
    start: AnyQuantity | None = None
    """start value of the first descent; default: the value in the scene"""
    prior: AnyQuantity | None = None
    """mean of the prior distribution"""
    prior_sigma: AnyQuantity | None = None
    """standard deviation of the prior distribution"""
    scale: Literal["log", "linear"] = "log"
    """whether steps are relative or absolute"""

    def _faults(self) -> Iterator[str]:
        if not (self.keys or self.multiplies or self.shifts):
            yield 'moves nothing; write keys = ["joints.NAME.stiffness.normal"]'


class FitTable(StrictTable):
    """How the fit is done."""

    starts: Annotated[Count, Between(1, MAX_STARTS)] = 1
    """number of descents from different start values"""
    seed: CountFromZero = 1
    """of the random starts"""
    modes_above: PositiveFrequency | None = None
    """default for every case without its own"""
    pairing: Literal["best", "track"] = "best"
    """assign modes to targets again in every step, or keep the first assignment"""
    noise: Literal["stated", "residuals"] = "stated"
    """standard deviations as given, or estimated from the residuals"""
    method: Literal["trf", "dogbox"] = "trf"
    """method of `scipy.optimize.least_squares`"""
    evaluations: Count = 200
    """maximum number of evaluations per descent"""


class RivalTable(StrictTable):
    """Another model of the same machine, fitted to the same measurements."""

    set: Annotated[dict[Text, Any], Field(max_length=1000)] = {}
    """keys of the scene with other values: `"joints.foot.loss_factor" = 0.1`"""
    without: Names | None = None
    """parameters that this model does not have"""
    parameters: dict[Name, ParameterTable] = {}
    """parameters that it has in addition, or with other keys or bounds"""


class TargetsTable(StrictTable):
    """A target file."""

    name: Text | None = None
    """heading of the results; default: the file's name"""
    cases: Annotated[dict[Name, CaseTable], Field(min_length=1)]
    """measurements by name: one variant in one pose each"""
    parameters: Annotated[dict[Name, ParameterTable], Field(min_length=1)]
    """numbers of the scene that are fitted, by name"""
    rivals: Annotated[dict[Name, RivalTable], Field(max_length=20)] = {}
    """other models that are fitted too, and ranked by evidence"""
    fit: FitTable = FitTable()
    """settings of the fit"""


@dataclass(frozen=True)
class ShapeTarget:
    """A mode shape as motions at places, compared by MAC.

    Attributes:
        entries: ``(observer, dof, value)``; observers are points, interfaces
            (``component.interface``) or components. Complex values are compared with the damped mode.
        tolerance: Standard deviation of ``sqrt(1 - MAC)``.
        described: It comes from a description in words (which bodies turn), not from measured
            vectors.
        insist: It is fitted even where no mode is like it.
    """

    entries: tuple[tuple[str, int, complex], ...]
    tolerance: float
    described: bool
    insist: bool = False

    @cached_property
    def direction(self) -> ComplexArray:
        """Its values ``(k,)`` with length one."""
        values = np.array([value for _, _, value in self.entries], dtype=np.complex128)
        return np.asarray(values / np.linalg.norm(values))

    @property
    def is_complex(self) -> bool:
        """Its motions are not in phase."""
        return bool(np.any(self.direction.imag))


@dataclass(frozen=True)
class MeasuredDamping:
    """A measured damping ratio, and the standard deviation of its logarithm, weight counted."""

    ratio: float
    sigma: float


@dataclass(frozen=True)
class ModeTarget:
    """A measured natural frequency, with shape and damping where they are known.

    Attributes:
        frequency_hz: [Hz].
        sigma: Standard deviation of its logarithm, weight counted.
        hold_out: Predicted, not fitted.
        number: Of the mode that meets it, from 1 with those below the floor; None for any mode.
        label: What the file calls the mode; empty without a name.
    """

    name: str
    frequency_hz: float
    sigma: float
    shape: ShapeTarget | None = None
    hold_out: bool = False
    number: int | None = None
    label: str = ""
    damping: MeasuredDamping | None = None


@dataclass(frozen=True)
class ComplianceTarget:
    """A measured compliance.

    Attributes:
        motion: That is measured, along x, y or z.
        value: [m/N].
        sigma: Standard deviation relative to the value, weight counted.
        either_sign: Only its size was measured.
        hold_out: Predicted, not fitted.
        record: The line through a record of forces and displacements that it comes from.
    """

    name: str
    motion: ObservedDof
    force: ObservedDof
    value: float
    sigma: float
    either_sign: bool = False
    hold_out: bool = False
    record: LineFit | None = None

    @property
    def logarithmic(self) -> bool:
        """Its sign is certain, so that the ratio of model and measurement has a logarithm."""
        return self.motion == self.force or self.either_sign


@dataclass(frozen=True)
class ResponseTarget:
    """A measured frequency response.

    Attributes:
        motion: That is measured, along x, y or z.
        frequencies_hz: Lines ``(l,)`` [Hz], above zero.
        values: Displacement over force at each [m/N].
        sigma: Standard deviation relative to the size, weight counted; of the phase in radians. With
            deviations their root mean square over the largest size.
        deviations: Standard deviations of the real and of the imaginary part at each line by noise
            [m/N], weight counted; empty where lines are as good as their size.
        hold_out: Predicted, not fitted.
    """

    name: str
    motion: ObservedDof
    force: ObservedDof
    frequencies_hz: tuple[float, ...]
    values: tuple[complex, ...]
    sigma: float
    deviations: tuple[float, ...] = ()
    hold_out: bool = False


@dataclass(frozen=True)
class ModeLimit:
    """At most so many modes below a frequency [Hz]; sigma of the logarithm by which the next one
    may miss it.
    """

    modes: int
    below_hz: float
    sigma: float


# scene file, empty for the one that is fitted, and variant
type MachineKey = tuple[str, str | None]


@dataclass(frozen=True)
class TargetCase:
    """What was measured in one variant and pose.

    Attributes:
        variant: Of the scene; None for the scene as written.
        pose: Name of a pose of the scene; None for its first.
        floor_hz: Modes below are none of the targets (rigid-body modes, the machine on its mounts).
        like: Case whose modes of the same labels are followed by shape; None for none.
        scene: File of another machine; empty for the one that is fitted.
    """

    name: str
    variant: str | None
    pose: str | None
    floor_hz: float
    modes: tuple[ModeTarget, ...]
    compliances: tuple[ComplianceTarget, ...]
    responses: tuple[ResponseTarget, ...] = ()
    limit: ModeLimit | None = None
    like: str | None = None
    scene: str = ""

    def change_modes(self, names: Collection[str] | None = None, **changes: Any) -> "TargetCase":
        """Return the case with other fields of the modes of some names, or of all."""
        modes = (
            replace(target, **changes) if names is None or target.name in names else target
            for target in self.modes
        )
        return replace(self, modes=tuple(modes))

    @property
    def is_led(self) -> bool:
        """It has modes beside responses that count by their noise: they lead to these, which hold all
        that modes taken from them say.
        """
        noisy = any(target.deviations and not target.hold_out for target in self.responses)
        return noisy and not all(target.hold_out for target in self.modes)

    @property
    def ends(self) -> list[tuple[ObservedDof, ObservedDof]]:
        """Motion and force of compliances and responses."""
        return [
            *((target.motion, target.force) for target in self.compliances),
            *((target.motion, target.force) for target in self.responses),
        ]

    @property
    def is_damped(self) -> bool:
        """Its targets depend on damping."""
        return bool(self.responses) or any(mode.damping is not None for mode in self.modes)

    @property
    def records(self) -> list[tuple[ComplianceTarget, LineFit]]:
        """Compliances that are fitted and come from a record of forces and displacements, with its line."""
        return [(one, one.record) for one in self.compliances if one.record and not one.hold_out]

    @property
    def machine(self) -> MachineKey:
        """Return which machine it was measured on."""
        return self.scene, self.variant

    @property
    def most_modes(self) -> int:
        """Number of modes that its targets take at least, those below the floor among them."""
        return max(len(self.modes), *(target.number or 0 for target in self.modes), 0)

    @property
    def data(self) -> int:
        """Number of measured values that are fitted, shapes aside."""
        modes = [1 + (mode.damping is not None) for mode in self.modes if not mode.hold_out]
        lines = [2 * len(item.values) for item in self.responses if not item.hold_out]
        compliances = sum(not item.hold_out for item in self.compliances)
        return sum(modes) + sum(lines) + compliances

    @property
    def held_out(self) -> tuple[bool, ...]:
        """Of each target, modes first: whether it is predicted and not fitted."""
        return (
            *(target.hold_out for target in self.modes),
            *(target.hold_out for target in self.compliances),
            *(target.hold_out for target in self.responses),
        )


@dataclass(frozen=True)
class KeyRule:
    """How one scene key follows a parameter p with reference r.

    Attributes:
        kind: ``set``: factor p + offset; ``multiply``: times (p / r)^factor; ``shift``: plus factor
            (p - r).
    """

    key: KeyPath
    kind: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """A number that is fitted.

    Attributes:
        rules: Scene keys that follow it.
        lower: Smallest value, SI.
        upper: Largest value, SI.
        start: Where the first start begins, SI.
        reference: Value at which multiplied and shifted keys are as written, SI.
        prior: Expected value, SI; None without a prior.
        prior_sigma: Standard deviation of the prior in the fitted coordinate.
        logarithmic: The fitted coordinate is ln p, else p over the width of its bounds.
    """

    name: str
    rules: tuple[KeyRule, ...]
    lower: float
    upper: float
    start: float
    reference: float
    prior: float | None
    prior_sigma: float | None
    logarithmic: bool
    dimension: Dimension
    unit: str

    @property
    def width(self) -> float:
        """Return the distance of the bounds: one of the fitted coordinate where it is no logarithm."""
        return self.upper - self.lower

    def locate(self, value: float) -> float:
        """Return the fitted coordinate of a value."""
        return float(np.log(value)) if self.logarithmic else value / self.width

    def value(self, coordinate: float) -> float:
        """Return the value at a fitted coordinate."""
        return float(np.exp(coordinate) if self.logarithmic else coordinate * self.width)


@dataclass(frozen=True)
class IdentificationTask:
    """A checked target file."""

    name: str
    cases: tuple[TargetCase, ...]
    parameters: tuple[Parameter, ...]
    settings: FitTable
    rivals: tuple[str, ...] = ()
