"""Components reduced without factors equal those reduced with them."""

import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.parts.components import Component, SolverMethod
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic import lobpcg, multigrid
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import ConvergenceError

COLUMN, BLOCK = ((3, 4, 14), (0.1, 0.13, 0.5)), ((7, 7, 7), (0.2, 0.19, 0.21))
METHODS: tuple[SolverMethod, ...] = ("direct", "iterative")
FACES = {"foot": "z-", "tip": "z+"}


def reduce_by(
    solver: SolverMethod, component: Component, mesh: ComponentMesh, target: ModeTarget
) -> Superelement:
    settings = dataclasses.replace(component.reduction, solver=solver)
    return reduce_elastic(
        dataclasses.replace(component, reduction=settings),
        mesh,
        comm=MPI.COMM_SELF,
        request=ReductionRequest(modes=target),
    )


@pytest.mark.parametrize(
    ("shape", "kind", "couplings"),
    [
        (COLUMN, "tet10", ("rigid", "rigid")),
        pytest.param(BLOCK, "tet10", ("rigid", "average"), marks=pytest.mark.trials),
        pytest.param(COLUMN, "tet10", ("average", "average"), marks=pytest.mark.trials),
        pytest.param(BLOCK, "tet10", ("average",), marks=pytest.mark.trials),
        (COLUMN, "tet10", ()),
        pytest.param(COLUMN, "hex27", ("rigid", "average"), marks=pytest.mark.trials),
    ],
)
def test_superelements_are_those_of_factors(
    shape: tuple[tuple[int, ...], tuple[float, ...]], kind: CellKind, couplings: tuple[str, ...]
) -> None:
    interfaces = dict(zip(FACES, couplings, strict=False))
    mesh = make_box(*shape, {name: FACES[name] for name in interfaces}, kind=kind)
    component = make_component(interfaces)
    direct, iterative = (
        reduce_by(solver, component, mesh, ModeTarget(count=12)) for solver in METHODS
    )
    size = direct.boundary_size
    difference = np.abs(iterative.stiffness - direct.stiffness)[:size, :size].max()
    assert difference <= 1e-10 * np.abs(direct.stiffness[:size, :size]).max()
    assert iterative.stiffness.shape == direct.stiffness.shape
    values, exact = (np.diag(found.stiffness)[size:] for found in (iterative, direct))
    np.testing.assert_allclose(np.sqrt(values), np.sqrt(exact), rtol=1e-8)
    if not couplings:
        return  # rigid motions, of which the modes left out hold rounding
    # energies that the modes left out would add
    found, known = iterative.errors.truncation, direct.errors.truncation
    assert found is not None and known is not None
    np.testing.assert_allclose(found.first, known.first, atol=1e-3 * np.abs(known.first).max())


@pytest.mark.trials
@pytest.mark.parametrize("target", [ModeTarget(count=26), ModeTarget(up_to_hz=26e3)])
def test_all_modes_up_to_a_frequency_come_in_more_than_one_block(
    monkeypatch: pytest.MonkeyPatch, target: ModeTarget
) -> None:
    monkeypatch.setattr(lobpcg, "LARGEST_BLOCK", 10)
    mesh = make_box(*COLUMN, FACES, kind="tet10")
    component = make_component({"foot": "rigid", "tip": "rigid"})
    direct, iterative = (reduce_by(solver, component, mesh, target) for solver in METHODS)
    assert len(direct.stiffness) > 12 + 20
    values, exact = (np.diag(found.stiffness)[12:] for found in (iterative, direct))
    np.testing.assert_allclose(np.sqrt(values), np.sqrt(exact), rtol=1e-8)


def test_modes_that_stall_name_component_and_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lobpcg, "MOST_STEPS", 2)
    mesh = make_box(*COLUMN, FACES, kind="tet10")
    component = make_component({"foot": "rigid", "tip": "rigid"}, name="bed")
    with pytest.raises(ConvergenceError, match=r'component bed: LOBPCG found .* solver = "direct"'):
        reduce_by("iterative", component, mesh, ModeTarget(count=12))


def test_loads_that_stall_name_component_and_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multigrid, "MOST_STEPS", 2)
    mesh = make_box(*COLUMN, FACES, kind="tet10")
    component = make_component({"foot": "rigid", "tip": "average"}, name="bed")
    with pytest.raises(
        ConvergenceError, match=r'component bed: conjugate gradients left .* solver = "direct"'
    ):
        reduce_by("iterative", component, mesh, ModeTarget(count=12))
