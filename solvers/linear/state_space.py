"""First-order form of a second-order system with named inputs and outputs: ``x' = A x + B u``, ``y = C x + D u``.

Also as state spaces of python-control, where it is installed, and smaller by balanced truncation, with the bound of its error.
"""

import dataclasses
import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.modal_coordinates import (
    ModalCoordinates,
    count_modes,
    has_symmetric_terms,
    is_diagonal,
    keep_modes,
    to_modal_coordinates,
)
from headstock.solvers.second_order import ComplexArray, Port, SecondOrderSystem, input_columns, name_port, output_rows

MASSLESS_CONDITION = 1e14


@dataclass(frozen=True, eq=False)
class ModalPairs:
    """Modes that nothing couples: state ``2k, 2k + 1`` is ``(s p, p')`` of mode k.

    Attributes:
        scales: ``(m,)`` s [rad/s].
        squares: ``(m,)`` omega^2 [rad^2/s^2].
        viscous: ``(m,)`` ``2 zeta omega`` [rad/s].
    """

    scales: FloatArray
    squares: FloatArray
    viscous: FloatArray


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear system in time.

    Attributes:
        a: ``(n, n)``.
        b: ``(n, n_inputs)``.
        c: ``(n_outputs, n)``.
        d: ``(n_outputs, n_inputs)``.
        inputs: Names of the loads.
        outputs: Names of the motions.
        states: A name for each state.
        pairs: The modes behind the states, where no damping couples them.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    states: tuple[str, ...]
    pairs: ModalPairs | None = None

    def respond(self, omega: FloatArray) -> ComplexArray:
        """Frequency response ``(n_freq, n_outputs, n_inputs)`` at angular frequencies [rad/s]."""
        unit = np.eye(len(self.a))
        return np.array([self.c @ np.linalg.solve(1j * value * unit - self.a, self.b + 0j) + self.d for value in omega])


def to_state_space(
    system: SecondOrderSystem, *, inputs: Sequence[Port], outputs: Sequence[Port], up_to_hz: float | None = None
) -> StateSpace:
    """State space of a system; outputs are displacements.

    In modal coordinates, each mode as ``(omega p, p')``: half the sum of squares of the states is the energy. Structural damping
    is replaced by the viscous one of equal loss in each mode. A system with unsymmetric terms keeps its own dofs.

    Args:
        system: Any; unsymmetric ones need mass on every dof.
        inputs: Ports.
        outputs: Ports.
        up_to_hz: Keep modes up to here only; the static compliance of the others goes to D. None keeps all.

    Raises:
        ModelError: A port is unknown, or a dof without mass stands in the way.
    """
    if not has_symmetric_terms(system):
        return _unsymmetric(system, tuple(inputs), tuple(outputs))
    coordinates = to_modal_coordinates(equivalent_viscous(system), inputs, outputs)
    if coordinates is None:
        raise ModelError("a damper acts on a dof without mass, which has no place in a state space; give every body a mass")
    if up_to_hz is not None:
        coordinates = keep_modes(coordinates, count_modes(coordinates, up_to_hz))
    return modal_state_space(coordinates, tuple(inputs), tuple(outputs))


def modal_state_space(coordinates: ModalCoordinates, inputs: tuple[Port, ...], outputs: tuple[Port, ...]) -> StateSpace:
    """State space of modal coordinates: state ``2k`` is ``omega p`` of mode k, state ``2k + 1`` is ``p'``."""
    squares, count = coordinates.squares, len(coordinates.squares)
    lowest = float(np.sqrt(squares[squares > 0.0].min(initial=np.inf)))
    scales = np.where(squares > 0.0, np.sqrt(squares), lowest if np.isfinite(lowest) else 1.0)
    damping = np.zeros((count, count)) if coordinates.viscous is None else coordinates.viscous
    first, second = np.arange(0, 2 * count, 2), np.arange(1, 2 * count, 2)
    a = np.zeros((2 * count, 2 * count))
    a[first, second] = scales
    a[second, first] = -squares / scales
    a[np.ix_(second, second)] = -damping
    b, c = np.zeros((2 * count, len(inputs))), np.zeros((len(outputs), 2 * count))
    b[second], c[:, first] = coordinates.inputs, coordinates.outputs / scales
    d = np.zeros_like(coordinates.residual) if coordinates.complete else coordinates.residual
    names = tuple(f"mode {mode + 1} {part}" for mode in range(count) for part in ("displacement", "velocity"))
    pairs = ModalPairs(scales, squares, np.array(damping.diagonal())) if is_diagonal(coordinates.viscous) else None
    return StateSpace(a, b, c, d, inputs, outputs, names, pairs)


def _unsymmetric(system: SecondOrderSystem, inputs: tuple[Port, ...], outputs: tuple[Port, ...]) -> StateSpace:
    if system.hysteretic is not None:
        raise ModelError("structural damping of an unsymmetric system has no equivalent in time; give it viscous damping")
    if not np.linalg.cond(system.mass) < MASSLESS_CONDITION:
        raise ModelError("a dof without mass has no place in the state space of an unsymmetric system; give every body a mass")
    count = len(system.mass)
    zero = np.zeros((count, count))
    damping = zero if system.damping is None else np.linalg.solve(system.mass, system.damping)
    a = np.block([[zero, np.eye(count)], [-np.linalg.solve(system.mass, system.stiffness), -damping]])
    b = np.vstack([np.zeros((count, len(inputs))), np.linalg.solve(system.mass, input_columns(system, inputs))])
    c = np.hstack([output_rows(system, outputs), np.zeros((len(outputs), count))])
    names = tuple(f"{label} {part}" for part in ("displacement", "velocity") for label in system.labels)
    return StateSpace(a, b, c, np.zeros((len(outputs), len(inputs))), inputs, outputs, names)


def to_control(space: StateSpace) -> Any:
    """A ``control.StateSpace`` with the same matrices and names.

    Raises:
        ModelError: python-control is not installed.
    """
    try:
        control = importlib.import_module("control")
    except ImportError as error:
        raise ModelError("python-control is not installed; install it by `pip install control`, or write a .mat file") from error
    return control.StateSpace(
        space.a, space.b, space.c, space.d,
        inputs=[name_port(port) for port in space.inputs],
        outputs=[name_port(port) for port in space.outputs],
        states=list(space.states),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class BalancedReduction:
    """A truncated state space and what it may be off by.

    Attributes:
        space: Of the wanted order; its states have no meaning of their own.
        hankel: ``(n,)`` Hankel singular values of the whole, falling.
        bound: The largest singular value of the error lies below this at every frequency.
    """

    space: StateSpace
    hankel: FloatArray
    bound: float


def balance_truncate(space: StateSpace, order: int) -> BalancedReduction:
    """Keep the states that loads reach and outputs see most.

    Args:
        space: Every pole must decay.
        order: Number of states to keep.

    Raises:
        ModelError: A pole does not decay, or the order is not between one and the number of states.

    Source: Moore (1981); Laub, Heath, Paige and Ward (1987), square-root algorithm; Glover (1984) for the bound
        ``2 (sigma_{r+1} + ... + sigma_n)``.
    """
    size = len(space.a)
    if not 1 <= order <= size:
        raise ModelError(f"order {order} is not between 1 and the {size} states there are")
    slowest = float(np.linalg.eigvals(space.a).real.max())
    if not slowest < 0.0:
        raise ModelError(
            f"balanced truncation needs poles that decay, and one has the real part {slowest:.3g}; give the machine damping"
        )
    reach = _root(scipy.linalg.solve_continuous_lyapunov(space.a, -space.b @ space.b.T))
    sight = _root(scipy.linalg.solve_continuous_lyapunov(space.a.T, -space.c.T @ space.c))
    left, hankel, right = np.linalg.svd(sight.T @ reach)
    scale = 1.0 / np.sqrt(hankel[:order])
    into, back = (sight @ left[:, :order] * scale).T, reach @ right[:order].T * scale
    reduced = dataclasses.replace(
        space,
        a=into @ space.a @ back,
        b=into @ space.b,
        c=space.c @ back,
        states=tuple(f"balanced {number + 1}" for number in range(order)),
        pairs=None,
    )
    return BalancedReduction(reduced, hankel, float(2.0 * hankel[order:].sum()))


def measure_error(whole: StateSpace, reduced: StateSpace, frequencies_hz: FloatArray) -> float:
    """Largest singular value of the difference of two responses over given frequencies."""
    omega = 2.0 * np.pi * np.asarray(frequencies_hz, dtype=float)
    return float(np.linalg.norm(whole.respond(omega) - reduced.respond(omega), ord=2, axis=(1, 2)).max())


def _root(gramian: FloatArray) -> FloatArray:
    """``R`` with ``R R^T`` equal to a gramian; what rounding makes negative is zero."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
