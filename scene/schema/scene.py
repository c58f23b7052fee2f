"""Schema of a whole scene file, its analyses, effects, limits and the accuracy it asks for."""

import functools
import re
from collections.abc import Collection
from importlib import import_module
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model, field_validator

from headstock.geometry.machine.joints import JointEnd
from headstock.scene.reading.names import NAMES
from headstock.scene.reading.units import ACCELERATION, RATE, TIME, quantity_pattern, quote_value
from headstock.scene.schema import types
from headstock.scene.schema.axes import AxisTable, MechanismTable, PointTable, PoseTable
from headstock.scene.schema.components import (
    ComponentTable,
    InterfaceTable,
    MaterialTable,
    OrientationTable,
)
from headstock.scene.schema.cutting import CuttingTable
from headstock.scene.schema.drives import DriveTable
from headstock.scene.schema.effects import EFFECT_NAMES, PLAIN_EFFECTS
from headstock.scene.schema.exports import ExportTable
from headstock.scene.schema.joints import ChainTable, JointTable
from headstock.scene.schema.loads import LoadTable, ProbeTable, SupportTable
from headstock.scene.schema.sensors import MassTable, SensorTable
from headstock.scene.schema.studies import StudyTable, SweepTable

TIGHTEST, LOOSEST = 1e-4, 0.2
MAX_INCLUDED = 50
_PREFIX = re.compile(r"([A-Za-z][A-Za-z0-9_]{0,31})?")


def _find_accuracy_fault(share: float) -> str:
    if TIGHTEST <= share <= LOOSEST:
        return ""
    return types.find_share_fault(share, "accuracy") or (
        f'is {100.0 * share:g} %; an accuracy lies between {100.0 * TIGHTEST:g} % and {100.0 * LOOSEST:g} %; write "1 %"'
    )


Accuracy = Annotated[
    types.Ratio,
    types.without_fault(_find_accuracy_fault),
    types.describe_ratio(
        f"ratio from {TIGHTEST:g} to {LOOSEST:g}", ("1 %", 0.01), minimum=TIGHTEST, maximum=LOOSEST
    ),
]


class _AccuracyTable(types.StrictTable):
    """How far any requested number may be off: mesh sizes, cells, order and mode counts are chosen
    for it.
    """

    to: Accuracy
    """largest relative error of any requested number"""
    models: Literal["none", "deforming", "all"] = "deforming"
    """which bodies become rigid, segmented or elastic as the accuracy allows: `deforming`, those that are not `rigid` in the scene; `all`;
    or `none`"""
    interfaces: Literal["none", "open", "all"] = "open"
    """which interfaces of rigid joints between elastic bodies get deformation shapes where six motions are not enough: `open`, those
    without `coupling`; `all`; or `none`"""


def _wrap_accuracy(value: object) -> object:
    return value if isinstance(value, dict) else {"to": value}


AccuracyEntry = Annotated[
    _AccuracyTable,
    BeforeValidator(_wrap_accuracy),
    types.OrForm({"description": "ratio", "examples": ["1 %"], **types.RATIO_FORM}),
]


_LEFT_OUT = types.OrForm({"const": False, "description": "left out"})


class AnalysesTable(types.StrictTable):
    """What is computed; `false` leaves an analysis out, in a variant say."""

    def get[T: types.RequestTable](self, kind: type[T]) -> T | None:
        """Return the table of an analysis; None where it is left out."""
        return next((table for _, table in self if isinstance(table, kind)), None)

    @property
    def requested(self) -> dict[str, types.RequestTable]:
        """Tables of the analyses that are not left out, by name."""
        return {name: table for name, table in self if table is not None}

    @property
    def effects(self) -> frozenset[str]:
        """Effects that act in one of the analyses and only in a few."""
        return frozenset().union(*(table.effects for table in self.requested.values()))

    @field_validator("*", mode="before")
    @classmethod
    def _leave_out(cls, value: object) -> object:
        return None if value is False else value


class _CompareTable(types.StrictTable):
    """What `headstock compare` shows unless the command line says otherwise."""

    variants: Annotated[list[types.Text], Field(min_length=1, max_length=100)] | None = None
    """columns, `A+B` for joined variants, `as written` for none; default: all"""
    fidelity: (
        Annotated[
            list[Literal["rigid", "segmented", "polynomial", "elastic"]],
            Field(min_length=1, max_length=4),
        ]
        | None
    ) = None
    """each variant once with its elastic and segmented components at each of these fidelities; default: as written"""
    pose: types.Text | None = None
    """pose that is compared; default: the first"""
    reference: types.Text | None = None
    """column the others are compared with; default: the richest"""


class _LimitsTable(types.StrictTable):
    """What a run may cost."""

    elements: types.Count | None = None
    """maximum number of elements of a component; default: 3 million, which no limit exceeds"""
    memory: types.PositiveMemory | None = None
    """maximum estimated memory of a stage; default: what the computer, its batch system or control group allows"""
    time: types.PositiveTime | None = None
    """time that a run may take: one estimated at more than twice of it is refused, and no stage begins after it; also the processor time of
    meshing a component; default: none, 300 s for meshing"""


def _read_effects(value: object) -> object:
    if isinstance(value, list) and all(isinstance(name, str) for name in value):
        return dict.fromkeys(value, True)
    return value


_RATIOS = {"anyOf": [types.RATIO_FORM, {"type": "array", "items": types.RATIO_FORM, "minItems": 1}]}


_ACCELERATION = {"type": "string", "pattern": quantity_pattern(ACCELERATION)}


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
                            "alpha": {"type": "string", "pattern": quantity_pattern(RATE)},
                            "beta": {"type": "string", "pattern": quantity_pattern(TIME)},
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
    dict[types.Text, Any],
    BeforeValidator(_read_effects),
    types.JsonForm(
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
        raise types.problem(
            f'{quote_value(value)} is no prefix of names; write letters, digits and _, beginning with a letter, at most 32, such as "spindle_"'
        )
    return value


class FitTable(types.StrictTable):
    """How uncertain the values of a variant are that were fitted to measurements; written by a command."""

    moves: Annotated[list[dict[str, Any]], Field(max_length=100)]
    """independent changes of its keys, each by half of a 95 % interval"""
    open: list[types.Text] = []
    """parameters that the measurements leave open"""
    scatter: dict[types.Name, types.Ratio] = {}
    """half of the 95 % interval of the errors of a measurement, by kind"""


class IncludeTable(types.StrictTable):
    """A file whose entries become entries of the scene."""

    file: types.Text
    """a `.toml` file in the folder of the scene or below, from the folder of the file that includes it"""
    prefix: Annotated[
        str,
        BeforeValidator(_read_prefix),
        types.JsonForm(
            {"type": "string", "pattern": f"^{_PREFIX.pattern}$", "examples": ["spindle_"]}
        ),
    ] = ""
    """text before the name of every entry of the file"""


def _wrap_include(value: object) -> object:
    return [
        {"file": item} if isinstance(item, str) else item
        for item in (value if isinstance(value, list) else [value])
    ]


_FILE_NAME = {"type": "string", "examples": ["spindle.toml"]}
Includes = Annotated[
    list[Annotated[IncludeTable, types.OrForm(_FILE_NAME)]],
    BeforeValidator(_wrap_include),
    Field(max_length=MAX_INCLUDED),
    types.OrForm(),
]


class SceneTable(types.StrictTable):
    """A scene: one machine, its poses and what is to be computed."""

    name: types.Text | None = None
    """heading of the results; default: the file's name"""
    include: Includes = []
    """other files with parts of the machine, see [short scenes](short_scenes.md): `"spindle.toml"`, a list of them, or `{ file =
    "spindle.toml", prefix = "spindle_" }`"""
    parameters: dict[str, Any] = {}
    """values with names, see [short scenes](short_scenes.md): `wall = "12 mm"`, used as `"= 2 * wall + 3 mm"` anywhere but in `variants`
    and `studies`"""
    materials: dict[types.Name, MaterialTable] = {}
    """materials by name"""
    cutting: dict[types.Name, CuttingTable] = {}
    """cutting coefficients of work materials, by the name that `material` takes ([how to](cutting_coefficients.md))"""
    components: dict[types.Name, ComponentTable] = {}
    """bodies of the machine by name"""
    joints: dict[types.Name, JointTable] = {}
    """connections between components, by name"""
    chains: dict[types.Name, ChainTable] = {}
    """point masses and springs in a row along one direction, by name"""
    points: dict[types.Name, PointTable] = {}
    """points at which results are computed, by name"""
    axes: dict[types.Name, AxisTable] = {}
    """machine axes by name"""
    supports: dict[types.Name, SupportTable] = {}
    """faces whose nodes are fixed, by name"""
    loads: dict[types.Name, LoadTable] = {}
    """static loads by name"""
    probes: dict[types.Name, ProbeTable] = {}
    """points at which displacement and stress are reported, by name"""
    sensors: dict[types.Name, SensorTable] = {}
    """places where motion is measured or a force acts, by name, or tables of them, see [sensors](supports_and_loads.md#sensors)"""
    masses: dict[types.Name, MassTable] = {}
    """point masses on components, by name, or tables of them"""
    mechanism: MechanismTable | None = None
    """a closed-loop mechanism; poses and sweeps then describe the tool: `X Y Z` is its point, `A B` are its rotations about x and y"""
    variants: dict[types.Name, dict[str, Any]] = {}
    """named sets of overrides, keys in quotes: `"components.column.fidelity" = "rigid"`; chosen by `--variant`; `--variant A+B` applies
    `A`, then `B`"""
    fits: dict[types.Name, FitTable] = {}
    """what `identify --write NAME` knows of fitted values, by the name of their variant: with it a run adds them to every ±"""
    compare: _CompareTable = Field(default_factory=_CompareTable.model_construct)
    """what `headstock compare` shows, see [variants side by side](comparing.md)"""
    poses: Annotated[dict[types.Name, PoseTable], Field(max_length=types.MAX_POSES)] = {}
    """axis positions: `X = "10 mm"`; axes left out are at zero; default: one pose, `reference`, with all axes at zero"""
    sweeps: dict[types.Name, SweepTable] = {}
    """poses in which `headstock sweep` repeats the analyses ([sweeps](sweeps.md))"""
    studies: dict[types.Name, StudyTable] = {}
    """parameters that `headstock study` varies, see [studies](studies.md)"""
    drives: dict[types.Name, DriveTable] = {}
    """motors, screws and controllers of axes, see [drives and control](drives.md); used with the effect `drive_control`"""
    effects: Effects = {}
    """effects by name, each `true` or `false`, or a list of names, see [effects](effects.md); `gravity` may be an acceleration; `damping`
    may be a table: `{ modal = 0.02 }` adds this damping ratio to every mode (a list is for the first modes, its last value for all others),
    `{ rayleigh = { alpha = "2 1/s", beta = "1e-5 s" } }` adds `alpha M + beta K` of the whole machine; default: all off"""
    analyses: AnalysesTable = Field(default_factory=AnalysesTable.model_construct)
    """what is computed"""
    exports: dict[types.Name, ExportTable] = {}
    """models for other programs that `run` writes, by name, see [other programs](exchange.md)"""
    orientation: OrientationTable = Field(default_factory=OrientationTable.model_construct)
    """position and orientation of the whole machine"""
    limits: _LimitsTable = Field(default_factory=_LimitsTable.model_construct)
    """limits of size, memory and time of a run"""
    accuracy: AccuracyEntry | None = None
    """allowed error of every requested number: meshes and modes are chosen accordingly, see [accuracy](accuracy.md); default: none, the
    scene's own meshes and modes"""
    model_errors: types.Flag = False
    """compare rigid and segmented bodies with coarse finite elements: what they leave out becomes a part of every ±, see
    [errors](errors.md#models-of-bodies)"""
    interface_errors: types.Flag = False
    """compare rigid joints between elastic bodies with deformation shapes in both forms: what their interfaces leave out becomes a part of
    the ± of frequencies, compliances and frequency responses, see [errors](errors.md#rigid-joints)"""
    free: types.Flag = False
    """accept that the whole machine is not connected to ground"""
    accept_defaults: types.Flag = False
    """compute with the defaults of [open values](#open), which results list; `--accept-defaults` sets it"""

    def interface_at(self, end: JointEnd) -> tuple[ComponentTable, InterfaceTable] | None:
        """Component and interface of an end; None for ground, and for what did not pass the schema."""
        component = self.components.get(end.component or "")
        interface = None if component is None else component.interfaces.get(end.interface or "")
        return None if component is None or interface is None else (component, interface)

    @property
    def active(self) -> frozenset[str]:
        """Effects that are switched on."""
        return frozenset(name for name, value in self.effects.items() if value is not False)

    @property
    def is_lumped(self) -> bool:
        """Return whether the mechanism itself is the model: rigid bodies on lumped springs, and joints
        have no part in it.
        """
        return self.mechanism is not None and self.mechanism.model == "lumped"


def load_record(name: str) -> Any:
    """Return what the module of an analysis says of it, a ``SceneAnalysis``."""
    return import_module(f"headstock.scene.analyses.{name}").ANALYSIS


def complete_scene() -> type[SceneTable]:
    """Return the table of a whole scene with the tables of all analyses."""
    return table_of(frozenset(SceneTable.model_fields), frozenset(NAMES))


@functools.cache
def table_of(sections: frozenset[str], analyses: frozenset[str]) -> type[SceneTable]:
    """Return the table of scenes in which no other sections and analyses are written: their modules
    are not loaded, and no rules built for them, which takes longer than all checks.
    """
    fields: dict[str, Any] = {
        name: (Any, field.get_default(call_default_factory=True))
        for name, field in SceneTable.model_fields.items()
        if name not in sections
    }
    if "analyses" in sections:
        requests = _table_of_analyses(analyses)
        fields["analyses"] = (requests, Field(default_factory=requests.model_construct))
    return create_model("SceneTable", __base__=SceneTable, __doc__=SceneTable.__doc__, **fields)


def _table_of_analyses(names: Collection[str]) -> type[AnalysesTable]:
    fields: dict[str, Any] = dict.fromkeys(NAMES, (Any, None))
    for name in NAMES:
        if name in names:
            record = load_record(name)
            meaning = Field(json_schema_extra={types.MEANING: record.meaning})
            fields[name] = (Annotated[record.table | None, _LEFT_OUT, meaning], None)
    return create_model(
        "AnalysesTable", __base__=AnalysesTable, __doc__=AnalysesTable.__doc__, **fields
    )
