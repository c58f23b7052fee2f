"""Field types of the scene schema: quantities with units, plain numbers, names, directions and
references.
"""

import ast
import copy
import dataclasses
import functools
import inspect
import itertools
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, Self, cast

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StrictBool,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import (
    no_info_after_validator_function,
    no_info_before_validator_function,
)

from headstock.geometry.frames import DOF_NAMES, find_axis
from headstock.geometry.machine.joints import GROUND, JointEnd
from headstock.scene.reading import units
from headstock.scene.reading.units import (
    Dimension,
    Quantity,
    Sign,
    UnitError,
    parse_quantity,
    quantity_pattern,
    quote_value,
)
from headstock.solvers.control.drive_trains import DRIVE_CHANNELS

MEANING = "meaning"  # keyword of the schema that pydantic makes of a table
DEFAULT = "; default: "
MAX_COUNT = 10_000_000
MAX_RIBS = 200
MAX_POSES = 1000
THREE_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
AXIS_DIRECTIONS = tuple(f"{sign}{letter}" for sign in ("", "+", "-") for letter in "xyz")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,63}")
_DIRECTION = re.compile(r"([+-]?)([xyz])")


class PlainNames(GenerateJsonSchema):
    """Names of rules as users see them: without the mark of what is private in a module."""

    def normalize_name(self, name: str) -> str:
        """Return the name of a rule, without underscores before it."""
        return super().normalize_name(name.lstrip("_"))


class StrictTable(BaseModel):
    """A table of the scene: unknown keys are errors, values cannot be changed afterwards.

    The text below a field says what its key means, for the scene reference and for editors; what
    follows ``DEFAULT`` in it holds where the key is left out.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True
    )

    def _faults(self) -> Iterator[str]:
        """Yield what is wrong with keys of which each is right by itself, and what to write; the
        first one is reported.
        """
        yield from ()

    @model_validator(mode="after")
    def _refuse_faults(self) -> Self:
        if fault := next(self._faults(), None):
            raise problem(fault)
        return self

    def given(self, keys: Iterable[str]) -> dict[str, Any]:
        """Values of those of some keys that are given."""
        return {key: value for key in keys if (value := getattr(self, key)) is not None}

    def fill[Built](self, kind: type[Built], **others: object) -> Built:
        """Build a dataclass whose fields have the values of the keys of their names, lists as tuples.

        Args:
            others: Its other fields, and those with another value.
        """
        names = {field.name for field in dataclasses.fields(cast(type[Any], kind))}
        values = self.given((names & type(self).model_fields.keys()) - others.keys())
        tuples = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
        build = cast(Callable[..., Built], kind)
        return build(**values | tuples, **others)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the description with the meaning of each key."""
        reference = handler(core)
        rules = handler.resolve_ref_schema(reference)["properties"]
        for base in cls.__mro__[::-1]:
            for name, text in _read_meanings(base).items() if issubclass(base, StrictTable) else ():
                rules[cls.model_fields[name].alias or name][MEANING] = text
        return reference


def table_name(table: type[BaseModel]) -> str:
    """Return what a table of the schema is called: ``Tube`` of ``_TubeTable``."""
    return table.__name__.removeprefix("_").removesuffix("Table")


@functools.cache
def _read_meanings(table: type[StrictTable]) -> dict[str, str]:
    """Return the texts below the fields that a table itself declares, by field."""
    if "__firstlineno__" not in table.__dict__:
        return {}  # made of other tables, without source
    tree = ast.parse(textwrap.dedent(inspect.getsource(table))).body[0]
    statements = tree.body if isinstance(tree, ast.ClassDef) else []
    return {
        field.target.id: " ".join(below.value.value.split())
        for field, below in itertools.pairwise(statements)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


def one_of(*keys: str) -> ConfigDict:
    """Table of which exactly one of some keys is given; the table checks it too, in words of its
    own.
    """
    return ConfigDict(json_schema_extra={"oneOf": [{"required": [key]} for key in keys]})


def not_both(*keys: str) -> ConfigDict:
    """Table of which some keys do not stand beside each other; the table checks it too, in words of
    its own.
    """
    return ConfigDict(json_schema_extra={"not": {"required": list(keys)}})


def problem(message: str) -> PydanticCustomError:
    """A validation error that carries a finished message."""
    return PydanticCustomError("scene", "{message}", {"message": message})


def without_fault(find_fault: Callable[[Any], str]) -> AfterValidator:
    """A validator of what a function says what is wrong with; nothing where the text is empty."""

    def check(value: object) -> object:
        if fault := find_fault(value):
            raise problem(fault)
        return value

    return AfterValidator(check)


def read_quantity(value: object, *dimensions: Dimension) -> Quantity:
    """Return a quantity of one of some dimensions."""
    if isinstance(value, Quantity):
        return value
    try:
        return parse_quantity(value, *dimensions)
    except UnitError as error:
        raise problem(str(error)) from error


type Form = dict[str, Any]


@dataclass(frozen=True)
class JsonForm:
    """How a value stands in the JSON schema where pydantic's own description would refuse what is
    accepted; a fresh one at each place.
    """

    form: Form

    def __get_pydantic_json_schema__(
        self, _core: CoreSchema, _handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The description itself."""
        return copy.deepcopy(self.form)


@dataclass(frozen=True)
class OrForm:
    """A value may also be written in another form, as the JSON schema says; ``None`` stands for one
    item of a list, without brackets.
    """

    form: Form | None = None

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Either form."""
        usual = handler(core)
        other = usual["items"] if self.form is None else copy.deepcopy(self.form)
        return {"anyOf": [usual, other]}


@dataclass(frozen=True)
class Between:
    """Lowest and highest value of a number, both allowed, which the JSON schema says too."""

    low: float
    high: float

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The number, then its limits."""
        return no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The number with its limits."""
        return handler(core) | {"minimum": self.low, "maximum": self.high}

    def _check(self, value: float) -> float:
        if not self.low <= value <= self.high:
            shown = (
                quote_value(number) if isinstance(number, int) else f"{number:g}"
                for number in (value, self.low, self.high)
            )
            raise problem("is {} but must lie between {} and {}".format(*shown))
        return value


SIGN_WORDS: dict[Sign, str] = {"any": "", "positive": " above zero", "not negative": " from zero"}


def describe_quantity(*dimensions: Dimension, sign: Sign = "any") -> JsonForm:
    """Describe such a quantity for the JSON schema."""
    names = " or ".join(dimension.name for dimension in dimensions) + SIGN_WORDS[sign]
    return JsonForm(
        {
            "type": "string",
            "description": f"{names} with a unit",
            "examples": [dimension.example for dimension in dimensions],
            "pattern": quantity_pattern(*dimensions, sign=sign),
        }
    )


LEAST = 1e-30  # what is smaller is a slip of units, and its powers would vanish [SI]


def _check_sign(value: float, sign: Sign) -> float:
    if sign == "positive" and not value >= LEAST:
        raise problem(f"is {value:g} in SI units but must be above zero ({LEAST:g} at least)")
    if sign == "not negative" and not value >= 0.0:
        raise problem(f"is {value:g} in SI units but must not be negative")
    return value


@dataclass(frozen=True)
class QuantityOf(JsonForm):
    """A text with a unit becomes a quantity of one of some dimensions."""

    form: Form = field(init=False)
    dimensions: tuple[Dimension, ...]
    sign: Sign = "any"

    def __post_init__(self) -> None:
        form = describe_quantity(*self.dimensions, sign=self.sign).form
        object.__setattr__(self, "form", form)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """The quantity read, and its sign."""
        return no_info_before_validator_function(self._read, handler(source))

    def _read(self, value: object) -> Quantity | float:
        quantity = read_quantity(value, *self.dimensions)
        _check_sign(quantity.value, self.sign)
        return quantity


@dataclass(frozen=True)
class InUnits(QuantityOf):
    """A text with a unit of a dimension becomes a number in SI units."""

    def _read(self, value: object) -> Quantity | float:
        quantity = super()._read(value)
        return quantity.value if isinstance(quantity, Quantity) else quantity


Length = Annotated[float, InUnits((units.LENGTH,))]
PositiveLength = Annotated[float, InUnits((units.LENGTH,), "positive")]
NotNegativeLength = Annotated[float, InUnits((units.LENGTH,), "not negative")]
Angle = Annotated[float, InUnits((units.ANGLE,))]
Pressure = Annotated[float, InUnits((units.PRESSURE,))]
PositivePressure = Annotated[float, InUnits((units.PRESSURE,), "positive")]
PositiveDensity = Annotated[float, InUnits((units.DENSITY,), "positive")]
PositiveMass = Annotated[float, InUnits((units.MASS,), "positive")]
PositiveFrequency = Annotated[float, InUnits((units.FREQUENCY,), "positive")]
Frequency = Annotated[float, InUnits((units.FREQUENCY,), "not negative")]
PositiveTime = Annotated[float, InUnits((units.TIME,), "positive")]
NotNegativeTime = Annotated[float, InUnits((units.TIME,), "not negative")]
PositiveMemory = Annotated[float, InUnits((units.MEMORY,), "positive")]
PositiveForce = Annotated[float, InUnits((units.FORCE,), "positive")]
PositiveStiffness = Annotated[float, InUnits((units.STIFFNESS,), "positive")]
PositiveStiffnessPerArea = Annotated[float, InUnits((units.STIFFNESS_PER_AREA,), "positive")]
PositiveRotationalStiffness = Annotated[float, InUnits((units.ROTATIONAL_STIFFNESS,), "positive")]
Force = Annotated[float, InUnits((units.FORCE,))]
Speed = Annotated[float, InUnits((units.SPEED,))]
PositiveSpeed = Annotated[float, InUnits((units.SPEED,), "positive")]
PositiveAngularSpeed = Annotated[float, InUnits((units.ANGULAR_SPEED,), "positive")]
Moment = Annotated[float, InUnits((units.MOMENT,))]
PositiveMoment = Annotated[float, InUnits((units.MOMENT,), "positive")]
Acceleration = Annotated[float, InUnits((units.ACCELERATION,))]
PositiveInertia = Annotated[float, InUnits((units.INERTIA,), "positive")]
NotNegativeInertia = Annotated[float, InUnits((units.INERTIA,), "not negative")]
NotNegativeDamping = Annotated[float, InUnits((units.DAMPING,), "not negative")]
PositiveRate = Annotated[float, InUnits((units.RATE,), "positive")]
NotNegativeRate = Annotated[float, InUnits((units.RATE,), "not negative")]
NotNegativeForce = Annotated[float, InUnits((units.FORCE,), "not negative")]
SpecificForce = Annotated[float, InUnits((units.SPECIFIC_FORCE,))]
PositiveSpecificForce = Annotated[float, InUnits((units.SPECIFIC_FORCE,), "positive")]
EdgeForce = Annotated[float, InUnits((units.EDGE_FORCE,))]
NotNegativeEdgeForce = Annotated[float, InUnits((units.EDGE_FORCE,), "not negative")]
TimedLoadSize = Annotated[
    Quantity,
    QuantityOf((units.FORCE, units.MOMENT, units.IMPULSE, units.ANGULAR_IMPULSE)),
]
PathFeed = Annotated[Quantity, QuantityOf((units.SPEED, units.ANGULAR_SPEED), "positive")]
AxisPosition = Annotated[Quantity, QuantityOf((units.LENGTH, units.ANGLE))]
PositiveAxisPosition = Annotated[Quantity, QuantityOf((units.LENGTH, units.ANGLE), "positive")]
VelocityGain = Annotated[
    Quantity, QuantityOf((units.DAMPING, units.ROTATIONAL_DAMPING), "positive")
]
FrictionSlope = Annotated[Quantity, QuantityOf((units.DAMPING,), "not negative")]
JointDamping = Annotated[Quantity, QuantityOf((units.DAMPING, units.ROTATIONAL_DAMPING))]


@dataclass(frozen=True)
class _StiffnessOf(QuantityOf):
    """The same, or ``rigid``."""

    def _read(self, value: object) -> Any:
        return value if value == "rigid" and isinstance(value, str) else super()._read(value)


JointStiffness = Annotated[
    Quantity | str,
    _StiffnessOf((units.STIFFNESS, units.ROTATIONAL_STIFFNESS)),
    OrForm({"const": "rigid"}),
]


def _read_number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem(
            f"{quote_value(value)} is not a plain number; write one without quotes and unit, such as 0.3"
        )
    if (isinstance(value, int) and abs(value) > 10**300) or not math.isfinite(value):
        raise problem(f"{quote_value(value)} is not finite; write an ordinary number")
    return float(value)


def _read_whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise problem(
            f"{quote_value(value)} is not a whole number; write one without quotes, such as 1"
        )
    return value


Number = Annotated[float, BeforeValidator(_read_number), JsonForm({"type": "number"})]
PositiveNumber = Annotated[
    Number,
    AfterValidator(lambda value: _check_sign(value, "positive")),
    JsonForm({"type": "number", "exclusiveMinimum": 0.0}),
]
WholeNumber = Annotated[int, BeforeValidator(_read_whole), JsonForm({"type": "integer"})]
Count = Annotated[WholeNumber, Between(1, MAX_COUNT), JsonForm({"type": "integer", "minimum": 1})]
CountFromZero = Annotated[
    WholeNumber, Between(0, MAX_COUNT), JsonForm({"type": "integer", "minimum": 0})
]
RibCount = Annotated[WholeNumber, Between(0, MAX_RIBS)]
Flag = StrictBool


# a number, or a text with a number and perhaps a per cent sign
RATIO_FORM: Form = {"type": ["number", "string"], "pattern": quantity_pattern(units.RATIO)}


def _read_ratio(value: object) -> float:
    if not isinstance(value, str):
        return _read_number(value)
    return read_quantity(value, units.RATIO).value


Ratio = Annotated[float, BeforeValidator(_read_ratio)]


def describe_ratio(
    description: str, examples: tuple[str | float, ...], **limits: float
) -> JsonForm:
    """Describe a ratio between limits for the JSON schema."""
    return JsonForm({"description": description, "examples": [*examples], **RATIO_FORM, **limits})


def find_share_fault(share: float, what: str) -> str:
    """Say why a number is no share; empty where it is one."""
    if 0.0 <= share <= 1.0:
        return ""
    article = "an" if what[0] in "aeiou" else "a"
    return f'is {share:g}; {article} {what} lies between 0 and 1; write for example 0.02 or "2 %"'


def find_damping_fault(share: float, what: str) -> str:
    """Say why a number is no share of damping; empty where it is one.

    Args:
        share: Damping ratio or loss factor [-].
    """
    if 0.0 <= share < 1.0:
        return ""
    meant = f'"{share:g} %"' if 1.0 <= share < 100.0 else '0.02 or "2 %"'
    return (
        f"is {share:g} ({100.0 * share:g} %); a {what} lies between 0 and 1 (100 %); write {meant}"
    )


_DAMPING = describe_ratio("ratio from 0, below 1", (0.02, "2 %"), minimum=0.0, exclusiveMaximum=1.0)
DampingShare = Annotated[
    Ratio, without_fault(lambda share: find_damping_fault(share, "damping ratio")), _DAMPING
]
LossFactor = Annotated[
    Ratio, without_fault(lambda share: find_damping_fault(share, "loss factor")), _DAMPING
]
NotNegativeShare = Annotated[
    Ratio,
    without_fault(lambda share: find_share_fault(share, "share")),
    describe_ratio("ratio from 0 to 1", (0.02, "2 %"), minimum=0.0, maximum=1.0),
]


def _read_channel(value: object) -> tuple[str, str]:
    if isinstance(value, str) and value:
        return value, ""
    if (
        not isinstance(value, list)
        or len(value) != 2
        or not all(isinstance(part, str) for part in value)
    ):
        raise problem(
            f'{quote_value(value)} names no point and direction; write ["tcp", "x"], or "tcp" for x, y and z'
        )
    if value[1] not in (*DOF_NAMES, *DRIVE_CHANNELS):
        raise problem(
            f"{quote_value(value[1])} is no direction; write one of {', '.join(DOF_NAMES)}"
        )
    return value[0], value[1]


class RequestTable(StrictTable):
    """An analysis, which can be kept for when it is requested."""

    highest: ClassVar[str] = ""  # key of the highest frequency that is wanted
    loads_probes: ClassVar[Literal["", "by the scene", "by itself"]] = ""  # so that they show much

    on_request: Flag = False

    @property
    def effects(self) -> frozenset[str]:
        """Effects that act in this analysis and only in a few."""
        return frozenset()

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Return the description with the meaning of each key; ``on_request`` names the analysis."""
        reference = super().__get_pydantic_json_schema__(core, handler)
        name = table_name(cls).lower()
        rule = handler.resolve_ref_schema(reference)["properties"]["on_request"]
        rule[MEANING] = f"run only when named: `--analysis {name}`"
        return reference


# a point or component.interface, and a direction; empty for x, y and z
ChannelName = Annotated[
    tuple[str, str],
    BeforeValidator(_read_channel),
    JsonForm(
        {
            "description": "point or component.interface with direction",
            "examples": [["tcp", "x"], "tcp"],
            "anyOf": [
                {"type": "string", "minLength": 1},
                {"type": "array", "items": {"type": "string"}, "minItems": 2, "maxItems": 2},
            ],
        }
    ),
]


def _read_name(value: object) -> str:
    if not isinstance(value, str) or _NAME.fullmatch(value) is None:
        raise problem(
            f"{quote_value(value)} is not a name; write letters, digits, _ and -, beginning with a letter, at most 64"
        )
    return value


Name = Annotated[
    str, BeforeValidator(_read_name), JsonForm({"type": "string", "pattern": f"^{_NAME.pattern}$"})
]


def _find_text_fault(value: str) -> str:
    fits = len(value) <= 400 and value.isprintable()
    return "" if fits else "must be one line of at most 400 printable characters"


Text = Annotated[str, without_fault(_find_text_fault)]


def _wrap(value: object) -> object:
    return value if isinstance(value, list) else [value]


Size = Annotated[list[PositiveLength], Field(min_length=3, max_length=3)]
Position = Annotated[list[Length], Field(min_length=3, max_length=3)]
Exceptions = dict[str, dict[str, Any]]  # by number of a place: dotted keys and their values
Names = Annotated[
    list[Text], BeforeValidator(_wrap), Field(min_length=1, max_length=1000), OrForm()
]


def read_direction(value: object) -> tuple[float, float, float]:
    """A unit vector from a letter with or without a sign, or from three numbers.

    Raises:
        PydanticCustomError: It is none.
    """
    if isinstance(value, str) and (match := _DIRECTION.fullmatch(value)):
        sign = -1.0 if match[1] == "-" else 1.0
        x, y, z = (sign if letter == match[2] else 0.0 for letter in "xyz")
        return x, y, z
    if not isinstance(value, list) or len(value) != 3:
        raise problem(
            f'{quote_value(value)} is not a direction; write "x", "-z" or three plain numbers such as [1, 0, 0]'
        )
    vector = np.array([_read_number(item) for item in value])
    scale = float(np.abs(vector).max())
    if scale == 0.0:
        raise problem("a direction needs a length above zero")
    vector = vector / scale
    x, y, z = (float(item) for item in vector / np.linalg.norm(vector))
    return x, y, z


def show_direction(vector: Iterable[float]) -> str:
    """A unit vector as a scene writes it: ``"x"``, ``"-z"`` or three numbers."""
    numbers = [float(number) for number in vector]
    if (axis := find_axis(numbers)) is not None:
        return f'"{"-" if axis[1] < 0.0 else ""}{axis[0]}"'
    return f"[{', '.join(f'{number:.4g}' for number in numbers)}]"


def describe_direction(description: str, words: Iterable[str], *examples: object) -> JsonForm:
    """Describe a direction by one of some words, or three numbers, for the JSON schema."""
    forms = [{"enum": [*words]}, THREE_NUMBERS]
    return JsonForm({"description": description, "examples": [*examples], "anyOf": forms})


Direction = Annotated[
    tuple[float, float, float],
    BeforeValidator(read_direction),
    describe_direction("x, -z ... or three plain numbers", AXIS_DIRECTIONS, "x", "-z", [1, 0, 0]),
]


def _read_end(value: object) -> JointEnd:
    if isinstance(value, JointEnd):
        return value
    if value == GROUND:
        return JointEnd()
    if not isinstance(value, str) or value.count(".") != 1 or not all(value.split(".")):
        raise problem(
            f'{quote_value(value)} is not an end; write "component.interface" or "ground"'
        )
    component, _, interface = value.partition(".")
    return JointEnd(component, interface)


End = Annotated[
    JointEnd,
    BeforeValidator(_read_end),
    JsonForm(
        {
            "type": "string",
            "description": "component.interface or ground",
            "examples": ["column.foot", "ground"],
            "pattern": rf"^({GROUND}|[^.]+\.[^.]+)$",
        }
    ),
]


def describe_span(dimensions: tuple[Dimension, ...], example: list[Any], low: int) -> JsonForm:
    """Describe a span of the lowest and the highest value and their number for the JSON schema."""
    return JsonForm(
        {
            "type": "array",
            "examples": [example],
            "prefixItems": [
                *2 * [{"type": "string", "pattern": quantity_pattern(*dimensions)}],
                {"type": "integer", "minimum": low},
            ],
            "minItems": 3,
            "maxItems": 3,
        }
    )


def read_span(what: str) -> BeforeValidator:
    """Refuse what has not three entries.

    Args:
        what: What a span is of, and an example of one.
    """

    def read(value: object) -> object:
        if not isinstance(value, list) or len(value) != 3:
            raise problem(f"is not a span; write lowest, highest and number of {what}")
        return value

    return BeforeValidator(read)
