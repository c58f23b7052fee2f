"""Loops of controllers with a step as they are: motions sampled, forces held, against the continuous
loops that stand for them in time.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.machine.drives import MEASURED, AxisControl, LinearBlock
from headstock.solvers.control.drive_loops import (
    force_channels,
    make_actuator,
    open_plant,
    plant_outputs,
    remove_anchors,
)
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.linear_blocks import connect_in_series, stack_blocks
from headstock.solvers.control.stability import LoopPoles
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem
from headstock.solvers.state_spaces.held_inputs import hold_inputs
from headstock.solvers.state_spaces.state_space import StateSpace

HELD_CYCLES = 0.5  # of the dead time of a controller with a step, which the held force brings
SAMPLES = 10.0  # of a period, from which a step follows a motion


@dataclass(frozen=True)
class SamplingDifference:
    """How far poles of continuous loops are from those of the sampled ones.

    Attributes:
        share: Largest distance over the size of a pole, up to a tenth of the sampling rate.
        hz: Size of that pole [Hz].
        up_to_hz: A tenth of the sampling rate [Hz].
        stable: Whether no motion of the sampled loops grows.
    """

    share: float
    hz: float
    up_to_hz: float
    stable: bool


def compare_sampled(
    system: SecondOrderSystem, trains: Sequence[DriveTrain], poles: LoopPoles
) -> SamplingDifference | None:
    """Compare the poles of loops with those of the sampled loops; None where no controller has a step,
    or they have different ones.

    Args:
        system: From ``free_motors``, with its damping.
        poles: Of the continuous loops.
    """
    steps = {train.control.law.step_s for train in trains}
    if len(steps) != 1 or steps == {0.0}:
        return None
    (step_s,) = steps
    sampled = _find_sampled_poles(system, tuple(trains), step_s)
    up_to_hz = 1.0 / (SAMPLES * step_s)
    near = poles.poles[np.abs(poles.poles) <= 2.0 * math.pi * up_to_hz]
    stable = bool((sampled.real <= 1e-9 * np.abs(sampled)).all())
    if not len(near):
        return SamplingDifference(0.0, 0.0, up_to_hz, stable)
    distances = np.abs(near[:, None] - sampled).min(axis=1) / np.abs(near)
    worst = int(np.argmax(distances))
    hz = float(np.abs(near[worst])) / (2.0 * math.pi)
    return SamplingDifference(float(distances[worst]), hz, up_to_hz, stable)


def _find_sampled_poles(
    system: SecondOrderSystem, trains: tuple[DriveTrain, ...], step_s: float
) -> ComplexArray:
    """Return ``ln(z) / T`` of the loops with motions sampled every T and forces held in between
    [rad/s].

    Source: Franklin, Powell and Workman (1998), section 4.3 (zero-order hold).
    """
    plant = remove_anchors(open_plant(system, trains), trains)
    plant = plant.select(force_channels(trains), plant_outputs(trains))
    split = [_split_control(train.control, step_s) for train in trains]
    law, actuators = (stack_blocks(blocks) for blocks in zip(*split, strict=True))
    held = hold_inputs(_drive_plant(plant, actuators), step_s)
    whole = np.block(
        [
            [held.a + held.b @ law.d @ held.c, held.b @ law.c],
            [law.b @ held.c, law.a],
        ]
    )
    values = scipy.linalg.eigvals(whole, check_finite=False)
    return np.log(values[np.abs(values) > 0.0] + 0j) / step_s


def _split_control(control: AxisControl, step_s: float) -> tuple[LinearBlock, LinearBlock]:
    """Return what a controller computes at its step, from measured position and motor speed to the force
    that it holds, and what is between this and the force of the motor.
    """
    errors, law = control.errors[:, MEASURED:], control.law
    computed = LinearBlock(law.a, law.b @ errors, law.c, law.d @ errors)
    filters = [*control.filters]
    while filters and filters[0].step_s == step_s:
        computed = connect_in_series(computed, filters.pop(0))
    late = max(control.dead_time - HELD_CYCLES * step_s, 0.0)
    rest = dataclasses.replace(control, filters=tuple(filters), dead_time=late)
    return computed, make_actuator(rest)


def _drive_plant(plant: StateSpace, actuators: LinearBlock) -> StateSpace:
    """Return a plant behind its actuators: what is held goes in, what controllers read comes out,
    positions of encoders and speeds of motors, drive by drive.
    """
    count = actuators.d.shape[1]
    read = np.stack([plant.c[:count], plant.c[count : 2 * count] @ plant.a], axis=1)
    rows = read.reshape(2 * count, -1)
    a = np.block(
        [
            [plant.a, plant.b @ actuators.c],
            [np.zeros((len(actuators.a), len(plant.a))), actuators.a],
        ]
    )
    return StateSpace(
        a,
        np.vstack([plant.b @ actuators.d, actuators.b]),
        np.hstack([rows, np.zeros((2 * count, len(actuators.a)))]),
        np.zeros((2 * count, count)),
        plant.inputs,
        tuple(("read", str(number)) for number in range(2 * count)),
        tuple(map(str, range(len(a)))),
    )
