"""``summary.json``: what a run found as one typed mapping."""

import math
import types
from typing import Any, Literal, NotRequired, TypedDict, cast, get_type_hints

from headstock.pipeline.answers.accuracy import (
    AccuracySummary,
    InterfaceErrorsSummary,
    ModelErrorsSummary,
)
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.contouring import ContourSummary
from headstock.pipeline.answers.control import ControlSummary
from headstock.pipeline.answers.frf import ResponseSummary
from headstock.pipeline.answers.lobes import LobesSummary
from headstock.pipeline.answers.map import MapSummary, MechanismSummary
from headstock.pipeline.answers.modal import ModesSummary, PoseModes
from headstock.pipeline.answers.path import PathSummary
from headstock.pipeline.answers.probes import ProbeSummary
from headstock.pipeline.answers.static import PointSummary, StaticAnswer
from headstock.pipeline.answers.transient import TransientSummary
from headstock.pipeline.answers.volumetric import VolumetricSummary
from headstock.pipeline.planning.analyses import load_answer_types
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.results import ComponentFacts, Results
from headstock.pipeline.storage.provenance import ProvenanceSummary


class _StageSummary(TypedDict):
    """The entry of a stage."""

    stage: str
    component: str | None
    pose: str | None
    reason: str
    seconds: float
    cpu_seconds: float
    cached: bool
    peak_rss_mb: float


class _TotalsSummary(TypedDict):
    """Sums over components and stages."""

    mass_kg: float
    full_dofs: int
    reduced_dofs: int
    seconds: float
    peak_rss_mb: float


class ComponentSummary(TypedDict):
    """The entry of a component."""

    fidelity: str
    full_dofs: int
    reduced_dofs: int
    mass_kg: float
    cutoff_hz: float | None
    residual: float
    mesh_quality: NotRequired[dict[str, float | None]]
    mesh_corrected: NotRequired[bool]


class RunSummary(TypedDict):
    """The content of ``summary.json``; analyses that were not requested are not in it, but for
    empty ``static`` and ``modal``.
    """

    format: NotRequired[int]
    name: str
    status: Literal["done", "failed"]
    versions: dict[str, str]
    stages: list[_StageSummary]
    totals: _TotalsSummary
    components: dict[str, ComponentSummary]
    static: dict[str, PointSummary]  # of the first pose
    modal: list[ModesSummary]
    warnings: list[str]
    failures: list[str]
    assumptions: NotRequired[list[str]]
    # not where the summary is kept without them, as in studies
    files: NotRequired[dict[str, dict[str, str]]]
    provenance: NotRequired[ProvenanceSummary]
    static_poses: NotRequired[dict[str, dict[str, PointSummary]]]  # of several poses
    probes: NotRequired[dict[str, dict[str, ProbeSummary]]]
    mechanism: NotRequired[dict[str, MechanismSummary]]
    frf: NotRequired[dict[str, ResponseSummary]]
    path: NotRequired[PathSummary]
    control: NotRequired[dict[str, ControlSummary]]
    lobes: NotRequired[dict[str, LobesSummary]]
    transient: NotRequired[dict[str, TransientSummary]]
    map: NotRequired[MapSummary]
    volumetric: NotRequired[dict[str, VolumetricSummary]]
    contouring: NotRequired[ContourSummary]
    accuracy: NotRequired[AccuracySummary]
    model_errors: NotRequired[ModelErrorsSummary]
    interface_errors: NotRequired[InterfaceErrorsSummary]


def list_entry_types() -> dict[str, Any]:
    """Return the type of every entry that ``summary.json`` may hold, by its key: those that
    :class:`RunSummary` names, and of other answers what they summarise, by pose or as it is.
    """
    entries: dict[str, Any] = {}
    for kind in load_answer_types():
        content: Any = get_type_hints(kind.summarise)["return"]
        entries[kind.entry] = types.GenericAlias(dict, (str, content)) | content
    return entries | get_type_hints(RunSummary)


def summarise(results: Results) -> RunSummary:
    """Return the content of ``summary.json``.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    kinds: dict[type[Answer], list[Answer]] = {StaticAnswer: [], PoseModes: []}
    for answer in results.answers:
        kinds.setdefault(type(answer), []).append(answer)
    entries = [kind.gather(answers) for kind, answers in kinds.items()]
    summary = {
        "name": results.name,
        "status": "failed" if results.failures else "done",
        "versions": results.versions,
        "stages": [_summarise_stage(record) for record in results.stages],
        "totals": _sum_up(results),
        "components": {
            name: _summarise_component(facts) for name, facts in results.components.items()
        },
        "warnings": list(results.warnings),
        "failures": list(results.failures),
        "files": {name: {"sha256": digest} for name, digest in results.files.items()},
        **({"assumptions": list(results.assumptions)} if results.assumptions else {}),
        **({} if results.provenance is None else {"provenance": results.provenance.summarise()}),
        **{key: content for entry in entries for key, content in entry.items()},
    }
    return cast(RunSummary, summary)


def _sum_up(results: Results) -> _TotalsSummary:
    facts = results.components.values()
    return {
        "mass_kg": sum(fact.mass_kg for fact in facts),
        "full_dofs": sum(fact.full_dofs for fact in facts),
        "reduced_dofs": sum(fact.reduced_dofs for fact in facts),
        "seconds": round(sum(record.seconds for record in results.stages), 4),
        "peak_rss_mb": round(
            max((record.peak_rss_mb for record in results.stages), default=0.0), 1
        ),
    }


def _summarise_stage(record: StageRecord) -> _StageSummary:
    return {
        "stage": record.stage.kind,
        "component": record.stage.component,
        "pose": record.stage.pose,
        "reason": record.stage.reason,
        "seconds": round(record.seconds, 4),
        "cpu_seconds": round(record.cpu_seconds, 4),
        "cached": record.cached,
        "peak_rss_mb": round(record.peak_rss_mb, 1),
    }


def _summarise_component(facts: ComponentFacts) -> ComponentSummary:
    summary: ComponentSummary = {
        "fidelity": facts.fidelity,
        "full_dofs": facts.full_dofs,
        "reduced_dofs": facts.reduced_dofs,
        "mass_kg": facts.mass_kg,
        "cutoff_hz": _number_or_null(facts.cutoff_hz),
        "residual": facts.residual,
    }
    if facts.quality is not None:
        summary["mesh_quality"] = {
            "minimum_scaled_jacobian": facts.quality.minimum_scaled_jacobian,
            "repaired": facts.quality.repaired,
            "volume": facts.quality.volume,
            "cad_volume": _number_or_null(facts.quality.cad_volume),
        }
    if facts.corrected:
        summary["mesh_corrected"] = True
    return summary


def _number_or_null(value: float) -> float | None:
    # infinite cut-offs and missing CAD volumes are legal and have no JSON number
    return float(value) if math.isfinite(value) else None
