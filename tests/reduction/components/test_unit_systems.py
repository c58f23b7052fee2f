"""the same body in metres, kilograms and seconds and in millimetres, tonnes and seconds."""

import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from common import Dense, approx, make_box, make_component, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Load, Material, Patch
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.validation.parts.component_models import FullModes, full_model, full_modes

pytestmark = pytest.mark.hard("H18")

COMM = MPI.COMM_SELF
SIZE = (0.038, 0.1, 0.5)
GROUPS = {"foot": "z-", "tip": "z+", "load:oil": "x+"}
SI = Material("steel", 2.1e11, 0.3, 7850.0)
MM_T_S = Material("steel", 2.1e5, 0.3, 7.85e-9)
# what one unit of each dof of an interface and of a mode is in the other system
TO_MM = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
Both = tuple[tuple[Superelement, FullModes], tuple[Superelement, FullModes]]


@pytest.fixture(scope="module", params=["rigid", "average"])
def both(request: pytest.FixtureRequest) -> Both:
    def reduced(
        material: Material, scale: float, pressure: float
    ) -> tuple[Superelement, FullModes]:
        mesh = make_box((1, 2, 6), SIZE, GROUPS, kind="tet10")
        volume = mesh.quality.volume * scale**3
        mesh = dataclasses.replace(
            mesh,
            points=mesh.points * scale,
            quality=dataclasses.replace(mesh.quality, volume=volume),
        )
        component = make_component(
            {"foot": request.param, "tip": request.param},
            material=material,
            size=(scale * SIZE[0], scale * SIZE[1], scale * SIZE[2]),
        )
        oil = Load("oil", "body", "pressure", (Patch("x+"),), magnitude=pressure)
        wanted = ReductionRequest(ModeTarget(count=12))
        return reduce_elastic(component, mesh, (), (oil,), comm=COMM, request=wanted), full_modes(
            full_model(mesh, material, comm=COMM), 8
        )

    return reduced(SI, 1.0, 1e6), reduced(MM_T_S, 1e3, 1.0)


def test_natural_frequencies_are_equal(both: Both, dense: Dense) -> None:
    (metres, free_metres), (millimetres, free_millimetres) = both
    np.testing.assert_allclose(
        free_millimetres.frequencies_hz, free_metres.frequencies_hz, rtol=1e-9
    )
    np.testing.assert_allclose(
        millimetres.modal_frequencies_hz, metres.modal_frequencies_hz, rtol=1e-9
    )
    found, exact = (
        dense.frequencies(element.stiffness, element.mass)[6:] for element in (millimetres, metres)
    )
    np.testing.assert_allclose(found, exact, rtol=1e-9)


@pytest.mark.parametrize("name", ["stiffness", "mass"])
def test_stiffness_and_mass_of_the_interfaces_are_the_same_quantities(
    both: Both, name: str
) -> None:
    (metres, _), (millimetres, _) = both
    units = np.tile(TO_MM, 2)
    # 1 N is the same in both systems; a length is a thousand times as many
    exact = getattr(metres, name)[:12, :12]
    found = getattr(millimetres, name)[:12, :12] * np.outer(units, units) / 1e3
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(found - exact) / size).max() < 1e-9, name


def displacement_with_foot_fixed(element: Superelement) -> FloatArray:
    load = element.loads["oil"]
    foot = element.interface_maps["foot"].node
    free = np.setdiff1d(np.arange(len(element.stiffness)), np.arange(6 * foot, 6 * foot + 6))
    answer = np.zeros(len(element.stiffness))
    answer[free] = np.linalg.solve(element.stiffness[np.ix_(free, free)], load.vector[free])
    return present(element.recovery).basis @ answer + present(load.particular).ravel()


def test_displacements_are_a_thousand_times_as_many(both: Both) -> None:
    (metres, _), (millimetres, _) = both
    found, exact = (displacement_with_foot_fixed(element) for element in (millimetres, metres))
    assert np.abs(found / 1e3 - exact).max() < 1e-9 * np.abs(exact).max()
    np.testing.assert_allclose(
        millimetres.loads["oil"].vector[:12] / np.tile([1.0, 1.0, 1.0, 1e3, 1e3, 1e3], 2),
        metres.loads["oil"].vector[:12],
        rtol=1e-9,
        atol=1e-9 * np.abs(metres.loads["oil"].vector[:12]).max(),
    )


def test_mass_centre_and_inertia_are_the_same_quantities(both: Both) -> None:
    (metres, _), (millimetres, _) = both
    assert millimetres.mass_kg * 1e3 == approx(metres.mass_kg, rel=1e-12)
    np.testing.assert_allclose(millimetres.center_of_mass / 1e3, metres.center_of_mass, rtol=1e-11)
    np.testing.assert_allclose(
        millimetres.inertia * 1e-3, metres.inertia, rtol=1e-9, atol=1e-9 * metres.inertia.max()
    )
