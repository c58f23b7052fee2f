"""CHOLMOD, with and without METIS, and MUMPS are one factorisation."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import Component, Material, MeshSettings
from headstock.geometry.parts.solids import Box
from headstock.meshing.components.meshing import mesh_component
from headstock.solvers.elastic import factorization
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.factorization import Factorization

STEEL = Material("steel", 210e9, 0.3, 7850.0)


@pytest.fixture(scope="module")
def operators() -> ElasticOperators:
    component = Component("block", Box((0.1, 0.05, 0.2)), STEEL, mesh=MeshSettings(size=0.03))
    return assemble_elasticity(
        mesh_component(component), STEEL, comm=MPI.COMM_SELF, with_mass=False
    )


def some_fixed(operators: ElasticOperators) -> BoolArray:
    """A clamped face, and single directions elsewhere, so that nodes are fixed in part."""
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    fixed[7::31] = True
    return fixed


def residual(
    operators: ElasticOperators, fixed: BoolArray, loads: FloatArray, found: FloatArray
) -> float:
    forces = operators.apply_stiffness(found)
    return float(np.abs((forces - loads)[~fixed]).max() / np.abs(loads).max())


def solve(operators: ElasticOperators, fixed: BoolArray) -> tuple[FloatArray, FloatArray, str]:
    loads = np.random.default_rng(3).standard_normal((operators.owned_dofs, 5))
    with Factorization(operators, fixed) as factors:
        kind = str(factors.factors.getPC().getFactorMatrix().getType())
        return loads, factors.solve(loads), kind


def test_displacements_balance_the_loads_and_fixed_dofs_stay(operators: ElasticOperators) -> None:
    fixed = some_fixed(operators)
    loads, found, _ = solve(operators, fixed)
    assert residual(operators, fixed, loads, found) < 1e-9
    assert not found[fixed].any()


@pytest.mark.skipif(not PETSc.Sys.hasExternalPackage("cholmod"), reason="PETSc without CHOLMOD")
def test_cholmod_with_and_without_metis_and_mumps_agree(
    operators: ElasticOperators, monkeypatch: pytest.MonkeyPatch
) -> None:
    fixed = some_fixed(operators)
    _, ordered, first = solve(operators, fixed)
    monkeypatch.setattr(factorization, "dissect_nodes", lambda pattern: None)
    _, default, second = solve(operators, fixed)
    monkeypatch.setattr(factorization, "_has_cholmod", lambda: False)
    _, other, third = solve(operators, fixed)
    assert (first, second, third) == ("cholmod", "cholmod", "mumps")
    assert np.abs(ordered - other).max() < 1e-10 * np.abs(other).max()
    assert np.abs(default - other).max() < 1e-10 * np.abs(other).max()
