import dataclasses

import numpy as np
import pytest

from common import approx, make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import CouplingKind, Patch, ReductionSettings, Support
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.requests import mode_target
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import ModelError
from reduced_parts import reduce_mesh

SIZE = (0.1, 0.13, 0.4)


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    groups = {"foot": "z-", "tip": "z+", "support:plane": "x-", "support:clamp": "z-"}
    return make_box((2, 2, 4), SIZE, groups)


def plane(*directions: str) -> tuple[Support]:
    return (Support("plane", "body", (Patch("x-"),), directions),)


def test_labels_name_every_dof_in_order(mesh: ComponentMesh) -> None:
    element = reduce_mesh(
        make_component({"foot": "rigid", "tip": "average"}), mesh, modes=6, gravity=True
    )
    assert element.labels[:7] == (
        *(("foot", dof) for dof in ("x", "y", "z", "rx", "ry", "rz")),
        ("tip", "x"),
    )
    assert element.labels[12] == ("mode", "1")
    assert len(element.labels) == len(element.stiffness) == 12 + element.modal_count
    assert element.full_dofs == mesh.points.size


def test_the_mass_of_an_even_mesh_has_no_rounding_of_many_equal_terms() -> None:
    even = make_box((4, 8, 24), (0.04, 0.1, 0.3), {"foot": "z-", "tip": "z+"})
    component = make_component({"foot": "rigid", "tip": "average"})
    element = reduce_mesh(component, even, modes=1, errors=False)
    mass = component.material.density * 0.04 * 0.1 * 0.3
    assert element.mass_kg == approx(mass, rel=1e-14, abs=0.0)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_a_free_component_with_one_interface_has_no_stiffness_there_at_all(
    mesh: ComponentMesh, coupling: CouplingKind
) -> None:
    element = reduce_mesh(make_component({"foot": coupling}), mesh, modes=6, gravity=True)
    assert not element.stiffness[:6, :6].any()
    check_superelement(element)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_a_symmetry_plane_leaves_its_three_motions_without_stiffness(
    mesh: ComponentMesh, coupling: CouplingKind
) -> None:
    element = reduce_mesh(
        make_component({"tip": coupling}), mesh, plane("x"), modes=6, gravity=True
    )
    # in the plane x = 0: along y, along z, about x
    for motion in ([0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]):
        force = element.stiffness[:, :6] @ np.array(motion, dtype=float)
        assert np.abs(force).max() < 1e-15 * np.abs(element.stiffness[:6, :6]).max()
        # the diagonal shows a null space: there not even rounding may be left
        assert abs(force[:6] @ motion) < 1e-28 * np.abs(element.stiffness[:6, :6]).max()
    assert element.supported


def test_half_a_body_on_its_symmetry_plane_is_the_symmetric_half_of_the_whole() -> None:
    whole = make_box((4, 2, 3), (0.2, 0.13, 0.3), {"foot": "z-", "tip": "z+"})
    half = make_box((2, 2, 3), (0.1, 0.13, 0.3), {"foot": "z-", "tip": "z+", "support:plane": "x-"})
    component = make_component({"foot": "rigid", "tip": "rigid"})
    full = reduce_mesh(component, whole)
    part = reduce_mesh(component, half, plane("x"))

    def stretch(element: Superelement) -> FloatArray:
        """Stiffness against pulling the faces apart and against turning them towards each other
        about x.
        """
        motions = np.zeros((12, 2))
        for name, sign in (("foot", -1.0), ("tip", 1.0)):
            node = element.interface_maps[name].node
            motions[6 * node + 2, 0] = motions[6 * node + 3, 1] = sign
        return motions.T @ element.stiffness @ motions

    found, exact = 2.0 * stretch(part), stretch(full)
    assert [frame.origin[0] for frame in part.frames[:2]] == approx([0.05] * 2)
    np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-12 * np.abs(exact).max())


def test_a_body_on_a_symmetry_plane_alone_keeps_the_three_motions_that_the_plane_leaves(
    mesh: ComponentMesh,
) -> None:
    element = reduce_mesh(make_component(), mesh, plane("x"), modes=6, gravity=True)
    assert element.boundary_size == 6 and not element.stiffness[:6, :6].any()
    rows = element.constraints[:, :6]
    # x, turning about y and about z are fixed
    np.testing.assert_allclose(
        np.abs(rows).sum(axis=0) > 1e-9, [True, False, False, False, True, True]
    )
    free = element.mass[:6, :6].diagonal()
    np.testing.assert_allclose(free[1:3], element.mass_kg, rtol=1e-9)
    assert free[3] == approx(element.inertia[0, 0], rel=1e-9)


def test_a_clamped_body_without_interfaces_is_its_modes(mesh: ComponentMesh) -> None:
    clamp = (Support("clamp", "body", (Patch("z-"),), ("x", "y", "z")),)
    element = reduce_mesh(make_component(), mesh, clamp, modes=6, gravity=True)
    assert element.boundary_size == 0
    np.testing.assert_allclose(element.mass, np.eye(element.modal_count), atol=1e-10)
    np.testing.assert_allclose(
        np.diag(element.stiffness), (2.0 * np.pi * element.modal_frequencies_hz) ** 2, rtol=1e-12
    )


def test_a_stated_mass_scales_the_density(mesh: ComponentMesh) -> None:
    plain = make_component({"foot": "rigid"})
    heavy = dataclasses.replace(plain, mass=123.0)
    one, other = (
        reduce_mesh(component, mesh, modes=6, gravity=True) for component in (plain, heavy)
    )
    assert other.mass_kg == approx(123.0, rel=1e-12)
    np.testing.assert_allclose(
        other.mass[:6, :6], one.mass[:6, :6] * 123.0 / one.mass_kg, rtol=1e-9, atol=1e-9
    )
    ratio = np.sqrt(one.mass_kg / 123.0)
    np.testing.assert_allclose(
        other.modal_frequencies_hz, one.modal_frequencies_hz * ratio, rtol=1e-9
    )


def test_mode_targets_follow_the_components_settings() -> None:
    component = make_component()
    by_count = dataclasses.replace(component, reduction=ReductionSettings(modes=7))
    by_frequency = dataclasses.replace(component, reduction=ReductionSettings(modes_to_hz=900.0))
    assert mode_target(by_count) == ModeTarget(count=7)
    assert mode_target(by_frequency) == ModeTarget(up_to_hz=900.0)
    with pytest.raises(ModelError, match=r"reduction.modes"):
        mode_target(dataclasses.replace(component, reduction=ReductionSettings()))


def test_residuals_of_the_solves_are_reported(mesh: ComponentMesh) -> None:
    element = reduce_mesh(
        make_component({"foot": "rigid", "tip": "average"}), mesh, modes=6, gravity=True
    )
    assert 0.0 < element.residual < 1e-8
