import dataclasses

import numpy as np
import pytest

from cases import cases
from common import approx
from headstock.solvers.milling.tool_path import (
    PolylineContour,
    SquareContour,
    describe_contour,
    plan_contour,
)

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


@pytest.mark.parametrize("face", range(4))
def test_feed_is_kept_on_faces_and_the_block_stays_on_the_right(face: int) -> None:
    plan = plan_contour(CONTOUR)
    cut, center = plan.cuts[face], np.array([*CONTOUR.center, CONTOUR.height])
    points = plan.path.at(np.linspace(cut.begins + 0.1, cut.ends - 0.3, 50, dtype=np.float64))
    speeds = np.linalg.norm(points.velocity, axis=1)
    assert np.allclose(speeds, CONTOUR.feed, rtol=1e-11, atol=0.0)
    right = np.cross(points.velocity, [0.0, 0.0, 1.0])
    assert (((center - points.position) * right).sum(axis=1) > 0.0).all()
    outward = [(-1, 0), (0, 1), (1, 0), (0, -1)][face]
    assert np.allclose((points.position - center)[:, :2] @ outward, 0.11, atol=1e-12)


def test_a_block_on_the_left_is_gone_around_the_other_way_and_its_faces_look_outward() -> None:
    right, left = plan_contour(CONTOUR), plan_contour(dataclasses.replace(CONTOUR, part="left"))
    times = np.linspace(*right.path.span, 300, dtype=np.float64)
    mirrored = right.path.at(times).position * [1.0, -1.0, 1.0] + [0.0, 2 * CONTOUR.center[1], 0.0]
    assert np.allclose(left.path.at(times).position, mirrored, atol=1e-12)
    assert [cut.at for cut in left.cuts] == ["lowest x", "lowest y", "highest x", "highest y"]
    center = np.array([*CONTOUR.center, CONTOUR.height])
    for cut in (*right.cuts, *left.cuts):
        middle = cut.start + 0.5 * cut.length * cut.travel - center
        assert np.allclose(middle, 0.5 * CONTOUR.side * cut.outward, atol=1e-12)


def test_averages_cut_corners_by_as_much_as_they_shrink_a_circle() -> None:
    plan = plan_contour(CONTOUR)
    path, markers = plan.path, [cut.begins for cut in plan.cuts]
    middle = np.array(markers[1:]) - 0.25 * np.pi * CONTOUR.offset / CONTOUR.feed
    corners = np.array(CONTOUR.center) + 0.1 * np.array([[-1, 1], [1, 1], [1, -1]])
    found = np.linalg.norm(path.at(middle).position[:, :2] - corners, axis=1)
    half = 0.5 * CONTOUR.window * CONTOUR.feed / CONTOUR.offset
    assert np.allclose(found, CONTOUR.offset * (np.sin(half) / half) ** 3, atol=1e-11)
    assert plan.leaves == approx(path.span[1] - 0.015 - 0.02 / CONTOUR.feed)


LINE = PolylineContour(
    points=((0.0, 0.0), (0.0, 0.1), (0.08, 0.1), (0.08, 0.16), (0.2, 0.1)),
    feeds=(0.05, 0.1, 0.1, 0.05),
    radius=0.0,
    height=0.05,
    offset=0.008,
    lead=0.015,
    window=0.004,
)


def test_averages_cut_a_sharp_corner_by_the_mean_size_of_their_delay() -> None:
    plan = plan_contour(LINE)
    # second corner, the same feed before and after: 13/32 of a window is the mean of |sum of three|
    corner = plan.bends[2]
    found = plan.path.at(np.array([corner])).position[0]
    shift = 0.5 * 13.0 / 32.0 * LINE.window * 0.1
    assert found == approx([0.08 - shift, 0.1 + shift, 0.05], abs=1e-12)
    speeds = np.linalg.norm(
        plan.path.velocity(np.array([0.5, plan.bends[1] + 0.3, plan.bends[3] + 0.5])), axis=1
    )
    assert speeds == approx([0.05, 0.1, 0.05], abs=1e-12)


def test_faces_of_a_line_end_at_the_corners_of_the_part() -> None:
    plan = plan_contour(LINE)
    assert [cut.at.split(" to ")[0] for cut in plan.cuts] == [
        "(0, 0)",
        "(0, 100)",
        "(80, 100)",
        "(80, 160)",
    ]
    ends = [(cut.start, cut.start + cut.length * cut.travel) for cut in plan.cuts]
    # the part is on the right: the first corner is one of the part, the second one a nook
    assert ends[0][0] == approx([0.008, 0.015, 0.05])
    assert ends[0][1] == approx([0.008, 0.092, 0.05])
    assert ends[1][0] == approx([0.008, 0.092, 0.05])
    assert ends[1][1] == approx([0.08, 0.092, 0.05])
    assert ends[2][0] == approx([0.088, 0.1, 0.05])
    # lines at a distance of the radius meet where one face ends and the next one starts
    assert ends[2][1] == approx(ends[3][0])
    assert plan.cuts[0].begins == approx(plan.enters)
    times = plan.cuts[3].begins + np.array([0.0, 0.5])
    beside = (plan.path.at(times).position - plan.cuts[3].start) @ plan.cuts[3].outward
    assert beside == approx([0.008, 0.008], abs=1e-11)


def test_arcs_around_the_corners_of_a_line_are_tangents() -> None:
    plan = plan_contour(dataclasses.replace(LINE, radius=0.004, window=1e-3))
    times = np.linspace(0.1, plan.path.span[1] - 0.1, 20_001, dtype=np.float64)
    points = plan.path.at(times)
    # no kink: along an arc the travel turns by speed over radius
    turned = np.abs(np.diff(np.unwrap(np.arctan2(points.velocity[:, 1], points.velocity[:, 0]))))
    assert turned.max() < 1.01 * 0.1 / 0.004 * (times[1] - times[0])
    total = np.array([np.pi / 2, np.pi / 2, np.pi / 2 + np.arctan(0.5)]).sum()
    assert turned.sum() == approx(total, rel=2e-5)


@cases
def test_a_line_that_is_no_contour_is_refused(change: dict[str, object], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        plan_contour(dataclasses.replace(LINE, **change))  # type: ignore[arg-type]


def test_a_contour_says_where_the_tool_goes() -> None:
    assert describe_contour(CONTOUR) == "around a block of 200 mm"
    assert describe_contour(LINE) == "along a line of 5 corners, 374.2 mm"
