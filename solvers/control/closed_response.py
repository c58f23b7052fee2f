"""Frequency response of a machine under control: motions per load while the drives answer.

    H = R_oi - R_of (1 + L)^-1 C R_si

``R`` are receptances of the machine with free motors, from loads ``i`` and drive forces ``f`` to
motions ``o`` and what the controllers see ``s``; ``C`` is minus the force each controller answers
with, ``L = C R_sf``. Dead times are exact; so is structural damping.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop, close_loops
from headstock.solvers.control.drive_trains import FORCE, MOTOR, DriveTrain, measured_channel
from headstock.solvers.control.margins import answer_motions, take_off_anchors
from headstock.solvers.control.stability import (
    LoopPoles,
    find_loop_poles,
    has_free_motions,
    require_stable,
)
from headstock.solvers.linear.frequency_response import FrfModel, prepare_frf
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

CONTROLLED = "closed loops"


@dataclass(frozen=True, eq=False)
class ControlForces:
    """What drives under control add to the dynamic stiffness of a machine with free motors, in
    coordinates of which there are ``m``.

    Attributes:
        pushed: ``(m, n_drives)`` generalised load per drive force; motors move with its transpose.
        seen: ``(n_drives, m)`` what the controllers see.
    """

    trains: tuple[DriveTrain, ...]
    pushed: FloatArray
    seen: FloatArray

    def project(self, space: FloatArray) -> "ControlForces":
        """The same in other coordinates, by their directions ``(m, k)``."""
        return ControlForces(self.trains, space.T @ self.pushed, self.seen @ space)

    def dynamic_stiffness(self, omega: FloatArray) -> ComplexArray:
        """``(n_freq, m, m)``, not symmetric, at positive angular frequencies; without the springs
        that anchor motors.
        """
        motors = self.pushed.T
        anchors = np.array([train.anchor for train in self.trains])[:, None] * motors
        return self.pushed @ (answer_motions(self.trains, omega, self.seen, motors) - anchors)


def control_forces(system: SecondOrderSystem, trains: Sequence[DriveTrain]) -> ControlForces:
    """Return what the drives of a system from ``free_motors`` add to its dynamic stiffness."""
    pushed = input_columns(system, [(train.name, FORCE) for train in trains])
    measured = output_rows(system, [measured_channel(train) for train in trains])
    return ControlForces(tuple(trains), pushed, measured)


@dataclass(frozen=True, eq=False)
class ClosedResponse:
    """A machine under control, ready to be asked for its response.

    Attributes:
        free: With free motors: drive forces first among its inputs, what the controllers see and
            the motors first among its outputs.
        loop: The loops, with motions at its first outputs.
        found: Poles of the closed loops.
    """

    free: FrfModel
    trains: tuple[DriveTrain, ...]
    loop: ClosedLoop
    found: LoopPoles

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies."""
        count = len(self.trains)
        open_response = take_off_anchors(self.free.form.evaluate(omega), self.trains)
        measured, motors, moved = np.split(open_response, [count, 2 * count], axis=1)
        answers = answer_motions(self.trains, omega, measured, motors)
        forces = np.linalg.solve(np.eye(count) + answers[..., :count], answers[..., count:])
        return moved[..., count:] - moved[..., :count] @ forces

    def poles(self) -> ComplexArray:
        """Poles of the closed loops [rad/s]."""
        return self.found.poles


def prepare_closed_frf(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    modes: ModalResult | None = None,
) -> FrfModel:
    """Close the loops of all drives for a frequency response.

    Args:
        system: From ``free_motors``, with its damping.
        inputs: Where loads act.
        outputs: Where motion is wanted.
        modes: All undamped modes of the system, where they are already known.

    Raises:
        UnstableControlError: A pole grows, so that there is no steady response.
    """
    loop = close_loops(system, trains, inputs=inputs, outputs=outputs)
    poles = require_stable(system, trains, loop, find_loop_poles(loop))
    free = prepare_frf(
        system,
        inputs=[*((train.name, FORCE) for train in trains), *inputs],
        outputs=[
            *(measured_channel(train) for train in trains),
            *((train.name, MOTOR) for train in trains),
            *outputs,
        ],
        modes=modes,
    )
    return FrfModel(
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        form=ClosedResponse(free, tuple(trains), loop, poles),
        direct=free.direct,
        at_rest=find_rest(loop, outputs, inputs),
        coordinates=None,
        method=CONTROLLED,
    )


def find_rest(
    loop: ClosedLoop, outputs: Sequence[Channel], inputs: Sequence[Channel]
) -> FloatArray:
    """Return the motion at rest under loads or set positions ``(n_outputs, n_inputs)``; NaN where the
    machine floats.
    """
    if has_free_motions(loop):
        return np.full((len(outputs), len(inputs)), np.nan)
    space = loop.space.select(inputs, outputs)
    return space.d - space.c @ scipy.linalg.solve(space.a, space.b)
