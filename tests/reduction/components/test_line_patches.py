"""a patch on a line has no rotation about it: that rotation is fixed and named, everything else
is right.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from common import Dense, make_box, make_component
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import CouplingKind
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.solvers.errors import ModelError
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H15")

SIZE = (0.2, 0.2, 0.4)
LINES: dict[str, tuple[Callable[[FloatArray], BoolArray], tuple[float, float, float]]] = {
    "along an edge": (lambda p: (p[:, 2] > SIZE[2] - 1e-9) & (p[:, 0] < 1e-9), (0.0, 1.0, 0.0)),
    "across a face": (
        lambda p: (p[:, 2] > SIZE[2] - 1e-9) & (np.abs(p[:, 0] - p[:, 1]) < 1e-9),
        (1.0, 1.0, 0.0),
    ),
}


@pytest.fixture(scope="module", params=list(LINES))
def line(request: pytest.FixtureRequest) -> tuple[ComponentMesh, IntArray, FloatArray]:
    chosen, axis = LINES[request.param]
    mesh = make_box((2, 2, 3), SIZE, {"foot": "z-"})
    nodes = np.flatnonzero(chosen(mesh.points))
    assert len(nodes) == 5
    mesh = dataclasses.replace(
        mesh, patches=mesh.patches | {"line": np.repeat(nodes[:, None], 9, axis=1)}
    )
    return mesh, nodes, np.array(axis) / np.linalg.norm(axis)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_a_line_is_refused_unless_forced(
    line: tuple[ComponentMesh, IntArray, FloatArray], coupling: CouplingKind
) -> None:
    with pytest.raises(ModelError, match="line of component body"):
        reduce_mesh(make_component({"foot": "rigid", "line": coupling}), line[0], modes=4)


@pytest.mark.parametrize("coupling", ["rigid!", "average!"])
def test_the_rotation_about_the_line_is_fixed_and_named(
    line: tuple[ComponentMesh, IntArray, FloatArray], coupling: CouplingKind
) -> None:
    mesh, _, axis = line
    element = reduce_mesh(make_component({"foot": "rigid", "line": coupling}), mesh, modes=4)
    node = element.interface_maps["line"].node
    turn = np.zeros(len(element.stiffness))
    turn[6 * node + 3 : 6 * node + 6] = axis
    assert np.abs(element.stiffness @ turn).max() < 1e-9 * np.abs(element.stiffness).max()
    rows = element.constraints
    assert np.linalg.matrix_rank(rows, tol=1e-9) == 1
    assert np.linalg.norm(rows @ turn) > 0.9
    direction = ", ".join(f"{value:+.3f}" for value in axis)
    opposite = ", ".join(f"{-value:+.3f}" for value in axis)
    said = "".join(element.warnings)
    assert "no rotation about" in said
    assert direction in said or opposite.replace("-0.000", "+0.000") in said or opposite in said


def test_the_other_five_motions_are_those_of_a_rigid_line(
    line: tuple[ComponentMesh, IntArray, FloatArray], dense: Dense
) -> None:
    mesh, nodes, axis = line
    element = reduce_mesh(make_component({"foot": "rigid", "line": "rigid!"}), mesh, modes=4)
    stiffness, _ = dense.pencil(mesh, make_component().material)
    center = mesh.points[nodes].mean(axis=0)
    across = np.linalg.svd(axis[None])[2][1:]
    motions = np.zeros((len(mesh.points), 3, 5))
    motions[nodes, :, :3] = np.eye(3)
    for column, direction in enumerate(across):
        motions[nodes, :, 3 + column] = np.cross(direction, mesh.points[nodes] - center)
    fixed = np.zeros(len(mesh.points), dtype=bool)
    fixed[nodes] = fixed[mesh.points[:, 2] < 1e-9] = True
    free = np.repeat(~fixed, 3)
    basis = np.hstack([motions.reshape(-1, 5), np.eye(len(free))[:, free]])
    exact = np.linalg.inv(basis.T @ stiffness @ basis)[:5, :5]
    node = element.interface_maps["line"].node
    select = np.zeros((6, 5))
    select[:3, :3], select[3:, 3:] = np.eye(3), across.T
    block = element.stiffness[6 * node : 6 * node + 6, 6 * node : 6 * node + 6]
    found = np.linalg.inv(select.T @ block @ select)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(found - exact) / scale).max() < 1e-9


def test_a_mean_over_a_line_yields_finite_motions_softer_than_the_rigid_line(
    line: tuple[ComponentMesh, IntArray, FloatArray],
) -> None:
    mesh, _, _ = line
    rigid, average = (
        reduce_mesh(make_component({"foot": "rigid", "line": f"{coupling}!"}), mesh, modes=4)
        for coupling in ("rigid", "average")
    )
    node = rigid.interface_maps["line"].node
    rows = slice(6 * node, 6 * node + 3)
    soft = np.linalg.inv(average.stiffness[rows, rows])
    stiff = np.linalg.inv(rigid.stiffness[rows, rows])
    assert np.isfinite(average.stiffness).all()
    assert np.isfinite(average.mass).all()
    assert np.linalg.eigvalsh(soft - stiff).min() > -1e-9 * np.abs(stiff).max()


def test_a_body_that_hangs_on_a_line_alone_is_named_as_free(
    line: tuple[ComponentMesh, IntArray, FloatArray],
) -> None:
    mesh, _, _ = line
    mesh = dataclasses.replace(mesh, patches={"line": mesh.patches["line"]})
    with pytest.raises(
        ModelError, match="1 rigid motions of the component are fixed by no interface"
    ):
        reduce_mesh(make_component({"line": "rigid!"}), mesh, modes=4)
