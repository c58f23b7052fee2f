"""Schema of a whole scene file, its analyses, effects, limits and the accuracy it asks for."""

import re
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from headstock.scene.reading.units import ACCELERATION, RATE, TIME, show_value
from headstock.scene.requests import Motors
from headstock.scene.schema.axes import AxisTable, PointTable, PoseTable
from headstock.scene.schema.chains import ChainTable
from headstock.scene.schema.components import ComponentTable, MaterialTable, OrientationTable
from headstock.scene.schema.cutting import CuttingTable
from headstock.scene.schema.drives import ControlTable, DriveTable
from headstock.scene.schema.effects import EFFECT_NAMES, PLAIN_EFFECTS
from headstock.scene.schema.joints import JointTable
from headstock.scene.schema.loads import LoadTable, ProbeTable, SupportTable
from headstock.scene.schema.mechanism import ContouringTable, LobesTable, MechanismTable
from headstock.scene.schema.path import PathTable
from headstock.scene.schema.studies import StudyTable, SweepTable
from headstock.scene.schema.transient import TransientTable
from headstock.scene.schema.types import (
    MAX_POSES,
    RATIO_FORM,
    Between,
    ChannelName,
    Count,
    Flag,
    Frequency,
    JsonForm,
    Name,
    Names,
    OrForm,
    PositiveFrequency,
    PositiveMemory,
    PositiveTime,
    QuantityPattern,
    RequestTable,
    StrictTable,
    Text,
    not_both,
    problem,
    read_share,
)
from headstock.scene.schema.volumetric import VolumetricTable

Channels = Annotated[list[ChannelName], Field(min_length=1, max_length=100)]
TIGHTEST, LOOSEST = 1e-4, 0.2
MAX_INCLUDED = 50
_PREFIX = re.compile(r"([A-Za-z][A-Za-z0-9_]{0,31})?")


class FrfTable(RequestTable):
    """Frequency response between points, or interfaces, from one frequency to another."""

    inputs: Channels | None = None
    outputs: Channels | None = None
    start: Annotated[Frequency, Field(alias="from")] = 0.0
    to: PositiveFrequency
    points: Annotated[Count, Between(2, 100_000)] = 401
    spacing: Literal["linear", "log"] = "linear"
    adaptive: Flag = True
    motion: Literal["receptance", "mobility", "accelerance"] = "receptance"
    motors: Motors = "locked"
    fields_at: tuple[PositiveFrequency, ...] = ()
    poses: Names | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        beyond = [hz for hz in self.fields_at if hz > self.to]
        if beyond:
            raise problem(
                f"`fields_at` has {beyond[0]:g} Hz, beyond `to` = {self.to:g} Hz, up to which modes are kept; write a higher `to`"
            )
        if self.start >= self.to:
            raise problem(
                f"begins at {self.start:g} Hz and ends at {self.to:g} Hz; write a lower `from`"
            )
        if self.spacing == "log" and self.start == 0.0:
            raise problem('a log spacing cannot begin at 0 Hz; write from = "1 Hz"')
        return self


def _read_accuracy(value: object) -> float:
    share = read_share(value, "accuracy")
    if not TIGHTEST <= share <= LOOSEST:
        raise problem(
            f'is {100.0 * share:g} %; an accuracy lies between {100.0 * TIGHTEST:g} % and {100.0 * LOOSEST:g} %; write "1 %"'
        )
    return share


Accuracy = Annotated[
    float,
    BeforeValidator(_read_accuracy),
    JsonForm(
        {
            "description": f"ratio from {TIGHTEST:g} to {LOOSEST:g}",
            "examples": ["1 %", 0.01],
            **RATIO_FORM,
            "minimum": TIGHTEST,
            "maximum": LOOSEST,
        }
    ),
]


class AccuracyTable(StrictTable):
    """How far any requested number may be off: mesh sizes, cells, order and mode counts are chosen
    for it.
    """

    to: Accuracy
    models: Literal["none", "deforming", "all"] = "deforming"
    interfaces: Literal["none", "open", "all"] = "open"


def _wrap_accuracy(value: object) -> object:
    return value if isinstance(value, dict) else {"to": value}


AccuracyEntry = Annotated[
    AccuracyTable,
    BeforeValidator(_wrap_accuracy),
    OrForm({"description": "ratio", "examples": ["1 %"], **RATIO_FORM}),
]


class StaticTable(RequestTable):
    """Compliance at points; without `at` at every point."""

    at: Names | None = None
    poses: Names | None = None


class ModalTable(RequestTable):
    """Natural frequencies and modes; six of them unless `count` or `up_to` is given; `from` and
    `up_to` are a window of frequencies.
    """

    model_config = not_both("count", "up_to")

    count: Count | None = None
    start: Annotated[Frequency, Field(alias="from")] = 0.0
    up_to: PositiveFrequency | None = None
    poses: Names | None = None
    spread: Flag = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.count is not None and self.up_to is not None:
            raise problem("gives both count and up_to; keep one")
        if self.start and self.up_to is None:
            raise problem('a window of frequencies ends somewhere; write up_to = "500 Hz" as well')
        if self.up_to is not None and self.start >= self.up_to:
            raise problem(
                f"begins at {self.start:g} Hz and ends at {self.up_to:g} Hz; write a lower `from`"
            )
        return self


class MapTable(RequestTable):
    """Modes, static stiffness and condition number of a lumped mechanism over the poses of a sweep
    along two or three axes.
    """

    sweep: Text
    count: Annotated[Count, Between(1, 6)] = 3


_LEFT_OUT = OrForm({"const": False, "description": "left out"})


class AnalysesTable(StrictTable):
    """What is computed; `false` leaves an analysis out, in a variant say."""

    static: Annotated[StaticTable | None, _LEFT_OUT] = None
    modal: Annotated[ModalTable | None, _LEFT_OUT] = None
    frf: Annotated[FrfTable | None, _LEFT_OUT] = None
    map: Annotated[MapTable | None, _LEFT_OUT] = None
    contouring: Annotated[ContouringTable | None, _LEFT_OUT] = None
    path: Annotated[PathTable | None, _LEFT_OUT] = None
    control: Annotated[ControlTable | None, _LEFT_OUT] = None
    volumetric: Annotated[VolumetricTable | None, _LEFT_OUT] = None
    lobes: Annotated[LobesTable | None, _LEFT_OUT] = None
    transient: Annotated[TransientTable | None, _LEFT_OUT] = None

    @field_validator("*", mode="before")
    @classmethod
    def _leave_out(cls, value: object) -> object:
        return None if value is False else value


class CompareTable(StrictTable):
    """What `headstock compare` shows unless the command line says otherwise."""

    variants: Annotated[list[Text], Field(min_length=1, max_length=100)] | None = None
    fidelity: (
        Annotated[
            list[Literal["rigid", "segmented", "polynomial", "elastic"]],
            Field(min_length=1, max_length=4),
        ]
        | None
    ) = None
    pose: Text | None = None
    reference: Text | None = None


class LimitsTable(StrictTable):
    """What a run may cost."""

    elements: Count | None = None
    memory: PositiveMemory | None = None
    time: PositiveTime | None = None


def _read_effects(value: object) -> object:
    return (
        dict.fromkeys(value, True)
        if isinstance(value, list) and all(isinstance(name, str) for name in value)
        else value
    )


_RATIOS = {"anyOf": [RATIO_FORM, {"type": "array", "items": RATIO_FORM, "minItems": 1}]}


_ACCELERATION = {"type": "string", "pattern": QuantityPattern((ACCELERATION,))}


_EFFECT_FORMS = {
    **{name: {"type": "boolean"} for name in PLAIN_EFFECTS},
    "gravity": {
        "anyOf": [
            {"type": "boolean"},
            _ACCELERATION,
            {"type": "array", "items": _ACCELERATION, "minItems": 3, "maxItems": 3},
        ],
        "examples": [True, "9.81 m/s^2"],
    },
    "damping": {
        "anyOf": [
            {"type": "boolean"},
            {
                "type": "object",
                "properties": {
                    "modal": _RATIOS,
                    "rayleigh": {
                        "type": "object",
                        "properties": {
                            "alpha": {"type": "string", "pattern": QuantityPattern((RATE,))},
                            "beta": {"type": "string", "pattern": QuantityPattern((TIME,))},
                        },
                        "minProperties": 1,
                        "additionalProperties": False,
                    },
                },
                "minProperties": 1,
                "additionalProperties": False,
            },
        ],
        "examples": [True, {"modal": 0.02}],
    },
}


Effects = Annotated[
    dict[Text, Any],
    BeforeValidator(_read_effects),
    JsonForm(
        {
            "anyOf": [
                {"type": "object", "properties": _EFFECT_FORMS, "additionalProperties": False},
                {"type": "array", "items": {"enum": list(EFFECT_NAMES)}},
            ]
        }
    ),
]


def _read_prefix(value: object) -> str:
    if not isinstance(value, str) or _PREFIX.fullmatch(value) is None:
        raise problem(
            f'{show_value(value)} is no prefix of names; write letters, digits and _, beginning with a letter, at most 32, such as "spindle_"'
        )
    return value


class IncludeTable(StrictTable):
    """A file whose entries become entries of the scene."""

    file: Text
    prefix: Annotated[
        str,
        BeforeValidator(_read_prefix),
        JsonForm({"type": "string", "pattern": f"^{_PREFIX.pattern}$", "examples": ["spindle_"]}),
    ] = ""


def _wrap_include(value: object) -> object:
    return [
        {"file": item} if isinstance(item, str) else item
        for item in (value if isinstance(value, list) else [value])
    ]


_FILE_NAME = {"type": "string", "examples": ["spindle.toml"]}
Includes = Annotated[
    list[Annotated[IncludeTable, OrForm(_FILE_NAME)]],
    BeforeValidator(_wrap_include),
    Field(max_length=MAX_INCLUDED),
    OrForm(),
]


class SceneTable(StrictTable):
    """A scene: one machine, its poses and what is to be computed."""

    name: Text | None = None
    include: Includes = []
    parameters: dict[str, Any] = {}
    materials: dict[Name, MaterialTable] = {}
    cutting: dict[Name, CuttingTable] = {}
    components: dict[Name, ComponentTable] = {}
    joints: dict[Name, JointTable] = {}
    chains: dict[Name, ChainTable] = {}
    points: dict[Name, PointTable] = {}
    axes: dict[Name, AxisTable] = {}
    supports: dict[Name, SupportTable] = {}
    loads: dict[Name, LoadTable] = {}
    probes: dict[Name, ProbeTable] = {}
    mechanism: MechanismTable | None = None
    variants: dict[Name, dict[str, Any]] = {}
    compare: CompareTable = CompareTable()
    poses: Annotated[dict[Name, PoseTable], Field(max_length=MAX_POSES)] = {}
    sweeps: dict[Name, SweepTable] = {}
    studies: dict[Name, StudyTable] = {}
    drives: dict[Name, DriveTable] = {}
    effects: Effects = {}
    analyses: AnalysesTable = AnalysesTable()
    orientation: OrientationTable = OrientationTable()
    limits: LimitsTable = LimitsTable()
    accuracy: AccuracyEntry | None = None
    model_errors: Flag = False
    interface_errors: Flag = False
    free: Flag = False

    @property
    def is_lumped(self) -> bool:
        """Whether the mechanism itself is the model: rigid bodies on lumped springs, and joints
        have no part in it.
        """
        return self.mechanism is not None and self.mechanism.model == "lumped"
