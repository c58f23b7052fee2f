"""bodies of a micrometre and of ten kilometres, and bodies far from their origin."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

from common import STEEL, Dense, make_box, make_component, make_faced
from headstock.geometry.parts.components import (
    CellShape,
    Component,
    CouplingKind,
    Interface,
    MeshSettings,
    Patch,
)
from headstock.geometry.parts.solids import Box
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.validation.parts.component_models import full_model, full_modes
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H19")

COMM = MPI.COMM_SELF
SIZE = np.array([0.4, 0.7, 1.0])
SIZES = [1e-6, pytest.param(1e-3, marks=pytest.mark.trials), 1e4]
# a body of any length, and that of 1 m
ReduceAt = tuple[Callable[[float], Superelement], Superelement]


def meshed(length: float, coupling: CouplingKind, cells: CellShape) -> Component:
    width, depth, height = (float(f"{side * length:.12g}") for side in SIZE)
    pad = Patch("z+", "rect", (0.0, 0.0, 0.0), (0.2 * length, 0.2 * length))
    interfaces = {
        name: Interface(name, (patch,), coupling)
        for name, patch in (("foot", Patch("z-")), ("pad", pad))
    }
    settings = {"interfaces": interfaces, "mesh": MeshSettings(0.25 * length, 2, cells)}
    return make_faced("body", Box((width, depth, height)), {}, **settings)


@pytest.fixture(
    scope="module", params=[("rigid", "tet"), ("average", "hex")], ids=["rigid tet", "average hex"]
)
def reduce_at(request: pytest.FixtureRequest) -> ReduceAt:
    @functools.cache
    def reduce_size(length: float) -> Superelement:
        component = meshed(length, *request.param)
        return reduce_mesh(component, mesh_component(component), modes=8, recovery=False)

    return reduce_size, reduce_size(1.0)


@pytest.mark.parametrize("length", SIZES)
def test_frequencies_go_with_one_over_length(
    reduce_at: ReduceAt, dense: Dense, length: float
) -> None:
    reduce_size, unit = reduce_at
    element = reduce_size(length)
    check_superelement(element)
    np.testing.assert_allclose(
        element.modal_frequencies_hz * length, unit.modal_frequencies_hz, rtol=1e-8
    )
    found, exact = (dense.frequencies(e.stiffness, e.mass)[6:] for e in (element, unit))
    np.testing.assert_allclose(found * length, exact, rtol=1e-8)


@pytest.mark.parametrize("length", SIZES)
def test_compliances_go_with_one_over_length(reduce_at: ReduceAt, length: float) -> None:
    reduce_size, unit = reduce_at
    element = reduce_size(length)
    units = np.array([1.0, 1.0, 1.0, 1.0 / length, 1.0 / length, 1.0 / length])
    foot = element.interface_maps["foot"].node
    rows = slice(6 - 6 * foot, 12 - 6 * foot)
    found = units[:, None] * element.stiffness[rows, rows] * units / length
    exact = unit.stiffness[rows, rows]
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(found - exact) / size).max() < 1e-8


@pytest.mark.parametrize("shift", [1e4, -1e4])
@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_an_offset_of_ten_kilometres_changes_frequencies_by_less_than_a_millionth(
    dense: Dense, shift: float, coupling: CouplingKind
) -> None:
    mesh = make_box((2, 2, 3), tuple(SIZE), {"foot": "z-", "tip": "z+"}, kind="tet10")
    far = dataclasses.replace(mesh, points=mesh.points + np.array([shift, -shift, 0.5 * shift]))
    component = make_component({"foot": coupling, "tip": coupling}, size=tuple(SIZE))
    near_element, far_element = (
        reduce_mesh(component, m, modes=8, recovery=False) for m in (mesh, far)
    )
    np.testing.assert_allclose(
        far_element.modal_frequencies_hz, near_element.modal_frequencies_hz, rtol=1e-6
    )
    found, exact = (dense.frequencies(e.stiffness, e.mass)[6:] for e in (far_element, near_element))
    np.testing.assert_allclose(found, exact, rtol=1e-6)
    free_near, free_far = (
        full_modes(full_model(m, STEEL, comm=COMM), 4).frequencies_hz for m in (mesh, far)
    )
    np.testing.assert_allclose(free_far, free_near, rtol=1e-6)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_mass_and_inertia_do_not_cancel_ten_kilometres_away(coupling: CouplingKind) -> None:
    mesh = make_box((2, 2, 3), tuple(SIZE), {"foot": "z-", "tip": "z+"}, kind="tet10")
    far = dataclasses.replace(mesh, points=mesh.points + np.array([1e4, -1e4, 5e3]))
    component = make_component({"foot": coupling, "tip": coupling}, size=tuple(SIZE))
    near_element, far_element = (
        reduce_mesh(component, m, modes=8, recovery=False) for m in (mesh, far)
    )
    check_superelement(far_element)
    np.testing.assert_allclose(
        far_element.inertia, near_element.inertia, rtol=1e-6, atol=1e-6 * near_element.inertia.max()
    )
