"""Lowest eigenpairs of ``K x = lambda M x`` by SLEPc's Krylov-Schur method on the inverse, vector by
vector.
"""

from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.eigenpairs import (
    MOST_VECTORS,
    EigenPairs,
    ModeTarget,
    converged_pairs,
    select_pairs,
)
from headstock.solvers.elastic.eigenproblem import EigenProblem, shell_inverse
from headstock.solvers.elastic.libraries import PETSc, SLEPc
from headstock.solvers.errors import ConvergenceError

FIRST_GUESS = 30  # modes up to a frequency
TOLERANCE = 1e-7  # of residuals of the inverse; there is no free step behind it
SPARE_VECTORS = 4
MOST_RESTARTS = 200
BEYOND = 3  # pairs behind those wanted that show where a cluster ends


def krylov_schur_pairs(problem: EigenProblem, start: FloatArray, target: ModeTarget) -> EigenPairs:
    """Return the lowest eigenpairs, complete up to the target and to the end of the cluster there.

    A single start vector sees one mode of several with the same frequency, the others only through
    rounding: block Lanczos is the surer one there.

    Args:
        start: ``(n, b)``, of which the first vector is taken.

    Raises:
        ConvergenceError: The frequency asked for was not reached.

    Source: Stewart (2001), a Krylov-Schur algorithm; Hernandez, Roman and Vidal (2005), SLEPc.
    """
    limit = min(problem.dimension, max(20 * (target.count or 0) + 200, MOST_VECTORS))
    asked, solves = min((target.count or FIRST_GUESS) + BEYOND, limit), 0
    while True:
        values, vectors, bounds, spent = _search(problem, start[:, 0], asked)
        solves += spent
        complete = asked >= problem.dimension and len(values) >= problem.dimension
        selected = select_pairs(values, bounds, target, complete)
        if selected is not None:
            following = 1.0 / values[selected] if selected < len(values) else np.inf
            break
        if len(values) < asked or asked >= limit:
            if target.count is None:
                raise ConvergenceError(
                    f"Krylov-Schur found {len(values)} modes and could not finish {target}; ask for fewer modes "
                    "(reduction.modes, or a lower reduction.modes_to)"
                )
            # the last of those that converged is the next one
            selected, following = converged_pairs(values[:-1], bounds[:-1])
            if selected == len(values) - 1:
                following = float(1.0 / values[-1])
            break
        asked = min(2 * asked, limit)
    return EigenPairs(
        np.asarray(1.0 / values[:selected]),
        vectors[:, :selected],
        bounds[:selected],
        float(following),
        solves,
    )


class _Converged(NamedTuple):
    """Values of the inverse ``(m,)``, falling, vectors ``(n, m)``, relative residual bounds ``(m,)``
    and how many solves they took.
    """

    values: FloatArray
    vectors: FloatArray
    bounds: FloatArray
    solves: int


def _search(problem: EigenProblem, start: FloatArray, asked: int) -> _Converged:
    """Return the lowest pairs that converge, at least as many as asked for where all is well."""
    stiffness, mass = problem.inverse.getOperators()[0], problem.mass
    search = SLEPc.EPS().create(mass.getComm())
    search.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    search.setOperators(stiffness, mass)
    search.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    search.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    search.setTarget(0.0)
    search.setTolerances(TOLERANCE, MOST_RESTARTS)
    search.setDimensions(asked, min(2 * asked + SPARE_VECTORS, problem.dimension))
    # a purified vector would take one more solve each; the Rayleigh quotient that follows does as
    # much
    search.setPurify(False)
    spectrum = search.getST()
    spectrum.setType(SLEPc.ST.Type.SINVERT)
    spectrum.setShift(0.0)
    counted = _CountedInverse(problem.inverse)
    # SLEPc empties the solver that it is given, and the factors are still needed
    spectrum.setKSP(shell_inverse(counted, stiffness))
    first = mass.createVecRight()
    first.setArray(start)
    search.setInitialSpace(first)
    try:
        search.solve()
        count = search.getConverged()
        vectors = np.zeros((first.getLocalSize(), count))
        values, bounds = np.zeros(count), np.zeros(count)
        for index in range(count):
            values[index] = 1.0 / search.getEigenpair(index, first).real
            vectors[:, index] = first.getArray(readonly=True)
            bounds[index] = search.getErrorEstimate(index)
    finally:
        search.destroy()
        first.destroy()
    return _Converged(values, vectors, bounds, counted.solves)


class _CountedInverse:
    def __init__(self, inverse: PETSc.KSP) -> None:
        self._inverse, self.solves = inverse, 0

    def apply(self, _: PETSc.PC, given: PETSc.Vec, solution: PETSc.Vec) -> None:
        self._inverse.solve(given, solution)
        self.solves += 1
