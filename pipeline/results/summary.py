"""How results read as ``summary.json``."""

import math

from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.answers import summarise_answers
from headstock.pipeline.results.results import ComponentFacts, Results
from headstock.pipeline.storage.json_texts import Json


def summarise(results: Results) -> Json:
    """The content of ``summary.json``.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    summary: Json = {
        "name": results.name,
        "status": "failed" if results.failures else "done",
        "versions": results.versions,
        "stages": [_summarise_stage(record) for record in results.stages],
        "totals": _sum_up(results),
        "components": {name: _summarise_component(facts) for name, facts in results.components.items()},
        "static": {},
        "modal": [],
        "warnings": list(results.warnings),
        "failures": list(results.failures),
        "files": {name: {"sha256": digest} for name, digest in results.files.items()},
    }
    if results.provenance is not None:
        summary["provenance"] = results.provenance.summarise()
    return summary | summarise_answers(results.answers)


def _sum_up(results: Results) -> Json:
    facts = results.components.values()
    return {
        "mass_kg": sum(fact.mass_kg for fact in facts),
        "full_dofs": sum(fact.full_dofs for fact in facts),
        "reduced_dofs": sum(fact.reduced_dofs for fact in facts),
        "seconds": round(sum(record.seconds for record in results.stages), 4),
        "peak_rss_mb": round(max((record.peak_rss_mb for record in results.stages), default=0.0), 1),
    }


def _summarise_stage(record: StageRecord) -> Json:
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


def _summarise_component(facts: ComponentFacts) -> Json:
    summary: Json = {
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
    return summary


def _number_or_null(value: float) -> float | None:
    # infinite cut-offs and missing CAD volumes are legal and have no JSON number
    return float(value) if math.isfinite(value) else None
