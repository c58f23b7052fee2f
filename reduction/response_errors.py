"""How far the frequency response of a reduced machine is from that with every mode kept."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from headstock.geometry.frames import FloatArray
from headstock.reduction.frequency_errors import TruncatedPart, new_directions
from headstock.solvers.modal_analysis import ModalResult
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

REACH = 2.0  # times the highest frequency: modes of the trial space; static responses stand for those above
CHUNK = 256  # frequencies at a time


@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """What the modes left out change of a receptance, as two estimates between which it lies as a rule.

    Attributes:
        least: ``(n_freq, n_outputs, n_inputs)`` change by the least they can add; NaN where there is no bound.
        most: The same by the most they can add.
    """

    least: ComplexArray
    most: ComplexArray

    @property
    def bounds(self) -> FloatArray:
        """Size of the error ``(n_freq, n_outputs, n_inputs)``: the larger change and the distance between both."""
        return np.asarray(np.maximum(np.abs(self.least), np.abs(self.most)) + np.abs(self.most - self.least))


def bound_response_errors(
    system: SecondOrderSystem,
    parts: Mapping[str, TruncatedPart],
    modes: ModalResult,
    ports: tuple[FloatArray, FloatArray],
    frequencies_hz: FloatArray,
    *,
    loss_factors: Mapping[str, float],
) -> ResponseErrors:
    """Change of a frequency response by the modes that components leave out.

    The dynamic stiffness loses ``lambda^2 R(lambda)`` (see ``bound_frequency_errors``); a loss factor eta of a component divides
    its ``omega_k^2`` by ``1 / (1 + i eta)``. Both responses are computed in the space of the machine's modes up to ``REACH`` times the
    highest frequency, of the static responses to the loads and at the outputs, and of the first corrections of the modes.

    Args:
        system: The coupled machine with its damping.
        parts: Its components that leave modes out.
        modes: All its undamped modes.
        ports: Loads ``(n, n_inputs)`` and output rows ``(n_outputs, n)``.
        frequencies_hz: ``(n_freq,)``.
        loss_factors: By component, where they act in the system.

    Source: Leung (1978) for the condensed dynamic stiffness; Jakobsson, Bengzon and Larson (2012, arXiv:1206.5479) estimate the same
        error by a dual problem.
    """
    loads, rows = ports
    shape = (len(frequencies_hz), len(rows), loads.shape[1])
    least, most = np.zeros(shape, dtype=complex), np.zeros(shape, dtype=complex)
    if not parts:
        return ResponseErrors(least, most)
    space = _trial_space(system, parts, modes, np.hstack([loads, rows.T]), float(frequencies_hz.max()))
    pushes = np.hstack([space.T @ loads, space.T @ rows.T]).astype(complex)
    inner = _Projection(system, parts, space, loss_factors)
    squares = (2.0 * np.pi * frequencies_hz) ** 2
    limit = min(part.truncation.limit for part in parts.values())
    least[squares >= limit] = most[squares >= limit] = np.nan
    inside = np.flatnonzero((squares > 0.0) & (squares < limit))
    for start in range(0, len(inside), CHUNK):
        lines = inside[start : start + CHUNK]
        dynamic, (low, high) = inner.dynamic_stiffness(squares[lines]), inner.participations(squares[lines])
        plain = (rows @ space) @ np.linalg.solve(dynamic, pushes[:, : loads.shape[1]])
        moved = np.linalg.solve(dynamic - high, pushes)
        given, seen = moved[:, :, : loads.shape[1]], moved[:, :, loads.shape[1] :]
        most[lines] = (rows @ space) @ given - plain
        # from the most to the least it is a small step, taken to first order: a third factorisation would cost half as much again
        least[lines] = most[lines] - seen.transpose(0, 2, 1) @ ((high - low) @ given)
    return ResponseErrors(least, most)


class _Projection:
    """A damped system and what its components leave out, in a trial space."""

    def __init__(
        self, system: SecondOrderSystem, parts: Mapping[str, TruncatedPart], space: FloatArray, loss_factors: Mapping[str, float]
    ) -> None:
        self._stiffness: ComplexArray = (space.T @ system.stiffness @ space).astype(complex)
        if system.hysteretic is not None:
            self._stiffness += 1j * (space.T @ system.hysteretic @ space)
        self._mass = space.T @ system.mass @ space
        self._damping = None if system.damping is None else space.T @ system.damping @ space
        self._moments = []
        for name, part in parts.items():
            seen, moments = part.rows @ space, part.truncation
            first, second = seen.T @ moments.first @ seen, seen.T @ moments.second @ seen
            self._moments.append((first, second, moments.limit, 1.0 + 1j * loss_factors.get(name, 0.0)))

    def dynamic_stiffness(self, squares: FloatArray) -> ComplexArray:
        """``K + i H + i omega C - omega^2 M`` ``(n_freq, m, m)``."""
        dynamic: ComplexArray = self._stiffness - squares[:, None, None] * self._mass
        if self._damping is not None:
            dynamic = dynamic + 1j * np.sqrt(squares)[:, None, None] * self._damping
        return dynamic

    def participations(self, squares: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """The least and the most that ``lambda^2 R`` can be ``(n_freq, m, m)``."""
        shape = (len(squares), *self._mass.shape)
        least, most = np.zeros(shape, dtype=complex), np.zeros(shape, dtype=complex)
        column = squares[:, None, None]
        for first, second, limit, lossy in self._moments:
            least += column**2 / lossy * (first + column / lossy * second)
            most += column**2 / lossy * (first + column / lossy / (1.0 - column / limit) * second)
        return least, most


def _trial_space(
    system: SecondOrderSystem, parts: Mapping[str, TruncatedPart], modes: ModalResult, pushes: FloatArray, highest_hz: float
) -> FloatArray:
    """M-orthonormal directions ``(n, m)`` in which the response and its change are sought."""
    count = max(modes.rigid_count + 1, int(np.searchsorted(modes.frequencies_hz, REACH * highest_hz, side="right")))
    shapes = modes.shapes[:, :count]
    elastic = modes.frequencies_hz[modes.rigid_count :]
    shift = (2.0 * np.pi * float(elastic[0])) ** 2 if modes.rigid_count and len(elastic) else 0.0
    near = shapes[:, : max(modes.rigid_count + 1, int(np.searchsorted(modes.frequencies_hz, 1.2 * highest_hz, side="right")))]
    pushed = np.sum([part.rows.T @ (part.truncation.first @ (part.rows @ near)) for part in parts.values()], axis=0)
    try:
        factor = cho_factor(system.stiffness + shift * system.mass)
    except np.linalg.LinAlgError:
        return shapes
    return np.hstack([shapes, new_directions(cho_solve(factor, np.hstack([pushes, pushed])), shapes, system.mass)])
