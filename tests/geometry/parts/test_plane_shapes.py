"""Shapes of patches in their plane."""

import math
from itertools import pairwise

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.plane_shapes import (
    PlaneShape,
    find_outline_fault,
    flatten_patch,
    patch_width,
)

PLANE = np.eye(3)[:2]
# an L of two legs, written clockwise
LEGS = ((0, 0, 0), (0, 60, 0), (20, 60, 0), (20, 20, 0), (80, 20, 0), (80, 0, 0))
CORNERS = tuple((1e-3 * x, 1e-3 * y, 1e-3 * z) for x, y, z in LEGS)
L_PATCH = Patch("z+", "outline", (0.03, 0.02, 0.0), corners=CORNERS)
SHAPES = {
    "disk": (Patch("z+", "disk", size=(0.04,)), math.pi * 4e-4, math.pi * 0.04, 0.04),
    "ring": (Patch("z+", "ring", size=(0.04, 0.01)), math.pi * 3.75e-4, math.pi * 0.05, 0.015),
    "rect": (Patch("z+", "rect", size=(0.06, 0.02), angle=0.5), 1.2e-3, 0.16, 0.02),
    "outline": (L_PATCH, 2.4e-3, 0.28, 4 * 2.4e-3 / 0.28),
}


def _sample(shape: PlaneShape) -> tuple[FloatArray, float]:
    """Points of a fine grid around a shape, and the area of each."""
    low, high = shape.bounds
    steps = (np.arange(400) + 0.5) / 400
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    return low + grid * (high - low), float(np.prod(high - low)) / len(grid)


@pytest.mark.parametrize("name", SHAPES)
def test_area_rim_and_width_are_those_of_the_closed_form(name: str) -> None:
    patch, area, perimeter, width = SHAPES[name]
    shape = flatten_patch(patch, PLANE)
    assert (shape.area, shape.perimeter) == approx((area, perimeter))
    assert patch_width(patch) == approx(width) == shape.width
    points, each = _sample(shape)
    inside = points[shape.depths(points) >= 0.0]
    assert len(inside) * each == approx(area, rel=5e-3)
    assert inside.mean(axis=0) == approx(shape.centroid, abs=1e-4)
    rim = shape.rim(24, 1e-4)
    assert shape.depths(rim) == approx(np.full(len(rim), 1e-4))


@pytest.mark.parametrize("name", SHAPES)
def test_chords_and_pieces_make_up_the_area(name: str) -> None:
    patch, area, *_ = SHAPES[name]
    shape = flatten_patch(patch, PLANE)
    for direction in (0, 1):
        low, high = shape.bounds[:, direction]
        steps = low + (high - low) * (np.arange(1000) + 0.5) / 1000
        middles, halves = shape.chords(direction, steps)
        assert 2.0 * halves.sum() * (high - low) / 1000 == approx(area, rel=2e-3)
        moment = 2.0 * (middles * halves).sum() * (high - low) / 1000
        assert moment == approx(area * shape.centroid[1 - direction], abs=1e-3 * area * high)
    pieces = [np.vstack([piece, piece[:1]]) for piece in shape.pieces()]
    drawn = sum(0.5 * np.linalg.det([a, b]) for piece in pieces for a, b in pairwise(piece))
    assert drawn == approx(area, rel=4e-3)


def test_rect_turns_from_the_first_axis_towards_the_second() -> None:
    turned = Patch("z+", "rect", size=(0.06, 0.02), angle=math.radians(30))
    end = 0.029 * np.array([[math.cos(math.radians(30)), math.sin(math.radians(30))]])
    assert flatten_patch(turned, PLANE).depths(end) == approx(0.001)
    assert not turned.is_grid_aligned and Patch("z+", "rect", size=(0.06, 0.02)).is_grid_aligned


def test_band_has_no_shape_in_a_plane() -> None:
    with pytest.raises(ValueError, match=r"goes around a cylinder.*write one of disk, ring"):
        flatten_patch(Patch("z+", "band", size=(0.01,)), PLANE)


@pytest.mark.parametrize(
    ("corners", "fault"),
    [
        (LEGS, ""),
        (((0, 0, 0), (9, 9, 0), (9, 0, 0), (0, 9, 0)), "cross"),
        (((0, 0, 0), (9, 0, 0), (9, 9, 1), (0, 9, 0)), "no plane"),
        (((0, 0, 0), (9, 0, 0), (9, 0, 0), (0, 9, 0)), "the same"),
        (((0, 0, 0), (9, 0, 0), (5, 0, 0)), "no area"),
    ],
)
def test_corners_that_are_no_outline_are_named(
    corners: tuple[tuple[float, float, float], ...], fault: str
) -> None:
    found = find_outline_fault(np.array(corners, dtype=float), flatness=1e-4)
    assert fault in found and bool(found) == bool(fault)
