"""Poles of a machine under control: which grow, whose loop makes them, and how much gain would be
stable.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import MEASURED, AxisControl
from headstock.solvers.control.drive_loops import (
    ClosedLoop,
    close_loops,
    close_plant,
    force_channels,
    open_plant,
)
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.linear_blocks import LARGEST_ANGLE
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

REAL = 1e-9  # an imaginary part below this share of a pole's size is roundoff
GROWING = 1e-9  # a real part below this share of a pole's size is roundoff
# poles below this share of the machine's fastest are at rest: free bodies that no drive holds
AT_REST = 1e-7
BISECTIONS = 30
STEP_DOWN, SMALLEST_SCALE = 0.7, 1e-3


@dataclass(frozen=True, eq=False)
class LoopPoles:
    """Poles of a closed loop, rising in size; conjugate pairs stand once, with the pole above the
    real axis.

    Attributes:
        poles: ``(m,)`` [rad/s].
        frequencies_hz: ``(m,)`` ``Im / (2 pi)``, zero for real poles.
        damping_ratios: ``(m,)`` ``-Re / |pole|``.
        shapes: ``(n, m)`` states of the machine.
        drives: ``(m,)`` the drive whose motor takes or gives most power in each.
        modes: ``(m,)`` the open-loop mode of the machine (free motors) with most energy in each.
        limit_hz: Beyond this frequency a dead time is not known, and nothing is said of stability;
            infinite without one.
    """

    poles: ComplexArray
    frequencies_hz: FloatArray
    damping_ratios: FloatArray
    shapes: ComplexArray
    drives: tuple[str, ...]
    modes: tuple[int, ...]
    limit_hz: float

    def growing(self) -> list[int]:
        """Return the poles that grow, fastest growth first."""
        return _list_growing(self.poles, self.limit_hz)


def _list_growing(poles: ComplexArray, limit_hz: float) -> list[int]:
    """Return the poles that grow at most at some frequency, fastest growth first."""
    sizes = np.abs(poles)
    # eigenvalues are known to the rounding of the fastest, which very stiff loops have
    rounding = np.finfo(float).eps * sizes.max(initial=0.0)
    growing = np.flatnonzero(
        (poles.real > np.maximum(GROWING * sizes, rounding))
        & (poles.imag <= 2.0 * math.pi * limit_hz)
    )
    return [int(index) for index in growing[np.argsort(-poles[growing].real)]]


def _select_poles(poles: ComplexArray, floor: float) -> NDArray[np.intp]:
    """Return which poles stand for all, rising in size: one of each conjugate pair, none below a size."""
    # a machine that floats has double poles at zero, which rounding splits
    real = np.abs(poles.imag) <= REAL * np.abs(poles)
    kept = np.flatnonzero((real | (poles.imag > 0.0)) & (np.abs(poles) > floor))
    return kept[np.argsort(np.abs(poles[kept]), kind="stable")]


def _find_floor(loop: ClosedLoop) -> float:
    """Return up to which size poles are those of free bodies at rest [rad/s]; zero without any."""
    if not has_free_motions(loop):
        return 0.0
    return AT_REST * float(np.abs(np.linalg.eigvals(loop.plant.a)).max(initial=0.0))


def find_loop_poles(loop: ClosedLoop) -> LoopPoles:
    """All poles of a closed loop but those of free bodies at rest."""
    poles, vectors = scipy.linalg.eig(loop.space.a, check_finite=False)
    real = np.abs(poles.imag) <= REAL * np.abs(poles)
    kept = _select_poles(poles, _find_floor(loop))
    poles = np.where(real, poles.real + 0.0j, poles)[kept]
    shapes = vectors[:, kept]
    forces = loop.space.c[loop.space.rows.of(force_channels(loop.trains))] @ shapes
    power = np.abs(forces * (loop.rates @ shapes))
    energy = np.abs(shapes[: loop.plant_size]) ** 2
    modal = energy.reshape(-1, 2, len(kept)).sum(axis=1) if loop.plant_size else energy
    return LoopPoles(
        poles=poles,
        frequencies_hz=np.where(real[kept], 0.0, poles.imag / (2.0 * math.pi)),
        damping_ratios=-poles.real / np.where(np.abs(poles) > 0.0, np.abs(poles), 1.0),
        shapes=shapes[: loop.plant_size],
        drives=tuple(loop.trains[int(index)].name for index in np.argmax(power, axis=0)),
        modes=tuple(int(mode) for mode in np.argmax(modal, axis=0)),
        limit_hz=_dead_time_limit(loop.trains),
    )


def _dead_time_limit(trains: Sequence[DriveTrain]) -> float:
    """Up to which frequency the dead times of all drives are right [Hz]; infinite without any."""
    longest = max((train.control.dead_time for train in trains), default=0.0)
    return math.inf if longest == 0.0 else LARGEST_ANGLE / (2.0 * math.pi * longest)


def require_stable(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    loop: ClosedLoop | None = None,
    poles: LoopPoles | None = None,
) -> LoopPoles:
    """The poles of a stable loop.

    Args:
        system: From ``free_motors``.
        loop: As closed, where it is known.
        poles: Its poles, where they are known.

    Raises:
        UnstableControlError: A pole grows; names its axis, its frequency and the largest stable
            gain.
    """
    loop = loop or close_loops(system, trains)
    poles = poles or find_loop_poles(loop)
    growing = poles.growing()
    if not growing:
        return poles
    worst = growing[0]
    train = next(train for train in trains if train.name == poles.drives[worst])
    rate, hz = float(poles.poles[worst].real), float(poles.frequencies_hz[worst])
    motion = f"a motion at {hz:.4g} Hz grows by e in {1.0 / rate:.3g} s (damping {100.0 * poles.damping_ratios[worst]:.3g} %)"
    if hz == 0.0:
        motion = f"a motion without oscillation grows by e in {1.0 / rate:.3g} s"
    raise UnstableControlError(
        f"the control of axis {train.axis} is unstable: {motion}; {_advise(system, tuple(trains), train)}",
        axis=train.axis,
        frequency_hz=hz,
    )


def find_largest_gain(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    name: str,
    change: Callable[[AxisControl, float], AxisControl],
) -> float | None:
    """The largest scale up to one of a drive's gain at which no pole grows, by bisection; None
    where none was found.

    Args:
        system: From ``free_motors``.
        trains: All drives; the others stay as they are.
    """
    plant = open_plant(system, trains)
    floor, limit_hz = _find_floor(close_plant(plant, trains)), _dead_time_limit(trains)

    def stable(scale: float) -> bool:
        changed = [
            dataclasses.replace(train, control=change(train.control, scale))
            if train.name == name
            else train
            for train in trains
        ]
        # without shapes, which take most of the time
        poles = scipy.linalg.eigvals(close_plant(plant, changed).space.a, check_finite=False)
        return not _list_growing(poles[_select_poles(poles, floor)], limit_hz)

    high, low = 1.0, STEP_DOWN
    while not stable(low):
        high, low = low, STEP_DOWN * low
        if low < SMALLEST_SCALE:
            return None
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
        if high - low < 1e-4 * high:
            break
    return low


def scale_position_gain(control: AxisControl, scale: float) -> AxisControl:
    """The controller with position errors that count more or less: in a cascade, another kv."""
    errors = control.errors.copy()
    errors[:, [0, MEASURED]] *= scale
    return dataclasses.replace(control, errors=errors)


def _scale_law(control: AxisControl, scale: float) -> AxisControl:
    """The controller with another gain from its errors to the force."""
    law = control.law
    return dataclasses.replace(
        control, law=dataclasses.replace(law, c=scale * law.c, d=scale * law.d)
    )


def _scale_velocity_gain(control: AxisControl, scale: float) -> AxisControl:
    """The controller with another velocity gain, and position control that hardly acts: its
    velocity loop by itself.
    """
    return scale_position_gain(_scale_law(control, scale), SMALLEST_SCALE)


def _advise(system: SecondOrderSystem, trains: tuple[DriveTrain, ...], train: DriveTrain) -> str:
    """Return which gain would be stable, of the keys that the drive has."""
    kv, kp = train.control.position_gain, train.control.velocity_gain
    scale = find_largest_gain(system, trains, train.name, scale_position_gain) if kv else None
    if scale is not None and kv:
        return f"the largest stable kv found is {scale * kv:.4g} 1/s, and {kv:.4g} 1/s is asked for"
    cascade = train.control.is_cascade
    scale = find_largest_gain(system, trains, train.name, _scale_velocity_gain) if cascade else None
    if scale is not None and kp:
        return (
            f"its velocity loop is so by itself: the largest stable velocity_gain found is {scale * kp:.4g} N s/m along the axis, and "
            f"{kp:.4g} N s/m is asked for"
        )
    scale = find_largest_gain(system, trains, train.name, _scale_law)
    if scale is not None:
        return f"its loop is stable at {scale:.3g} times the gain of its controller (gain margin {20.0 * math.log10(scale):.3g} dB)"
    gains = "kv or velocity_gain" if cascade else "gain of its controller"
    check = "encoder" if cascade else "the sign of the controller and its own poles, encoder"
    return f"no smaller {gains} is stable either, down to a thousandth; check {check}, dead time, and the damping of the machine"


def has_free_motions(loop: ClosedLoop) -> bool:
    """Return whether more motions of the machine are free than its drives constrain."""
    # each mode is (s p, p') with p'' = -omega^2 p
    restoring = loop.plant.a[1::2, 0::2].diagonal()
    return int(np.count_nonzero(restoring == 0.0)) > len(loop.trains)
