"""Static solves without a factorisation: conjugate gradients, preconditioned by multigrid, for many
loads side by side.
"""

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.elastic.multigrid import Multigrid
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.ranks import sum_over_ranks

# of the energy of the error; whoever solves refines it with the residual of K itself, so that the
# second solve leaves the square of it
TOLERANCE = 1e-7
MOST_STEPS = 300


class IterativeInverse:
    """``K^-1`` between the dofs that are not fixed, by iteration; an alternative to
    ``Factorization`` for parts whose factors do not fit.

    Rigid motions that the fixed dofs leave free carry no load: loads are taken less their part along
    them, and displacements hold none of them. Collective.

    Args:
        operators: Stiffness, assembled with its corner level.
        fixed: ``(3 n_owned,)`` dofs that do not move.
        motions: ``(3 n_owned, r)`` rigid motions that these leave free.
    """

    def __init__(self, operators: ElasticOperators, fixed: BoolArray, motions: FloatArray) -> None:
        self._comm = operators.comm
        self.multigrid = Multigrid(operators, fixed, motions)
        self.steps = 0

    def solve(self, loads: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n_owned, k)`` under loads ``(3 n_owned, k)``.

        Raises:
            ConvergenceError: A load did not converge.

        Source: Hestenes and Stiefel (1952); each column is an iteration of its own.
        """
        result = np.zeros(loads.shape, order="F")
        rest = self.multigrid.without_motions(loads)
        preconditioned = self.multigrid.apply(rest)
        sizes = self._products(rest, preconditioned)
        limits = TOLERANCE**2 * sizes
        active = np.flatnonzero(sizes > 0.0)
        rest, step, sizes = rest[:, active], preconditioned[:, active], sizes[active]
        for _ in range(MOST_STEPS):
            if not len(active):
                return result
            forces = self.multigrid.without_motions(self.multigrid.multiply(step))
            lengths = sizes / self._products(step, forces)
            result[:, active] += lengths * step
            rest -= lengths * forces
            preconditioned = self.multigrid.apply(rest)
            before, sizes = sizes, self._products(rest, preconditioned)
            self.steps += 1
            going = sizes > limits[active]
            step = preconditioned + (sizes / before) * step
            active, rest, step, sizes = active[going], rest[:, going], step[:, going], sizes[going]
        left = float(np.sqrt((sizes / limits[active]).max())) * TOLERANCE
        raise ConvergenceError(
            f"conjugate gradients left an error of {left:.2g} (allowed {TOLERANCE:g}) after {MOST_STEPS} steps: the elements are too "
            'distorted or the part too thin for an iterative solver; write reduction = { solver = "direct" }, or look for slivers'
        )

    def close(self) -> None:
        """Release the multigrid."""
        self.multigrid.close()

    def _products(self, left: FloatArray, right: FloatArray) -> FloatArray:
        return sum_over_ranks(self._comm, np.einsum("ij,ij->j", left, right))
