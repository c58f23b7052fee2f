"""What a run found: the types, and how they read as ``summary.json``."""

import dataclasses
import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machines import Pose
from headstock.meshing.component_mesh import MeshQuality
from headstock.pipeline.error_estimates import Estimate
from headstock.pipeline.frf_results import PoseResponse, summarise_response
from headstock.pipeline.machine_views import MachineView
from headstock.pipeline.path_results import PathResult, summarise_path
from headstock.pipeline.stages import StageRecord
from headstock.solvers.errors import AccuracyError

Json = dict[str, Any]
UM_PER_KN = 1e9  # m/N
DIRECTIONS = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class ComponentFacts:
    """What became of a component.

    Attributes:
        fidelity: ``rigid``, ``elastic`` or ``superelement``.
        full_dofs: Dofs before reduction.
        reduced_dofs: Dofs of its superelement.
        mass_kg: Mass [kg].
        cutoff_hz: Its fixed-interface modes are complete up to here; inf for rigid bodies.
        residual: Largest relative residual of its solves.
        quality: Of its mesh; None without one.
    """

    fidelity: str
    full_dofs: int
    reduced_dofs: int
    mass_kg: float
    cutoff_hz: float
    residual: float
    quality: MeshQuality | None = None


@dataclass(frozen=True, eq=False)
class PointCompliance:
    """Static compliance at a named point, tool relative to work, machine axes.

    Attributes:
        compliance: ``(6, 6)`` [m/N, 1/N, 1/(N m)], rows and columns x y z rx ry rz.
        budget: Direction x, y, z to share of the compliance per component or joint; shares sum to 1.
        sentence: What it says about the weak link.
        displacement: ``(6,)`` motion under the scene's static loads [m, rad]; None without loads.
        errors: Direction x, y, z to how far the compliance in it may be off [m/N].
    """

    compliance: FloatArray
    budget: dict[str, dict[str, float]]
    sentence: str = ""
    displacement: FloatArray | None = None
    errors: dict[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ProbeResponse:
    """Response of a component to all static loads together at a probe, in machine axes.

    Attributes:
        component: Its name.
        displacement: ``(3,)`` [m].
        stress: ``(3, 3)`` [Pa].
        jump: Largest difference between the stresses of the cells that meet there over their largest entry.
    """

    component: str
    displacement: FloatArray
    stress: FloatArray
    jump: float


@dataclass(frozen=True, eq=False)
class PoseModes:
    """Natural modes of vibration in one pose.

    Attributes:
        pose: Axis positions.
        frequencies_hz: ``(m,)``, rigid-body modes first.
        rigid_count: How many of them are rigid-body modes.
        errors: How far each may be off [Hz].
        damping_ratio: Of each; None without damping.
        damped_hz: Frequency of the damped oscillation [Hz]; zero where it is overdamped, None without damping.
        mode_names: In plain words.
        energy_share: Per mode, share of the strain energy per component or joint.
        kinetic_share: Per mode, share of the kinetic energy per component.
        shapes: ``(n, m)`` mass-normalised, over the dofs of all superelements in the order of ``labels``.
        placements: Frame of each component in the machine in this pose.
        spread_hz: Lowest and highest frequency of each mode with every interface averaging and rigid [Hz]; None where it has no partner,
            empty where none was asked for.
    """

    pose: Pose
    frequencies_hz: FloatArray
    rigid_count: int
    errors: tuple[Estimate, ...]
    damping_ratio: tuple[float | None, ...]
    mode_names: tuple[str, ...]
    energy_share: tuple[dict[str, float], ...]
    kinetic_share: tuple[dict[str, float], ...]
    shapes: FloatArray
    damped_hz: tuple[float | None, ...] = ()
    placements: dict[str, Frame] = field(default_factory=dict)
    spread_hz: tuple[tuple[float, float] | None, ...] = ()

    @property
    def error_hz(self) -> tuple[float | None, ...]:
        """Estimated error of each frequency, all sources together; None where there is no estimate."""
        return tuple(error.total for error in self.errors)


@dataclass(frozen=True)
class MechanismPose:
    """A closed-loop mechanism in a pose: its coordinates [m, rad] and how well its drives command the wrist centre."""

    coordinates: dict[str, float]
    condition_number: float


@dataclass(frozen=True, eq=False)
class Results:
    """Everything a run found.

    Attributes:
        name: Scene name.
        versions: Of the libraries behind it.
        stages: What ran, in order.
        components: By name.
        static: Pose name to point name to compliance.
        modal: One per pose.
        responses: Frequency responses, one per pose.
        probes: Pose name to probe name to response.
        joint_springs: Joint name to ``(6, 6)`` stiffness in its joint frame [N/m, N m/rad].
        labels: A name for each row of the mode shapes.
        warnings: In plain words.
        failures: Analyses that were refused, with the reason; the others were still computed.
        view: What pictures of the machine are drawn from.
        control: Pose name to closed-loop poles and figures of the drives, as in the summary.
        contouring: Tool gap around a milled block, as in the summary.
        path: Deviation from a path while axes accelerate.
        map: Frequencies, stiffness and condition number over a plane of poses, as in the summary.
        mechanism: Pose name to where a closed-loop mechanism stands; empty without one.
        accuracy: How settings were chosen for an accuracy, as in the summary; None where the scene asks for none.
        files: SHA-256 by file name of what was written beside the summary.
    """

    name: str
    versions: dict[str, str]
    stages: tuple[StageRecord, ...]
    components: dict[str, ComponentFacts]
    static: dict[str, dict[str, PointCompliance]]
    modal: tuple[PoseModes, ...]
    joint_springs: dict[str, FloatArray]
    labels: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    probes: dict[str, dict[str, ProbeResponse]] = field(default_factory=dict)
    view: MachineView = field(default_factory=MachineView)
    files: dict[str, str] = field(default_factory=dict)
    mechanism: dict[str, MechanismPose] = field(default_factory=dict)
    map: Json | None = None
    contouring: Json | None = None
    path: PathResult | None = None
    control: dict[str, Json] = field(default_factory=dict)
    responses: tuple[PoseResponse, ...] = ()
    accuracy: Json | None = None


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


def dump_json(content: Any) -> str:
    """Strict JSON text: a number that is not finite is an error, not ``NaN``."""
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def check_finite(what: str, values: Any) -> Any:
    """The values as plain lists.

    Raises:
        AccuracyError: One of them is not a finite number.
    """
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise AccuracyError(f"{what} holds values that are not finite: {array[~np.isfinite(array)][:3].tolist()}")
    return array.tolist()


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
    what = f"static compliance at {name}"
    summary: Json = {
        "compliance_um_per_kN": check_finite(what, point.compliance[:3, :3] * UM_PER_KN),
        "compliance_6x6": check_finite(what, point.compliance),
        "budget": {
            direction: dict(zip(shares, check_finite(f"budget at {name}", list(shares.values())), strict=True))
            for direction, shares in point.budget.items()
        },
        "sentence": point.sentence,
        "error_um_per_kN": {
            direction: None if error.total is None else UM_PER_KN * error.total for direction, error in point.errors.items()
        },
        "error_share": {direction: _scale_shares(error, UM_PER_KN) for direction, error in point.errors.items()},
        "error_parts": {direction: _scale_parts(error, UM_PER_KN) for direction, error in point.errors.items()},
        "error_left_out": sorted({words for error in point.errors.values() for words in error.left_out}),
    }
    if point.displacement is not None:
        summary["displacement"] = check_finite(f"displacement of {name} under the static loads", point.displacement)
    return summary


def _scale_shares(error: Estimate, factor: float) -> Json:
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
        "frequencies_hz": check_finite(what, modes.frequencies_hz),
        "rigid_count": modes.rigid_count,
        "error_hz": list(modes.error_hz),
        "error_share": [dict(error.shares) for error in modes.errors],
        "error_parts": [_scale_parts(error) for error in modes.errors],
        "error_left_out": sorted({words for error in modes.errors for words in error.left_out}),
        "damping_ratio": list(modes.damping_ratio),
        "damped_hz": list(modes.damped_hz),
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
