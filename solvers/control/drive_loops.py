"""Position and velocity control closed around a machine with free motors: a linear system from set
points to motions.

    F = lag(dead time(filters(law(errors) + m_f a_set)))

where errors are weighted sums of what is set and measured; in a cascade of P position and PI velocity
control

    error = kv (x_set - x_measured) + f_v v_set - v_motor
    law   = kp error + kp / T_n  integral(error)

The machine is linear about its pose; the travel of an axis is a free coordinate of it, so that set
points may be as large as the pose allows. The loop is continuous: sampling counts as a dead time of
one cycle of computing and half a cycle of hold. At constant speed a controlled axis lags behind its
set point by a constant.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import (
    CONTROL_INPUTS,
    MEASURED,
    MOTOR_SPEED,
    SET_ACCELERATION,
    AxisControl,
    LinearBlock,
)
from headstock.solvers.control.drive_trains import FORCE, MOTOR, SLIDE, DriveTrain, measured_channel
from headstock.solvers.control.linear_blocks import (
    connect_in_series,
    make_dead_time,
    stack_blocks,
    to_continuous,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.state_space import StateSpace, to_state_space

SET_POINTS = ("position", "velocity", "acceleration")
ENCODER = "encoder"


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A machine under control.

    Attributes:
        space: Inputs: ``(axis, "position" | "velocity" | "acceleration")`` of every driven axis,
            then the loads. Outputs: those asked for, then ``(drive, "encoder")``, ``(drive,
            "motor")``, ``(drive, "slide")`` and ``(drive, "force")`` of each drive.
        plant_size: How many states are the machine's, the first ones.
        rates: ``(n_drives, n)`` velocity of each motor per state.
        plant: The machine with free motors.
    """

    space: StateSpace
    trains: tuple[DriveTrain, ...]
    plant_size: int
    rates: FloatArray
    plant: StateSpace


def close_loops(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    *,
    inputs: Sequence[Channel] = (),
    outputs: Sequence[Channel] = (),
    up_to_hz: float | None = None,
) -> ClosedLoop:
    """Close the loops of all drives.

    Args:
        system: From ``free_motors``, with its damping.
        inputs: Where loads act.
        outputs: Where motion is wanted.
        up_to_hz: Keep machine modes up to here, the others statically; None keeps all.

    Raises:
        ModelError: A channel is unknown.
    """
    plant = open_plant(system, trains, inputs=inputs, outputs=outputs, up_to_hz=up_to_hz)
    return close_plant(plant, trains, inputs, outputs)


def open_plant(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    *,
    inputs: Sequence[Channel] = (),
    outputs: Sequence[Channel] = (),
    up_to_hz: float | None = None,
) -> StateSpace:
    """The machine between drive forces with loads, and the motions that are wanted with those that
    controllers see.

    Args:
        system: From ``free_motors``.
        inputs: Where loads act.
        outputs: Where motion is wanted.
        up_to_hz: Keep machine modes up to here, the others statically; None keeps all.
    """
    return to_state_space(
        system,
        inputs=[*force_channels(trains), *inputs],
        outputs=[*outputs, *plant_outputs(trains)],
        up_to_hz=up_to_hz,
    )


def force_channels(trains: Iterable[DriveTrain]) -> tuple[Channel, ...]:
    """Forces of drives: inputs of a plant, outputs of a closed loop."""
    return tuple((train.name, FORCE) for train in trains)


def plant_outputs(trains: Sequence[DriveTrain]) -> tuple[Channel, ...]:
    """Outputs of a plant that close its loops: what controllers read, then motors, then slides."""
    measured = (measured_channel(train) for train in trains)
    return (*measured, *((train.name, what) for what in (MOTOR, SLIDE) for train in trains))


def close_plant(
    plant: StateSpace,
    trains: Sequence[DriveTrain],
    inputs: Sequence[Channel] = (),
    outputs: Sequence[Channel] = (),
) -> ClosedLoop:
    """Close the loops of all drives around a plant made for them.

    Args:
        plant: With ``force_channels`` among its inputs, ``plant_outputs`` among its outputs.
        inputs: Where loads act; two on one channel stand once.
        outputs: Where motion is wanted.
    """
    trains, inputs = tuple(trains), tuple(dict.fromkeys(inputs))
    # from here on forces of drives stand first, and what closes the loops last
    plant = plant.select((*force_channels(trains), *inputs), (*outputs, *plant_outputs(trains)))
    plant = remove_anchors(plant, trains)
    control = stack_blocks([make_controller(train.control) for train in trains])
    return ClosedLoop(
        space=_feed_back(plant, control, trains, inputs, tuple(outputs)),
        trains=trains,
        plant_size=len(plant.a),
        rates=np.hstack(
            [_motor_rates(plant, trains, len(outputs)), np.zeros((len(trains), len(control.a)))]
        ),
        plant=plant,
    )


def remove_anchors(plant: StateSpace, trains: tuple[DriveTrain, ...]) -> StateSpace:
    """The plant without the springs that anchor its motors: forces ``k x`` of motors that move by
    ``x``.
    """
    springs = np.diag([train.anchor for train in trains])
    if not springs.any():
        return plant
    count = len(trains)
    forces, motors = slice(0, count), slice(-2 * count, -count)
    # x = c q + d (k x + u) of the motors, where modes left out act at once
    gain = springs @ np.linalg.inv(np.eye(count) - plant.d[motors, forces] @ springs)
    by_state, by_load = gain @ plant.c[motors], gain @ plant.d[motors]
    return dataclasses.replace(
        plant,
        a=plant.a + plant.b[:, forces] @ by_state,
        b=plant.b + plant.b[:, forces] @ by_load,
        c=plant.c + plant.d[:, forces] @ by_state,
        d=plant.d + plant.d[:, forces] @ by_load,
        pairs=None,
    )


def make_controller(control: AxisControl) -> LinearBlock:
    """A controller in continuous time: inputs are set position, velocity, acceleration, measured
    position and motor velocity, the output a force.
    """
    law, forward = to_continuous(control.law), np.zeros((1, CONTROL_INPUTS))
    forward[0, SET_ACCELERATION] = control.acceleration_feed_forward
    block = LinearBlock(law.a, law.b @ control.errors, law.c, law.d @ control.errors + forward)
    return connect_in_series(block, make_actuator(control))


def make_actuator(control: AxisControl) -> LinearBlock:
    """Return what a force passes behind the law of its controller, in continuous time: filters, dead time
    and current loop.
    """
    block = LinearBlock.gain(1.0)
    for further in (*map(to_continuous, control.filters), make_dead_time(control.dead_time)):
        block = connect_in_series(block, further)
    if control.current_lag > 0.0:
        rate = 1.0 / control.current_lag
        lag = LinearBlock(
            np.array([[-rate]]), np.array([[rate]]), np.ones((1, 1)), np.zeros((1, 1))
        )
        block = connect_in_series(block, lag)
    return block


def _motor_rates(plant: StateSpace, trains: tuple[DriveTrain, ...], asked: int) -> FloatArray:
    """Velocity of each motor per state of the plant: displacement rows have no load in their first
    derivative.
    """
    first = asked + len(trains)
    return plant.c[first : first + len(trains)] @ plant.a


def _feed_back(
    plant: StateSpace,
    control: LinearBlock,
    trains: tuple[DriveTrain, ...],
    inputs: tuple[Channel, ...],
    outputs: tuple[Channel, ...],
) -> StateSpace:
    count, asked = len(trains), len(outputs)
    to_forces, to_loads = slice(0, count), slice(count, None)
    rows_read = asked + np.arange(count)
    # what the controllers see: position, then velocity, of each drive; their inputs come five by
    # five
    read = np.vstack([plant.c[rows_read], _motor_rates(plant, trains, asked)])
    seen_d = np.vstack([plant.d[rows_read], np.zeros((count, plant.d.shape[1]))])
    first = CONTROL_INPUTS * np.arange(count)
    measured = np.concatenate([first + MEASURED, first + MOTOR_SPEED])
    # from set points of the axes to controllers: one axis may have two drives
    axes = dict.fromkeys(train.axis for train in trains)
    driven = np.array([[float(train.axis == axis) for axis in axes] for train in trains])
    spread = np.kron(driven.reshape(count, len(axes)), np.eye(CONTROL_INPUTS, len(SET_POINTS)))
    direct = control.d[:, measured]
    # forces act at once on what the controllers measure, and these at once on forces: an algebraic
    # loop. It is solved here, so that force = gains @ (states, control states, set points, loads)
    # and no force is an input any more
    loop = np.eye(count) - direct @ seen_d[:, to_forces]
    pushed = np.hstack([direct @ read, control.c, control.d @ spread, direct @ seen_d[:, to_loads]])
    gains = np.linalg.solve(loop, pushed)
    size, dim, sets = len(plant.a), len(control.a), spread.shape[1]
    # measured = (states, control states, set points, loads)
    view = (
        np.hstack([read, np.zeros((2 * count, dim + sets)), seen_d[:, to_loads]])
        + seen_d[:, to_forces] @ gains
    )
    open_plant = np.hstack([plant.a, np.zeros((size, dim + sets)), plant.b[:, to_loads]])
    open_control = np.hstack(
        [np.zeros((dim, size)), control.a, control.b @ spread, np.zeros((dim, len(inputs)))]
    )
    open_outputs = np.hstack([plant.c, np.zeros((len(plant.c), dim + sets)), plant.d[:, to_loads]])
    rows = np.vstack(
        [open_plant + plant.b[:, to_forces] @ gains, open_control + control.b[:, measured] @ view]
    )
    outs = np.vstack([open_outputs + plant.d[:, to_forces] @ gains, gains])
    states = (*plant.states, *(f"control {number + 1}" for number in range(dim)))
    names = tuple((train.name, what) for what in (ENCODER, MOTOR, SLIDE, FORCE) for train in trains)
    split = size + dim
    return StateSpace(
        rows[:, :split],
        rows[:, split:],
        outs[:, :split],
        outs[:, split:],
        (*set_channels(trains), *inputs),
        (*outputs, *names),
        states,
    )


def set_channels(trains: Sequence[DriveTrain]) -> tuple[Channel, ...]:
    """Set points of every driven axis."""
    return tuple(
        (axis, kind)
        for axis in dict.fromkeys(train.axis for train in trains)
        for kind in SET_POINTS
    )


def find_velocity_lag(loop: ClosedLoop, axis: str) -> tuple[float, dict[Channel, float]]:
    """Steady lag of an axis that moves at 1 m/s.

    At constant speed the states follow ``x = X1 t + X0`` with ``A X1 + B_p = 0`` and ``A X0 + B_v =
    X1``: exact, no time run.

    Args:
        loop: A stable closed loop, no more motions free than its drives hold.

    Returns:
        Set point less measured position [s], and what each output does beyond what it does per
        metre of travel at rest [s].
    """
    space = loop.space
    position, velocity = (space.inputs.index((axis, kind)) for kind in ("position", "velocity"))
    travel = -np.linalg.solve(space.a, space.b[:, position])
    steady = np.linalg.solve(space.a, travel - space.b[:, velocity])
    moved: FloatArray = space.c @ steady + space.d[:, velocity]
    train = next(train for train in loop.trains if train.axis == axis)
    shown = {channel: float(value) for channel, value in zip(space.outputs, moved, strict=True)}
    return -shown[train.name, ENCODER], shown
