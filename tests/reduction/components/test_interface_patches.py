import dataclasses

import numpy as np
import pytest

from common import approx, make_box
from headstock.geometry.frames import FloatArray, rigid_map
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.interface_patches import measure_patch

SIZE = (0.2, 0.3, 0.5)
KINDS = ["tet4", "hex8", "tet10", "hex27"]


def slanted(points: FloatArray) -> FloatArray:
    return np.asarray(points @ np.array([[1.0, 0.0, 0.0], [0.3, 1.1, 0.0], [-0.2, 0.4, 0.9]]))


@pytest.fixture(params=KINDS)
def mesh(request: pytest.FixtureRequest) -> ComponentMesh:
    return make_box(
        (2, 3, 2),
        SIZE,
        {"top": "z+", "side": "x-", "skin": lambda c: np.ones(len(c), dtype=bool)},
        kind=request.param,
        warp=slanted,
    )


def test_area_and_centroid_are_those_of_the_face(mesh: ComponentMesh) -> None:
    patch = measure_patch(mesh, "top")
    edges = slanted(np.diag(SIZE))
    corner = slanted(np.array([[0.0, 0.0, SIZE[2]]]))[0]
    assert patch.area == approx(np.linalg.norm(np.cross(edges[0], edges[1])), rel=1e-12)
    np.testing.assert_allclose(patch.centroid, corner + 0.5 * (edges[0] + edges[1]), rtol=1e-12)


def test_normals_point_outward_and_close_around_the_body(mesh: ComponentMesh) -> None:
    whole = measure_patch(mesh, "skin")
    assert np.abs(whole.normals.sum(axis=0)).max() < 1e-13 * whole.area
    # divergence theorem: the flux of the position is three times the volume
    assert (whole.normals * whole.points).sum() == approx(3.0 * mesh.quality.volume, rel=1e-12)


def test_weights_integrate_products_over_the_face(mesh: ComponentMesh) -> None:
    patch = measure_patch(mesh, "side")
    edges = slanted(np.diag(SIZE))
    # coordinates along the two edges of the side run from 0 to 1
    place = np.linalg.solve(edges.T, patch.points.T).T[:, 1:]
    ones = np.ones(len(place))
    assert ones @ patch.weights @ ones == approx(patch.area, rel=1e-12)
    assert place[:, 0] @ patch.weights @ place[:, 0] == approx(patch.area / 3.0, rel=1e-12)
    assert place[:, 0] @ patch.weights @ place[:, 1] == approx(patch.area / 4.0, rel=1e-12)


@pytest.mark.parametrize("name", ["top", "side", "skin"])
def test_the_mean_of_a_rigid_motion_is_that_motion(mesh: ComponentMesh, name: str) -> None:
    patch = measure_patch(mesh, name)
    rigid = rigid_map(patch.points, patch.centroid)
    np.testing.assert_allclose(patch.average_operator().T @ rigid, np.eye(6), atol=1e-11)


def test_a_unit_force_on_a_mean_is_a_uniform_traction(mesh: ComponentMesh) -> None:
    patch = measure_patch(mesh, "top")
    load = patch.average_operator()[:, 1].reshape(-1, 3)
    uniform = np.asarray(patch.weights.sum(axis=1)).ravel() / patch.area
    np.testing.assert_allclose(load[:, 1], uniform, atol=1e-12)
    assert np.abs(load[:, [0, 2]]).max() < 1e-12


def test_an_area_determines_all_rotations_and_a_line_all_but_one(mesh: ComponentMesh) -> None:
    assert len(measure_patch(mesh, "top").undetermined_rotations()) == 0
    line = mesh.points[np.unique(mesh.patches["top"])]
    axis = slanted(np.array([[1.0, 0.0, 0.0]]))[0]
    along = np.unique(mesh.patches["top"])[
        np.linalg.norm(np.cross(line - line[0], axis), axis=1) < 1e-12
    ]
    forced = dataclasses.replace(
        mesh, patches={"line": np.repeat(along[:, None], mesh.patches["top"].shape[1], axis=1)}
    )
    patch = measure_patch(forced, "line")
    assert patch.area == 0.0
    found = patch.undetermined_rotations()
    assert len(found) == 1
    assert np.linalg.norm(np.cross(found[0], axis / np.linalg.norm(axis))) < 1e-7
    assert np.isfinite(patch.average_operator()).all()


def test_a_point_determines_no_rotation(mesh: ComponentMesh) -> None:
    forced = dataclasses.replace(
        mesh, patches={"point": np.full((1, mesh.patches["top"].shape[1]), 0)}
    )
    patch = measure_patch(forced, "point")
    assert len(patch.undetermined_rotations()) == 3
    np.testing.assert_allclose(patch.average_operator()[:, :3], np.eye(3), atol=1e-14)
    assert not patch.average_operator()[:, 3:].any()


def test_a_group_without_facets_is_refused_with_the_groups_there_are(mesh: ComponentMesh) -> None:
    with pytest.raises(
        ValueError, match=r"'rail' has no facets; groups: \['side', 'skin', 'top'\]"
    ):
        measure_patch(mesh, "rail")
