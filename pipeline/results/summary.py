"""How results read as ``summary.json``."""

import dataclasses
import math

import numpy as np

from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.estimates import Estimate
from headstock.pipeline.results.frf import summarise_response
from headstock.pipeline.results.path import summarise_path
from headstock.pipeline.results.results import ComponentFacts, PointCompliance, PoseModes, ProbeResponse, Results
from headstock.pipeline.storage.json_texts import Json, check_finite, null_open

UM_PER_KN = 1e9  # m/N


def summarise(results: Results) -> Json:
    """The content of ``summary.json``; ``static`` holds the first pose, and ``static_poses`` all of them when there are several.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    by_pose = {
        pose: {name: _summarise_point(name, point) for name, point in points.items()} for pose, points in results.static.items()
    }
    summary: Json = {
        "name": results.name,
        "status": "failed" if results.failures else "done",
        "versions": results.versions,
        "stages": [_summarise_stage(record) for record in results.stages],
        "totals": _sum_up(results),
        "components": {name: _summarise_component(facts) for name, facts in results.components.items()},
        "static": next(iter(by_pose.values()), {}),
        "modal": [_summarise_modes(modes) for modes in results.modal],
        "warnings": list(results.warnings),
        "failures": list(results.failures),
        "files": {name: {"sha256": digest} for name, digest in results.files.items()},
    }
    if results.provenance is not None:
        summary["provenance"] = results.provenance.summarise()
    if results.responses:
        summary["frf"] = {response.curves.pose: summarise_response(response) for response in results.responses}
    if results.probes:
        summary["probes"] = {
            pose: {name: _summarise_probe(name, probe) for name, probe in probes.items()} for pose, probes in results.probes.items()
        }
    if results.contouring is not None:
        summary["contouring"] = results.contouring
    if results.path is not None:
        summary["path"] = summarise_path(results.path)
    if results.control:
        summary["control"] = results.control
    if results.accuracy is not None:
        summary["accuracy"] = results.accuracy
    if results.map is not None:
        summary["map"] = results.map
    if results.mechanism:
        summary["mechanism"] = {pose: dataclasses.asdict(found) for pose, found in results.mechanism.items()}
    if len(by_pose) > 1:
        summary["static_poses"] = by_pose
    return summary


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


def _summarise_point(name: str, point: PointCompliance) -> Json:
    what, free = f"static compliance at {name}", bool(point.free_motions)
    summary: Json = {
        "compliance_um_per_kN": null_open(what, point.compliance[:3, :3] * UM_PER_KN, free=free),
        "compliance_6x6": null_open(what, point.compliance, free=free),
        "free_motions": list(point.free_motions),
        "budget": {
            direction: dict(zip(shares, check_finite(f"budget at {name}", list(shares.values())), strict=True))
            for direction, shares in point.budget.items()
        },
        "sentence": point.sentence,
        "error_um_per_kN": {
            direction: None if error.total is None else UM_PER_KN * error.total for direction, error in point.errors.items()
        },
        "error_share": {direction: scale_shares(error, UM_PER_KN) for direction, error in point.errors.items()},
        "error_parts": {direction: _scale_parts(error, UM_PER_KN) for direction, error in point.errors.items()},
        "error_left_out": sorted({words for error in point.errors.values() for words in error.left_out}),
    }
    if point.displacement is not None:
        summary["displacement"] = null_open(f"displacement of {name} under the static loads", point.displacement, free=free)
    return summary


def scale_shares(error: Estimate, factor: float) -> Json:
    """Source of error to its size in another unit."""
    return {source: None if size is None else factor * size for source, size in error.shares.items()}


def _scale_parts(error: Estimate, factor: float = 1.0) -> Json:
    return {source: {name: factor * size for name, size in parts.items()} for source, parts in error.parts.items()}


def _summarise_probe(name: str, probe: ProbeResponse) -> Json:
    what = f"response at probe {name}"
    deviator = probe.stress - np.trace(probe.stress) / 3.0 * np.eye(3)
    stress = check_finite(what, probe.stress * 1e-6)
    return {
        "component": probe.component,
        "displacement_um": check_finite(what, probe.displacement * 1e6),
        "stress_mpa": {"xyz"[i] + "xyz"[j]: stress[i][j] for i in range(3) for j in range(i, 3)},
        "von_mises_mpa": float(np.sqrt(1.5 * (deviator**2).sum()) * 1e-6),
        "stress_jump": probe.jump,
    }


def _summarise_modes(modes: PoseModes) -> Json:
    what = f"modal analysis in pose {modes.pose.name}"
    summary: Json = {
        "pose_name": modes.pose.name,
        "pose": modes.pose.positions,
        "pose_units": {axis: modes.pose_units[axis] for axis in modes.pose.positions if axis in modes.pose_units},
        "frequencies_hz": check_finite(what, modes.frequencies_hz),
        "rigid_count": modes.rigid_count,
        "error_hz": list(modes.error_hz),
        "error_share": [dict(error.shares) for error in modes.errors],
        "error_parts": [_scale_parts(error) for error in modes.errors],
        "error_left_out": sorted({words for error in modes.errors for words in error.left_out}),
        "damping_ratio": list(modes.damping_ratio),
        "damping_error": list(modes.damping_error or (None,) * len(modes.damping_ratio)),
        "damped_hz": list(modes.damped_hz),
        "damped_error_hz": list(modes.damped_error_hz or (None,) * len(modes.damped_hz)),
        "mode_names": list(modes.mode_names),
        "energy_share": [dict(share) for share in modes.energy_share],
        "kinetic_share": [dict(share) for share in modes.kinetic_share],
    }
    if modes.spread_hz:
        summary["interface_spread_hz"] = [None if span is None else list(span) for span in modes.spread_hz]
    return summary


def _number_or_null(value: float) -> float | None:
    # infinite cut-offs and missing CAD volumes are legal and have no JSON number
    return float(value) if math.isfinite(value) else None
