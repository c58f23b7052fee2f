"""Points of a test are found on the model, whatever axes they were measured in."""

import itertools

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.parts.nearest_places import find_nearest_place
from headstock.geometry.parts.skins import Skin
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import TestPoint, as_vector
from headstock.studies.correlation.placement import _MachineSurface, place_test


def box(size: tuple[float, float, float], steps: int = 1) -> Skin:
    """A box from the origin, its faces in squares of two triangles."""
    points: list[FloatArray] = []
    triangles: list[list[int]] = []
    grid = np.linspace(0.0, 1.0, steps + 1)
    for axis, side in itertools.product(range(3), (0.0, 1.0)):
        base = len(points)
        for u, v in itertools.product(grid, grid):
            points.append(np.roll([side, u, v], axis) * size)
        for i, j in itertools.product(range(steps), range(steps)):
            a = base + i * (steps + 1) + j
            b, c, d = a + 1, a + steps + 2, a + steps + 1
            triangles += [[a, b, c], [a, c, d]]
    return Skin(np.array(points), np.array(triangles), np.zeros((0, 2), dtype=int), "box")


SKINS = {"bed": box((1.2, 0.5, 0.3), 4), "column": box((0.3, 0.4, 0.9))}
FRAMES = {"bed": Frame(), "column": Frame(np.array([0.1, 0.05, 0.3]))}


def measured_points(count: int = 40) -> FloatArray:
    rng = np.random.default_rng(3)
    surface = _MachineSurface(SKINS, FRAMES)
    return surface.nearest(rng.uniform([-0.1, -0.1, 0.0], [1.3, 0.6, 1.3], (count, 3)))[0]


def as_points(places: FloatArray) -> dict[str, TestPoint]:
    return {str(n): TestPoint(str(n), as_vector(place)) for n, place in enumerate(places, 1)}


def test_the_nearest_place_of_many_points_is_that_of_each() -> None:
    places = np.random.default_rng(1).uniform(-0.5, 1.5, (50, 3))
    surface = _MachineSurface(SKINS, FRAMES)
    nearest, distances, triangles = surface.nearest(places)
    owners = surface.owners[triangles]
    for place, found, distance, owner in zip(places, nearest, distances, owners, strict=True):
        each = [
            find_nearest_place(skin, place - FRAMES[name].origin) for name, skin in SKINS.items()
        ]
        assert distance == approx(min(gap for _, gap in each))
        name = list(SKINS)[owner]
        assert each[owner][0] + FRAMES[name].origin == approx(found)
    assert len(set(owners)) == 2


def test_points_that_lie_on_the_model_stay() -> None:
    placement = place_test(as_points(measured_points() + 1e-3), SKINS, FRAMES)
    np.testing.assert_array_equal(placement.rotation, np.eye(3))
    assert placement.rms < 2e-3
    assert placement.remarks == (
        "points of the test stand where the file has them, in the axes of the machine",
    )


def test_other_axes_are_fitted_to_the_surfaces() -> None:
    places = measured_points()
    turn = rotation_about(np.array([0.1, 0.0, 1.0]), 1.5)
    moved = (places - [2.0, -1.0, 0.5]) @ turn
    moved[0] += 0.3  # on a part that is not modelled
    placement = place_test(as_points(moved), SKINS, FRAMES)
    back = moved @ placement.rotation.T + placement.translation
    np.testing.assert_allclose(back[1:], places[1:], atol=3e-3)
    assert "the best fit to the surfaces" in placement.remarks[0]
    assert any(text.startswith("point 1 lies") for text in placement.remarks)


def test_three_known_points_decide() -> None:
    places = measured_points()
    turn = rotation_about(np.array([1.0, 1.0, 0.0]), 2.0)
    moved = (places - [2.0, -1.0, 0.5]) @ turn
    matches = {"3": places[2], "17": places[16], "30": places[29], "none": places[0]}
    placement = place_test(as_points(moved), SKINS, FRAMES, matches)
    np.testing.assert_allclose(
        moved @ placement.rotation.T + placement.translation, places, atol=1e-9
    )
    assert "by 3 points that the scene places" in placement.remarks[0]


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, r"span 1\d{3} m, the machine 1\.\d+ m: mm read as m\?"),
        (1e-3, r"span 0\.001\d+ m, the machine 1\.\d+ m: m read as mm\?"),
    ],
)
def test_points_in_another_unit_are_named(factor: float, words: str) -> None:
    with pytest.raises(MeasurementError, match=words):
        place_test(as_points(factor * measured_points()), SKINS, FRAMES)


def test_points_of_another_machine_are_refused() -> None:
    other = np.random.default_rng(5).uniform(-1.0, 2.0, (40, 3))
    with pytest.raises(MeasurementError, match=r"lie .* mm from the surfaces of the machine"):
        place_test(as_points(other), SKINS, FRAMES)
