"""more modes wanted than there are interior dofs, every point in an interface, no interior at
all.
"""

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.parts.components import Component, CouplingKind
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.validation.parts.component_models import full_model, full_modes
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H24")

COMM = MPI.COMM_SELF
SIZE = (0.1, 0.13, 0.2)


def reduced(mesh: ComponentMesh, component: Component, count: int) -> Superelement:
    return reduce_mesh(component, mesh, modes=count)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_a_count_above_the_interior_dofs_gives_all_of_them(coupling: CouplingKind) -> None:
    mesh = make_box((1, 1, 2), SIZE, {"foot": "z-", "tip": "z+"})
    element = reduced(mesh, make_component({"foot": coupling, "tip": coupling}, size=SIZE), 100_000)
    interior = 3 * 27 if coupling == "rigid" else 3 * 45 - 12
    assert element.modal_count == interior
    assert element.cutoff_hz == np.inf
    check_superelement(element)


def test_just_as_many_modes_as_interior_dofs_are_all() -> None:
    mesh = make_box((1, 1, 1), SIZE, {"foot": "z-", "tip": "z+"})
    element = reduced(mesh, make_component({"foot": "rigid", "tip": "rigid"}, size=SIZE), 27)
    assert element.modal_count == 27
    assert element.cutoff_hz == np.inf


@pytest.mark.parametrize("count", [0, 5])
def test_two_patches_that_hold_every_point_leave_no_modes(count: int) -> None:
    mesh = make_box((1, 1, 1), SIZE, {"foot": "z-", "tip": "z+"}, kind="hex8")
    element = reduced(mesh, make_component({"foot": "rigid", "tip": "rigid"}, size=SIZE), count)
    assert element.modal_count == 0
    assert element.cutoff_hz == np.inf
    check_superelement(element)
    # one straight element between two plates: the uniform strain state is exact where Poisson's
    # effect is prevented
    young, poisson = 2.1e11, 0.3
    confined = young * (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    assert element.stiffness[2, 2] == approx(confined * SIZE[0] * SIZE[1] / SIZE[2], rel=1e-10)


def test_one_rigid_interface_over_every_point_is_a_rigid_body() -> None:
    mesh = make_box(
        (1, 1, 1), SIZE, {"all": lambda centers: np.ones(len(centers), dtype=bool)}, kind="tet10"
    )
    # the block's middle is the only point that is not on its surface; straight tets of the lattice
    # have a node there
    element = reduced(mesh, make_component({"all": "rigid"}, size=SIZE), 100)
    assert element.modal_count == 3
    assert np.abs(element.stiffness[:6, :6]).max() < 1e-9 * 2.1e11
    check_superelement(element)


def test_all_modes_of_a_free_body_are_its_dofs_less_its_rigid_motions() -> None:
    mesh = make_box((1, 1, 1), SIZE)
    element = reduced(mesh, make_component(size=SIZE), 10_000)
    assert element.modal_count == 3 * 27 - 6


def test_a_full_model_asked_for_more_modes_than_it_has_gives_all() -> None:
    mesh = make_box((1, 1, 1), SIZE, kind="hex8")
    model = full_model(mesh, make_component().material, comm=COMM)
    modes = full_modes(model, 1000)
    assert len(modes.frequencies_hz) == 3 * 8 - 6
    fixed = np.zeros(24, dtype=bool)
    assert count_frequencies_below(model.operators, fixed, 1.01 * modes.frequencies_hz[-1]) == 24
