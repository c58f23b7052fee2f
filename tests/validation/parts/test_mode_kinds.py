"""Claims about telling bending, torsion and extension apart."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.parts.beam_cases import _beam_mode_kinds


def bar_points() -> FloatArray:
    rng = np.random.default_rng(3)
    return rng.uniform(-1.0, 1.0, (400, 3)) * [0.02, 0.05, 0.25]


def test_bending_extension_and_torsion_are_told_apart() -> None:
    points = bar_points()
    x, y, z = points.T
    none, wave = np.zeros_like(x), np.sin(4.0 * z)
    slope = 4.0 * np.cos(4.0 * z)
    fields = [
        np.column_stack([wave, none, -slope * x]),
        np.column_stack([none, wave, -slope * y]),
        np.column_stack([none, none, wave]),
        np.column_stack([-y * wave, x * wave, none]),
    ]
    shapes = np.column_stack([field.ravel() for field in fields])
    assert _beam_mode_kinds(points, shapes, 2) == ["x", "y", "z", "torsion"]


def test_the_kind_does_not_depend_on_sign_or_size_of_the_shape() -> None:
    points = bar_points()
    shape = np.column_stack([np.zeros(400), np.cos(points[:, 2]), np.zeros(400)]).reshape(-1, 1)
    assert _beam_mode_kinds(points, np.hstack([1e-9 * shape, -1e9 * shape]), 2) == ["y", "y"]
