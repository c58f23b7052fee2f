"""How far a controlled axis lags behind its set point at constant speed."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ENCODER, ClosedLoop
from headstock.solvers.second_order import Port


def find_velocity_lag(loop: ClosedLoop, axis: str) -> tuple[float, dict[Port, float]]:
    """Steady lag of an axis that moves at 1 m/s.

    At constant speed the states follow ``x = X1 t + X0`` with ``A X1 + B_p = 0`` and ``A X0 + B_v = X1``: exact, no time run.

    Args:
        loop: A stable closed loop, no more motions free than its drives hold.
        axis: The axis.

    Returns:
        Set point less measured position [s], and what each output does beyond what it does per metre of travel at rest [s].
    """
    space = loop.space
    position, velocity = (space.inputs.index((axis, kind)) for kind in ("position", "velocity"))
    travel = -np.linalg.solve(space.a, space.b[:, position])
    steady = np.linalg.solve(space.a, travel - space.b[:, velocity])
    moved: FloatArray = space.c @ steady + space.d[:, velocity]
    train = next(train for train in loop.trains if train.axis == axis)
    shown = {port: float(value) for port, value in zip(space.outputs, moved, strict=True)}
    return -shown[train.name, ENCODER], shown
