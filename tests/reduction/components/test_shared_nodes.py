"""interfaces that overlap, cover each other or touch: tied, merged or dropped, and equal to
the merged model.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from common import Choice, Dense, approx, make_box, make_component, present
from headstock.geometry.frames import BoolArray, FloatArray, rigid_transfer
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.superelement import Superelement
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H13")

SIZE = (0.2, 0.3, 0.4)


def top(low: float, high: float) -> Callable[[FloatArray], BoolArray]:
    """Facets of the upper face between two heights of y."""
    return lambda centers: (
        (centers[:, 2] > SIZE[2] - 1e-9)
        & (centers[:, 1] > low * SIZE[1])
        & (centers[:, 1] < high * SIZE[1])
    )


@pytest.fixture(scope="module")
def block() -> ComponentMesh:
    whole = top(0.0, 1.0)
    groups: dict[str, Choice] = {
        "foot": "z-", "left": top(0.0, 0.7), "right": top(0.3, 1.0), "all": whole, "again": whole,
        "low_half": top(0.0, 0.5), "high_half": top(0.5, 1.0), "side": "x+", "skew": lambda c: whole(c) | (c[:, 0] > SIZE[0] - 1e-9),
    }  # fmt: skip
    return make_box((2, 4, 3), SIZE, groups)


@pytest.fixture(scope="module")
def reduced(block: ComponentMesh) -> Callable[..., Superelement]:
    def reduce_with(couplings: dict[str, str], count: int = 6) -> Superelement:
        mesh = dataclasses.replace(block, patches={name: block.patches[name] for name in couplings})
        component = make_component(couplings, size=SIZE)
        return reduce_mesh(component, mesh, modes=count)

    return reduce_with


def compliance(element: Superelement, name: str) -> FloatArray:
    """Motion ``(6, 6)`` of an interface under unit loads on it, foot fixed, the superelement's own
    ties kept.
    """
    size = len(element.stiffness)
    foot = element.interface_maps["foot"].node
    rows = [np.eye(size)[6 * foot : 6 * foot + 6], element.constraints]
    _, values, vectors = np.linalg.svd(np.vstack(rows))
    basis = vectors[int((values > 1e-9 * values[0]).sum()) :].T
    place = element.interface_maps[name]
    motion = np.zeros((6, size))
    transfer = rigid_transfer(element.frames[place.node].origin, place.frame.origin)
    motion[:, 6 * place.node : 6 * place.node + 6] = transfer
    channels = motion @ basis
    return np.asarray(channels @ np.linalg.solve(basis.T @ element.stiffness @ basis, channels.T))


def frequencies(element: Superelement) -> FloatArray:
    size = len(element.stiffness)
    _, values, vectors = np.linalg.svd(np.vstack([element.constraints, np.zeros((1, size))]))
    basis = (
        vectors[int((values > 1e-9 * values[0]).sum()) :].T
        if len(element.constraints)
        else np.eye(size)
    )
    factor = np.linalg.inv(np.linalg.cholesky(basis.T @ element.mass @ basis))
    eigenvalues = np.linalg.eigvalsh(factor @ basis.T @ element.stiffness @ basis @ factor.T)
    return np.asarray(np.sqrt(np.abs(eigenvalues)) / (2.0 * np.pi))


def assert_same(found: FloatArray, exact: FloatArray, tolerance: float = 1e-10) -> None:
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(found - exact) / scale).max() < tolerance


def moved(matrix: FloatArray, source: FloatArray, target: FloatArray) -> FloatArray:
    transfer = rigid_transfer(source, target)
    return transfer @ matrix @ transfer.T


def test_overlapping_rigid_patches_move_as_one(reduced: Callable[..., Superelement]) -> None:
    two = reduced({"foot": "rigid", "left": "rigid", "right": "rigid"})
    one = reduced({"foot": "rigid", "all": "rigid"})
    assert np.linalg.matrix_rank(two.constraints, tol=1e-9) == 6
    assert any("share" in warning and "6" in warning for warning in two.warnings)
    whole = compliance(one, "all")
    center = one.interface_maps["all"].frame.origin
    for name in ("left", "right"):
        assert_same(
            compliance(two, name), moved(whole, center, two.interface_maps[name].frame.origin)
        )
    np.testing.assert_allclose(frequencies(two)[6:12], frequencies(one)[6:12], rtol=1e-9)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_identical_patches_are_merged(reduced: Callable[..., Superelement], coupling: str) -> None:
    two = reduced({"foot": "rigid", "all": coupling, "again": coupling})
    one = reduced({"foot": "rigid", "all": coupling})
    assert two.stiffness.shape == one.stiffness.shape
    assert two.interface_maps["all"].node == two.interface_maps["again"].node
    assert_same(compliance(two, "again"), compliance(one, "all"))
    assert any("merged" in warning for warning in two.warnings)


def test_rigid_patches_that_meet_in_an_edge_keep_the_hinge_between_them(
    reduced: Callable[..., Superelement],
) -> None:
    # top and side share the nodes of one edge along y: five of six relative motions are tied, the
    # turn about the edge is free
    hinged = reduced({"foot": "average", "all": "rigid", "side": "rigid"})
    assert np.linalg.matrix_rank(hinged.constraints, tol=1e-9) == 5
    hinge = np.zeros(6 * len(hinged.frames))
    edge = np.array([SIZE[0], 0.0, SIZE[2]])
    node = hinged.interface_maps["side"].node
    arm = hinged.frames[node].origin - edge
    hinge[6 * node : 6 * node + 6] = [*np.cross([0.0, 1.0, 0.0], arm), 0.0, 1.0, 0.0]
    assert np.abs(hinged.constraints[:, : len(hinge)] @ hinge).max() < 1e-9
    assert hinge @ hinged.stiffness[: len(hinge), : len(hinge)] @ hinge > 0.0


def test_a_curved_patch_over_two_faces_is_one_rigid_interface(
    reduced: Callable[..., Superelement], block: ComponentMesh, dense: Dense
) -> None:
    element = reduced({"foot": "rigid", "skew": "rigid"}, 0)
    stiffness, _ = dense.pencil(block, make_component().material)
    foot, skew = (np.unique(block.patches[name]) for name in ("foot", "skew"))
    shared = np.intersect1d(foot, skew)
    assert len(shared) > 2
    # the patch over the corner shares an edge with the foot: the body is fixed by it but for the
    # turn about that edge
    assert np.linalg.matrix_rank(element.constraints, tol=1e-9) == 5
    place = element.frames[element.interface_maps["skew"].node].origin
    center = block.points[foot].mean(axis=0)
    turn = np.zeros((len(block.points), 3))
    turn[skew] = np.cross([0.0, 1.0, 0.0], block.points[skew] - [SIZE[0], 0.0, 0.0])
    turn[foot] = 0.0
    free = np.ones(len(block.points), dtype=bool)
    free[np.union1d(foot, skew)] = False
    inner, outer = np.repeat(free, 3), np.repeat(~free, 3)
    answer = turn.ravel()
    answer[inner] = -np.linalg.solve(
        stiffness[np.ix_(inner, inner)], stiffness[np.ix_(inner, outer)] @ answer[outer]
    )
    dofs = np.zeros(12)
    node = element.interface_maps["skew"].node
    dofs[6 * node : 6 * node + 6] = [
        *np.cross([0.0, 1.0, 0.0], place - [SIZE[0], 0.0, 0.0]),
        0.0,
        1.0,
        0.0,
    ]
    assert center[2] == 0.0
    assert dofs @ element.stiffness @ dofs == approx(answer @ stiffness @ answer, rel=1e-10)


def test_means_over_two_halves_and_over_the_whole_depend_on_each_other(
    reduced: Callable[..., Superelement],
) -> None:
    three = reduced(
        {"foot": "rigid", "low_half": "average", "high_half": "average", "all": "average"}
    )
    one = reduced({"foot": "rigid", "all": "average"})
    assert np.linalg.matrix_rank(three.constraints, tol=1e-9) > 0
    assert_same(compliance(three, "all"), compliance(one, "all"), 1e-9)
    halves = reduced({"foot": "rigid", "low_half": "average", "high_half": "average"})
    assert_same(compliance(three, "low_half"), compliance(halves, "low_half"), 1e-9)


def test_overlapping_averaging_patches_stay_independent(
    reduced: Callable[..., Superelement],
) -> None:
    two = reduced({"foot": "rigid", "left": "average", "right": "average"})
    alone = reduced({"foot": "rigid", "left": "average"})
    assert len(two.constraints) == 0
    assert_same(compliance(two, "left"), compliance(alone, "left"), 1e-9)


def test_a_mean_that_overlaps_a_rigid_patch_is_still_the_mean(
    reduced: Callable[..., Superelement], block: ComponentMesh
) -> None:
    two = reduced({"foot": "rigid", "left": "rigid", "all": "average"})
    alone = reduced({"foot": "rigid", "left": "rigid"})
    assert_same(compliance(two, "left"), compliance(alone, "left"), 1e-9)
    # any motion of the dofs gives the points of the face displacements whose mean is the
    # interface's own motion
    place = two.interface_maps["all"].node
    dofs = np.random.default_rng(2).standard_normal(len(two.stiffness))
    patch = measure_patch(block, "all")
    points = (3 * patch.nodes[:, None] + np.arange(3)).ravel()
    np.testing.assert_allclose(
        patch.average_operator().T @ (present(two.recovery).basis @ dofs)[points],
        dofs[6 * place : 6 * place + 6],
        rtol=1e-8,
    )


@pytest.mark.parametrize(
    "couplings",
    [
        {"left": "average", "all": "rigid"},
        {"all": "rigid", "left": "rigid"},
        {"left": "rigid", "all": "rigid"},
    ],
    ids=["a mean of a part", "whole and part", "part and whole"],
)
def test_a_part_of_a_rigid_face_moves_as_the_face(
    reduced: Callable[..., Superelement], couplings: dict[str, str]
) -> None:
    two = reduced({"foot": "rigid"} | couplings)
    one = reduced({"foot": "rigid", "all": "rigid"})
    exact = moved(
        compliance(one, "all"),
        one.interface_maps["all"].frame.origin,
        two.interface_maps["left"].frame.origin,
    )
    assert_same(compliance(two, "left"), exact)
