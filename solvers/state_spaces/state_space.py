"""First-order form of a second-order system with named inputs and outputs: ``x' = A x + B u``,
``y = C x + D u``.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_little_mass, equivalent_viscous
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.linear.modal_coordinates import (
    ModalCoordinates,
    count_modes,
    has_symmetric_terms,
    is_diagonal,
    keep_modes,
    to_modal_coordinates,
)
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    Index,
    SecondOrderSystem,
    input_columns,
    output_rows,
)
from headstock.solvers.watched_outputs import Watch, WatchedOutputs

MASSLESS_CONDITION = 1e14


@dataclass(frozen=True, eq=False)
class UncoupledModes:
    """Modes that nothing couples: state ``2k, 2k + 1`` is ``(s p, p')`` of mode k.

    Attributes:
        scales: ``(m,)`` s [rad/s].
        eigenvalues: ``(m,)`` omega^2 [rad^2/s^2].
        viscous: ``(m,)`` ``2 zeta omega`` [rad/s].
    """

    scales: FloatArray
    eigenvalues: FloatArray
    viscous: FloatArray


@dataclass(frozen=True, eq=False)
class Feedthrough:
    """Direct feedthrough of inputs to outputs, whatever moves.

    Attributes:
        outputs: ``p`` of them.
        inputs: ``k`` of them.
        shares: ``(p, k)``.
    """

    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    shares: FloatArray


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear system in time.

    Attributes:
        a: ``(n, n)``.
        b: ``(n, n_inputs)``.
        c: ``(n_outputs, n)``.
        d: ``(n_outputs, n_inputs)``.
        pairs: The modes behind the states, where no damping couples them.
        modal: States ``2k, 2k + 1`` are ``(s p, p')`` of mode k, s its angular frequency.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    states: tuple[str, ...]
    pairs: UncoupledModes | None = None
    modal: bool = False

    @functools.cached_property
    def columns(self) -> Index:
        """Return where the inputs stand."""
        return Index(self.inputs)

    @functools.cached_property
    def rows(self) -> Index:
        """Return where the outputs stand."""
        return Index(self.outputs)

    def select(self, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> "StateSpace":
        """Return the same states between some of the inputs and outputs."""
        if (tuple(inputs), tuple(outputs)) == (self.inputs, self.outputs):
            return self
        columns, rows = self.columns.of(inputs), self.rows.of(outputs)
        return dataclasses.replace(
            self,
            b=self.b[:, columns],
            c=self.c[rows],
            d=self.d[rows][:, columns],
            inputs=tuple(inputs),
            outputs=tuple(outputs),
        )

    def pass_on(self, direct: "Feedthrough | None") -> "StateSpace":
        """Return the system with further direct feedthrough of some inputs to some outputs."""
        if direct is None:
            return self
        d, rows = self.d.copy(), self.rows.of(direct.outputs)
        block = d[rows]
        block[:, self.columns.of(direct.inputs)] += direct.shares
        d[rows] = block
        return dataclasses.replace(self, d=d)

    def watch(self, outputs: Watch) -> WatchedOutputs:
        """Return some of the outputs, with rates and accelerations of others added.

        Those others are displacements: what inputs do to them directly has no rate here.
        """
        rows = self.rows.of(outputs.channels)
        states, inputs = self.c[rows], self.d[rows]
        rates, accelerations = (
            self._find_rows(outputs.channels, added) @ self.a
            for added in (outputs.rates, outputs.accelerations)
        )
        # y' = C A x, y'' = C A (A x + B u)
        return WatchedOutputs(
            states + rates + accelerations @ self.a, inputs + accelerations @ self.b
        )

    def _find_rows(
        self, channels: Sequence[Channel], added: Mapping[Channel, Channel]
    ) -> FloatArray:
        """Find the rows ``(k, n)`` of what is added to each channel; zero for nothing."""
        rows = np.zeros((len(channels), len(self.a)))
        some = [number for number, channel in enumerate(channels) if channel in added]
        rows[some] = self.c[self.rows.of(added[channels[number]] for number in some)]
        return rows

    def respond(self, omega: FloatArray) -> ComplexArray:
        """Return the frequency response ``(n_freq, n_outputs, n_inputs)`` at angular frequencies
        [rad/s].
        """
        unit = np.eye(len(self.a))
        return np.array(
            [
                self.c @ np.linalg.solve(1j * value * unit - self.a, self.b + 0j) + self.d
                for value in omega
            ]
        )


def to_state_space(
    system: SecondOrderSystem,
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    up_to_hz: float | None = None,
    modes: ModalResult | None = None,
    little_mass: bool = False,
) -> StateSpace:
    """Return the state space of a system; outputs are displacements.

    In modal coordinates, each mode as ``(omega p, p')``: half the sum of squares of the states is
    the energy. Structural damping is replaced by the viscous one of equal loss in each mode. A
    system with unsymmetric terms keeps its own dofs.

    Args:
        system: Any; unsymmetric ones need mass on every dof.
        up_to_hz: Keep modes up to here only; the static compliance of the others goes to D. None
            keeps all.
        modes: All undamped modes, where they are already known.
        little_mass: Give a little to dofs without mass that dampers act on.

    Raises:
        ModelError: A channel is unknown, or a dof without mass stands in the way.
    """
    if not has_symmetric_terms(system):
        return _unsymmetric(system, tuple(inputs), tuple(outputs))
    damped = equivalent_viscous(system, modes)
    coordinates = to_modal_coordinates(damped, inputs, outputs, modes)
    if coordinates is None and little_mass:
        lighter = add_little_mass(damped, modes or solve_modal(system))
        coordinates = to_modal_coordinates(lighter, inputs, outputs)
    if coordinates is None:
        raise ModelError(
            "a damper acts on dofs that have neither mass nor stiffness"
            if little_mass
            else "a damper acts on a dof without mass, which has no place in a state space; give every body a mass"
        )
    if up_to_hz is not None:
        coordinates = keep_modes(coordinates, count_modes(coordinates, up_to_hz))
    return modal_state_space(coordinates, tuple(inputs), tuple(outputs))


def modal_state_space(
    coordinates: ModalCoordinates, inputs: tuple[Channel, ...], outputs: tuple[Channel, ...]
) -> StateSpace:
    """Return the state space of modal coordinates: state ``2k`` is ``omega p`` of mode k, state
    ``2k + 1`` is ``p'``.

    Args:
        coordinates: ``m`` modes with their input and output matrices and the residual flexibility
            of those left out.
        inputs: Name of each column of ``B`` and ``D``.
        outputs: Name of each row of ``C`` and ``D``.

    Returns:
        ``A (2 m, 2 m)``, ``B``, ``C``, ``D``; for a rigid-body mode ``omega`` is that of the lowest
        elastic one, as a mere scale.
    """
    eigenvalues, count = coordinates.eigenvalues, len(coordinates.eigenvalues)
    lowest = float(np.sqrt(eigenvalues[eigenvalues > 0.0].min(initial=np.inf)))
    scales = np.where(
        eigenvalues > 0.0, np.sqrt(eigenvalues), lowest if np.isfinite(lowest) else 1.0
    )
    damping = np.zeros((count, count)) if coordinates.viscous is None else coordinates.viscous
    first, second = np.arange(0, 2 * count, 2), np.arange(1, 2 * count, 2)
    a = np.zeros((2 * count, 2 * count))
    a[first, second] = scales
    a[second, first] = -eigenvalues / scales
    a[np.ix_(second, second)] = -damping
    b, c = np.zeros((2 * count, len(inputs))), np.zeros((len(outputs), 2 * count))
    b[second], c[:, first] = coordinates.inputs, coordinates.outputs / scales
    d = np.zeros_like(coordinates.residual) if coordinates.complete else coordinates.residual
    names = tuple(
        f"mode {mode + 1} {part}" for mode in range(count) for part in ("displacement", "velocity")
    )
    pairs = (
        UncoupledModes(scales, eigenvalues, np.array(damping.diagonal()))
        if is_diagonal(coordinates.viscous)
        else None
    )
    return StateSpace(a, b, c, d, inputs, outputs, names, pairs, modal=True)


def _unsymmetric(
    system: SecondOrderSystem, inputs: tuple[Channel, ...], outputs: tuple[Channel, ...]
) -> StateSpace:
    if system.hysteretic is not None:
        raise ModelError(
            "structural damping of an unsymmetric system has no equivalent in time; give it viscous damping"
        )
    if not np.linalg.cond(system.mass) < MASSLESS_CONDITION:
        raise ModelError(
            "a dof without mass has no place in the state space of an unsymmetric system; give every body a mass"
        )
    count = len(system.mass)
    zero = np.zeros((count, count))
    damping = zero if system.damping is None else np.linalg.solve(system.mass, system.damping)
    a = np.block(
        [[zero, np.eye(count)], [-np.linalg.solve(system.mass, system.stiffness), -damping]]
    )
    b = np.vstack(
        [
            np.zeros((count, len(inputs))),
            np.linalg.solve(system.mass, input_columns(system, inputs)),
        ]
    )
    c = np.hstack([output_rows(system, outputs), np.zeros((len(outputs), count))])
    names = tuple(
        f"{label} {part}" for part in ("displacement", "velocity") for label in system.labels
    )
    return StateSpace(a, b, c, np.zeros((len(outputs), len(inputs))), inputs, outputs, names)
