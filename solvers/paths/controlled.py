"""Deviation from a path of a machine under control, in parts: following error, quasi-static share,
rigid-body response, residual vibration.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop, set_channels
from headstock.solvers.control.driven_motion import DrivenMotion, solve_motion
from headstock.solvers.control.stability import has_free_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.state_space import StateSpace
from headstock.solvers.linear.time_response import solve_stepped_response
from headstock.solvers.paths.loads import PathLoads, cut_times, loads_at, longest_step, step_loads
from headstock.solvers.paths.response import PathDeviation, step_times
from headstock.solvers.paths.set_points import (
    SetPoint,
    list_breaks,
    sample_move,
    step_accelerations,
)
from headstock.solvers.watched_outputs import Watch, WatchedOutputs


@dataclass(frozen=True, eq=False)
class ControlledPath:
    """A closed loop along a straight path.

    Attributes:
        loop: Closed; its first outputs are those wanted.
        shares: Travel of each driven axis per travel along the path [-].
        travel: ``(n_outputs,)`` how the rigid machine moves each output wanted per travel along the
            path.
        low_frequency_limit_hz: Poles below this frequency are rigid-body motion on the drives and
            mounts [Hz].
        loads: On the machine; None for none.
        watched: Other outputs of the loop that are asked for as a whole.
    """

    loop: ClosedLoop
    shares: Mapping[str, float]
    travel: FloatArray
    low_frequency_limit_hz: float
    loads: PathLoads | None = None
    watched: Watch = field(default_factory=Watch)

    @functools.cached_property
    def others(self) -> WatchedOutputs:
        """What is watched, of states and inputs."""
        return self.loop.space.watch(self.watched)


@dataclass(frozen=True, eq=False)
class _Motion:
    """The states as ``x = X_s s + X_v v + X_a a + xi``: what a path would hold them at, and what
    rings about it.

    Attributes:
        place: X_s ``(n,)``: at rest, per travel.
        speed: X_v: at constant speed.
        pull: X_a: at constant acceleration.
        inputs: ``(n, 3)`` columns of position, speed and acceleration along the path.
        direct: ``(n_outputs + w, 3)`` what they do at once to the outputs, then to what is watched,
            through drive forces and the flexibility of modes left out.
        low_frequency: ``(n, n)`` projector on the low-frequency poles.
    """

    place: FloatArray
    speed: FloatArray
    pull: FloatArray
    inputs: FloatArray
    direct: FloatArray
    low_frequency: FloatArray


def solve_controlled_path(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation over a move by exact discretisation; the way and the speed are states, driven by
    the acceleration alone.

    Quasi-static is what constant speed (lag) and constant acceleration hold, without the
    low-frequency poles; low_frequency is the part of those poles; dynamic is the residual vibration
    of the others, and what loads do.

    Args:
        path: The loop and its path.
        move: Along it.
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: The machine floats, so that no acceleration can last.

    Source: ``A X_s = -B_s``, ``A X_v = X_s - B_v``, ``A X_a = X_v - B_a``, ``xi' = A xi - X_a a'``.
    """
    motion = _split(path)
    space, count = path.loop.space, len(path.travel)
    rows, size = space.c[:count], len(space.a)
    a = np.zeros((size + 2, size + 2))
    a[:size] = np.hstack([space.a, motion.inputs[:, :2]])
    a[size, size + 1] = 1.0
    first = len(set_channels(path.loop.trains))
    own = space.b[:, first : first + loads_at(path.loads, np.zeros(1), np.zeros(1)).shape[1]]
    b = np.hstack(
        [
            np.append(motion.inputs[:, 2], [0.0, 1.0])[:, None],
            np.vstack([own, np.zeros((2, own.shape[1]))]),
        ]
    )
    low_frequency = rows @ motion.low_frequency
    others, loads = path.others, slice(first, first + own.shape[1])
    direct = np.zeros((2 * count + len(others.states), b.shape[1]))
    direct[:count, 0] = motion.direct[:count, 2]
    direct[:count, 1:] = space.d[:count, loads]
    direct[2 * count :, 0] = motion.direct[count:, 2]
    direct[2 * count :, 1:] = others.inputs[:, loads]
    c = np.vstack(
        [
            np.hstack([rows, motion.direct[:count, :2] - np.outer(path.travel, [1.0, 0.0])]),
            np.hstack(
                [
                    low_frequency,
                    -(low_frequency @ motion.place)[:, None],
                    -(low_frequency @ motion.speed)[:, None],
                ]
            ),
            np.hstack([others.states, motion.direct[count:, :2]]),
        ]
    )
    whole = StateSpace(a, b, c, direct, (), (), ())
    fine, parts = cut_times(samples, path.loads)
    times, places = step_times(move, fine)
    given = np.concatenate(
        [step_accelerations(move, times)[:, :, None], step_loads(path.loads, move, times)], axis=2
    )
    found = solve_stepped_response(whole, times, given).outputs[places[::parts]]
    quasi_static = _follow(path, motion, move, samples)
    total, low_frequency = found[:, :count], found[:, count : 2 * count]
    return PathDeviation(
        samples,
        total,
        quasi_static,
        low_frequency,
        total - quasi_static - low_frequency,
        found[:, 2 * count :] if path.watched.channels else None,
    )


def solve_rubbing_path(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> tuple[PathDeviation, DrivenMotion]:
    """The same with friction in the guides; what friction does counts as dynamic.

    Args:
        path: Its loop is closed with its loads, then ``friction_channels``, as inputs.
        move: Along it.
        samples: ``(n,)`` from zero [s].

    Raises:
        ConvergenceError: Friction does not settle.
    """
    linear = solve_controlled_path(path, move, samples)
    cosines = [
        path.shares.get(axis, 0.0)
        for axis, kind in set_channels(path.loop.trains)
        if kind == "position"
    ]

    def given(times: FloatArray) -> FloatArray:
        now = sample_move(move, times)
        own = [now.positions, now.speeds, now.accelerations]
        return np.column_stack([*own, loads_at(path.loads, times, now.speeds)])

    pushing = np.eye(loads_at(path.loads, np.zeros(1), np.zeros(1)).shape[1])
    spread = scipy.linalg.block_diag(np.kron(np.array(cosines)[:, None], np.eye(3)), pushing)
    found = solve_motion(
        path.loop,
        given,
        samples,
        spread=spread,
        breaks=list_breaks(move),
        longest=longest_step(path.loads),
    )
    way = sample_move(move, samples).positions
    total = found.outputs[:, : len(path.travel)] - np.outer(way, path.travel)
    return PathDeviation(
        samples,
        total,
        linear.quasi_static,
        linear.low_frequency,
        total - linear.quasi_static - linear.low_frequency,
        path.others.evaluate(found.right, np.hstack([given(samples) @ spread.T, -found.friction]))
        if path.watched.channels
        else None,
    ), found


def _split(path: ControlledPath) -> _Motion:
    space = path.loop.space
    if has_free_motions(path.loop):
        raise ModelError(
            "the machine floats, so nothing holds it against accelerating axes; join it to ground by a mount"
        )
    sets = set_channels(path.loop.trains)
    shares = np.array([path.shares.get(axis, 0.0) for axis, _ in sets])
    given, direct = (
        np.column_stack(
            [(part[:, : len(sets)] * shares)[:, kind::3].sum(axis=1) for kind in range(3)]
        )
        for part in (space.b, np.vstack([space.d[: len(path.travel)], path.others.inputs]))
    )
    factors = scipy.linalg.lu_factor(space.a)
    place = scipy.linalg.lu_solve(factors, -given[:, 0])
    speed = scipy.linalg.lu_solve(factors, place - given[:, 1])
    pull = scipy.linalg.lu_solve(factors, speed - given[:, 2])
    return _Motion(
        place,
        speed,
        pull,
        given,
        direct,
        project_slow(space.a, 2.0 * np.pi * path.low_frequency_limit_hz),
    )


def _follow(
    path: ControlledPath, motion: _Motion, move: SetPoint, samples: FloatArray
) -> FloatArray:
    """What speed and acceleration hold ``(n, n_outputs)``."""
    rows = path.loop.space.c[: len(path.travel)]
    now = sample_move(move, samples)
    direct = motion.direct[: len(rows)]
    speed = rows @ motion.speed + direct[:, 1]
    pull = rows @ (motion.pull - motion.low_frequency @ motion.pull) + direct[:, 2]
    return np.asarray(np.outer(now.speeds, speed) + np.outer(now.accelerations, pull))


def project_slow(a: FloatArray, limit: float) -> FloatArray:
    """Projector ``(n, n)`` on the invariant subspace of the poles below a size.

    Source: Golub and Van Loan (2013), section 7.6.3: ordered Schur form, its blocks parted by a
    Sylvester equation.
    """
    triangular, basis, count = scipy.linalg.schur(
        a, output="real", sort=lambda re, im: bool(np.hypot(re, im) < limit)
    )
    first, rest = slice(0, count), slice(count, None)
    if count in (0, len(a)):
        return np.eye(len(a)) if count else np.zeros_like(a)
    parting = scipy.linalg.solve_sylvester(
        triangular[first, first], -triangular[rest, rest], -triangular[first, rest]
    )
    return np.asarray(basis[:, first] @ np.hstack([np.eye(count), -parting]) @ basis.T)
