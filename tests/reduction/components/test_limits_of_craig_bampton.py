"""all fixed-interface modes kept is the full model, none is Guyan's, and statics are exact for
any number.
"""

import numpy as np
import pytest

from common import Dense, make_box, make_component, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import CouplingKind, Load, Patch
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.superelement import Superelement
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H21")

SIZE = (0.1, 0.13, 0.4)
GROUPS = {"foot": "z-", "tip": "z+", "load:wind": "x+", "load:oil": "y-"}
LOADS = (
    Load("wind", "body", "traction", (Patch("x+"),), vector=(1.0, 2.0, 3.0)),
    Load("oil", "body", "pressure", (Patch("y-"),), magnitude=2.5e5),
)
ALL = 10**6


@pytest.fixture(scope="module")
def block(dense: Dense) -> tuple[ComponentMesh, FloatArray, FloatArray]:
    mesh = make_box((1, 1, 4), SIZE, GROUPS)
    return mesh, *dense.pencil(mesh, make_component().material)


def reduced(
    mesh: ComponentMesh,
    couplings: tuple[str, str],
    count: int,
    loads: tuple[Load, ...] = (),
    *,
    gravity: bool = False,
) -> Superelement:
    foot, tip = couplings
    component = make_component({"foot": foot, "tip": tip}, size=SIZE)
    return reduce_mesh(component, mesh, (), loads, modes=count, gravity=gravity)


def assert_spectrum(found: FloatArray, exact: FloatArray, tolerance: float) -> None:
    assert len(found) == len(exact)
    assert found[:6].max() < 1e-5 * exact[6]
    np.testing.assert_allclose(found[6:], exact[6:], rtol=tolerance)


@pytest.mark.parametrize(
    "couplings",
    [("rigid", "rigid"), ("average", "average"), ("rigid", "average")],
    ids=["rigid", "average", "mixed"],
)
def test_all_modes_behind_faces_are_the_full_model(
    block: tuple[ComponentMesh, FloatArray, FloatArray], dense: Dense, couplings: tuple[str, str]
) -> None:
    mesh, stiffness, mass = block
    basis, _ = dense.rigid_map(
        mesh,
        [name for name, kind in zip(("foot", "tip"), couplings, strict=True) if kind == "rigid"],
    )
    exact = dense.frequencies(basis.T @ stiffness @ basis, basis.T @ mass @ basis)
    element = reduced(mesh, couplings, ALL)
    assert_spectrum(dense.frequencies(element.stiffness, element.mass), exact, 1e-9)
    assert element.cutoff_hz == np.inf


def test_no_modes_between_rigid_faces_are_guyans_condensation(
    block: tuple[ComponentMesh, FloatArray, FloatArray], dense: Dense
) -> None:
    mesh, stiffness, mass = block
    basis, _ = dense.rigid_map(mesh, ["foot", "tip"])
    stiffness, mass = basis.T @ stiffness @ basis, basis.T @ mass @ basis
    static = np.vstack([np.eye(12), -np.linalg.solve(stiffness[12:, 12:], stiffness[12:, :12])])
    element = reduced(mesh, ("rigid", "rigid"), 0)
    guyan_stiffness, guyan_mass = static.T @ stiffness @ static, static.T @ mass @ static
    assert np.abs(element.stiffness - guyan_stiffness).max() < 1e-10 * np.abs(guyan_stiffness).max()
    assert np.abs(element.mass - guyan_mass).max() < 1e-10 * np.abs(guyan_mass).max()
    exact = dense.frequencies(guyan_stiffness, guyan_mass)
    np.testing.assert_allclose(
        dense.frequencies(element.stiffness, element.mass)[6:], exact[6:], rtol=1e-10
    )


@pytest.mark.parametrize("count", [0, 1, 7, 30])
@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_statics_at_the_interfaces_are_those_of_the_full_model_for_any_count(
    block: tuple[ComponentMesh, FloatArray, FloatArray], count: int, coupling: CouplingKind
) -> None:
    mesh, stiffness, _ = block
    # foot fixed as it is coupled, unit forces and moments on the tip
    element = reduced(mesh, ("rigid", coupling), count)
    rows = {name: slice(6 * a.node, 6 * a.node + 6) for name, a in element.interface_maps.items()}
    free = np.r_[
        np.arange(*rows["tip"].indices(len(element.stiffness))),
        np.arange(12, len(element.stiffness)),
    ]
    found = np.linalg.inv(element.stiffness[np.ix_(free, free)])[:6, :6]
    exact = tip_compliance(mesh, stiffness, coupling)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(found - exact) / scale).max() < 1e-9


def tip_motions(mesh: ComponentMesh) -> tuple[IntArray, FloatArray]:
    """Dofs of the tip's points and their rigid motions ``(n, 6)`` about its centre."""
    tip = np.unique(mesh.patches["tip"])
    rigid = np.zeros((3 * len(tip), 6))
    for row, (x, y, z) in enumerate(mesh.points[tip] - [SIZE[0] / 2, SIZE[1] / 2, SIZE[2]]):
        rigid[3 * row : 3 * row + 3] = [
            [1, 0, 0, 0, z, -y],
            [0, 1, 0, -z, 0, x],
            [0, 0, 1, y, -x, 0],
        ]
    return (3 * tip[:, None] + np.arange(3)).ravel(), rigid


def rigid_tip_basis(mesh: ComponentMesh) -> FloatArray:
    """Motions of the whole model with its foot fixed and its tip rigid, those of the tip first."""
    free = np.repeat(mesh.points[:, 2] > 1e-9, 3)
    dofs, rigid = tip_motions(mesh)
    free[dofs] = False
    motion = np.zeros((len(free), 6))
    motion[dofs] = rigid
    return np.hstack([motion, np.eye(len(free))[:, free]])


def tip_compliance(
    mesh: ComponentMesh, stiffness: FloatArray, coupling: CouplingKind
) -> FloatArray:
    """Compliance of the tip by a saddle-point system on the whole model, the foot's points fixed."""
    tip = np.unique(mesh.patches["tip"])
    free = np.repeat(mesh.points[:, 2] > 1e-9, 3)
    dofs, rigid = tip_motions(mesh)
    if coupling == "rigid":
        basis = rigid_tip_basis(mesh)
        return np.asarray(np.linalg.inv(basis.T @ stiffness @ basis)[:6, :6], dtype=np.float64)
    weights = consistent_weights(mesh.points[tip])
    weighted = np.zeros_like(rigid)
    for axis in range(3):
        weighted[axis::3] = weights @ rigid[axis::3]
    operator = np.zeros((len(free), 6))
    operator[dofs] = weighted @ np.linalg.inv(rigid.T @ weighted)
    inner = np.flatnonzero(free)
    compliance = np.linalg.solve(stiffness[np.ix_(inner, inner)], operator[inner])
    return operator[inner].T @ compliance


def consistent_weights(places: FloatArray) -> FloatArray:
    """``integral N_i N_j dA`` over the one biquadratic facet of the tip, as a product of line
    integrals.
    """
    order = np.lexsort((places[:, 1], places[:, 0]))
    line = np.array([[4, 2, -1], [2, 16, 2], [-1, 2, 4]]) / 30.0
    result = np.zeros((9, 9))
    result[np.ix_(order, order)] = np.kron(line * SIZE[0], line * SIZE[1])
    return result


@pytest.mark.parametrize("count", [0, 5, ALL])
@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_loads_on_the_body_move_every_point_as_in_the_full_model_for_any_count(
    block: tuple[ComponentMesh, FloatArray, FloatArray], count: int, coupling: CouplingKind
) -> None:
    mesh, stiffness, mass = block
    element = reduced(mesh, ("rigid", coupling), count, loads=LOADS, gravity=True)
    free = np.repeat(mesh.points[:, 2] > 1e-9, 3)
    basis = rigid_tip_basis(mesh) if coupling == "rigid" else np.eye(len(free))[:, free]
    down = np.tile([0.0, 0.0, 1.0], len(mesh.points))
    loads = {
        "gravity:z": mass @ down,
        "oil": surface_load(mesh, "load:oil", [0.0, 2.5e5, 0.0]),
        "wind:y": surface_load(mesh, "load:wind", [0, 1, 0]),
    }
    assert loads.keys() <= element.loads.keys()
    for name, force in loads.items():
        exact = basis @ np.linalg.solve(basis.T @ stiffness @ basis, basis.T @ force)
        fixed = slice(
            6 * element.interface_maps["foot"].node, 6 * element.interface_maps["foot"].node + 6
        )
        active = np.setdiff1d(np.arange(len(element.stiffness)), np.arange(fixed.start, fixed.stop))
        answer = np.zeros(len(element.stiffness))
        answer[active] = np.linalg.solve(
            element.stiffness[np.ix_(active, active)], element.loads[name].vector[active]
        )
        found = (
            present(element.recovery).basis @ answer
            + present(element.loads[name].particular).ravel()
        )
        assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max(), name


def surface_load(mesh: ComponentMesh, group: str, traction: list[float]) -> FloatArray:
    """Consistent nodal forces of a uniform traction on rectangular biquadratic facets: Simpson's
    weights times the area.
    """
    simpson = np.array([1.0, 1, 1, 1, 4, 4, 4, 4, 16]) / 36.0
    force = np.zeros((len(mesh.points), 3))
    for facet in mesh.patches[group]:
        a, b, c = mesh.points[facet[[0, 1, 3]]]
        area = np.linalg.norm(np.cross(b - a, c - a))
        np.add.at(force, facet, area * simpson[:, None] * np.array(traction, dtype=float))
    return force.ravel()


def test_a_static_reduction_needs_no_mass(
    block: tuple[ComponentMesh, FloatArray, FloatArray],
) -> None:
    mesh, _, _ = block
    element = reduce_mesh(make_component({"foot": "rigid", "tip": "rigid"}), mesh)
    assert not element.mass.any()
    assert element.stiffness.shape == (12, 12)
    with_mass = reduced(mesh, ("rigid", "rigid"), 3)
    np.testing.assert_allclose(
        element.stiffness,
        with_mass.stiffness[:12, :12],
        rtol=1e-12,
        atol=1e-12 * np.abs(element.stiffness).max(),
    )
