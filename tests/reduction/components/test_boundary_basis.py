import numpy as np
import pytest

from common import make_box, make_component
from headstock.geometry.frames import rigid_map
from headstock.geometry.parts.components import Patch, Support
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.boundary_basis import build_boundary_basis

SIZE = (0.2, 0.3, 0.4)


def support(name: str, *directions: str) -> Support:
    return Support(name, "body", (Patch("x-"),), directions)


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    groups = {"foot": "z-", "tip": "z+", "side": "x+", "support:plane": "x-", "support:all": "y-"}
    return make_box((2, 2, 2), SIZE, groups)


def test_rigid_patches_hold_their_points_and_means_hold_none(mesh: ComponentMesh) -> None:
    basis = build_boundary_basis(make_component({"foot": "rigid", "tip": "average"}), mesh, ())
    fixed = np.isin(np.arange(mesh.points.size), basis.fixed).reshape(-1, 3)
    np.testing.assert_array_equal(fixed.all(axis=1), mesh.points[:, 2] < 1e-12)
    np.testing.assert_array_equal(fixed.any(axis=1), fixed.all(axis=1))
    assert not len(basis.held.dofs)


def test_a_support_fixes_its_directions_alone(mesh: ComponentMesh) -> None:
    basis = build_boundary_basis(make_component({"tip": "average"}), mesh, (support("plane", "x"),))
    fixed = np.isin(np.arange(mesh.points.size), basis.held.dofs).reshape(-1, 3)
    np.testing.assert_array_equal(fixed[:, 0], mesh.points[:, 0] < 1e-12)
    assert not fixed[:, 1:].any()


def test_rigid_patches_come_first_and_every_interface_keeps_its_name(mesh: ComponentMesh) -> None:
    basis = build_boundary_basis(make_component({"tip": "average", "foot": "rigid"}), mesh, ())
    assert [node.name for node in basis.nodes] == ["foot", "tip"]
    assert basis.interface_maps["tip"].node == 1
    np.testing.assert_allclose(
        basis.interface_maps["tip"].frame.origin, [SIZE[0] / 2, SIZE[1] / 2, SIZE[2]], rtol=1e-12
    )


def test_shapes_are_rigid_motions_about_the_centroid(mesh: ComponentMesh) -> None:
    basis = build_boundary_basis(make_component({"foot": "rigid"}), mesh, ())
    dofs, values, columns = basis.shapes[0]
    assert columns.tolist() == list(range(6))
    nodes = dofs[::3] // 3
    np.testing.assert_allclose(
        values, rigid_map(mesh.points[nodes], np.array([SIZE[0] / 2, SIZE[1] / 2, 0.0])), atol=1e-15
    )


def test_separate_interfaces_are_independent(mesh: ComponentMesh) -> None:
    basis = build_boundary_basis(make_component({"foot": "rigid", "tip": "rigid"}), mesh, ())
    assert basis.constraints.shape == (0, 12)
    assert basis.warnings == ()


@pytest.mark.parametrize(
    ("directions", "motions"),
    [(("x",), [[0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]]), (("x", "y", "z"), [])],
    ids=["symmetry plane", "clamp"],
)
def test_a_support_that_shares_points_with_a_rigid_patch_leaves_it_the_motions_in_the_plane(
    mesh: ComponentMesh, directions: tuple[str, ...], motions: list[list[int]]
) -> None:
    # the foot meets x = 0 in an edge along y, whose points keep their x: y, z and the turn about x
    # about that edge's height stay free
    basis = build_boundary_basis(
        make_component({"foot": "rigid"}), mesh, (support("plane", *directions),)
    )
    free = np.linalg.svd(np.vstack([basis.constraints, np.zeros((1, 6))]))[2][
        np.linalg.matrix_rank(basis.constraints) :
    ]
    if not motions:
        # a fixed edge leaves the turn about itself
        assert len(free) == 1
        assert abs(free[0][4]) > 0.9
        return
    # foot frame at z = 0, as the edge: besides the three motions of the plane, the turn about the
    # edge itself
    assert len(free) == 4
    for motion in motions:
        assert np.abs(basis.constraints @ np.array(motion, dtype=float)).max() < 1e-12


def test_constraint_rows_are_orthonormal(mesh: ComponentMesh) -> None:
    basis = build_boundary_basis(make_component({"foot": "rigid", "side": "rigid"}), mesh, ())
    np.testing.assert_allclose(
        basis.constraints @ basis.constraints.T, np.eye(len(basis.constraints)), atol=1e-12
    )
    assert len(basis.constraints) == 5
