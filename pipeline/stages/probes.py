"""The stage that recovers displacement and stress at probes from the static loads of a pose."""

import importlib

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Probe
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.results.static import ProbeAnswer, ProbeResponse
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.coupling.ports import GRAVITY, load_factors
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.solvers.errors import ModelError

# loaded only where a scene has probes: it needs the element library, which takes most of a second to import
RECOVERY_MODULE = "headstock.solvers.elastic.stress_recovery"


def run_recover_stage(state: RunState, stage: Stage) -> Outcome:
    """Displacement and stress at every probe under all static loads together; a mechanism is refused."""
    if not state.is_root or state.coupled is None or stage.pose is None:
        return Outcome()
    probes = state.scene.machine.probes
    try:
        total = np.sum(list(state.coupled.loads.values()), axis=0)
        stacked = state.coupled.basis @ solve_machine_static(state.coupled, total).displacements
    except ModelError as error:
        return Outcome(detail="refused: see below", failures=(f"probes in pose {stage.pose}: {error}",))
    found = {name: _respond(state, state.coupled, stacked, probe) for name, probe in probes.items()}
    return Outcome(detail=", ".join(probes), answers=(ProbeAnswer(stage.pose, found),))


def _respond(state: RunState, coupled: CoupledMachine, stacked: FloatArray, probe: Probe) -> ProbeResponse:
    field = _component_field(state, coupled, stacked, probe.component)
    mesh, component = state.probe_meshes[probe.component], state.plan.components[probe.component]
    recovery = importlib.import_module(RECOVERY_MODULE)
    found = recovery.recover_at_points(mesh, component.material, field, np.array([probe.position]))
    turn = coupled.placements[probe.component].rotation
    return ProbeResponse(probe.component, turn @ found.displacement[0], turn @ found.stress[0] @ turn.T, float(found.jump[0]))


def _component_field(state: RunState, coupled: CoupledMachine, stacked: FloatArray, name: str) -> FloatArray:
    """Displacement ``(3 n_points,)`` of a component's mesh points in its own axes: reduced dofs and what they cannot show."""
    superelement = state.reduced[name].superelement
    if superelement.recovery is None:
        raise ModelError(f"component {name!r} was reduced without a recovery basis, so nothing can be recovered at its probes")
    field = superelement.recovery.basis @ (turn_dofs(superelement, coupled.placements[name]) @ stacked[coupled.offsets[name]])
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
