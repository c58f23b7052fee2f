import numpy as np
import pytest

from common import STEEL, approx
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.geometry.parts.mass_properties import _box_sum_properties, closed_form_properties
from headstock.geometry.parts.patches import _clear_spans, _rib_spans, planar_boxes, rect_union
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, Tube


def component(solid: Solid, **patches: tuple[Patch, ...]) -> Component:
    return Component(
        "part", solid, STEEL, interfaces={name: Interface(name, p) for name, p in patches.items()}
    )


def test_box_has_its_textbook_inertia() -> None:
    found = closed_form_properties(component(Box((0.1, 0.2, 0.5)), top=(Patch("z+"),)))
    assert found is not None
    assert found.volume == approx(0.01, rel=1e-14)
    assert np.allclose(found.center, [0, 0, 0.25], atol=1e-16)
    expected = 0.01 / 12 * np.diag([0.2**2 + 0.5**2, 0.1**2 + 0.5**2, 0.1**2 + 0.2**2])
    assert np.allclose(found.inertia, expected, rtol=1e-13, atol=1e-18)
    assert found.patch_areas["top"] == approx(0.02, rel=1e-14)
    assert np.allclose(found.patch_centroids["top"], [0, 0, 0.5], rtol=1e-12, atol=1e-15)


def test_tube_is_the_difference_of_two_cylinders() -> None:
    found = closed_form_properties(component(Tube(0.2, 0.12, 0.7)))
    full, hole = (
        closed_form_properties(component(Tube(0.2, 0.0, 0.7))),
        closed_form_properties(component(Tube(0.12, 0.0, 0.7))),
    )
    assert found is not None and full is not None and hole is not None
    assert found.volume == approx(full.volume - hole.volume, rel=1e-13)
    assert np.allclose(found.inertia, full.inertia - hole.inertia, rtol=1e-12, atol=1e-18)


def test_column_is_symmetric_about_its_axes_and_lighter_than_its_block() -> None:
    found = closed_form_properties(
        component(HollowColumn((0.3, 0.2, 1.0), 0.02, 0.03, 0.01, ribs_z=2, ribs_x=1, ribs_y=0))
    )
    assert found is not None
    clear = (0.26 - 0.01) * 0.16 * (0.94 - 0.02)
    assert found.volume == approx(0.3 * 0.2 * 1.0 - clear, rel=1e-13)
    assert np.allclose(found.center, [0, 0, 0.5], atol=1e-15)
    assert np.allclose(found.inertia, np.diag(np.diag(found.inertia)), atol=1e-15)


def test_crossing_ribs_are_counted_once() -> None:
    plate = Plate((0.4, 0.3, 0.02), 0.05, 0.01, ribs_x=2, ribs_y=1)
    found = closed_form_properties(component(plate, ribs=(Patch("z+"),), side=(Patch("x-"),)))
    assert found is not None
    rib_area = 2 * 0.4 * 0.01 + 0.3 * 0.01 - 2 * 0.01**2
    assert found.volume == approx(0.4 * 0.3 * 0.02 + rib_area * 0.05, rel=1e-13)
    assert found.patch_areas["ribs"] == approx(rib_area, rel=1e-13)
    assert found.patch_areas["side"] == approx(0.3 * 0.02 + 2 * 0.01 * 0.05, rel=1e-13)


def test_overlapping_patches_of_one_interface_count_once() -> None:
    rect, strip = (
        Patch("z+", "rect", (0, 0, 0), (0.04, 0.02)),
        Patch("z+", "strip", (0, 0, 0), (0.02,), "y"),
    )
    found = closed_form_properties(component(Box((0.1, 0.1, 0.1)), both=(rect, strip)))
    assert found is not None
    assert found.patch_areas["both"] == approx(0.04 * 0.02 + 0.02 * 0.1 - 0.02 * 0.02, rel=1e-13)


def test_imprint_beyond_the_face_is_cut_to_it() -> None:
    found = closed_form_properties(
        component(
            Box((0.1, 0.1, 0.1)), corner=(Patch("z+", "rect", (0.05, 0.05, 9.0), (0.04, 0.04)),)
        )
    )
    assert found is not None
    assert found.patch_areas["corner"] == approx(0.02**2, rel=1e-12)
    assert np.allclose(found.patch_centroids["corner"], [0.04, 0.04, 0.1], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    "patch", [Patch("face:1"), Patch("z+", "disk", (0.05, 0, 0), (0.04,)), Patch("outer")]
)
def test_patches_without_closed_form_are_left_to_the_cad_kernel(patch: Patch) -> None:
    assert closed_form_properties(component(Box((0.1, 0.1, 0.1)), a=(patch,))) is None


def test_ribs_leave_equal_clear_gaps() -> None:
    gaps = [high - low for low, high in _clear_spans(3, 0.01, -0.1, 0.13)]
    assert np.allclose(gaps, 0.05, rtol=1e-12, atol=0.0)
    assert all(high - low == approx(0.01) for low, high in _rib_spans(3, 0.01, -0.1, 0.13))


def test_union_of_rectangles_has_the_area_of_a_fine_raster() -> None:
    rng = np.random.default_rng(0)
    rects = []
    for _ in range(6):
        a, b = np.sort(rng.integers(0, 20, 2)), np.sort(rng.integers(0, 20, 2))
        rects.append((float(a[0]), float(a[1] + 1), float(b[0]), float(b[1] + 1)))
    raster = np.zeros((21, 21), dtype=bool)
    for a0, a1, b0, b1 in rects:
        raster[int(a0) : int(a1), int(b0) : int(b1)] = True
    assert sum((r[1] - r[0]) * (r[3] - r[2]) for r in rect_union(rects)) == raster.sum()


def test_inertia_of_a_sum_of_boxes_does_not_depend_on_how_it_is_cut() -> None:
    whole = _box_sum_properties(planar_boxes(Box((0.2, 0.3, 0.4))))
    low, high = np.array([-0.1, -0.15, 0.0]), np.array([0.1, 0.15, 0.4])
    middle = np.array([0.1, 0.15, 0.13])
    parts = _box_sum_properties([(1.0, low, middle), (1.0, np.array([-0.1, -0.15, 0.13]), high)])
    assert parts[0] == approx(whole[0], rel=1e-13)
    assert np.allclose(parts[2], whole[2], rtol=1e-12, atol=0.0)
