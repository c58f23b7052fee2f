"""Supports in turned directions: a body and its supports turned together are the body with supports
along its axes, which take another way through the reduction; normals of faces; edges.
"""

import dataclasses

import numpy as np
import pytest

from common import make_box, make_component
from headstock.geometry.frames import FloatArray, rotate_dofs, rotation_about
from headstock.geometry.parts.components import FixedDirection, Patch, Support
from headstock.geometry.parts.solids import Tube
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components import supports as supports_module
from headstock.reduction.components.supports import hold_points
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from reduced_parts import reduce_mesh

SIZE = (0.1, 0.13, 0.3)
TURN = rotation_about(np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25), 0.7)
GROUPS = {"foot": "z-", "tip": "z+", "support:plane": "x-", "support:base": "z-"}


def mesh_of(turn: FloatArray | None = None) -> ComponentMesh:
    return make_box(
        (1, 2, 3), SIZE, GROUPS, warp=None if turn is None else lambda points: points @ turn.T
    )


def plane(*directions: FixedDirection) -> Support:
    return Support("plane", "body", (Patch("x-"),), directions)


def base(*directions: FixedDirection) -> Support:
    return Support("base", "body", (Patch("z-"),), directions)


def turned(direction: str) -> tuple[float, float, float]:
    x, y, z = (float(number) for number in TURN[:, "xyz".index(direction)])
    return x, y, z


def reduce(turn: FloatArray | None, interfaces: dict[str, str], *supports: Support) -> Superelement:
    return reduce_mesh(make_component(interfaces), mesh_of(turn), supports, modes=5, gravity=True)


def allow(constraints: FloatArray) -> FloatArray:
    """Projection onto the boundary motions that constraint rows leave."""
    count = constraints.shape[1]
    return np.asarray(
        np.eye(count) - (np.linalg.pinv(constraints) @ constraints if len(constraints) else 0.0)
    )


def compare(found: Superelement, expected: Superelement) -> None:
    """In the motions of the boundary that are left, turned back; modal dofs by their frequencies
    and by what they weigh.
    """
    nodes = len(expected.frames)
    boundary = 6 * nodes
    back = np.kron(np.eye(nodes), rotate_dofs(TURN))
    allowed = allow(expected.constraints[:, :boundary])
    np.testing.assert_allclose(allow(found.constraints[:, :boundary] @ back), allowed, atol=1e-9)
    back, stay = back @ allowed, allowed
    for name in ("stiffness", "mass"):
        own, wanted = (getattr(each, name)[:boundary, :boundary] for each in (found, expected))
        wanted = stay @ wanted @ stay
        np.testing.assert_allclose(
            back.T @ own @ back, wanted, atol=1e-9 * np.abs(getattr(expected, name)).max()
        )
    np.testing.assert_allclose(found.modal_frequencies_hz, expected.modal_frequencies_hz, rtol=1e-8)
    coupling, wanted = (
        np.abs(each.mass[boundary:, :boundary] @ turn)
        for each, turn in ((found, back), (expected, stay))
    )
    np.testing.assert_allclose(coupling, wanted, atol=1e-7 * wanted.max())
    assert found.supported and expected.supported


@pytest.mark.parametrize("coupling", ["average", "rigid"])
def test_a_plane_fixed_along_its_normal_is_one_fixed_along_an_axis(coupling: str) -> None:
    """Some of its points belong to the interface: to a rigid one as relations of its dofs."""
    expected = reduce(None, {"tip": coupling}, plane("x"))
    for found in (
        reduce(TURN, {"tip": coupling}, plane(turned("x"))),
        reduce(TURN, {"tip": coupling}, plane("normal")),
    ):
        compare(found, expected)
    assert len(expected.constraints) == (2 if coupling == "rigid" else 0)


def test_supports_that_meet_in_points_hold_what_each_of_them_holds() -> None:
    expected = reduce(None, {"tip": "average"}, plane("x"), base("y", "z"))
    found = reduce(TURN, {"tip": "average"}, plane(turned("x")), base(turned("y"), turned("z")))
    compare(found, expected)


def test_a_body_without_interfaces_keeps_the_motions_that_a_turned_plane_leaves() -> None:
    found, expected = (reduce(turn, {}, plane("normal")) for turn in (TURN, None))
    assert found.boundary_size == 6 and not found.stiffness[:6, :6].any()
    assert np.linalg.matrix_rank(found.constraints) == 3
    np.testing.assert_allclose(found.modal_frequencies_hz, expected.modal_frequencies_hz, rtol=1e-8)


def test_normals_along_an_axis_and_vectors_that_span_a_plane_fix_dofs() -> None:
    component = make_component({})
    held = hold_points(component, mesh_of(), [plane("normal")])
    along = hold_points(component, mesh_of(), [plane("x")])
    assert not len(held.nodes) and np.array_equal(held.dofs, along.dofs)
    both = hold_points(component, mesh_of(), [plane((0.6, 0.8, 0.0), (-0.8, 0.6, 0.0))])
    assert not len(both.nodes)
    assert np.array_equal(both.dofs, hold_points(component, mesh_of(), [plane("x", "y")]).dofs)


def test_normals_of_a_round_face_are_radial_and_let_it_turn() -> None:
    def wrap(points: FloatArray) -> FloatArray:
        """A box as a quarter of a tube."""
        angle, radius = points[:, 0] / 0.1 * 0.5 * np.pi, 0.05 + points[:, 1]
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), points[:, 2]])

    mesh = make_box((3, 1, 2), (0.1, 0.02, 0.1), {"support:skin": "y+"}, warp=wrap, straight=False)
    tube = dataclasses.replace(make_component({}), solid=Tube(0.14, 0.1, 0.1))
    held = hold_points(tube, mesh, [Support("skin", "body", (Patch("outer"),), ("normal",))])
    # points on the x and y axes are fixed along them
    assert len(held.nodes) and len(held.dofs)
    radial = held.points * [1.0, 1.0, 0.0]
    along = np.einsum("ni,ni->n", held.directions, radial) / np.linalg.norm(radial, axis=1)
    np.testing.assert_allclose(np.abs(along), 1.0, rtol=1e-12)
    turning = held.turned_motions(np.zeros(3))[:, [2, 5]]
    assert np.abs(turning).max() < 1e-15
    # another solid has the normals of its mesh, near those of the circle, and says so
    other = hold_points(
        make_component({}), mesh, [Support("skin", "body", (Patch("y+"),), ("normal",))]
    )
    assert any("curved face" in words for words in other.warnings)
    circle = other.points / np.linalg.norm(other.points * [1.0, 1.0, 0.0], axis=1)[:, None]
    assert np.abs(np.einsum("ni,ni->n", other.directions, circle)).min() > 0.9999


def test_an_edge_is_where_two_faces_meet() -> None:
    component = make_component({})
    groups = {"support:side": "z-", "support:side|edge": "x+"}
    mesh = make_box((1, 2, 3), SIZE, groups)
    side = Support("side", "body", (Patch("z-"),), ("z",), (Patch("x+"),))
    held = hold_points(component, mesh, [side])
    points = mesh.points[held.dofs // 3]
    assert len(points) == 5 and (held.dofs % 3 == 2).all()
    np.testing.assert_allclose(points[:, [0, 2]], [[SIZE[0], 0.0]] * 5, atol=1e-12)
    apart = make_box((1, 2, 3), SIZE, groups | {"support:side|edge": "z+"})
    with pytest.raises(ModelError, match="do not meet in an edge"):
        hold_points(component, apart, [side])


def test_turned_directions_of_too_many_points_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supports_module, "MOST_TURNED", 10)
    with pytest.raises(ModelError, match="at most 10 can be: take larger elements"):
        hold_points(make_component({}), mesh_of(), [plane(turned("x"))])
