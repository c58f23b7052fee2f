"""Deviation from a path of a machine under control, in parts: following error, quasi-static share,
rigid-body response, residual vibration.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import SET_POINTS, ClosedLoop, set_channels
from headstock.solvers.control.driven_motion import DrivenMotion, solve_motion
from headstock.solvers.control.friction_loop import friction_channels, spread_inputs
from headstock.solvers.control.stability import has_free_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.state_space import StateSpace
from headstock.solvers.linear.time_response import solve_stepped_response
from headstock.solvers.paths.loads import (
    PathLoads,
    cut_times,
    load_channels,
    loads_at,
    longest_step,
    step_loads,
)
from headstock.solvers.paths.response import PathDeviation, step_times
from headstock.solvers.paths.set_points import (
    SetPoint,
    list_breaks,
    sample_move,
    step_accelerations,
)
from headstock.solvers.second_order import Channel, Positions
from headstock.solvers.watched_outputs import Watch, WatchedOutputs, WatchedValues


@dataclass(frozen=True, eq=False)
class ControlledPath:
    """A closed loop along a straight path.

    Attributes:
        shares: Travel of each driven axis per travel along the path [-].
        travel: ``(n_outputs,)`` how the rigid machine moves each output wanted per travel along the
            path.
        low_frequency_limit_hz: Poles below this frequency are rigid-body motion on the drives and
            mounts [Hz].
        loads: On the machine; None for none.
        watched: Other outputs of the loop that are asked for as a whole.
    """

    loop: ClosedLoop
    outputs: tuple[Channel, ...]
    shares: Mapping[str, float]
    travel: FloatArray
    low_frequency_limit_hz: float
    loads: PathLoads | None = None
    watched: Watch = field(default_factory=Watch)

    @functools.cached_property
    def others(self) -> WatchedOutputs:
        """What is watched, of states and inputs."""
        return self.loop.space.watch(self.watched)

    @functools.cached_property
    def rows(self) -> Positions:
        """Where the outputs wanted stand."""
        return self.loop.space.rows.of(self.outputs)

    @property
    def given(self) -> dict[Channel, FloatArray]:
        """Inputs of the loop, of position, speed and acceleration along the path, then of loads."""
        units = dict(zip(SET_POINTS, np.eye(len(SET_POINTS)), strict=True))
        sets = {
            (axis, kind): self.shares.get(axis, 0.0) * units[kind]
            for axis, kind in set_channels(self.loop.trains)
        }
        return add_loads(sets, load_channels(self.loads))


def add_loads(
    sets: Mapping[Channel, FloatArray], loads: Sequence[Channel]
) -> dict[Channel, FloatArray]:
    """Rows ``(3 + k,)`` of inputs of position, speed and acceleration along a path, then of ``k`` loads.

    Args:
        sets: Rows ``(3,)`` of inputs that loads do not enter.
        loads: Where these act.
    """
    units = np.eye(len(SET_POINTS) + len(loads))
    padded = {channel: np.pad(row, (0, len(loads))) for channel, row in sets.items()}
    return padded | dict(zip(loads, units[len(SET_POINTS) :], strict=True))


@dataclass(frozen=True, eq=False)
class _Motion:
    """The states as ``x = X_s s + X_v v + X_a a + xi``: what a path would hold them at, and what
    rings about it.

    Attributes:
        place: X_s ``(n,)``: at rest, per travel.
        speed: X_v: at constant speed.
        pull: X_a: at constant acceleration.
        inputs: ``(n, 3 + k)`` columns of position, speed and acceleration along the path, and loads.
        direct: ``(n_outputs, 3 + k)`` what they do at once to the outputs, through drive forces and
            the flexibility of modes left out.
        beside: ``(w, 3 + k)`` the same to what is watched.
        low_frequency: ``(n, n)`` projector on the low-frequency poles.
    """

    place: FloatArray
    speed: FloatArray
    pull: FloatArray
    inputs: FloatArray
    direct: FloatArray
    beside: FloatArray
    low_frequency: FloatArray


def solve_controlled_path(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation over a move by exact discretisation; position and speed are states, driven by
    the acceleration alone.

    Quasi-static is what constant speed (lag) and constant acceleration hold, without the
    low-frequency poles; low_frequency is the part of those poles; dynamic is the residual vibration
    of the others, and what loads do.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: The machine floats, so that no acceleration can last.

    Source: ``A X_s = -B_s``, ``A X_v = X_s - B_v``, ``A X_a = X_v - B_a``, ``xi' = A xi - X_a a'``.
    """
    motion = _split(path)
    space, count = path.loop.space, len(path.travel)
    rows, size = space.c[path.rows], len(space.a)
    a = np.zeros((size + 2, size + 2))
    a[:size] = np.hstack([space.a, motion.inputs[:, :2]])
    a[size, size + 1] = 1.0
    # of position and speed, which are states, the acceleration is the rate
    acting = motion.inputs[:, 2:]
    b = np.vstack([acting, np.zeros((2, acting.shape[1]))])
    b[-1, 0] = 1.0
    low_frequency = rows @ motion.low_frequency
    direct = np.vstack(
        [motion.direct[:, 2:], np.zeros((count, acting.shape[1])), motion.beside[:, 2:]]
    )
    c = np.vstack(
        [
            np.hstack([rows, motion.direct[:, :2] - np.outer(path.travel, [1.0, 0.0])]),
            np.hstack(
                [
                    low_frequency,
                    -(low_frequency @ motion.place)[:, None],
                    -(low_frequency @ motion.speed)[:, None],
                ]
            ),
            np.hstack([path.others.states, motion.beside[:, :2]]),
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
        WatchedValues(path.watched.channels, found[:, 2 * count :]),
    )


def solve_path_with_friction(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> tuple[PathDeviation, DrivenMotion]:
    """The same with friction in the guides; what friction does counts as dynamic.

    Args:
        path: Its loop is closed with its loads and ``friction_channels``.
        samples: ``(n,)`` from zero [s].

    Raises:
        ConvergenceError: Friction does not settle.
    """
    linear, space = solve_controlled_path(path, move, samples), path.loop.space

    def given(times: FloatArray) -> FloatArray:
        now = sample_move(move, times)
        own = [now.positions, now.speeds, now.accelerations]
        return np.column_stack([*own, loads_at(path.loads, times, now.speeds)])

    found = solve_motion(
        path.loop,
        given,
        samples,
        spread=path.given,
        breaks=list_breaks(move),
        longest=longest_step(path.loads),
    )
    positions = sample_move(move, samples).positions
    total = found.outputs[:, path.rows] - np.outer(positions, path.travel)
    acting = given(samples) @ spread_inputs(space.inputs, path.given).T
    acting[:, space.columns.of(friction_channels(path.loop.trains))] = -found.friction
    return PathDeviation(
        samples,
        total,
        linear.quasi_static,
        linear.low_frequency,
        total - linear.quasi_static - linear.low_frequency,
        WatchedValues(path.watched.channels, path.others.evaluate(found.right, acting)),
    ), found


def _split(path: ControlledPath) -> _Motion:
    space = path.loop.space
    if has_free_motions(path.loop):
        raise ModelError(
            "the machine floats, so nothing holds it against accelerating axes; join it to ground by a mount"
        )
    spread = spread_inputs(space.inputs, path.given)
    # sums in the order of the axes: of what constant speed holds little is left
    given, direct, beside = (
        (part[:, :, None] * spread).sum(axis=1)
        for part in (space.b, space.d[path.rows], path.others.inputs)
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
        beside,
        project_slow(space.a, 2.0 * np.pi * path.low_frequency_limit_hz),
    )


def _follow(
    path: ControlledPath, motion: _Motion, move: SetPoint, samples: FloatArray
) -> FloatArray:
    """What speed and acceleration hold ``(n, n_outputs)``."""
    rows, now = path.loop.space.c[path.rows], sample_move(move, samples)
    speed = rows @ motion.speed + motion.direct[:, 1]
    pull = rows @ (motion.pull - motion.low_frequency @ motion.pull) + motion.direct[:, 2]
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
