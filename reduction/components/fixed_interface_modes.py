"""Fixed-interface modes of a component, iterative or dense, and the moments of those that a
reduction leaves out.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import DEFAULT_EIGENSOLVER, Eigensolver
from headstock.meshing.component_mesh import IntArray
from headstock.reduction.components.sensors import combine_attachments
from headstock.reduction.superelement import Truncation, lowest_participating
from headstock.solvers.elastic.constrained_modes import lowest_modes
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.eigenpairs import EigenPairs, ModeTarget, cluster_end
from headstock.solvers.elastic.lobpcg import block_width
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.solvers.errors import AccuracyError, ConvergenceError
from headstock.solvers.ranks import sum_over_ranks

DENSE_LIMIT = 4000
DENSE_SHARE = 0.1
SMALL = 400
RAYLEIGH_TOLERANCE = 1e-7  # what the search itself leaves
# share of an eigenvalue that rounding of the stiffness may reach in the search; the Rayleigh
# quotient keeps 1e-3 of it
ROUNDOFF_LIMIT = 0.3
MANY_MODES = 40
START_SEED, SIGN_SEED = 20101, 7
SPLIT_MIX = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)
COLUMNS = 48  # at a time: what products take besides the solution


@dataclass(frozen=True, eq=False)
class FixedInterfaceModes:
    """Modes with every boundary dof at zero.

    Attributes:
        eigenvalues: ``(m,)`` [rad^2/s^2].
        shapes: ``(3 n_owned, m)`` mass-normalised.
        cutoff_hz: No mode below this frequency is missing; inf when all are kept.
        residual: Largest relative change of an eigenvalue between the search and the Rayleigh
            quotient.
        remarks: What there is to say about modes that could not be found.
        attached: How many at the end are residual-attachment modes.
    """

    eigenvalues: FloatArray
    shapes: FloatArray
    cutoff_hz: float
    residual: float
    remarks: tuple[str, ...] = ()
    attached: int = 0


def find_fixed_interface_modes(
    solver: ConstrainedSolver,
    target: ModeTarget | None,
    *,
    eigensolver: Eigensolver = DEFAULT_EIGENSOLVER,
) -> FixedInterfaceModes:
    """Find the fixed-interface modes, complete up to a target and never cut through a cluster.

    Args:
        solver: Solver of the component with its interfaces fixed; its factorisation is reused.
        target: Count or frequency; None or a count of zero keeps none.
        eigensolver: Method for all but small models, which are solved densely.

    Raises:
        ConvergenceError: The modes did not converge.
        AccuracyError: A pair fails its residual check.

    Source: Craig and Bampton (1968).
    """
    owned = solver.operators.owned_dofs
    none = FixedInterfaceModes(np.zeros(0), np.zeros((owned, 0)), 0.0, 0.0)
    dimension = solver.free_total - solver.constraints.shape[1]
    if target is None or target.count == 0 or dimension <= 0:
        if dimension > 0:
            return none
        return FixedInterfaceModes(np.zeros(0), np.zeros((owned, 0)), np.inf, 0.0)
    remarks: tuple[str, ...] = ()
    many = target.up_to_hz is None and (target.count or 0) > DENSE_SHARE * dimension
    if (dimension <= DENSE_LIMIT and many) or dimension <= SMALL:
        pairs = _dense_modes(solver, target)
    else:
        # OpenBLAS's kernels take columns by eight: a block of 8 costs less than one of 6, and one of
        # 16 hardly more than one of 12. Wider blocks need more solves, which cost less each
        width = 8 if (target.count or 30) <= MANY_MODES else 16
        width = width if solver.multigrid is None else block_width(target)
        table = _draw_numbers(solver.operators.nodes, 3 * width, seed=START_SEED)
        start = np.where(solver.fixed[:, None], 0.0, table.reshape(-1, width))
        pairs = lowest_modes(solver, start, target, eigensolver=eigensolver)
    cutoff = float(np.sqrt(pairs.next_value) / (2.0 * np.pi))
    if not pairs.complete:
        remarks = (
            f"{len(pairs.values)} of {target.count} fixed-interface modes are kept: from {cutoff:.4g} Hz on "
            "they lie too densely to be distinguished; the ± covers what they add",
        )
    improved = _improve(solver, pairs.values, pairs.vectors)
    return FixedInterfaceModes(
        improved.values, _fix_signs(solver, improved.shapes), cutoff, improved.change, remarks
    )


def add_attachment_modes(
    solver: ConstrainedSolver, modes: FixedInterfaceModes, loads: FloatArray
) -> FixedInterfaceModes:
    """Return the modes with residual-attachment modes behind them, which make the static response to
    loads exact: those responses less the share of the modes, in combinations that are orthogonal in
    stiffness and mass.

    Args:
        solver: With the interfaces fixed; collective.
        modes: Complete up to their cut-off, below all of those added.
        loads: ``(3 n_owned, k)`` [N]; those whose response the modes have already add nothing.

    Source: MacNeal (1971), Computers and Structures 1, 581-601; Craig and Chang (1977), NASA CR-2922.
    """
    operators = solver.operators
    observed = solver.product(loads, modes.shapes)
    whole = solver.solve(loads)
    rest = whole - modes.shapes @ (observed / modes.eigenvalues).T
    mass = None
    if operators.scalar_mass is not None:
        mass = solver.product(rest, operators.apply_mass(rest))
    combinations, values = combine_attachments(
        solver.product(rest, solver.forces(rest)),
        mass,
        flexibility=np.diagonal(solver.product(loads, whole)),
        stiffness_scale=operators.stiffness_scale,
    )
    return dataclasses.replace(
        modes,
        eigenvalues=np.concatenate([modes.eigenvalues, values]),
        shapes=np.hstack([modes.shapes, rest @ combinations]),
        attached=len(values),
    )


def verify_mode_count(solver: ConstrainedSolver, modes: FixedInterfaceModes) -> None:
    """Count the modes below the first one left out by a factorisation of its own, so that no repeated mode
    can have been lost.

    Raises:
        AccuracyError: The count differs from the number of modes found.

    Source: Sylvester's law of inertia; Parlett (1980), sec. 3.3.
    """
    kept = np.sqrt(modes.eigenvalues.max(initial=0.0)) / (2.0 * np.pi)
    if not np.isfinite(modes.cutoff_hz) or modes.cutoff_hz <= 0.0:
        return
    shift = 0.5 * (kept + modes.cutoff_hz)
    count = count_frequencies_below(
        solver.operators, solver.fixed, shift, constraints=solver.constraints
    )
    if count != len(modes.eigenvalues):
        raise AccuracyError(
            f"{count} fixed-interface modes lie below {shift:.6g} Hz by a Sturm count, but {len(modes.eigenvalues)} were found; "
            "ask for another number of modes"
        )


def _draw_numbers(nodes: IntArray, count: int, *, seed: int) -> FloatArray:
    """Return the pseudo-random numbers ``(n, count)`` between -1 and 1 that belong to the nodes:
    each rank draws those of its own.

    Args:
        nodes: ``(n,)`` mesh points.
        seed: Another one gives others.

    Source: Steele, Lea and Flood (2014), Fast splittable pseudorandom number generators, fig. 15.
    """
    counters = nodes.astype(np.uint64)[:, None] * np.uint64(count) + np.arange(
        1, count + 1, dtype=np.uint64
    )
    state = (counters + (np.uint64(seed) << np.uint64(40))) * SPLIT_MIX[0]
    state = (state ^ (state >> np.uint64(30))) * SPLIT_MIX[1]
    state = (state ^ (state >> np.uint64(27))) * SPLIT_MIX[2]
    state ^= state >> np.uint64(31)
    # the upper 53 bits are as many as a double holds
    return (state >> np.uint64(11)) * 2.0**-52 - 1.0


def _dense_modes(solver: ConstrainedSolver, target: ModeTarget) -> EigenPairs:
    """Return all modes of a small model by dense algebra on every rank alike."""
    comm, operators = solver.comm, solver.operators
    free = np.flatnonzero(~solver.fixed)
    total = solver.free_total
    if total > DENSE_LIMIT + 200:
        raise ConvergenceError(
            f"{target} asks for most modes of a model with {total} free dofs; at most {DENSE_LIMIT} are done densely"
        )
    exscan: Any = comm  # mpi4py types leave out exscan
    first = int(exscan.exscan(len(free)) or 0)
    stiffness, mass = np.zeros((total, total)), np.zeros((total, total))
    constraints = np.zeros((total, solver.constraints.shape[1]))
    for owner in range(comm.size):
        count, start = comm.bcast((len(free), first), root=owner)
        unit = np.zeros((operators.owned_dofs, count))
        if comm.rank == owner:
            unit[free, np.arange(count)] = 1.0
        stiffness[first : first + len(free), start : start + count] = operators.apply_stiffness(
            unit
        )[free]
        mass[first : first + len(free), start : start + count] = operators.apply_mass(unit)[free]
    constraints[first : first + len(free)] = solver.constraints[free]
    fixed = sum_over_ranks(comm, constraints)
    basis = scipy.linalg.qr(fixed)[0][:, fixed.shape[1] :] if fixed.shape[1] else np.eye(total)
    values, vectors = scipy.linalg.eigh(
        _congruence(basis, sum_over_ranks(comm, stiffness)),
        _congruence(basis, sum_over_ranks(comm, mass)),
    )
    frequencies = np.sqrt(np.abs(values)) / (2.0 * np.pi)
    end = cluster_end(frequencies, min(target.count_wanted(frequencies), len(values)))
    shapes = np.zeros((operators.owned_dofs, end))
    shapes[free] = (basis @ vectors[:, :end])[first : first + len(free)]
    return EigenPairs(
        values[:end],
        shapes,
        np.zeros(end),
        float(values[end]) if end < len(values) else np.inf,
        solves=0,
    )


def _congruence(basis: FloatArray, matrix: FloatArray) -> FloatArray:
    product = basis.T @ (0.5 * (matrix + matrix.T)) @ basis
    return 0.5 * (product + product.T)


class _Improved(NamedTuple):
    """Eigenvalues ``(m,)`` [rad^2/s^2], shapes ``(n, m)``, the largest relative change."""

    values: FloatArray
    shapes: FloatArray
    change: float


def _improve(solver: ConstrainedSolver, values: FloatArray, shapes: FloatArray) -> _Improved:
    """Apply Rayleigh-Ritz to the shapes with K and M themselves: frequencies become upper bounds,
    and the search is checked by it.

    The search works with the inverse, which rounding of K changes by as much as ``energy_roundoff``
    says, or as the pins of a free body make of it; its shapes are off by the same share and the
    Rayleigh quotient by the square.
    """
    if not len(values):
        return _Improved(values, shapes, 0.0)
    stiffness = solver.product(shapes, solver.forces(shapes))
    mass = solver.product(shapes, solver.operators.apply_mass(shapes))
    improved, vectors = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
    shapes = shapes @ vectors
    share = solver.operators.energy_roundoff(shapes) / improved
    share = share * max(1.0, solver.roundoff / share.max())
    _require_resolved(values, improved, share)
    return _Improved(improved, shapes, float(np.abs(improved / values - 1.0).max()))


def _require_resolved(values: FloatArray, improved: FloatArray, roundoff: FloatArray) -> None:
    """Refuse eigenvalues that rounding may have drowned, or that two methods do not agree on as far
    as rounding lets them.

    Args:
        values: ``(m,)`` found with the inverse of the stiffness.
        improved: ``(m,)`` found with the stiffness itself.
        roundoff: ``(m,)`` share of each that rounding of the stiffness may reach.

    Raises:
        AccuracyError: Names the share or the difference, and what is allowed.
    """
    changes = np.abs(improved / values - 1.0)
    if not (roundoff <= ROUNDOFF_LIMIT).all():
        raise AccuracyError(
            f"rounding of the stiffness reaches {roundoff.max():.2g} of a fixed-interface eigenvalue (allowed {ROUNDOFF_LIMIT:g}): the "
            "component is too thin or too slender for solid elements; make it thicker, or model it as rigid or segmented"
        )
    if not (changes <= RAYLEIGH_TOLERANCE + roundoff).all():
        worst = int(np.argmax(changes - roundoff))
        raise AccuracyError(
            f"fixed-interface eigenvalue {worst + 1} changes by {changes[worst]:.2g} between the inverse and the stiffness itself; its "
            f"conditioning allows {RAYLEIGH_TOLERANCE + roundoff[worst]:.2g}: look for slivers"
        )


def _fix_signs(solver: ConstrainedSolver, shapes: FloatArray) -> FloatArray:
    """Return the shapes with signs that do not depend on the number of ranks."""
    weights = _draw_numbers(solver.operators.nodes, 3, seed=SIGN_SEED).reshape(1, -1)
    signs = np.sign(sum_over_ranks(solver.comm, weights @ shapes))
    return shapes * np.where(signs == 0.0, 1.0, signs)


def measure_truncation(
    solver: ConstrainedSolver, psi: FloatArray, modes: FixedInterfaceModes
) -> Truncation:
    """Return the moments of the modes left out, by one solve per boundary dof.

    ``X = K^-1 W``, with ``W`` the part of ``M psi`` that does no work on the fixed-interface modes
    kept, has the energies ``X^T K X = X^T W = sum p_k p_k^T / omega_k^2`` and ``X^T M X = sum p_k
    p_k^T / omega_k^4`` over those left out. In a body that one end holds, those kept have nearly
    all: taken from a solution instead of its load, they would leave nothing but rounding.

    Args:
        solver: With the interfaces fixed; collective.
        psi: ``(3 n_owned, n_b)`` constraint modes.

    Source: Kim and Lee (2015), residual substructural modes as the error of a Craig-Bampton basis.
    """
    operators, boundary = solver.operators, psi.shape[1]
    if not np.isfinite(modes.cutoff_hz):
        return Truncation(np.zeros((boundary, boundary)), np.zeros((boundary, boundary)), np.inf)
    shapes, attached = np.split(modes.shapes, [len(modes.eigenvalues) - modes.attached], axis=1)
    weighted = operators.apply_mass(psi)
    if shapes.shape[1]:
        heavy = operators.apply_mass(shapes)
        # twice, because once leaves rounding of the whole
        for _ in range(2):
            weighted = weighted - heavy @ solver.product(shapes, weighted)
    rest = solver.apply_inverse(weighted)
    if modes.attached:
        # these are no modes: they take a share of the static response, not of the load
        squares = modes.eigenvalues[-modes.attached :]
        rest = rest - attached @ (solver.product(attached, weighted) / squares[:, None])
    first, second = solver.product(rest, weighted), np.zeros((boundary, boundary))
    for start in range(0, boundary, COLUMNS):
        part = slice(start, start + COLUMNS)
        second[:, part] = solver.product(rest, operators.apply_mass(rest[:, part]))
    moments = Truncation(
        0.5 * (first + first.T), 0.5 * (second + second.T), (2.0 * np.pi * modes.cutoff_hz) ** 2
    )
    if modes.cutoff_hz > 0.0:
        return moments
    return dataclasses.replace(moments, limit=lowest_participating(moments.first, moments.second))
