"""Errors of damped modes compared with finer meshes and all modes kept, from the first-order change
of their poles.
"""

import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import RayleighDamping
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.estimates.frequency_errors import truncated_parts
from headstock.reduction.estimates.mesh_errors import SILENT_SHARE, meshed_parts, silent_energies
from headstock.solvers.linear.damping import DampedModes, pair_with_undamped
from headstock.solvers.linear.symmetric_matrices import is_symmetric
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

EQUAL = 1e-6  # relative distance of poles: closer ones are shifted together
# condition number of a pole, 1 without damping, from which it and its neighbours interact
INTERACTING = 1.5
# of the distance to the next pole: interacting ones that move further may not exist at all
SEPARATE = 0.1
# times shift over distance: the second-order addition to the shift of an interacting pole
CURVATURE = 4.0
SAFETY = 1.2  # factor on the shift of any other pole


@dataclass(frozen=True, eq=False)
class DampingErrors:
    """Store errors of damped modes, in the order of the undamped modes they belong to.

    Attributes:
        frequencies_hz: Error of each damped frequency [Hz], zero where the mode is overdamped; None
            where it is unknown.
        ratios: Error of each damping ratio; None where it is unknown.
        dampers: The joint or component that dissipates most of the energy; empty where none
            dominates.
        creeping: The mode is overdamped.
    """

    frequencies_hz: tuple[float | None, ...]
    ratios: tuple[float | None, ...]
    dampers: tuple[str, ...]
    creeping: tuple[bool, ...]


def estimate_damping_errors(
    coupled: CoupledMachine, system: SecondOrderSystem, damped: DampedModes, count: int
) -> DampingErrors:
    """Return the possible errors of the damped modes that belong to the lowest undamped ones.

    A change ``dD(s)`` of the dynamic stiffness by a source of error shifts a pole by
    ``-x^T dD x / (x^T (2 s M + C) x)``. Modes left out change it by ``-s^4 R(-s^2)`` (see
    ``Truncation``), finer meshes reduce the stiffness; both include the damping proportional to
    mass and stiffness. Poles that damping brings close together are ill-conditioned: where one
    shifts by a tenth of the distance to the next, first-order changes are unreliable, and a dashpot
    near its impedance match leaves poles that no finer model has.

    Args:
        system: The same machine with its viscous damping.
        damped: Its poles, at least those of the lowest undamped modes.
        count: Number of undamped modes.

    Source: Lancaster (1964), Numer. Math. 6, 377-387, for the derivative of a pole; Tisseur (2000),
    Linear Algebra Appl. 309, 339-361,
        for its condition number.
    """
    pairs = pair_with_undamped(damped, count)
    wanted = sorted({pole for pair in pairs for pole in pair if pole is not None})
    changes = _StiffnessChanges(coupled)
    shifts: dict[int, list[complex] | None] = dict.fromkeys(wanted)
    if system.damping is None or is_symmetric(system.damping):
        shifts = {pole: _shift_pole(system, damped, pole, changes) for pole in wanted}
    hz, ratios, dampers = [], [], []
    for first, second in pairs:
        errors = _mode_errors(damped, first, second, shifts)
        hz.append(errors[0])
        ratios.append(errors[1])
        dampers.append(
            "" if first is None else _largest_damper(coupled, system, damped.shapes[:, first])
        )
    creeping = tuple(
        first is not None and damped.frequencies_hz[first] == 0.0 for first, _ in pairs
    )
    return DampingErrors(tuple(hz), tuple(ratios), tuple(dampers), creeping)


class _StiffnessChanges:
    """Evaluate changes of a machine's dynamic stiffness by the sources of error at a pole."""

    def __init__(self, coupled: CoupledMachine) -> None:
        self._coupled = coupled
        self._truncated, self._meshed = truncated_parts(coupled), meshed_parts(coupled)

    def project(self, pole: complex, shapes: ComplexArray) -> list[ComplexArray] | None:
        """Return ``X^T dD X`` ``(k, k)`` for each source; None where a source is not known."""
        square = -(pole**2)
        if any(
            not abs(square) < part.truncation.limit for part in self._truncated.values()
        ) or self._is_silent(shapes):
            return None
        projections: list[ComplexArray] = []
        for name, part in self._truncated.items():
            # sum of lambda^2 p p^T / (omega_k^2 - lambda) over the modes left out, at complex
            # lambda: first moment, and all of the series' rest as if at the lowest of them (see
            # ``most_participation``)
            moments, moved = part.truncation, part.rows @ shapes
            elastic, heavy = self._damped(name, pole)
            ratio = square * heavy / elastic
            projections.append(
                square
                * heavy
                * ratio
                * (
                    moved.T
                    @ (moments.first + ratio / (1.0 - square / moments.limit) * moments.second)
                    @ moved
                )
            )
        for name, mesh in self._meshed.items():
            elastic, heavy = self._damped(name, pole)
            strained, moved, shape = mesh.strain(shapes), mesh.rows @ shapes, mesh.shape
            projections.append(elastic * (strained.T @ mesh.energy @ strained))
            if shape is not None:
                projections.append(
                    elastic * (strained.T @ shape.stiffness @ strained)
                    - square * heavy * (moved.T @ shape.mass @ moved)
                )
        return projections

    def _damped(self, name: str, pole: complex) -> tuple[complex, complex]:
        """Return ``1 + s beta`` of a component's stiffness and ``1 + alpha / s`` of its mass."""
        damping = self._coupled.rayleigh.get(name, RayleighDamping())
        return 1.0 + damping.beta * pole, 1.0 + (damping.alpha / pole if pole else 0.0)

    def _is_silent(self, shapes: ComplexArray) -> bool:
        parts: FloatArray = np.hstack([shapes.real, shapes.imag])
        energy = np.einsum(
            "im,ij,jm->", parts, self._coupled.system.stiffness, parts, optimize=True
        )
        return bool(silent_energies(self._coupled, parts).sum() > SILENT_SHARE * energy)


def _shift_pole(
    system: SecondOrderSystem, damped: DampedModes, index: int, changes: _StiffnessChanges
) -> list[complex] | None:
    """Return the shift of a pole by each source of error; None where it is unknown."""
    pole = complex(damped.poles[index])
    every = np.concatenate([damped.poles, damped.poles[damped.poles.imag > 0.0].conj()])
    distances = np.abs(every - pole)
    # shapes of equal poles are arbitrary combinations of one another: they are shifted together
    shapes = damped.shapes[:, distances[: len(damped.poles)] <= EQUAL * abs(pole)]
    slope = shapes.T @ (
        2.0 * pole * (system.mass @ shapes)
        + (0.0 if system.damping is None else system.damping @ shapes)
    )
    projected = changes.project(pole, shapes)
    if projected is None or not np.linalg.cond(slope) < 1.0 / EQUAL:
        return None
    moved = [np.linalg.eigvals(np.linalg.solve(slope, change)) for change in projected]
    shifts = [complex(values[np.argmax(np.abs(values))]) for values in moved]
    if 2.0 * abs(pole) * np.linalg.norm(np.linalg.inv(slope), 2) <= INTERACTING:
        return shifts
    share = sum(abs(shift) for shift in shifts) / distances[distances > EQUAL * abs(pole)].min(
        initial=np.inf
    )
    return None if share > SEPARATE else [shift / (1.0 - CURVATURE * share) for shift in shifts]


def _mode_errors(
    damped: DampedModes,
    first: int | None,
    second: int | None,
    shifts: dict[int, list[complex] | None],
) -> tuple[float | None, float | None]:
    """Return the errors of a mode's damped frequency [Hz] and damping ratio."""
    moved = None if first is None else shifts[first]
    if first is None or moved is None:
        return None, None
    pole = complex(damped.poles[first])
    if damped.frequencies_hz[first] > 0.0:
        # zeta = -Re s / |s|, the cosine of an angle that a shift across the pole turns; one along
        # the pole does so in the second order
        across = (
            sum(abs((shift * pole.conjugate()).imag) for shift in moved)
            * abs(pole.imag)
            / abs(pole) ** 3
        )
        along = 2.0 * abs(pole.real) * sum(abs(shift) for shift in moved) / abs(pole) ** 2
        return SAFETY * sum(abs(shift.imag) for shift in moved) / (2.0 * np.pi), SAFETY * max(
            across, along
        )
    other = None if second is None else shifts[second]
    if second is None or other is None or not damped.poles[second].real * pole.real > 0.0:
        return None, None
    real_pole, next_to = float(pole.real), float(damped.poles[second].real)
    moves = (
        sum(abs(shift) for shift in moved) / abs(real_pole),
        sum(abs(shift) for shift in other) / abs(next_to),
    )
    # the ratio depends on the quotient of both poles alone
    quotient = math.sqrt(real_pole / next_to)
    return 0.0, SAFETY * 0.25 * abs(quotient - 1.0 / quotient) * sum(moves)


def _largest_damper(coupled: CoupledMachine, system: SecondOrderSystem, shape: ComplexArray) -> str:
    """Return the joint or component that dissipates more than half of the energy of a damped
    motion; empty without one.
    """
    if system.damping is None:
        return ""

    losses = {
        f"joint {spring.name}": _lost(spring.damping, spring.rows @ shape)
        for spring in coupled.joint_springs
    }
    for name, matrix in coupled.matrices.dampings.items():
        losses[f"component {name}"] = _lost(matrix, coupled.basis[coupled.offsets[name]] @ shape)
    largest = max(losses, key=lambda name: losses[name], default="")
    return largest if largest and losses[largest] > 0.5 * _lost(system.damping, shape) else ""


def _lost(damping: FloatArray, motion: ComplexArray) -> float:
    return float((motion.conj() @ damping @ motion).real)
