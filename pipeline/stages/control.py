"""The control stage: loops closed around the machine in a pose, their poles, margins and tracking
error.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.pipeline.answers.control import (
    ClosedLoopDrive,
    ClosedLoopPole,
    ControlAnswer,
    GuardFrequency,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.machine import damp_system, warn_of_no_damping
from headstock.pipeline.stages.run_state import (
    Outcome,
    PoseModel,
    RunState,
    pose_model,
    pose_name,
)
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.scene.analyses.control import ControlRequest
from headstock.solvers.control.drive_loops import close_loops, find_velocity_lag
from headstock.solvers.control.drive_trains import MOTOR, DriveTrain
from headstock.solvers.control.margins import find_margins
from headstock.solvers.control.stability import LoopPoles, find_loop_poles, require_stable
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest
from headstock.solvers.second_order import SecondOrderSystem

ROUNDOFF = 1e-12  # of a stiffness that weight and anchors are taken off, and of a lag
TINY = 1e-12  # damping ratio or share of a motion that counts as none
LEAST_HEIGHT, MOST_GUARDS = 0.2, 6  # of a resonance over the rigid machine; listed of each drive
MARGIN_REACH = 4.0  # margins are looked for up to so many times the highest requested pole


@dataclass(frozen=True, eq=False)
class DrivenMachine:
    """A machine in a pose with its motors let go.

    Attributes:
        released: The machine, undamped modes and all; its system as coupled.
        modes: All its undamped modes: the travel of each driven axis is one without frequency.
    """

    released: PoseModel
    modes: ModalResult
    system: SecondOrderSystem
    trains: tuple[DriveTrain, ...]

    @property
    def coupled(self) -> CoupledMachine:
        """The released machine of superelements.

        Raises:
            ValueError: It is a lumped mechanism.
        """
        if self.released.coupled is None:
            raise ValueError("a lumped mechanism has no superelements")
        return self.released.coupled


def drive_machine(model: PoseModel, warn: Callable[[str], None]) -> DrivenMachine:
    """Place the drives of a scene in the pose of a machine and let their motors go.

    Args:
        model: The machine, motors locked.
        warn: Called with what is to be said of it.
    """
    scene = model.parts.scene
    released = model.release(scene.drives.values())
    bare, modes = released.model.system, released.model.all_modes
    for message in warn_of_no_damping(scene, bare):
        warn(message)
    if released.weight is None:
        damped = damp_system(scene, bare, modes)
        return DrivenMachine(released.model, modes, damped, released.trains)
    # modal damping is that of the modes without weight, and none of the motors' travels, which are
    # the lowest modes
    left = bare.stiffness - released.weight
    left[np.abs(left) <= ROUNDOFF * np.abs(bare.stiffness)] = 0.0
    plain = dataclasses.replace(bare, stiffness=left)
    damped = dataclasses.replace(damp_system(scene, plain), stiffness=bare.stiffness)
    modes = dataclasses.replace(modes, rigid_count=len(released.trains))
    return DrivenMachine(released.model, modes, damped, released.trains)


def drive_along(model: PoseModel, position: float, warn: Callable[[str], None]) -> DrivenMachine:
    """The machine at a place of a path, with its motors free and its loops stable.

    Args:
        position: From the start of the path [m].
        warn: Called with what is to be said of it.

    Raises:
        UnstableControlError: A pole grows.
    """
    driven = drive_machine(model, warn)
    try:
        require_stable(driven.system, driven.trains)
    except UnstableControlError as error:
        raise UnstableControlError(
            f"{1e3 * position:.4g} mm along the path {error}",
            axis=error.axis,
            frequency_hz=error.frequency_hz,
        ) from error
    return driven


def run_control_stage(state: RunState, stage: Stage) -> Outcome:
    """Poles, margins and tracking error of the closed loops; an unstable one is a failure, and the
    run goes on.
    """
    if not state.is_root:
        return Outcome()
    request, pose = state.scene.analyses[ControlRequest], pose_name(stage)
    driven = drive_machine(pose_model(state), state.warn)
    trains = driven.trains
    loop = close_loops(driven.system, trains)
    poles = find_loop_poles(loop)
    if poles.limit_hz < request.up_to_hz:
        state.warn(
            f"control: poles are valid up to {poles.limit_hz:.4g} Hz only (dead time of the drives), and {request.up_to_hz:.4g} Hz"
            " are requested; lower up_to"
        )
    verdict = ""
    try:
        require_stable(driven.system, trains, loop, poles)
    except UnstableControlError as error:
        verdict = str(error)
        state.failures.append(f"control in pose {pose}: {error}")
    margins = find_margins(
        driven.system, trains, to_hz=MARGIN_REACH * request.up_to_hz, around_hz=poles.frequencies_hz
    )
    lags = {
        axis: find_velocity_lag(loop, axis)[0]
        for axis in dict.fromkeys(train.axis for train in trains)
    }
    drives = tuple(
        ClosedLoopDrive(train, item, _round_lag(train, lags[train.axis]) * request.speed)
        for train, item in zip(trains, margins, strict=True)
    )
    listed = list_poles(driven, poles, request.up_to_hz)
    answer = ControlAnswer(
        pose,
        request.up_to_hz,
        request.speed,
        listed,
        drives,
        verdict,
        positions=driven.released.pose.positions,
    )
    answer = _guard_frequencies(answer, driven, MARGIN_REACH * request.up_to_hz)
    return Outcome(
        detail=f"{len(listed)} poles, {'unstable: see below' if verdict else 'stable'}",
        answers=(answer,),
    )


def _round_lag(train: DriveTrain, lag: float) -> float:
    """Lag per speed [s]; zero where feed-forward leaves roundoff of what it takes off."""
    return lag if abs(lag) * (train.control.position_gain or 1.0) > ROUNDOFF else 0.0


def _guard_frequencies(
    answer: ControlAnswer, driven: DrivenMachine, up_to_hz: float
) -> ControlAnswer:
    """Add the natural frequencies that stand out of the response of each motor to its own force, with
    their ±.

    A mode that moves the motor by phi peaks at ``phi^2 / (2 zeta omega^2)``, and the rigid machine moves
    by ``sum phi_rigid^2 / omega^2``: their ratio is the height of the resonance.
    """
    system, modes = driven.system, keep_lowest(driven.modes, up_to_hz=up_to_hz)
    elastic = slice(modes.rigid_count, None)
    omega, shapes = 2.0 * np.pi * modes.frequencies_hz[elastic], modes.shapes[:, elastic]
    losses = np.zeros(len(omega))
    for matrix, scale in ((system.damping, omega), (system.hysteretic, omega**2)):
        if matrix is not None:
            losses += np.einsum("ik,ij,jk->k", shapes, matrix, shapes) / (2.0 * scale)
    names, errors = (
        driven.released.name_modes(modes).names,
        driven.released.estimate_mode_errors(modes),
    )
    guards, bounds = [], {}
    for train in driven.trains:
        moved = system.outputs[train.name, MOTOR] @ modes.shapes
        share = moved[elastic] ** 2 / max(
            float(moved[: modes.rigid_count] @ moved[: modes.rigid_count]), TINY
        )
        heights = share / (2.0 * np.maximum(losses, TINY))
        order = [int(k) for k in np.argsort(-heights, kind="stable")[:MOST_GUARDS]]
        for number, mode in enumerate((k for k in order if heights[k] > LEAST_HEIGHT), 1):
            guard = GuardFrequency(
                train.name,
                number,
                float(modes.frequencies_hz[elastic][mode]),
                float(losses[mode]),
                float(heights[mode]) if losses[mode] > TINY else None,
                names[modes.rigid_count + mode],
            )
            guards.append(guard)
            bounds[answer.guard_key(guard)] = errors[modes.rigid_count + mode]
    return dataclasses.replace(answer, guards=tuple(guards)).with_errors(bounds, "replace")


def list_poles(
    driven: DrivenMachine, poles: LoopPoles, up_to_hz: float
) -> tuple[ClosedLoopPole, ...]:
    """Poles up to a frequency, oscillating or not, and all that grow, with what moves in them."""
    shown = [int(i) for i in np.flatnonzero(np.abs(poles.poles) <= 2.0 * math.pi * up_to_hz)]
    shown += [index for index in poles.growing() if index not in shown]
    wanted = max((poles.modes[i] for i in shown), default=-1) + 1
    modes = driven.modes
    kept = dataclasses.replace(
        modes,
        frequencies_hz=modes.frequencies_hz[:wanted],
        shapes=modes.shapes[:, :wanted],
        residuals=modes.residuals[:wanted],
    )
    names = driven.released.name_modes(kept).names
    listed = []
    for index in shown:
        mode, pole = poles.modes[index], poles.poles[index]
        controlled = poles.frequencies_hz[index] == 0.0 or mode < modes.rigid_count
        listed.append(
            ClosedLoopPole(
                complex(pole),
                frequency_hz=float(poles.frequencies_hz[index]),
                damping_ratio=float(poles.damping_ratios[index]),
                drive=poles.drives[index],
                name=f"control of {poles.drives[index]}" if controlled else names[mode],
            )
        )
    return tuple(listed)
