"""a superelement keeps the rigid motions, mass, centre of mass and inertia of its body."""

import dataclasses
import math

import numpy as np
import pytest

from common import approx, make_box, make_component, present
from headstock.geometry.frames import BoolArray, FloatArray, Frame, rigid_transfer
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.errors import AccuracyError
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H23")

SIZE = (0.2, 0.3, 0.7)
DENSITY = 7850.0
KINDS = [("rigid", "rigid"), ("average", "average"), ("rigid", "average")]


@pytest.fixture(scope="module", params=KINDS, ids=["rigid", "average", "mixed"])
def element(request: pytest.FixtureRequest) -> Superelement:
    def corner(centers: FloatArray) -> BoolArray:
        return (centers[:, 1] < 1e-9) & (centers[:, 2] > 0.35)

    mesh = make_box((2, 2, 4), SIZE, {"foot": "z-", "side": corner}, kind="tet10")
    component = make_component(dict(zip(("foot", "side"), request.param, strict=True)), size=SIZE)
    return reduce_mesh(component, mesh, modes=9)


def motions_about(
    element: Superelement, origin: FloatArray | tuple[float, float, float]
) -> FloatArray:
    rows = [rigid_transfer(np.asarray(origin), frame.origin) for frame in element.frames]
    return np.vstack([*rows, np.zeros((element.modal_count, 6))])


def test_a_rigid_motion_meets_no_stiffness(element: Superelement) -> None:
    motions = motions_about(element, element.center_of_mass)
    force = np.linalg.norm(element.stiffness @ motions)
    assert force < 1e-9 * np.linalg.norm(element.stiffness) * np.linalg.norm(motions)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (0.1, -2.0, 5.0)])
def test_mass_centre_and_inertia_are_those_of_the_block_about_any_point(
    element: Superelement, origin: tuple[float, float, float]
) -> None:
    mass = DENSITY * math.prod(SIZE)
    arm = 0.5 * np.array(SIZE) - origin
    squares = np.array(SIZE) ** 2
    inertia = mass * (
        np.diag(squares.sum() - squares) / 12.0 + arm @ arm * np.eye(3) - np.outer(arm, arm)
    )
    wanted = np.zeros((6, 6))
    wanted[:3, :3], wanted[3:, 3:] = mass * np.eye(3), inertia
    static = mass * np.array([[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]])
    wanted[:3, 3:], wanted[3:, :3] = static, static.T
    motions = motions_about(element, origin)
    assert np.abs(motions.T @ element.mass @ motions - wanted).max() < 1e-9 * np.abs(wanted).max()


def test_the_stated_mass_properties_are_those_of_the_block(element: Superelement) -> None:
    mass = DENSITY * math.prod(SIZE)
    squares = np.array(SIZE) ** 2
    assert element.mass_kg == approx(mass, rel=1e-12)
    np.testing.assert_allclose(element.center_of_mass, 0.5 * np.array(SIZE), rtol=1e-11)
    np.testing.assert_allclose(
        element.inertia, mass * np.diag(squares.sum() - squares) / 12.0, rtol=1e-9, atol=1e-9 * mass
    )


def test_shapes_recovered_from_a_rigid_motion_are_rigid(element: Superelement) -> None:
    motions = motions_about(element, (0.0, 0.0, 0.0))
    points = present(element.recovery).points
    turned = (present(element.recovery).basis @ motions[:, 5]).reshape(-1, 3)
    np.testing.assert_allclose(
        turned, np.column_stack([-points[:, 1], points[:, 0], 0.0 * points[:, 2]]), atol=1e-10
    )


def test_the_superelement_passes_its_own_checks(element: Superelement) -> None:
    check_superelement(element)


def test_a_lost_per_mille_of_mass_is_noticed(element: Superelement) -> None:
    broken = element.mass.copy()
    broken[0, 0] *= 1.001
    with pytest.raises(AccuracyError, match="mass"):
        check_superelement(dataclasses.replace(element, mass=broken))


def test_a_wrong_origin_is_noticed(element: Superelement) -> None:
    frames = (Frame(element.frames[0].origin + np.array([0.0, 0.0, 1e-3])), *element.frames[1:])
    with pytest.raises(AccuracyError):
        check_superelement(dataclasses.replace(element, frames=frames))
