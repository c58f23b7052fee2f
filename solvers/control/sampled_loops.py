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
    ENCODER,
    force_channels,
    make_actuator,
    open_plant,
    plant_outputs,
    remove_anchors,
)
from headstock.solvers.control.drive_trains import FORCE, MOTOR, SLIDE, DriveTrain
from headstock.solvers.control.linear_blocks import connect_in_series, stack_blocks
from headstock.solvers.control.stability import LoopPoles
from headstock.solvers.second_order import Channel, ComplexArray, SecondOrderSystem
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.solvers.state_spaces.transient import Sampling

HELD_CYCLES = 0.5  # of the dead time of a controller with a step, which the held force brings
FORGOTTEN = 1e-12  # of a state after a sample: none
SAMPLES = 10.0  # of a period, from which a step follows a motion


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """A machine under control of controllers with a step.

    Attributes:
        space: Between samples. Inputs: the loads. Outputs: as ``ClosedLoop`` has them.
        samples: What the controllers do to its states.
    """

    space: StateSpace
    samples: Sampling


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
    loop = sample_loops(system, trains)
    if loop is None:
        return None
    step_s, sampled = loop.samples.step_s, _find_sampled_poles(loop)
    up_to_hz = 1.0 / (SAMPLES * step_s)
    near = poles.poles[np.abs(poles.poles) <= 2.0 * math.pi * up_to_hz]
    stable = bool((sampled.real <= 1e-9 * np.abs(sampled)).all())
    if not len(near):
        return SamplingDifference(0.0, 0.0, up_to_hz, stable)
    distances = np.abs(near[:, None] - sampled).min(axis=1) / np.abs(near)
    worst = int(np.argmax(distances))
    hz = float(np.abs(near[worst])) / (2.0 * math.pi)
    return SamplingDifference(float(distances[worst]), hz, up_to_hz, stable)


def _find_sampled_poles(loop: SampledLoop) -> ComplexArray:
    """Return ``ln(z) / T`` of sampled loops [rad/s].

    Source: Franklin, Powell and Workman (1998), section 4.3 (zero-order hold).
    """
    samples = loop.samples
    moved = samples.jump @ scipy.linalg.expm(loop.space.a * samples.step_s)
    values = scipy.linalg.eigvals(moved, check_finite=False)
    # what is held has no memory of its own
    return np.log(values[np.abs(values) > FORGOTTEN] + 0j) / samples.step_s


def sample_loops(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    *,
    inputs: Sequence[Channel] = (),
    outputs: Sequence[Channel] = (),
    up_to_hz: float | None = None,
) -> SampledLoop | None:
    """Return loops whose controllers sample and hold, set points at rest; None where no controller has a
    step, or they have different ones.

    Args:
        system: From ``free_motors``, with its damping.
        inputs: Where loads act.
        outputs: Where motion is wanted.
        up_to_hz: Keep machine modes up to here, the others statically; None keeps all.
    """
    trains, steps = tuple(trains), {train.control.law.step_s for train in trains}
    if len(steps) != 1 or steps == {0.0}:
        return None
    (step_s,) = steps
    plant = open_plant(system, trains, inputs=inputs, outputs=outputs, up_to_hz=up_to_hz)
    plant = remove_anchors(plant, trains).select(
        (*force_channels(trains), *inputs), (*outputs, *plant_outputs(trains))
    )
    split = [_split_control(train.control, step_s) for train in trains]
    law, actuators = (stack_blocks(blocks) for blocks in zip(*split, strict=True))
    return _hold_forces(plant, actuators, law, trains, len(outputs), step_s)


def _hold_forces(
    plant: StateSpace,
    actuators: LinearBlock,
    law: LinearBlock,
    trains: tuple[DriveTrain, ...],
    asked: int,
    step_s: float,
) -> SampledLoop:
    """Connect a plant, forces first among its inputs, with what is between a held force and a motor,
    and with the law that is computed at samples.

    Args:
        asked: Outputs of the plant before what closes the loops.
    """
    count, size, late, kept = len(trains), len(plant.a), len(actuators.a), len(law.a)
    push, load = plant.b[:, :count], plant.b[:, count:]
    # states of the plant, of the actuators, forces held, states of the law
    forces = np.hstack([np.zeros((count, size)), actuators.c, actuators.d, np.zeros((count, kept))])
    rows = np.hstack([plant.c, np.zeros((len(plant.c), late + count + kept))])
    rows = np.vstack([rows + plant.d[:, :count] @ forces, forces])
    direct = np.vstack([plant.d[:, count:], np.zeros((count, load.shape[1]))])
    total = size + late + count + kept
    a = np.zeros((total, total))
    a[:size] = push @ forces
    a[:size, :size] += plant.a
    a[size : size + late, size : size + late + count] = np.hstack([actuators.a, actuators.b])
    b = np.zeros((total, load.shape[1]))
    b[:size] = load
    # displacements have no load in their first derivative
    motors = slice(asked + count, asked + 2 * count)
    speeds = np.zeros((count, total))
    speeds[:, :size] = plant.c[motors] @ plant.a
    read = np.stack([rows[asked : asked + count], speeds], axis=1).reshape(2 * count, -1)
    seen = np.stack([direct[asked : asked + count], 0.0 * direct[motors]], axis=1)
    held, states = slice(size + late, size + late + count), slice(size + late + count, total)
    jump, fed = np.eye(total), np.zeros_like(b)
    jump[held], jump[states] = law.d @ read, law.b @ read
    jump[held, states] += law.c
    jump[states, states] += law.a
    fed[held], fed[states] = (part @ seen.reshape(2 * count, -1) for part in (law.d, law.b))
    names = tuple((train.name, what) for what in (ENCODER, MOTOR, SLIDE, FORCE) for train in trains)
    space = StateSpace(
        a,
        b,
        rows,
        direct,
        plant.inputs[count:],
        (*plant.outputs[:asked], *names),
        (*plant.states, *(f"control {number + 1}" for number in range(total - size))),
    )
    return SampledLoop(space, Sampling(jump, fed, step_s))


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
