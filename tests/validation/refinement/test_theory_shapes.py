import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.validation.references.beam_theory import (
    EndConditions,
    euler_bernoulli_shape,
    wave_numbers,
)
from headstock.validation.refinement.theory_shapes import (
    _PairedMode,
    find_theory_shapes,
    read_shape,
    section_motions,
)

SIDES = (0.04, 0.1, 0.5)
NAMES = ("X1", "Y1", "X2", "T1", "Y2", "X3")
SHAPES = tuple(read_shape(name, 2) for name in NAMES)


def beam_points(sections: int) -> FloatArray:
    """Corners of equally spaced sections of a beam along z."""
    places = SIDES[2] * (np.arange(sections) + 0.5) / sections
    corners = np.array([[x, y] for x in (-0.02, 0.02) for y in (-0.05, 0.05)])
    return np.array([[*corner, place] for place in places for corner in corners])


def theory_field(name: str, points: FloatArray, ends: EndConditions) -> FloatArray:
    """Displacement of points whose sections move as plane ones in a mode of theory."""
    shape, along = read_shape(name, 2), points[:, 2] * (1.0 / SIDES[2])
    field = np.zeros_like(points)
    if shape.kind == "torsion":
        turn = np.sin(wave_numbers(ends, shape.number)[-1] * along) / SIDES[2]
        field[:, 0], field[:, 1] = -turn * points[:, 1], turn * points[:, 0]
        return field
    deflection, slope = euler_bernoulli_shape(ends, shape.number, along)
    field[:, shape.direction] = deflection
    field[:, 2] = -slope / SIDES[2] * points[:, shape.direction]
    return field


def pair(
    points: FloatArray, fields: FloatArray, ends: EndConditions = "clamped-free"
) -> dict[str, _PairedMode]:
    sections = section_motions(points, fields, axis=2, span=(0.0, SIDES[2]), sides=SIDES)
    return find_theory_shapes(sections, SHAPES, ends)


@pytest.mark.parametrize("ends", ["clamped-free", "clamped-clamped"])
@pytest.mark.parametrize("sections", [4, 13, 90])
def test_modes_in_any_order_are_named_by_their_shapes(ends: EndConditions, sections: int) -> None:
    points = beam_points(sections)
    order = np.random.default_rng(3).permutation(len(NAMES))
    names = [NAMES[number] for number in order]
    sizes = [(-1.0) ** k * (1.0 + k) for k in range(len(names))]
    fields = [
        size * theory_field(name, points, ends) for size, name in zip(sizes, names, strict=True)
    ]
    found = pair(points, np.array(fields), ends)
    assert [found[name].index for name in names] == list(range(len(NAMES)))
    assert all(mode.mac > 0.99 for mode in found.values())


def test_a_mode_goes_with_one_shape_and_a_shape_that_nothing_resembles_is_missing() -> None:
    points = beam_points(30)
    fields = np.array([theory_field(name, points, "clamped-free") for name in ("X1", "T1", "Y2")])
    assert set(pair(points, fields)) == {"X1", "T1", "Y2"}


def test_a_model_with_three_sections_keeps_its_first_mode_and_has_no_third() -> None:
    points = beam_points(3)
    first, overtone = (theory_field(name, points, "clamped-free") for name in ("X1", "X2"))
    # an overtone that a coarse model bends like the first mode
    found = pair(points, np.array([first, overtone, first + 0.3 * overtone]))
    assert found["X1"].index == 0
    assert found["X2"].index == 1
    assert "X3" not in found or found["X3"].index == 2


def test_a_stretching_mode_is_none_of_them() -> None:
    points = beam_points(30)
    field = np.zeros((1, len(points), 3))
    field[0, :, 2] = np.sin(0.5 * np.pi * points[:, 2] / SIDES[2])
    assert pair(points, field) == {}


def test_the_shape_of_a_clamped_beam_meets_its_end_conditions_and_the_slope_is_its_derivative() -> (
    None
):
    places = np.linspace(0.0, 1.0, 2001, dtype=np.float64)
    for ends in ("clamped-free", "clamped-clamped"):
        deflection, slope = euler_bernoulli_shape(ends, 3, places)
        assert abs(deflection[0]) < 1e-12
        assert abs(slope[0]) < 1e-12
        found, limit = np.gradient(deflection, places), 5e-4 * np.abs(slope).max()
        np.testing.assert_allclose(found[1:-1], slope[1:-1], atol=limit)
    assert abs(deflection[-1]) < 1e-9
    with pytest.raises(ValueError, match="must be clamped"):
        euler_bernoulli_shape("free-free", 1, places)
