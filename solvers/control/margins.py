"""Stability margins and bandwidths of control loops, from frequency responses with exact dead
times.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.machine.drives import MEASURED, SET_ACCELERATION, SET_SPEED, AxisControl
from headstock.solvers.control.drive_trains import FORCE, MOTOR, DriveTrain, measured_channel
from headstock.solvers.control.linear_blocks import block_response
from headstock.solvers.linear.frequency_response import evaluate_frf, prepare_frf
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

LOWEST_HZ = 0.1
POINTS = 4000
HALF = math.sqrt(0.5)


@dataclass(frozen=True)
class LoopMargins:
    """Figures of one drive's loop, opened at its force while the others stay closed; None where the
    response has no such point.

    Attributes:
        gain: Factor by which its gains may rise [-].
        gain_hz: Where the phase is -180 degrees there [Hz].
        lowest_gain: Factor to which they may fall, where too small ones are unstable too [-].
        phase_deg: Phase that may be lost, least over all crossings of gain one [degrees].
        phase_hz: Where [Hz].
        sensitivity: Largest ``|1 / (1 + L)|``: the inverse is the distance from instability.
        sensitivity_hz: Where [Hz].
        bandwidth_hz: Where the measured position first falls 3 dB below its set point [Hz].
        resonance: Largest measured position over set point [-].
    """

    drive: str
    gain: float | None
    gain_hz: float | None
    lowest_gain: float | None
    phase_deg: float | None
    phase_hz: float | None
    sensitivity: float
    sensitivity_hz: float
    bandwidth_hz: float | None
    resonance: float


def find_margins(
    system: SecondOrderSystem,
    trains: Sequence[DriveTrain],
    *,
    to_hz: float,
    around_hz: FloatArray | None = None,
) -> tuple[LoopMargins, ...]:
    """Margins and bandwidth of every drive.

    Args:
        system: From ``free_motors``.
        to_hz: Highest frequency looked at [Hz].
        around_hz: Frequencies beside which the grid is finer, such as those of the poles [Hz].

    Source: Franklin, Powell and Emami-Naeini (2019), sections 6.4 and 6.7.
    """
    frequencies = _grid(to_hz, around_hz)
    forces = [(train.name, FORCE) for train in trains]
    read = [measured_channel(train) for train in trains] + [(train.name, MOTOR) for train in trains]
    anchored = evaluate_frf(prepare_frf(system, inputs=forces, outputs=read), frequencies)
    receptance = take_off_anchors(anchored.receptance, trains)
    omega, count = 2.0 * np.pi * frequencies, len(trains)
    # L(i, j): per unit drive force
    loops = answer_motions(trains, omega, receptance[:, :count], receptance[:, count:])
    follow = _follow(loops, receptance[:, :count], command_forces(trains, omega))
    return tuple(
        _evaluate_loop(
            train.name, frequencies, _open_loop(loops, number), np.abs(follow[:, number])
        )
        for number, train in enumerate(trains)
    )


def take_off_anchors(receptance: ComplexArray, trains: Sequence[DriveTrain]) -> ComplexArray:
    """Receptances ``(n_freq, n_outputs, n_inputs)`` without the springs that anchor motors.

    Args:
        receptance: Drive forces first among its inputs; what the controllers see, then the motors,
            first among its outputs.
    """
    springs = np.diag([train.anchor for train in trains])
    if not springs.any():
        return receptance
    count = len(trains)
    motors = receptance[:, count : 2 * count]
    pushed = np.linalg.solve(np.eye(count) - springs @ motors[..., :count], springs @ motors)
    return receptance + receptance[..., :count] @ pushed


class _ControlPaths(NamedTuple):
    """Ways through a controller.

    Attributes:
        feedback: ``(n_freq, 2)`` minus the force per measured position [N/m] and per motor speed
            [N s/m].
        ahead: ``(n_freq,)`` force per set position, with the feed-forward [N/m].
    """

    feedback: ComplexArray
    ahead: ComplexArray


def _control_paths(control: AxisControl, omega: FloatArray) -> _ControlPaths:
    """Ways through a controller at angular frequencies ``(n_freq,)`` [rad/s], delays exact."""
    s = 1j * omega
    late = np.exp(-s * control.dead_time) / (1.0 + s * control.current_lag)
    for block in control.filters:
        late = late * block_response(block, omega)[:, 0, 0]
    forces = block_response(control.law, omega)[:, 0] @ control.errors
    ahead = forces[:, 0] + s * forces[:, SET_SPEED]
    ahead = ahead + s**2 * (forces[:, SET_ACCELERATION] + control.acceleration_feed_forward)
    return _ControlPaths(-late[:, None] * forces[:, MEASURED:], late * ahead)


def answer_motions(
    trains: Sequence[DriveTrain],
    omega: FloatArray,
    seen: FloatArray | ComplexArray,
    motors: FloatArray | ComplexArray,
) -> ComplexArray:
    """Return minus the forces ``(n_freq, n_drives, k)`` with which controllers answer motions.

    Args:
        omega: ``(n_freq,)`` angular frequencies.
        seen: ``(n_drives, k)`` what controllers see, or ``(n_freq, n_drives, k)``.
    """
    paths = [_control_paths(train.control, omega) for train in trains]
    feedback = np.stack([path.feedback for path in paths], axis=1)[..., None]
    return feedback[:, :, 0] * seen + feedback[:, :, 1] * (1j * omega[:, None, None] * motors)


def command_forces(trains: Sequence[DriveTrain], omega: FloatArray) -> ComplexArray:
    """Return the forces ``(n_freq, n_drives)`` of controllers per set point that moves harmonically, with
    its speed and acceleration; NaN at rest, where an integrator has no limit.
    """
    forces = np.full((len(omega), len(trains)), np.nan + 0j)
    moving = omega > 0.0
    for number, train in enumerate(trains):
        forces[moving, number] = _control_paths(train.control, omega[moving]).ahead
    return forces


def _follow(loops: ComplexArray, motion: ComplexArray, ahead: ComplexArray) -> ComplexArray:
    """Measured position of each drive per set position of its own ``(n_freq, n_drives)``."""
    count = loops.shape[1]
    forces = np.linalg.solve(np.eye(count) + loops, ahead[:, :, None] * np.eye(count))
    return np.einsum("fij,fji->fi", motion, forces)


def _open_loop(loops: ComplexArray, number: int) -> ComplexArray:
    """Loop of one drive with the others closed ``(n_freq,)``."""
    others = [i for i in range(loops.shape[1]) if i != number]
    direct = loops[:, number, number]
    if not others:
        return np.asarray(direct)
    rest = loops[:, others][:, :, others] + np.eye(len(others))
    through = np.linalg.solve(rest, loops[:, others, number][..., None])[..., 0]
    return direct - np.einsum("fi,fi->f", loops[:, number, others], through)


def _evaluate_loop(
    name: str, frequencies: FloatArray, loop: ComplexArray, follow: FloatArray
) -> LoopMargins:
    """Return the figures of a drive, from its loop and measured over set position ``(n_freq,)``."""
    imaginary = np.asarray(loop.imag, dtype=float)
    crossings = [
        (-value.real, hz)
        for hz, value in _find_crossings(frequencies, loop, imaginary, loop.real < 0.0)
    ]
    gain, gain_hz = min(
        ((1.0 / size, hz) for size, hz in crossings if size < 1.0), default=(None, None)
    )
    phase, phase_hz = min(
        (
            (180.0 - abs(math.degrees(math.atan2(value.imag, value.real))), hz)
            for hz, value in _find_crossings(frequencies, loop, np.asarray(np.abs(loop) - 1.0))
        ),
        default=(None, None),
    )
    sensitivity = 1.0 / np.abs(1.0 + loop)
    worst = int(np.argmax(sensitivity))
    falls = _find_crossings(frequencies, loop, follow - HALF) if follow[0] >= HALF else ()
    return LoopMargins(
        drive=name,
        gain=gain,
        gain_hz=gain_hz,
        lowest_gain=max((1.0 / size for size, _ in crossings if size > 1.0), default=None),
        phase_deg=phase,
        phase_hz=phase_hz,
        sensitivity=float(sensitivity[worst]),
        sensitivity_hz=float(frequencies[worst]),
        bandwidth_hz=next((hz for hz, _ in falls), None),
        resonance=float(follow.max()),
    )


def _find_crossings(
    frequencies: FloatArray,
    loop: ComplexArray,
    values: FloatArray,
    where: BoolArray | None = None,
) -> Iterator[tuple[float, complex]]:
    """Yield frequency [Hz] and loop wherever values change their sign, linear between two lines.

    Args:
        values: ``(n_freq,)``.
        where: Lines that count, both of a pair; None for all.
    """
    changed = np.sign(values[:-1]) != np.sign(values[1:])
    if where is not None:
        changed &= where[:-1] & where[1:]
    for index in np.flatnonzero(changed):
        share = float(values[index] / (values[index] - values[index + 1]))
        hz, value = (
            part[index] + share * (part[index + 1] - part[index]) for part in (frequencies, loop)
        )
        yield float(hz), complex(value)


def _grid(to_hz: float, around_hz: FloatArray | None) -> FloatArray:
    """Even on a logarithmic axis, and finer beside given frequencies."""
    base = np.geomspace(min(LOWEST_HZ, 0.01 * to_hz), to_hz, POINTS)
    if around_hz is None:
        return np.asarray(base, dtype=float)
    near = np.asarray(around_hz)[(np.asarray(around_hz) > 0.0) & (np.asarray(around_hz) < to_hz)]
    spread = np.concatenate([-np.geomspace(1e-5, 0.05, 25), np.geomspace(1e-5, 0.05, 25)])
    every = np.concatenate([base, (near[:, None] * (1.0 + spread)).ravel()])
    return np.asarray(np.unique(every[every <= to_hz]), dtype=float)
