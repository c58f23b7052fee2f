"""A system in the coordinates of its undamped modes, with the residual flexibility that modes left
out and massless dofs add.
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest, solve_modal
from headstock.solvers.linear.static_response import solve_pinned, solve_static
from headstock.solvers.linear.symmetric_matrices import find_null_space, is_symmetric
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

NEGLIGIBLE = 1e-10  # of the largest residual flexibility
FASTEST = 4.0  # times the limit: residual modes are no faster, so that time steps need not be finer
DIAGONAL_LIMIT = (
    1e-9  # off-diagonal entries below this share of their diagonal entries are roundoff
)
ROUNDOFF = 1e-13  # and those below this share of the largest entry
SEEN_LIMIT = 1e-10  # a channel or a damper moves in a rigid-body motion by more than this share
# damping over stiffness of dofs without mass over the largest of a mode: below, it is roundoff of
# modal damping where some dofs have next to no mass
SETTLED = 1e-5


@dataclass(frozen=True, eq=False)
class ModalCoordinates:
    """``p'' + C p' + (Omega^2 + i H) p = B f``, ``y = L p + E f``: all modes, rigid-body modes
    first.

    Attributes:
        eigenvalues: ``(m,)`` omega^2 [rad^2/s^2], exactly zero for rigid-body modes.
        rigid_count: How many modes are rigid-body modes.
        inputs: ``(m, n_inputs)`` modal loads.
        outputs: ``(n_outputs, m)`` motions per unit modal coordinate.
        viscous: ``(m, m)`` or None.
        hysteretic: ``(m, m)`` or None.
        elastic: ``(n_outputs, n_inputs)`` exact static compliance of the elastic modes and of dofs
            without mass, apart from the rigid-body motion that an unbalanced load sets off.
        residual: ``(n_outputs, n_inputs)`` what the elastic modes together lack of it: the
            flexibility of dofs without mass and of modes left out, else roundoff.
        complete: No mode is left out and no dof is without mass, so that the residual is roundoff.
        shapes: ``(n, m)`` mass-normalised.
    """

    eigenvalues: FloatArray
    rigid_count: int
    inputs: FloatArray
    outputs: FloatArray
    viscous: FloatArray | None
    hysteretic: FloatArray | None
    elastic: FloatArray
    residual: FloatArray
    complete: bool
    shapes: FloatArray

    @property
    def omega(self) -> FloatArray:
        """Undamped angular frequencies ``(m,)`` [rad/s]."""
        return np.sqrt(self.eigenvalues)

    @functools.cached_property
    def damped_apart(self) -> bool:
        """Damping couples no two modes."""
        return is_diagonal(self.viscous) and is_diagonal(self.hysteretic)


def to_modal_coordinates(
    system: SecondOrderSystem,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    modes: ModalResult | None = None,
) -> ModalCoordinates | None:
    """Return the system in modal coordinates; None where they cannot carry it.

    That is so when a matrix is not symmetric (control, gyroscopic terms), or a damper acts on dofs
    without mass.

    Args:
        modes: All undamped modes, where they are already known.

    Raises:
        ModelError: A channel is unknown, or the system has no answer.
    """
    loads, rows = input_columns(system, inputs), output_rows(system, outputs)
    if not has_symmetric_terms(system):
        return None
    modes = modes or solve_modal(system)
    damped = system.damping is not None or system.hysteretic is not None
    if modes.infinite_count and damped and not _dampers_have_mass(system, modes):
        return None
    eigenvalues = (2.0 * np.pi * modes.frequencies_hz) ** 2
    eigenvalues[: modes.rigid_count] = 0.0
    modal_loads, modal_rows = modes.shapes.T @ loads, rows @ modes.shapes
    elastic = rows @ elastic_displacements(system, modes, loads)
    flexible = slice(modes.rigid_count, None)
    residual = elastic - (modal_rows[:, flexible] / eigenvalues[flexible]) @ modal_loads[flexible]
    return ModalCoordinates(
        eigenvalues=eigenvalues,
        rigid_count=modes.rigid_count,
        inputs=modal_loads,
        outputs=modal_rows,
        viscous=_project(system.damping, modes),
        hysteretic=_project(system.hysteretic, modes),
        elastic=elastic,
        residual=residual,
        complete=modes.infinite_count == 0,
        shapes=modes.shapes,
    )


def keep_modes(coordinates: ModalCoordinates, count: int) -> ModalCoordinates:
    """Keep only the lowest elastic modes; what the others add statically goes to the residual
    flexibility.

    Args:
        count: Elastic modes kept; rigid-body modes stay.

    Source: MacNeal (1971), A hybrid method of component mode synthesis; Geradin and Rixen (2015),
    section 3.3.5 (mode
        acceleration).
    """
    kept = slice(0, coordinates.rigid_count + count)
    flexible = slice(coordinates.rigid_count, coordinates.rigid_count + count)
    rows, loads = coordinates.outputs[:, kept], coordinates.inputs[kept]
    statics = (
        coordinates.outputs[:, flexible] / coordinates.eigenvalues[flexible]
    ) @ coordinates.inputs[flexible]
    return dataclasses.replace(
        coordinates,
        eigenvalues=coordinates.eigenvalues[kept],
        inputs=loads,
        outputs=rows,
        viscous=None if coordinates.viscous is None else coordinates.viscous[kept, kept],
        hysteretic=None if coordinates.hysteretic is None else coordinates.hysteretic[kept, kept],
        residual=coordinates.elastic - statics,
        complete=coordinates.complete
        and len(coordinates.eigenvalues) <= coordinates.rigid_count + count,
        shapes=coordinates.shapes[:, kept],
    )


def reduce_to_modes(
    system: SecondOrderSystem,
    channels: Sequence[Channel],
    up_to_hz: float,
    modes: ModalResult | None = None,
) -> SecondOrderSystem:
    """Return the modes up to a frequency, and a residual mode for each independent static
    flexibility of the channels that they lack.

    Static answers are exact. A residual mode has the mass of its own shape; one that would be faster
    than ``FASTEST`` times the limit gets the mass that makes it so fast.

    Args:
        system: Symmetric, with collocated channels.
        channels: Where loads act and motion is observed.
        up_to_hz: Modes up to here are kept.
        modes: All undamped modes, where they are already known.

    Source: MacNeal (1971), A hybrid method of component mode synthesis; Rubin (1975), Improved
    component-mode representation for structural dynamic analysis (residual mass).
    """
    modes = modes or solve_modal(system)
    loads, rows = input_columns(system, channels), output_rows(system, channels)
    kept = keep_lowest(modes, up_to_hz=up_to_hz)
    flexible = slice(kept.rigid_count, None)
    squares = (2.0 * np.pi * kept.frequencies_hz[flexible]) ** 2
    flexible_shapes = kept.shapes[:, flexible]
    elastic = elastic_displacements(system, modes, loads)
    rest = elastic - (flexible_shapes / squares) @ (flexible_shapes.T @ loads)
    # independent shapes among them, by the flexibility they carry
    flexibility = loads.T @ rest
    level, turn = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    whole = float(np.abs(loads.T @ elastic).max(initial=0.0))
    carried = level > NEGLIGIBLE * whole
    shapes = np.zeros((len(system.mass), 0))
    squares_of_rest = np.zeros(0)
    if carried.any():
        # unit stiffness: rest^T K rest is the flexibility itself
        shapes = rest @ (turn[:, carried] / np.sqrt(level[carried]))
        mass = shapes.T @ system.mass @ shapes
        lightest = 1.0 / (2.0 * np.pi * FASTEST * up_to_hz) ** 2
        inertia, axes = np.linalg.eigh(0.5 * (mass + mass.T))
        squares_of_rest = 1.0 / np.maximum(inertia, lightest)
        shapes = shapes @ axes * np.sqrt(squares_of_rest)
    basis = np.concatenate([kept.shapes, shapes], axis=1)
    rigid = np.zeros(kept.rigid_count)
    count = basis.shape[1]

    def project(matrix: np.ndarray | None) -> np.ndarray | None:  # type: ignore[type-arg]
        return None if matrix is None else basis.T @ matrix @ basis

    return dataclasses.replace(
        system,
        mass=np.eye(count),
        stiffness=np.diag(np.concatenate([rigid, squares, squares_of_rest])),
        damping=project(system.damping),
        hysteretic=project(system.hysteretic),
        inputs={channel: basis.T @ loads[:, index] for index, channel in enumerate(channels)},
        outputs={channel: rows[index] @ basis for index, channel in enumerate(channels)},
        labels=tuple(f"mode.{number}" for number in range(count)),
    )


def count_modes(coordinates: ModalCoordinates, limit_hz: float) -> int:
    """Return the elastic modes up to a frequency."""
    return int(
        np.count_nonzero(
            (coordinates.eigenvalues > 0.0) & (coordinates.omega <= 2.0 * np.pi * limit_hz)
        )
    )


def has_symmetric_terms(system: SecondOrderSystem) -> bool:
    """Return whether every matrix passes the test without which no symmetric solver may see it."""
    terms = (system.mass, system.stiffness, system.damping, system.hysteretic)
    return all(term is None or is_symmetric(term) for term in terms)


def elastic_displacements(
    system: SecondOrderSystem, modes: ModalResult, loads: FloatArray
) -> FloatArray:
    """Return the static displacements ``(n, k)`` without the rigid-body motion that an unbalanced
    load sets off.

    A load that is not in balance is balanced by the inertia forces of that motion, and the answer
    is orthogonal to it.

    Args:
        system: Symmetric.
        modes: Its undamped modes; only the rigid ones are used.
        loads: ``(n, k)`` generalised loads.

    Source: Geradin and Rixen (2015), section 2.6 (inertia relief, pseudo-inverse of a free
    structure).
    """
    if not modes.rigid_count:
        return solve_static(system, loads).displacements
    rigid = modes.shapes[:, : modes.rigid_count]
    balanced = loads - system.mass @ (rigid @ (rigid.T @ loads))
    displacements = solve_pinned(system, find_null_space(system.stiffness).free, balanced)
    return displacements - rigid @ (rigid.T @ (system.mass @ displacements))


def rigid_response(
    coordinates: ModalCoordinates,
) -> tuple[FloatArray, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Return the acceleration per unit load of the rigid-body motion ``(n_outputs, n_inputs)``, and
    where it is more than roundoff.
    """
    first = slice(0, coordinates.rigid_count)
    moved, applied = coordinates.outputs[:, first], coordinates.inputs[first]
    size = np.abs(moved) @ np.abs(applied)
    reach = np.outer(
        np.linalg.norm(coordinates.outputs, axis=1), np.linalg.norm(coordinates.inputs, axis=0)
    )
    return moved @ applied, size > SEEN_LIMIT * reach


def modal_motion(
    coordinates: ModalCoordinates, omega: FloatArray, loads: ComplexArray
) -> ComplexArray:
    """Return the modal coordinates ``(k, m)`` under harmonic modal loads ``(k, m)`` at angular
    frequencies ``(k,)``.
    """
    square, size = omega[:, None] ** 2, len(coordinates.eigenvalues)
    terms = (coordinates.viscous, coordinates.hysteretic)
    if coordinates.damped_apart:
        viscous, hysteretic = (0.0 if term is None else term.diagonal() for term in terms)
        lost = omega[:, None] * viscous + hysteretic
        return loads / (coordinates.eigenvalues - square + 1j * lost)
    viscous, hysteretic = (np.zeros((size, size)) if term is None else term for term in terms)
    moved = np.empty_like(loads)
    for row, value in enumerate(omega):
        matrix = np.diag(coordinates.eigenvalues - value**2) + 1j * (value * viscous + hysteretic)
        moved[row] = np.linalg.solve(matrix, loads[row])
    return moved


def damps_rigid_motion(coordinates: ModalCoordinates) -> bool:
    """Return whether a damper resists a rigid-body motion."""
    first = coordinates.rigid_count
    for matrix in (coordinates.viscous, coordinates.hysteretic):
        if (
            matrix is not None
            and first
            and np.abs(matrix[:first]).max() > SEEN_LIMIT * np.abs(matrix).max()
        ):
            return True
    return False


def is_diagonal(matrix: FloatArray | None) -> bool:
    """Return whether damping couples no two modes by more than roundoff; true for none."""
    if matrix is None:
        return True
    size = np.sqrt(np.abs(matrix.diagonal()))
    rest = np.abs(matrix - np.diag(matrix.diagonal()))
    return bool(
        (
            rest
            <= DIAGONAL_LIMIT * np.outer(size, size) + ROUNDOFF * np.abs(matrix).max(initial=0.0)
        ).all()
    )


def undamped(system: SecondOrderSystem) -> SecondOrderSystem:
    """Return the same system without any damping."""
    return dataclasses.replace(system, damping=None, hysteretic=None)


def _project(matrix: FloatArray | None, modes: ModalResult) -> FloatArray | None:
    if matrix is None or not matrix.any():
        return None
    projected = modes.shapes.T @ matrix @ modes.shapes
    return 0.5 * (projected + projected.T)


def _dampers_have_mass(system: SecondOrderSystem, modes: ModalResult) -> bool:
    """Return whether no damper moves with dofs that have no mass: their springs settle them at
    once, compared with the slowest mode.
    """
    massless = find_null_space(system.mass, what="mass").vectors
    springs = massless.T @ system.stiffness @ massless
    shapes = modes.shapes[:, modes.rigid_count :]
    squares = (2.0 * np.pi * modes.frequencies_hz[modes.rigid_count :]) ** 2
    for matrix in (system.damping, system.hysteretic):
        if matrix is None or not matrix.any():
            continue
        slowest = (np.einsum("ij,ij->j", shapes, matrix @ shapes) / squares).max(initial=0.0)
        rates = np.abs(eigh(massless.T @ matrix @ massless, springs, eigvals_only=True)).max()
        if rates > SETTLED * slowest:
            return False
    return modes.infinite_count == massless.shape[1]
