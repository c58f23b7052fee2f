"""Transient response of a linear system to loads in closed form: exact at every instant, with its
figures and its balance of energy.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.second_order import SecondOrderSystem
from headstock.solvers.state_spaces.load_history import IndexArray, LoadHistory, SteppedLoads
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.solvers.state_spaces.time_response import group_steps, make_propagator, sine_gains

UNBALANCED = 1e-8  # of a load, what is left of it where it moves the system as a whole
CHANGE = 1e-6  # of the largest value: a smaller change of the rest position is none


@dataclass(frozen=True, eq=False)
class Sampling:
    """What controllers do at their samples: they read, compute, and hold what they find.

    Attributes:
        jump: ``(s, s)`` states after a sample per state before it.
        fed: ``(s, n_inputs)`` the same per load just before it.
        step_s: Between two samples, the first at the time zero [s].
    """

    jump: FloatArray
    fed: FloatArray
    step_s: float


@dataclass(frozen=True, eq=False)
class StateHistory:
    """States of a system over time.

    Attributes:
        left: ``(n, s)`` states just before each time.
        right: ``(n, s)`` and just after it: an impulse, or a sample of controllers, is between them.
    """

    loads: SteppedLoads
    left: FloatArray
    right: FloatArray


@dataclass(frozen=True, eq=False)
class Response:
    """Displacements and speeds of outputs over time.

    Attributes:
        times: ``(n,)`` [s].
        begins: ``(n - 1, k)`` displacements at the begin of each step, after what happens there.
        ends: ``(n - 1, k)`` and at its end, before what happens there.
        begin_speeds: ``(n - 1, k)``.
        end_speeds: ``(n - 1, k)``.
        sampled: ``(m,)`` which of the times are samples.
    """

    times: FloatArray
    begins: FloatArray
    ends: FloatArray
    begin_speeds: FloatArray
    end_speeds: FloatArray
    sampled: IndexArray

    def sample(self) -> tuple[FloatArray, FloatArray]:
        """Return the times of the samples ``(m,)`` and displacements there ``(m, k)``, after what
        happens at them.
        """
        values = np.concatenate([self.begins, self.ends[-1:]])
        return self.times[self.sampled], values[self.sampled]


@dataclass(frozen=True)
class TransientFigures:
    """Figures of a displacement over time.

    Attributes:
        peak: Displacement of the largest size.
        peak_time: When [s].
        start: Where it was before everything.
        final: Where it comes to rest under the loads of the end; None where it does not.
        overshoot: Largest excursion beyond the final position over the way there; None without a
            way.
        settling: Time after which it stays near the final position [s]; None where it does not
            within the duration.
    """

    peak: float
    peak_time: float
    start: float
    final: float | None
    overshoot: float | None
    settling: float | None


@dataclass(frozen=True)
class EnergyBalance:
    """Energy of the modes kept [J].

    Attributes:
        initial: At the time zero, of what was deformed or moved before.
        largest: Most at any time.
    """

    initial: float
    work: float
    dissipated: float
    final: float
    largest: float

    @property
    def error(self) -> float:
        """Return what does not add up, over the largest part."""
        most = max(self.initial, abs(self.work), self.dissipated, self.largest)
        rest = self.initial + self.work - self.dissipated - self.final
        return abs(rest) / most if most else 0.0


@dataclass(frozen=True, eq=False)
class StiffnessLoss:
    """Damping of elastic modes ``(m,)`` that goes with their stiffness.

    Attributes:
        viscous: Over the stiffness [s], as of Rayleigh's damping.
        ratios: Damping ratios given to modes.
    """

    viscous: FloatArray
    structural: FloatArray
    ratios: FloatArray


def soften_system(
    system: SecondOrderSystem,
    modes: ModalResult,
    factors: FloatArray,
    loss: StiffnessLoss | None = None,
) -> SecondOrderSystem:
    """Return a symmetric system with other natural frequencies, of the same shapes.

    Args:
        factors: ``(m,)`` of the first elastic ones.
        loss: Damping that goes with what becomes softer; None where dampers stay as they are.
    """
    moved = slice(modes.rigid_count, modes.rigid_count + len(factors))
    momenta = system.mass @ modes.shapes[:, moved]
    squares = (2.0 * np.pi * modes.frequencies_hz[moved]) ** 2
    lost = (1.0 - factors**2) * squares
    stiffness = system.stiffness - (momenta * lost) @ momenta.T
    damping, hysteretic = system.damping, system.hysteretic
    if loss is not None and damping is not None:
        viscous = loss.viscous * lost + 2.0 * loss.ratios * (1.0 - factors) * np.sqrt(squares)
        damping = damping - (momenta * viscous) @ momenta.T
    if loss is not None and hysteretic is not None:
        hysteretic = hysteretic - (momenta * (loss.structural * lost)) @ momenta.T
    return dataclasses.replace(system, stiffness=stiffness, damping=damping, hysteretic=hysteretic)


def _find_equilibrium(
    space: StateSpace, loads: FloatArray, samples: Sampling | None
) -> FloatArray | None:
    """Find the state ``(s,)`` at rest under constant loads ``(n_inputs,)``, which samples leave as it
    is; None where they are not in balance, so that there is none.
    """
    rates, push = space.a, space.b @ loads
    if samples is not None:
        rates = np.vstack([rates, samples.jump - np.eye(len(rates))])
        push = np.concatenate([push, samples.fed @ loads])
    if not push.any():
        return np.zeros(len(space.a))
    rest = np.linalg.lstsq(rates, -push, rcond=1e-13)[0]
    left = np.linalg.norm(rates @ rest + push)
    return np.asarray(rest) if left <= UNBALANCED * np.linalg.norm(push) else None


def solve_transient(
    space: StateSpace,
    loads: SteppedLoads,
    initial_state: FloatArray,
    samples: Sampling | None = None,
) -> StateHistory:
    """Return the motion under loads, exact at every time of the grid whatever its steps.

    Args:
        initial_state: ``(s,)`` before the time zero, which a sample then leaves as it is.
        samples: Of controllers, whose step is a multiple of that of the samples of the loads; None
            without any.
    """
    lengths, kinds = group_steps(loads.steps)
    propagators = [make_propagator(space, length) for length in lengths]
    forcing = np.zeros((len(kinds), len(space.a)))
    for kind, (propagator, length) in enumerate(zip(propagators, lengths, strict=True)):
        here = kinds == kind
        linear = loads.linear[here]
        forcing[here] = linear[:, 0] @ propagator.start.T + linear[:, 1] @ propagator.end.T
        for sine in loads.sines:
            forward, quadrature = sine_gains(space, length, sine.omega)
            forcing[here] += sine.forward[here] @ forward.T + sine.quadrature[here] @ quadrature.T
    struck = loads.impulses @ space.b.T
    left = np.empty((len(loads.times), len(space.a)))
    right = np.empty_like(left)
    left[0], right[0] = initial_state, initial_state + struck[0]
    marks, acting = _mark_samples(loads, samples)
    for number, kind in enumerate(kinds):
        left[number + 1] = propagators[kind].advance(right[number]) + forcing[number]
        reached = left[number + 1]
        if samples is not None and marks[number + 1]:
            reached = samples.jump @ reached + samples.fed @ acting[number]
        right[number + 1] = reached + struck[number + 1]
    return StateHistory(loads, left, right)


def _mark_samples(loads: SteppedLoads, samples: Sampling | None) -> tuple[BoolArray, FloatArray]:
    """Return at which times ``(n,)`` controllers sample, and the loads ``(n - 1, k)`` at the ends of
    steps.
    """
    marks = np.zeros(len(loads.times), dtype=bool)
    if samples is None:
        return marks, loads.linear[:, 1]
    step = loads.times[loads.sampled[1]] - loads.times[loads.sampled[0]]
    every = round(samples.step_s / step)
    marks[loads.sampled[every::every]] = True
    return marks, loads.evaluate()[0][:, 1]


def read_response(space: StateSpace, motion: StateHistory) -> Response:
    """Return the displacements and speeds of the outputs."""
    values, rates = motion.loads.evaluate()
    begins, ends = motion.right[:-1], motion.left[1:]
    speeds = [
        (states @ space.a.T + values[:, end] @ space.b.T) @ space.c.T + rates[:, end] @ space.d.T
        for end, states in enumerate((begins, ends))
    ]
    return Response(
        motion.loads.times,
        begins @ space.c.T + values[:, 0] @ space.d.T,
        ends @ space.c.T + values[:, 1] @ space.d.T,
        speeds[0],
        speeds[1],
        motion.loads.sampled,
    )


def find_figures(
    response: Response, *, start: FloatArray, final: FloatArray | None, near: float
) -> tuple[TransientFigures, ...]:
    """Find the peak, overshoot and settling time of every output; between samples the displacement
    is the cubic of both displacements and both speeds.

    Args:
        response: Of ``k`` outputs.
        start: ``(k,)`` displacements before everything.
        final: ``(k,)`` where they come to rest; None where they do not.
        near: Share of the change, or of the peak where start and end are the same place, within
            which a displacement has settled.
    """
    return tuple(_figures_of(response, column, start, final, near) for column in range(len(start)))


def find_energy(space: StateSpace, motion: StateHistory) -> EnergyBalance | None:
    """Balance of energy, its integrals by the trapezoidal rule with end corrections (error of fourth
    order): what does not add up says how coarse the samples are for the modes that move.

    None of a system without modes.
    """
    if not space.modal:
        return None
    values, rates = motion.loads.evaluate()
    steps = motion.loads.steps[:, None]
    gains, viscous = space.b[1::2], -space.a[1::2, 1::2]
    powers, changes = [], []
    for end, states in enumerate((motion.right[:-1], motion.left[1:])):
        speeds = states[:, 1::2]
        accelerations = (states @ space.a.T + values[:, end] @ space.b.T)[:, 1::2]
        pushes, grows = values[:, end] @ gains.T, rates[:, end] @ gains.T
        lost = speeds @ viscous
        powers.append(np.stack([(pushes * speeds).sum(1), (lost * speeds).sum(1)], axis=1))
        changes.append(
            np.stack(
                [
                    (grows * speeds + pushes * accelerations).sum(1),
                    2.0 * (lost * accelerations).sum(1),
                ],
                axis=1,
            )
        )
    work, dissipated = (
        0.5 * steps * (powers[0] + powers[1]) + steps**2 / 12.0 * (changes[0] - changes[1])
    ).sum(axis=0)
    struck = motion.loads.impulses @ gains.T
    work += float((struck * 0.5 * (motion.left + motion.right)[:, 1::2]).sum())
    stored = _stored_energy(space, motion.right)
    initial = float(_stored_energy(space, motion.left[:1])[0])
    return EnergyBalance(
        initial, float(work), float(dissipated), float(stored[-1]), float(stored.max())
    )


def rest_positions(
    space: StateSpace,
    loads: Sequence[LoadHistory],
    duration: float,
    samples: Sampling | None = None,
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Return the displacements before everything and at rest under the loads of the end (None where
    they do not come to rest), and the state before everything.

    Raises:
        ModelError: What acts beforehand is not in balance.
    """
    before = np.array([load.before for load in loads])
    state = _find_equilibrium(space, before, samples)
    if state is None:
        raise ModelError(
            "a load that is released acts on a motion that nothing holds, so nothing was at rest under it"
        )
    start = space.c @ state + space.d @ before
    if not all(load.is_constant_at(duration) for load in loads):
        return start, None, state
    held = np.array([_value_at(load, duration) for load in loads])
    rest = _find_equilibrium(space, held, samples)
    final = None if rest is None else space.c @ rest + space.d @ held
    return start, final, state


def _value_at(load: LoadHistory, time: float) -> float:
    piece = int(np.searchsorted(load.begins, time, side="right")) - 1
    return float(load.values[piece]) if piece >= 0 and time < load.ends[piece] else 0.0


def _stored_energy(space: StateSpace, states: FloatArray) -> FloatArray:
    """Return the kinetic and strain energy ``(n,)`` of states ``(n, 2 m)``."""
    elastic = states[:, 0::2] * (space.a[1::2, 0::2].diagonal() < 0.0)
    return 0.5 * ((elastic**2).sum(axis=1) + (states[:, 1::2] ** 2).sum(axis=1))


def _figures_of(
    response: Response,
    column: int,
    start: FloatArray,
    final: FloatArray | None,
    near: float,
) -> TransientFigures:
    steps = np.diff(response.times)
    shares, values = _candidates(
        steps,
        (response.begins[:, column], response.ends[:, column]),
        (response.begin_speeds[:, column], response.end_speeds[:, column]),
    )
    row, output_index = np.unravel_index(int(np.argmax(np.abs(values))), values.shape)
    peak = float(values[row, output_index])
    peak_time = float(response.times[row] + steps[row] * shares[row, output_index])
    begin = float(start[column])
    if final is None:
        return TransientFigures(peak, peak_time, begin, None, None, None)
    rest = float(final[column])
    change = rest - begin
    largest = float(np.abs(values).max())
    moves = abs(change) > CHANGE * max(largest, abs(begin))
    overshoot = None
    if moves:
        overshoot = max(0.0, float((np.sign(change) * (values - rest)).max()) / abs(change))
    away = np.abs(values - rest).max(axis=1)
    outside = np.flatnonzero(away > near * (abs(change) if moves else float(away.max())))
    settling: float | None = 0.0
    if len(outside):
        last = int(outside[-1])
        settling = float(response.times[last + 1]) if last + 1 < len(steps) else None
    return TransientFigures(peak, peak_time, begin, rest, overshoot, settling)


def _candidates(
    steps: FloatArray, ends: tuple[FloatArray, FloatArray], speeds: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return where on each step the cubic of ends and speeds may be largest, and its values there,
    ``(n - 1, 4)`` each: both ends and both places without speed.
    """
    (y0, y1), (v0, v1) = ends, (speeds[0] * steps, speeds[1] * steps)
    # y = y0 + v0 s + b s^2 + a s^3
    a, b = 2.0 * (y0 - y1) + v0 + v1, 3.0 * (y1 - y0) - 2.0 * v0 - v1
    root = np.sqrt(np.maximum(b * b - 3.0 * a * v0, 0.0))
    # the stable form of both roots of 3 a s^2 + 2 b s + v0
    q = -(b + np.where(b >= 0.0, 1.0, -1.0) * root)
    with np.errstate(divide="ignore", invalid="ignore"):
        inner = [q / (3.0 * a), v0 / q]
    inside = [np.where(np.isfinite(s) & (s > 0.0) & (s < 1.0), s, 0.0) for s in inner]
    shares = np.stack([np.zeros_like(y0), np.ones_like(y0), *inside], axis=1)
    columns = (part[:, None] for part in (y0, v0, b, a))
    c0, c1, c2, c3 = columns
    values = c0 + shares * (c1 + shares * (c2 + shares * c3))
    values[:, 1] = y1
    return shares, values
