"""The static stages: compliance and its budget at points, displacement and stress at probes. Only
rank 0 has anything to do.
"""

import dataclasses
import importlib

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray, Frame
from headstock.geometry.machine.machine import Probe
from headstock.pipeline.answers.static import (
    PointCompliance,
    ProbeAnswer,
    ProbeResponse,
    StaticAnswer,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.run_state import Outcome, PoseMotions, RunState, Solved, pose_model
from headstock.reduction.coupling.channels import GRAVITY, load_factors
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.solvers.errors import ModelError

# loaded only where a scene has probes: it needs the element library, which takes most of a second
# to import
RECOVERY_MODULE = "headstock.solvers.elastic.stress_recovery"


def run_static_stage(state: RunState, stage: Stage) -> Outcome:
    """Compliance and its budget at every requested point; a machine that moves freely is refused,
    and the run goes on.
    """
    if not state.is_root:
        return Outcome()
    model, request = pose_model(state), state.scene.analyses.static
    if request is None:
        raise ValueError("a static stage needs a static analysis in the scene")
    pose = model.pose.name
    solved: dict[str, Solved[PointCompliance]] = {}
    refused: tuple[str, ...] = ()
    try:
        for name in request.at:
            solved[name] = model.solve_point(name)
    except ModelError as error:
        refused = (f"static analysis in pose {pose}: {error}",)
    warnings = tuple(message for found in solved.values() for message in found.warnings)
    failures = tuple(message for found in solved.values() for message in found.failures) + refused
    if refused:
        return Outcome(detail="refused: see below", warnings=warnings, failures=failures)
    answer = StaticAnswer(pose, {name: found.answer for name, found in solved.items()})
    motions = {
        f"{name} {direction}": model.expand(model.push((name, direction)))
        for name, point in answer.points.items()
        for axis, direction in enumerate(DIRECTIONS)
        if not np.isnan(point.compliance[axis, axis])
    }
    state.motions.setdefault(pose, PoseMotions(model.offsets)).motions.update(motions)
    pushes = {
        push: model.shift_skins(state.skins, moved[:, None]) for push, moved in motions.items()
    }
    single = {
        push: {name: shift[0] for name, shift in shifts.items()} for push, shifts in pushes.items()
    }
    state.views[pose] = dataclasses.replace(state.views[pose], pushes=single)
    return Outcome(
        detail=", ".join(solved), answers=(answer,), warnings=warnings, failures=failures
    )


def run_recover_stage(state: RunState, stage: Stage) -> Outcome:
    """Displacement and stress at every probe under all static loads together; a mechanism is
    refused.
    """
    if not state.is_root or state.coupled is None or stage.pose is None:
        return Outcome()
    probes = state.scene.machine.probes
    try:
        total = np.sum(list(state.coupled.loads.values()), axis=0)
        stacked = state.coupled.basis @ solve_machine_static(state.coupled, total).displacements
        stacked = stacked + state.coupled.offset
    except ModelError as error:
        return Outcome(
            detail="refused: see below", failures=(f"probes in pose {stage.pose}: {error}",)
        )
    found = {name: _respond(state, state.coupled, stacked, probe) for name, probe in probes.items()}
    return Outcome(detail=", ".join(probes), answers=(ProbeAnswer(stage.pose, found),))


def _respond(
    state: RunState, coupled: CoupledMachine, stacked: FloatArray, probe: Probe
) -> ProbeResponse:
    field = _component_field(state, coupled, stacked, probe.component)
    mesh, component = state.probe_meshes[probe.component], state.plan.components[probe.component]
    recovery = importlib.import_module(RECOVERY_MODULE)
    found = recovery.recover_at_points(mesh, component.material, field, np.array([probe.position]))
    turn = coupled.placements[probe.component].rotation
    return ProbeResponse(
        probe.component,
        turn @ found.displacement[0],
        turn @ found.stress[0] @ turn.T,
        float(found.jump[0]),
    )


def _component_field(
    state: RunState, coupled: CoupledMachine, stacked: FloatArray, name: str
) -> FloatArray:
    """Displacement ``(3 n_points,)`` of a component's mesh points in its own axes: reduced dofs and
    what they cannot show.
    """
    superelement = state.reduced[name].superelement
    if superelement.recovery is None:
        raise ModelError(
            f"component {name!r} was reduced without a recovery basis, so nothing can be recovered at its probes"
        )
    field = superelement.recovery.basis @ (
        turn_dofs(superelement, coupled.placements[name]) @ stacked[coupled.offsets[name]]
    )
    factors: dict[str, float] = {}
    for load in state.scene.machine.loads.values():
        if load.component == name:
            factors |= load_factors(coupled.layout, load)
    factors |= _gravity_factors(state.plan.gravity, coupled.placements[name])
    for key, factor in factors.items():
        particular = superelement.loads[key].particular
        if particular is not None and factor:
            field = field + factor * particular.ravel()
    return np.asarray(field)


def _gravity_factors(gravity: FloatArray | None, placement: Frame) -> dict[str, float]:
    if gravity is None:
        return {}
    own = placement.rotation.T @ np.asarray(gravity, dtype=float)
    return {f"{GRAVITY}:{axis}": float(value) for axis, value in zip("xyz", own, strict=True)}
