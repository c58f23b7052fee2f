import numpy as np
import pytest

from headstock.solvers.milling.tool_path import SquareContour, plan_contour

CONTOUR = SquareContour(
    side=0.2, center=(0.05, -0.02), height=0.2, offset=0.01, lead=0.02, feed=5.0 / 60.0, window=0.01
)


def test_speeds_and_accelerations_are_derivatives_of_the_path() -> None:
    path = plan_contour(CONTOUR).path
    times, h = np.linspace(0.1, 10.5, 400, dtype=np.float64), 1e-5
    ahead, behind, here = path.at(times + h), path.at(times - h), path.at(times)
    assert np.abs((ahead.position - behind.position) / (2 * h) - here.velocity).max() < 3e-7
    assert np.abs((ahead.velocity - behind.velocity) / (2 * h) - here.acceleration).max() < 1e-3
    assert np.array_equal(path.velocity(times), here.velocity)


def test_positions_carry_no_roundoff_of_their_antiderivatives() -> None:
    path = plan_contour(CONTOUR).path
    times = 2.0 + 1e-5 * np.arange(200)
    assert np.abs(np.diff(path.at(times).position[:, 1], 3)).max() < 1e-11


def test_jerk_is_limited_everywhere() -> None:
    path = plan_contour(CONTOUR).path
    times = np.linspace(*path.span, 100_001, dtype=np.float64)
    jerk = np.diff(path.at(times).acceleration, axis=0) / (times[1] - times[0])
    # the start from rest: a step of the speed through three averages
    assert np.abs(jerk).max() < 1.01 * CONTOUR.feed / CONTOUR.window**2
    assert np.abs(path.at(np.array(path.span)).velocity).max() < 1e-12


def test_feed_is_kept_on_faces_and_the_block_stays_on_the_right() -> None:
    plan = plan_contour(CONTOUR)
    path, markers = plan.path, [cut.begins for cut in plan.cuts]
    center = np.array([*CONTOUR.center, CONTOUR.height])
    for face in range(4):
        points = path.at(
            np.linspace(markers[face] + 0.1, plan.cuts[face].ends - 0.3, 50, dtype=np.float64)
        )
        assert np.allclose(
            np.linalg.norm(points.velocity, axis=1), CONTOUR.feed, rtol=1e-11, atol=0.0
        )
        right = np.cross(points.velocity, [0.0, 0.0, 1.0])
        assert (((center - points.position) * right).sum(axis=1) > 0.0).all()
        outward = [(-1, 0), (0, 1), (1, 0), (0, -1)][face]
        assert np.allclose((points.position - center)[:, :2] @ outward, 0.11, atol=1e-12)


def test_averages_cut_corners_by_as_much_as_they_shrink_a_circle() -> None:
    plan = plan_contour(CONTOUR)
    path, markers = plan.path, [cut.begins for cut in plan.cuts]
    middle = np.array(markers[1:]) - 0.25 * np.pi * CONTOUR.offset / CONTOUR.feed
    corners = np.array(CONTOUR.center) + 0.1 * np.array([[-1, 1], [1, 1], [1, -1]])
    found = np.linalg.norm(path.at(middle).position[:, :2] - corners, axis=1)
    half = 0.5 * CONTOUR.window * CONTOUR.feed / CONTOUR.offset
    assert np.allclose(found, CONTOUR.offset * (np.sin(half) / half) ** 3, atol=1e-11)
    assert plan.leaves == pytest.approx(path.span[1] - 0.015 - 0.02 / CONTOUR.feed)
