"""Static solves of a component with fixed dofs, weighted-mean constraints and rigid motions, from
one factorisation or by iteration.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray, rigid_map
from headstock.geometry.parts.components import SolverMethod
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.elastic.factorization import Factorization
from headstock.solvers.elastic.libraries import PETSc
from headstock.solvers.elastic.multigrid import IterativeInverse, Multigrid
from headstock.solvers.errors import ConvergenceError, ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import max_over_ranks, sum_over_ranks

RIGID_TOLERANCE = 1e-9
# of forces: a Cholesky factorisation leaves some 1e-15 however badly conditioned the stiffness is
SOLVE_TOLERANCE = 1e-11
SOUND_RESIDUAL = 1e-13  # below it a solve is as good as its factorisation
# of the strain energy of soft shapes, below which displacements need no refinement; parts 1:300 or
# so
NEGLIGIBLE_ROUNDOFF = 1e-6
# of displacements: energies see the square of what they are off by
ENERGY_ROUNDOFF = float(np.sqrt(np.finfo(float).eps))
REFINEMENT_STEPS = 5


class ConstrainedSolver:
    """Solves ``K u = F + C mu`` with ``C^T u = q`` and fixed dofs at zero.

    A component that its fixed dofs leave free to move rigidly is pinned at as many dofs as it has
    free motions; pins, motions and mean constraints meet in one small dense saddle-point matrix, so
    that no penalty and no second factorisation is needed and the pins carry no force.

    Args:
        fixed: ``(3 n_owned,)`` dofs that do not move.
        constraints: ``(3 n_owned, n_c)`` columns of C, of full column rank on the dofs that are not
            fixed.
        method: Factors, or conjugate gradients on a multigrid, which need no pins.

    Raises:
        ModelError: The constraints leave a rigid motion free.
        ConvergenceError: The factorisation failed.

    Source: Farhat and Geradin (1998) for the pinned pseudo-inverse; Benzi, Golub and Liesen (2005),
    sec. 5, for the Schur complement.
    """

    def __init__(
        self,
        operators: ElasticOperators,
        fixed: BoolArray,
        constraints: FloatArray,
        *,
        method: SolverMethod = "direct",
    ) -> None:
        self.operators = operators
        self.comm = operators.comm
        self.fixed = fixed
        self.constraints = np.where(fixed[:, None], 0.0, constraints)
        self.motions = _free_motions(operators, fixed)
        self._inverse: Factorization | IterativeInverse = (
            Factorization(operators, fixed | _choose_pins(self.motions, operators))
            if method == "direct"
            else IterativeInverse(operators, fixed, self.motions)
        )
        self.free_total = int(self.comm.allreduce(int((~fixed).sum())))
        self._saddle = self._make_saddle(self._inverse.solve(self.constraints))
        self._cycle_saddle: _Saddle | None = None
        self.largest_residual = 0.0
        self.roundoff = self._soft_roundoff()

    def product(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return ``left^T right`` summed over the ranks."""
        return sum_over_ranks(self.comm, left.T @ right)

    def apply_inverse(self, loads: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n_owned, k)`` under loads, with ``C^T u = 0``; not refined:
        for use inside an eigensolver.
        """
        return self._solve(loads, np.zeros((self.constraints.shape[1], loads.shape[1])))[0]

    def solve(self, loads: FloatArray, targets: FloatArray | None = None) -> FloatArray:
        """Return the displacements under loads with ``C^T u = targets``, refined until residual
        and, in thin parts, displacements are small.

        A residual says little about displacements where the stiffness is badly conditioned. The
        factors are those of K with its rounding, the residual is that of K less it
        (``ElasticOperators.apply_stiffness``), so that refinement finds the digits back. Each step
        leaves what it changed times the rate at which changes fall, at first taken from
        ``roundoff``; it goes on until that is less than what rounding of the residual can make of
        displacements (``attainable_change``).

        Args:
            loads: ``(3 n_owned, k)`` [N].
            targets: ``(n_c, k)``; zero when left out.

        Raises:
            ConvergenceError: The residual does not fall below ``SOLVE_TOLERANCE`` of the forces
                inside the component, or refinement goes on to change the displacements.

        Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), sec. 12.1; Demmel et
        al. (2006), ACM TOMS 32, 325-351,
            on errors from the rate of refinement.
        """
        if targets is None:
            targets = np.zeros((self.constraints.shape[1], loads.shape[1]))
        result, unconstrained = self._solve(loads, targets)
        # loads that constraints carry alone leave rounding of the unconstrained displacements,
        # which is not to be refined
        reach = max_over_ranks(self.comm, np.abs(unconstrained).max(axis=0, initial=0.0))
        change, left, allowed = 1.0, self.roundoff, NEGLIGIBLE_ROUNDOFF
        for step in range(REFINEMENT_STEPS + 1):
            residual, size = self._residual(result, loads)
            if size <= (SOUND_RESIDUAL if step == 0 else SOLVE_TOLERANCE) and left <= allowed:
                self.largest_residual = max(self.largest_residual, size)
                return result
            if step < REFINEMENT_STEPS:
                correction, _ = self._solve(
                    residual, targets - self.product(self.constraints, result)
                )
                result = result + correction
                sizes = [
                    max_over_ranks(self.comm, np.abs(block).max(axis=0, initial=0.0))
                    for block in (correction, result)
                ]
                scale = np.maximum(np.maximum(sizes[1], reach), np.finfo(float).tiny)
                before, change = change, float(np.max(sizes[0] / scale, initial=0.0))
                rate = (
                    max(change, self.roundoff)
                    if step == 0
                    else change / before
                    if before > 0.0
                    else 0.0
                )
                left = change * rate / (1.0 - rate) if rate < 1.0 else np.inf
                allowed = self.attainable_change
        raise ConvergenceError(
            f"a static solve keeps a relative residual of {size:.2g} (allowed {SOLVE_TOLERANCE:g}), and its displacements are off by "
            f"{left:.2g} (its conditioning allows {allowed:.2g}), after {REFINEMENT_STEPS} refinements: the stiffness is too badly "
            "conditioned; look for slivers, for supports and interfaces that barely hold the component, or for a sheet too thin for "
            "solid elements"
        )

    @property
    def factors(self) -> PETSc.KSP:
        """Solver on the factors of what is neither fixed nor pinned, without constraints."""
        return self._factorization.factors

    @property
    def _factorization(self) -> Factorization:
        if isinstance(self._inverse, IterativeInverse):
            raise ConvergenceError("an iterative solver has no factors")
        return self._inverse

    @property
    def multigrid(self) -> Multigrid | None:
        """Return what stands for factors where there are none; else None."""
        return self._inverse.multigrid if isinstance(self._inverse, IterativeInverse) else None

    def precondition(self, forces: FloatArray) -> FloatArray:
        """Return what is near ``apply_inverse``, from one multigrid cycle in place of a solve."""
        if self.multigrid is None:
            return self.apply_inverse(forces)
        if self._cycle_saddle is None:
            # constraints carry part of the forces, and a cycle must leave nothing of that
            self._cycle_saddle = self._make_saddle(self.multigrid.apply(self.constraints))
        targets = np.zeros((self.constraints.shape[1], forces.shape[1]))
        return self._constrain(self.multigrid.apply(forces), forces, targets, self._cycle_saddle)

    @property
    def elimination_order(self) -> NDArray[np.int64]:
        """The owned dofs in the order of the rows of ``factors``."""
        return self._factorization.elimination_order

    @property
    def attainable_change(self) -> float:
        """Return what rounding of residuals can make of refined displacements, as a share of
        them.
        """
        residuals = np.longdouble if self.roundoff > NEGLIGIBLE_ROUNDOFF else np.float64
        return max(
            self.roundoff * float(np.finfo(residuals).eps / np.finfo(float).eps), ENERGY_ROUNDOFF
        )

    def forces(self, displacements: FloatArray) -> FloatArray:
        """Return ``K u`` of a block ``(3 n_owned, k)``, as precisely as the conditioning of the
        component calls for.
        """
        if self.roundoff <= NEGLIGIBLE_ROUNDOFF:
            return self.operators.apply_stiffness(displacements)
        return self.operators.apply_stiffness_precisely(displacements)

    def close(self) -> None:
        """Release the factorisation."""
        self._inverse.close()

    def __enter__(self) -> "ConstrainedSolver":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _solve(self, loads: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the displacements, and those without constraints and with the pins holding."""
        plain = self._inverse.solve(loads)
        return self._constrain(plain, loads, targets, self._saddle), plain

    def _constrain(
        self, plain: FloatArray, loads: FloatArray, targets: FloatArray, saddle: "_Saddle"
    ) -> FloatArray:
        """Return the displacements with ``C^T u = targets`` from those without constraints."""
        if not len(saddle.scale):
            return plain
        free_loads = np.where(self.fixed[:, None], 0.0, loads)
        right = np.vstack(
            [
                targets - self.product(self.constraints, plain),
                -self.product(self.motions, free_loads),
            ]
        )
        small = saddle.scale[:, None] * scipy.linalg.lu_solve(
            saddle.factors, saddle.scale[:, None] * right
        )
        count = self.constraints.shape[1]
        return plain + saddle.lifted @ small[:count] + self.motions @ small[count:]

    def _make_saddle(self, lifted: FloatArray) -> "_Saddle":
        count, rigid = self.constraints.shape[1], self.motions.shape[1]
        matrix = np.zeros((count + rigid, count + rigid))
        matrix[:count, :count] = self.product(self.constraints, lifted)
        coupling = self.product(self.constraints, self.motions)
        matrix[:count, count:], matrix[count:, :count] = coupling, coupling.T
        return _Saddle(lifted, *_factor_saddle(matrix, count, rigid))

    def _soft_roundoff(self) -> float:
        """Return the rounding of K as a share of the strain energy of a shape in which what is
        factorised deforms: its soft modes dominate it.
        """
        # forces that grow with the square of the distance bend a part, even a free one
        motions = rigid_node_motions(self.operators)
        arms = (motions[:, 3:].reshape(-1, 3, 3) ** 2).sum(axis=(1, 2))
        load = np.where(self.fixed, 0.0, np.repeat(1.0 + arms, 3))[:, None]
        shape = self._inverse.solve(load)
        energy = float(self.product(shape, load)[0, 0])
        if not max_over_ranks(self.comm, np.abs(shape).max(axis=0, initial=0.0))[0] > 0.0:
            return 0.0
        return float(self.operators.energy_roundoff(shape)[0]) / energy if energy > 0.0 else np.inf

    def _residual(self, result: FloatArray, loads: FloatArray) -> tuple[FloatArray, float]:
        forces = self.forces(result)
        residual = np.where(self.fixed[:, None], 0.0, loads - forces)
        given = max_over_ranks(self.comm, np.abs(loads).max(axis=0, initial=0.0))
        if self.constraints.shape[1]:
            # what the mean constraints carry is no residual: take out its component along C
            gram = self.product(self.constraints, self.constraints)
            multipliers = np.linalg.solve(gram, self.product(self.constraints, residual))
            residual = residual - self.constraints @ multipliers
        largest = self.operators.stiffness_scale
        reach = max_over_ranks(self.comm, np.abs(result).max(axis=0, initial=0.0))
        size = max_over_ranks(self.comm, np.abs(residual).max(axis=0, initial=0.0))
        return residual, float(
            np.max(size / np.maximum(largest * reach + given, np.finfo(float).tiny), initial=0.0)
        )


@dataclass(frozen=True, eq=False)
class _Saddle:
    """Correction of an unconstrained solve by constraints and rigid motions.

    Attributes:
        lifted: ``(3 n_owned, n_c)`` displacements under unit forces along the constraints.
        scale: ``(n_c + r,)`` that makes unit diagonal entries.
        factors: LU of the scaled dense saddle-point matrix.
    """

    lifted: FloatArray
    scale: FloatArray
    factors: tuple[FloatArray, FloatArray]


def rigid_node_motions(operators: ElasticOperators) -> FloatArray:
    """Return the six rigid motions ``(3 n_owned, 6)`` about the mean point, rotations scaled by the
    component's size to unit length.
    """
    center, units = scale_motions(operators)
    return (
        rigid_map(operators.points, center) * units if len(operators.points) else np.zeros((0, 6))
    )


def free_combinations(
    operators: ElasticOperators,
    fixed: BoolArray,
    turned: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the point ``(3,)`` and combinations ``(6, k)`` of the rigid motions about it that move
    no fixed dof.

    Args:
        fixed: ``(3 n_owned,)`` dofs that do not move.
        turned: Rows ``(m, 6)`` that must vanish, too, of unit rigid motions about a point, alike on
            all ranks; None for none.
    """
    center, units = scale_motions(operators)
    motions = rigid_node_motions(operators)
    blocked = sum_over_ranks(operators.comm, motions[fixed].T @ motions[fixed])
    count = int(operators.comm.allreduce(int(fixed.sum())))
    if turned is not None:
        rows = turned(center) * units
        blocked, count = blocked + rows.T @ rows, count + len(rows)
    values, vectors = np.linalg.eigh(blocked)
    free = values <= RIGID_TOLERANCE * max(float(count), 1.0)
    return center, units[:, None] * vectors[:, free]


def scale_motions(operators: ElasticOperators) -> tuple[FloatArray, FloatArray]:
    """Return the mean point ``(3,)``, and what makes unit motions of translations and rotations
    about it ``(6,)``.
    """
    comm, points = operators.comm, operators.points
    center = sum_over_ranks(comm, points.sum(axis=0)) / max(operators.total_nodes, 1)
    arms = comm.allreduce(float(((points - center) ** 2).sum()))
    radius = np.sqrt(arms / max(operators.total_nodes, 1)) or 1.0
    return center, np.repeat([1.0, 1.0 / radius], 3)


def _free_motions(operators: ElasticOperators, fixed: BoolArray) -> FloatArray:
    center, combinations = free_combinations(operators, fixed)
    motions = (
        rigid_map(operators.points, center) @ combinations
        if len(operators.points)
        else np.zeros((0, combinations.shape[1]))
    )
    return np.where(fixed[:, None], 0.0, motions)


def _choose_pins(motions: FloatArray, operators: ElasticOperators) -> BoolArray:
    """Return as many dofs as there are free motions, chosen one after the other where the motions
    left over are largest.
    """
    comm = operators.comm
    pins = np.zeros(len(motions), dtype=bool)
    rest = motions.copy()
    for _ in range(motions.shape[1]):
        sizes = np.einsum("ij,ij->i", rest, rest)
        best = int(np.argmax(sizes)) if len(sizes) else -1
        value, owner = comm.allreduce(
            (float(sizes[best]) if best >= 0 else -1.0, -comm.rank), op=MPI.MAX
        )
        row = comm.bcast(rest[best] if comm.rank == -owner else None, root=-owner)
        if comm.rank == -owner:
            pins[best] = True
        rest = rest - np.outer(rest @ row, row) / value
    return pins


def _factor_saddle(
    saddle: FloatArray, count: int, rigid: int
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    if not saddle.size:
        return np.zeros(0), (saddle, np.zeros(0))
    if rigid:
        coupling = saddle[:count, count:]
        norms = np.linalg.norm(coupling, axis=1, keepdims=True)
        singular = np.linalg.svd(coupling / np.where(norms > 0.0, norms, 1.0), compute_uv=False)
        fixed = int((singular > RIGID_TOLERANCE).sum())
        if fixed < rigid:
            raise ModelError(
                f"{rigid - fixed} rigid motions of the component are fixed by no interface and no support"
            )
    diagonal = np.abs(np.diag(saddle)).copy()
    typical = np.sqrt(diagonal[:count].max(initial=0.0)) or 1.0
    scale = np.where(
        diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), typical
    )
    return scale, scipy.linalg.lu_factor(scale[:, None] * saddle * scale[None, :])
