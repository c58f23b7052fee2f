"""``summary.json``: what a run found as one typed mapping."""

from typing import Any

from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.results import ComponentFacts, Results
from headstock.pipeline.storage.json_texts import find_known

type RunSummary = dict[str, Any]  # ``summary_keys.py`` lists its keys


def summarise(results: Results) -> RunSummary:
    """Return the content of ``summary.json``.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    kinds: dict[type[Answer], list[Answer]] = {StaticAnswer: [], PoseModes: []}
    for answer in results.answers:
        kinds.setdefault(type(answer), []).append(answer)
    entries = [kind.gather(answers) for kind, answers in kinds.items()]
    return {
        "name": results.name,
        "status": results.status,
        "versions": results.versions,
        "stages": [summarise_stage(record) for record in results.stages],
        "totals": sum_up(results),
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


def sum_up(results: Results) -> Entry:
    """Return masses, dofs and costs of all components and stages."""
    facts = results.components.values()
    return {
        "mass_kg": sum(fact.mass_kg for fact in facts),
        "full_dofs": sum(fact.full_dofs for fact in facts),
        "reduced_dofs": sum(fact.reduced_dofs for fact in facts),
        "seconds": round(sum(round(record.seconds, 4) for record in results.stages), 4),
        "peak_rss_mb": round(
            max((record.peak_rss_mb for record in results.stages), default=0.0), 1
        ),
    }


def summarise_stage(record: StageRecord) -> Entry:
    """Return what a summary holds of a stage; seconds and memory are rounded."""
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


def _summarise_component(facts: ComponentFacts) -> Entry:
    summary: Entry = {
        "fidelity": facts.fidelity,
        "full_dofs": facts.full_dofs,
        "reduced_dofs": facts.reduced_dofs,
        "mass_kg": facts.mass_kg,
        "cutoff_hz": find_known(facts.cutoff_hz),
        "residual": facts.residual,
    }
    if facts.quality is not None:
        summary["mesh_quality"] = {
            "minimum_scaled_jacobian": facts.quality.minimum_scaled_jacobian,
            "repaired": facts.quality.repaired,
            "volume": facts.quality.volume,
            "cad_volume": find_known(facts.quality.cad_volume),
        }
    if facts.corrected:
        summary["mesh_corrected"] = True
    return summary
