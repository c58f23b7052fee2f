"""Schema of a whole scene file, and its JSON schema."""

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from headstock.pipeline.schema_accuracy import AccuracyEntry
from headstock.pipeline.schema_components import ComponentTable, MaterialTable, OrientationTable
from headstock.pipeline.schema_connections import AxisTable, JointTable, LoadTable, PointTable, PoseTable, ProbeTable, SupportTable
from headstock.pipeline.schema_contouring import ContouringTable
from headstock.pipeline.schema_drives import ControlTable, DriveTable
from headstock.pipeline.schema_frequency import FrfTable
from headstock.pipeline.schema_mechanism import MechanismTable
from headstock.pipeline.schema_path import PathTable
from headstock.pipeline.schema_studies import StudyTable
from headstock.pipeline.schema_sweeps import SweepTable
from headstock.pipeline.schema_types import (
    MAX_POSES,
    Count,
    Flag,
    Name,
    Names,
    PositiveFrequency,
    PositiveMemory,
    PositiveTime,
    RequestTable,
    StrictTable,
    Text,
    problem,
)


class StaticTable(RequestTable):
    """Compliance at points; without `at` at every point."""

    at: Names | None = None
    poses: Names | None = None


class ModalTable(RequestTable):
    """Natural frequencies and modes; six of them unless `count` or `up_to` is given."""

    count: Count | None = None
    up_to: PositiveFrequency | None = None
    poses: Names | None = None
    spread: Flag = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.count is not None and self.up_to is not None:
            raise problem("gives both count and up_to; keep one")
        return self


class MapTable(RequestTable):
    """Modes, static stiffness and condition number of a lumped mechanism over the poses of a sweep along two or three axes."""

    sweep: Text
    count: Annotated[Count, Field(le=6)] = 3


class AnalysesTable(StrictTable):
    """What is computed; `false` leaves an analysis out, in a variant say."""

    static: StaticTable | None = None
    modal: ModalTable | None = None
    frf: FrfTable | None = None
    map: MapTable | None = None
    contouring: ContouringTable | None = None
    path: PathTable | None = None
    control: ControlTable | None = None

    @field_validator("*", mode="before")
    @classmethod
    def _leave_out(cls, value: object) -> object:
        return None if value is False else value


class CompareTable(StrictTable):
    """What `headstock compare` shows unless the command line says otherwise."""

    variants: Annotated[list[Text], Field(min_length=1, max_length=100)] | None = None
    fidelity: Annotated[list[Literal["rigid", "segmented", "elastic"]], Field(min_length=1, max_length=3)] | None = None
    pose: Text | None = None
    reference: Text | None = None


class LimitsTable(StrictTable):
    """What a run may cost."""

    elements: Count | None = None
    memory: PositiveMemory | None = None
    time: PositiveTime | None = None


def _read_effects(value: object) -> object:
    return dict.fromkeys(value, True) if isinstance(value, list) and all(isinstance(name, str) for name in value) else value


Effects = Annotated[dict[Text, Any], BeforeValidator(_read_effects)]


class SceneTable(StrictTable):
    """A scene: one machine, its poses and what is to be computed."""

    name: Text | None = None
    materials: dict[Name, MaterialTable] = {}
    components: dict[Name, ComponentTable] = {}
    joints: dict[Name, JointTable] = {}
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
    free: Flag = False


def schema_json() -> dict[str, Any]:
    """JSON schema of a scene file, as ``headstock schema`` prints it."""
    return SceneTable.model_json_schema(mode="validation")
