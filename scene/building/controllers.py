"""Controllers of drives: built from their tables, and what may be wrong with them."""

import math
from collections.abc import Iterator

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import (
    CONTROL_INPUTS,
    MOTOR_SPEED,
    SET_ACCELERATION,
    SET_SPEED,
    AxisControl,
    Cascade,
    LinearBlock,
    velocity_error,
)
from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.units import DAMPING
from headstock.scene.schema.drives import (
    ControlInput,
    ControllerTable,
    DriveTable,
    FilterTable,
    LinearTable,
)

DEAD_CYCLES = 1.5  # one cycle of computing, and half a cycle during which a force stays
HELD_CYCLES = 0.5  # of a discrete controller, whose own delays are in its equations
ALTERNATING = 1e-9  # distance of a pole from z = -1


def build_control(table: DriveTable, lead: float) -> AxisControl:
    """Build the controller of a drive.

    Args:
        table: Without faults.
        lead: Travel per turn of the motor [m].
    """
    pitch, gain = lead / (2.0 * math.pi), table.velocity_gain
    late = DEAD_CYCLES * table.sampling if table.sampling is not None else table.dead_time or 0.0
    filters = tuple(_build_filter(one) for one in table.filters or ())
    if table.controller is not None:
        law = _build_block(table.controller, len(_list_inputs(table, table.controller)))
        scale = 1.0 if table.controller.output == "force" else 1.0 / pitch
        late += HELD_CYCLES * law.step_s
        law = LinearBlock(law.a, law.b, scale * law.c, scale * law.d, law.step_s)
        errors = _build_errors(table, table.controller)
        return AxisControl(
            errors, law, 0.0, filters, late, table.current_loop or 0.0, table.encoder
        )
    if gain is None or table.kv is None:
        raise ValueError("a drive has a controller, or kv and velocity_gain")
    # a torque per turning speed is a force per speed over the square of travel per radian
    along = gain.value if gain.dimension == DAMPING else gain.value / pitch**2
    cascade = Cascade(
        position_gain=table.kv,
        velocity_gain=along,
        integral_time=math.inf if table.integral_time is None else table.integral_time,
        velocity_feed_forward=table.feed_forward.velocity,
        dead_time=late,
        current_lag=table.current_loop or 0.0,
        encoder=table.encoder,
        filters=filters,
    )
    return cascade.control


def _list_inputs(table: DriveTable, controller: ControllerTable) -> list[ControlInput]:
    return controller.inputs or ["position_error" if table.kv is None else "velocity_error"]


def _build_errors(table: DriveTable, controller: ControllerTable) -> FloatArray:
    """Return the rows ``(k, 5)`` of what a controller gets."""
    unit = np.eye(CONTROL_INPUTS)
    rows = {
        "position_error": velocity_error(1.0, 0.0)[0] + unit[MOTOR_SPEED],
        "velocity_error": velocity_error(0.0, 1.0)[0]
        if table.kv is None
        else velocity_error(table.kv, table.feed_forward.velocity)[0],
        "set_velocity": unit[SET_SPEED],
        "set_acceleration": unit[SET_ACCELERATION],
        "motor_velocity": unit[MOTOR_SPEED],
    }
    return np.array([rows[name] for name in _list_inputs(table, controller)])


def _build_filter(table: FilterTable) -> LinearBlock:
    """Build a filter; a notch is ``(s^2 + 2 g z w s + w^2) / (s^2 + 2 z w s + w^2)``."""
    if table.notch is None:
        return _build_block(table, 1)
    omega = 2.0 * math.pi * table.notch
    width = 2.0 * table.damping * omega
    return _build_transfer([1.0, table.depth * width, omega**2], [1.0, width, omega**2], step_s=0.0)


def _build_block(table: LinearTable, inputs: int) -> LinearBlock:
    step = table.step or 0.0
    if table.num is not None and table.den is not None:
        return _build_transfer(table.num, table.den, step_s=step)
    a, b, c = (np.array(rows or [], dtype=float) for rows in (table.a, table.b, table.c))
    d = np.zeros((1, inputs)) if table.d is None else np.array(table.d, dtype=float)
    return LinearBlock(a, b, c, d, step)


def _build_transfer(num: list[float], den: list[float], *, step_s: float) -> LinearBlock:
    """Return the observer form of a proper transfer function, its states of one size.

    Args:
        num: Highest power first.
        den: Likewise, the first not zero.
    """
    size = len(den) - 1
    monic = np.array(den) / den[0]
    above = np.pad(np.array(num) / den[0], (len(den) - len(num), 0))
    direct = above[0]
    rates = [abs(value) ** (1.0 / power) for power, value in enumerate(monic[1:], 1)]
    rate = 1.0 if step_s else max([*rates, 0.0]) or 1.0
    # with s = rate p coefficients of p^(n - k) are over rate^k
    powers = rate ** np.arange(1, size + 1)
    a = np.eye(size, k=1)
    a[:, :1] = -(monic[1:] / powers)[:, None]
    b = ((above[1:] - direct * monic[1:]) / powers)[:, None]
    return LinearBlock(rate * a, rate * b, np.eye(1, size), np.array([[direct]]), step_s)


def find_faults(table: DriveTable) -> Iterator[tuple[KeyPath, str]]:
    """Yield what is wrong with the controller and the filters of a drive, and where."""
    controller = table.controller
    if controller is not None:
        inputs = _list_inputs(table, controller)
        place: KeyPath = ("controller",)
        yield from ((place, fault) for fault in _find_block_faults(controller, inputs))
        if table.kv is not None and "velocity_error" not in inputs:
            yield (
                ("kv",),
                "acts on the velocity_error, which its controller does not get; remove it",
            )
        if table.kv is None and table.feed_forward.velocity:
            yield (
                ("feed_forward", "velocity"),
                "is added behind kv, which the drive has not; give the controller the input set_velocity",
            )
        if controller.step is not None and table.sampling is not None:
            yield ("sampling",), "the controller has its step; remove sampling"
    for number, one in enumerate(table.filters or ()):
        place = ("filters", number)
        if one.notch is None:
            yield from ((place, fault) for fault in _find_block_faults(one, ["force"]))
        elif one.num is not None or one.a is not None:
            yield place, "has a notch and another filter; write two filters"


def _find_block_faults(table: LinearTable, inputs: list[str] | list[ControlInput]) -> Iterator[str]:
    if table.num is not None and table.den is not None:
        faults = list(_find_transfer_faults(table.num, table.den, len(inputs)))
        yield from faults
        if faults:
            return
    elif table.a is None or table.b is None or table.c is None:
        yield "is empty; write num and den, or a, b and c"
        return
    else:
        wanted = {"a": (len(table.a), len(table.a)), "b": (len(table.a), len(inputs))}
        wanted |= {"c": (1, len(table.a)), "d": (1, len(inputs))}
        for key, (rows, columns) in wanted.items():
            matrix = getattr(table, key)
            if matrix is None or (len(matrix) == rows and all(len(r) == columns for r in matrix)):
                continue
            lengths = " and ".join(sorted({str(len(row)) for row in matrix}))
            yield (
                f"{key} has {len(matrix)} rows of {lengths} numbers; {len(table.a)} states and the inputs {', '.join(inputs)} need"
                f" {rows} x {columns}"
            )
            return
    if table.step is not None:
        poles = np.linalg.eigvals(_build_block(table, len(inputs)).a)
        if (np.abs(poles + 1.0) < ALTERNATING).any():
            yield "has a pole at z = -1, which no continuous controller has; leave it out"


def _find_transfer_faults(num: list[float], den: list[float], inputs: int) -> Iterator[str]:
    if inputs > 1:
        yield f"is a transfer function with {inputs} inputs; write a state space with a, b and c"
    if den[0] == 0.0:
        yield "den begins with zero; leave out leading zeros"
    if len(num) > len(den):
        yield (
            f"is not proper: num has degree {len(num) - 1} and den {len(den) - 1}; add poles far above the crossover to den"
        )
