"""The stages that work on the coupled machine: couple, static, modal. Only rank 0 has anything to do.

The damping a scene names, and no other, in a coupled machine.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import position_units
from headstock.geometry.mechanisms.tool_mechanism import solve_pose
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.results.estimates import Estimate
from headstock.pipeline.results.results import PointCompliance, PoseModes, describe_state
from headstock.pipeline.results.views import component_skin, shift_skins, view_pose
from headstock.pipeline.stages.estimates import estimate_compliance_errors, estimate_mode_errors
from headstock.pipeline.stages.run_state import Outcome, PoseMotions, RunState
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.damping_errors import estimate_damping_errors
from headstock.reduction.motions.body_motions import FreeMotion, find_free_motions, solve_machine_static, warn_of_free_motions
from headstock.reduction.motions.compliance_budget import find_weakest_link, point_budget
from headstock.reduction.motions.mode_naming import name_modes
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damped_modes import damping_of_undamped, solve_damped
from headstock.solvers.linear.damping import add_modal_damping, equivalent_viscous
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest, solve_modal
from headstock.solvers.second_order import SecondOrderSystem

DAMPING = "damping"
UNSTABLE = 1e-9
AT_REST = 1e-6  # of the lowest elastic frequency
LARGE_ERROR = 0.5  # of a damping ratio
NO_DAMPING = 1e-9  # a damping ratio: roundoff


def solve_all_modes(state: RunState, system: SecondOrderSystem) -> ModalResult:
    """All undamped modes of a coupled system, once for the analyses of a pose that need them."""
    if state.all_modes is None or state.all_modes[0] is not system:
        state.all_modes = (system, solve_modal(system))
    return state.all_modes[1]


def damp_system(state: RunState, system: SecondOrderSystem, modes: ModalResult | None = None) -> SecondOrderSystem:
    """The system with the damping of the scene: none unless the effect is named; modal ratios on top of joints and materials.

    Args:
        state: Of the run.
        system: As coupled, with what joints and materials bring.
        modes: All undamped modes, where they are already known.
    """
    if DAMPING not in state.scene.effects:
        return dataclasses.replace(system, damping=None, hysteretic=None)
    if state.scene.modal_damping:
        return add_modal_damping(system, state.scene.modal_damping, modes)
    if system.damping is None and system.hysteretic is None:
        state.warn("the effect damping is on, but no joint and no material has any: every damping ratio is zero")
    return system


def run_couple_stage(state: RunState, stage: Stage) -> Outcome:
    """Couple the superelements in a pose."""
    if not state.is_root:
        return Outcome()
    superelements = {name: state.reduced[name].superelement for name in state.plan.components}
    pose = state.plan.poses[_pose_name(stage)]
    state.coupled = couple(superelements, state.scene.machine, pose, gravity=state.plan.gravity)
    for message in state.coupled.warnings:
        state.warn(message)
    state.skins = {
        name: component_skin(state.plan.components[name], part.superelement, part.skin) for name, part in state.reduced.items()
    }
    state.views[pose.name] = view_pose(state.coupled, state.scene.machine)
    if state.scene.mechanism is not None:
        state.mechanism[pose.name] = describe_state(state.scene.mechanism, solve_pose(state.scene.mechanism, pose.positions))
    return Outcome(detail=f"{len(state.coupled.system.labels)} dofs")


def run_static_stage(state: RunState, stage: Stage) -> Outcome:
    """Compliance and its budget at every point asked for; a mechanism is refused, and the run goes on."""
    if not state.is_root:
        return Outcome()
    coupled, request = _coupled(state), state.scene.analyses.static
    if request is None:
        raise ValueError("a static stage needs a static analysis in the scene")
    try:
        points = {name: _point_compliance(state, coupled, name) for name in request.at}
    except ModelError as error:
        state.failures.append(f"static analysis in pose {stage.pose}: {error}")
        return Outcome(detail="refused: see below")
    state.static[_pose_name(stage)] = points
    motions = {
        f"{name} {direction}": coupled.basis @ solve_machine_static(coupled, coupled.system.inputs[name, direction]).displacements
        for name, point in points.items()
        for axis, direction in enumerate(DIRECTIONS)
        if not np.isnan(point.compliance[axis, axis])
    }
    _motions(state, stage, coupled).motions.update(motions)
    pushes = {push: shift_skins(coupled, state.skins, stacked[:, None]) for push, stacked in motions.items()}
    _add_to_view(state, stage, pushes={push: {name: one[0] for name, one in shifts.items()} for push, shifts in pushes.items()})
    return Outcome(detail=f"{', '.join(points)}")


def run_modal_stage(state: RunState, stage: Stage) -> Outcome:
    """Natural modes with names and energy shares."""
    if not state.is_root:
        return Outcome()
    coupled, request = _coupled(state), state.scene.analyses.modal
    if request is None:
        raise ValueError("a modal stage needs a modal analysis in the scene")
    # damping may couple every mode with every other
    complete = solve_all_modes(state, coupled.system) if DAMPING in state.scene.effects else None
    if complete is None:
        result = solve_modal(coupled.system, count=request.count, up_to_hz=request.up_to_hz)
    else:
        result = keep_lowest(complete, count=request.count, up_to_hz=request.up_to_hz)
    named = name_modes(coupled, result)
    errors = estimate_mode_errors(state, coupled, result)
    damping = _Damping() if complete is None else _damp_modes(state, coupled, complete, named.names, errors)
    stacked = coupled.basis @ result.shapes
    count = len(result.frequencies_hz)
    unexpected = _undeclared(state, find_free_motions(coupled)) if result.rigid_count else ()
    if unexpected:
        state.warn(warn_of_free_motions(unexpected))
    state.modal.append(
        PoseModes(
            pose=state.plan.poses[_pose_name(stage)],
            pose_units=position_units(state.scene.machine),
            frequencies_hz=result.frequencies_hz,
            rigid_count=min(result.rigid_count, count),
            errors=errors,
            damping_ratio=damping.ratios or (None,) * count,
            damped_hz=damping.frequencies_hz or (None,) * count,
            damping_error=damping.ratio_errors,
            damped_error_hz=damping.frequency_errors_hz,
            mode_names=named.names,
            energy_share=named.strain_shares,
            kinetic_share=named.kinetic_shares,
            shapes=stacked,
            placements=dict(coupled.placements),
        )
    )
    _motions(state, stage, coupled)
    _add_to_view(state, stage, shifts=shift_skins(coupled, state.skins, stacked))
    span = f"{result.frequencies_hz[0]:.4g} .. {result.frequencies_hz[-1]:.4g} Hz" if count else "none in the range"
    return Outcome(detail=f"{count} modes, {span}")


def _motions(state: RunState, stage: Stage, coupled: CoupledMachine) -> PoseMotions:
    """What is kept of the motions of a pose."""
    return state.motions.setdefault(_pose_name(stage), PoseMotions(coupled.offsets))


def _add_to_view(state: RunState, stage: Stage, **fields: Any) -> None:
    pose = _pose_name(stage)
    state.views[pose] = dataclasses.replace(state.views[pose], **fields)


@dataclass(frozen=True)
class _Damping:
    """Damping ratios and damped frequencies [Hz] of the first undamped modes, and how far each may be off; empty without damping."""

    ratios: tuple[float | None, ...] = ()
    frequencies_hz: tuple[float | None, ...] = ()
    ratio_errors: tuple[float | None, ...] = ()
    frequency_errors_hz: tuple[float | None, ...] = ()


def _damp_modes(
    state: RunState, coupled: CoupledMachine, complete: ModalResult, names: tuple[str, ...], undamped: tuple[Estimate, ...]
) -> _Damping:
    """Damping of the first undamped modes, of which names and errors are given."""
    count = len(names)
    viscous = equivalent_viscous(damp_system(state, coupled.system, complete), complete)
    damped = solve_damped(viscous, complete, lowest=count)
    # a rigid motion that a damper resists comes to rest anywhere: a pole that is zero but for roundoff
    elastic = complete.frequencies_hz[complete.rigid_count :]
    slowest = AT_REST * 2.0 * np.pi * float(elastic[0]) if len(elastic) else 0.0
    for pole, growing_hz in zip(damped.poles, damped.frequencies_hz, strict=True):
        if pole.real > UNSTABLE * abs(pole) and pole.real > slowest:
            state.warn(
                f"a motion near {growing_hz:.4g} Hz grows by itself: its damping is negative; check the signs of the joints' damping"
            )
    ratios, frequencies = damping_of_undamped(damped, count)
    ratios = tuple(0.0 if ratio is not None and abs(ratio) < NO_DAMPING else ratio for ratio in ratios)
    found = estimate_damping_errors(coupled, viscous, damped, count)
    ratio_errors, frequency_errors = list(found.ratios), list(found.frequencies_hz)
    given = bool(state.scene.modal_damping) and coupled.system.damping is None and coupled.system.hysteretic is None
    guesses: dict[str, list[str]] = {}
    creeping: dict[str, list[str]] = {}
    for mode in range(complete.rigid_count, count):
        error, ratio, hz = undamped[mode].total, ratios[mode], frequencies[mode]
        if error is None or hz is None:
            ratio_errors[mode] = frequency_errors[mode] = None
        else:
            least = error * hz / float(complete.frequencies_hz[mode])
            known = frequency_errors[mode]
            frequency_errors[mode] = None if known is None else max(known, least)
        if ratio is not None and (given or not ratio):
            ratio_errors[mode] = 0.0
        ratio_error, words = ratio_errors[mode], f"{mode + 1} ({names[mode]})"
        if found.creeping[mode]:
            creeping.setdefault(found.dampers[mode], []).append(words)
        elif error is not None and (ratio is None or ratio_error is None or ratio_error > LARGE_ERROR * abs(ratio)):
            guesses.setdefault(found.dampers[mode], []).append(words)
    for damper, modes in guesses.items():
        state.warn(
            f"damping{_by(damper)} of mode {', '.join(modes)} is not converged: damping ratio and damped frequency are no more than rough "
            "guesses; write a higher reduction.modes_to or a smaller mesh size. Where that moves them on and on, the damper swallows the "
            "waves that reach it, and there is no such mode"
        )
    for damper, modes in creeping.items():
        state.warn(
            f"mode {', '.join(modes)} is overdamped{_by(damper)}: it creeps back without oscillating; check the damping if that is not meant"
        )
    return _Damping(ratios, frequencies, tuple(ratio_errors), tuple(frequency_errors))


def _by(damper: str) -> str:
    return f" by {damper}" if damper else ""


def _point_compliance(state: RunState, coupled: CoupledMachine, name: str) -> PointCompliance:
    found = point_budget(coupled, name)
    along = np.diag(found.compliance)[:3]
    softest = DIRECTIONS[int(np.nanargmax(along))]
    link = find_weakest_link(coupled, name, softest, found)
    errors = estimate_compliance_errors(state, coupled, found.displacements)
    errors |= {direction: Estimate() for direction, value in zip(DIRECTIONS, along, strict=True) if np.isnan(value)}
    free = find_free_motions(coupled) if found.free else ()
    if free:
        state.warn(warn_of_free_motions(_undeclared(state, free) or free))
    sentence = "" if link is None else str(link)
    return PointCompliance(
        found.compliance, found.shares, sentence, _displacement(state, coupled, name), errors, tuple(map(str, free))
    )


def _displacement(state: RunState, coupled: CoupledMachine, name: str) -> FloatArray | None:
    """Motion ``(6,)`` of a point under all static loads together, NaN where a free motion leaves it open; None without an answer."""
    if not coupled.loads:
        return None
    try:
        found = solve_machine_static(coupled, np.sum(list(coupled.loads.values()), axis=0))
    except ModelError as error:
        message = f"displacements under the loads {', '.join(coupled.loads)}: {error}"
        if message not in state.failures:
            state.failures.append(message)
        return None
    rows = np.array([coupled.system.outputs[name, dof] for dof in DOF_NAMES])
    return np.where(found.determines(rows), rows @ found.displacements, np.nan)


def _undeclared(state: RunState, motions: Sequence[FreeMotion]) -> tuple[FreeMotion, ...]:
    """Those of the free motions in which not every body is declared free."""
    components = state.plan.components
    return tuple(motion for motion in motions if not motion.bodies or not all(components[name].free for name in motion.bodies))


def _coupled(state: RunState) -> CoupledMachine:
    if state.coupled is None:
        raise ValueError("an analysis needs a coupled machine before it")
    return state.coupled


def _pose_name(stage: Stage) -> str:
    if stage.pose is None:
        raise ValueError(f"a {stage.kind} stage needs a pose")
    return stage.pose
