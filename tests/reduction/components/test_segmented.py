"""A row of rigid segments on beam springs behaves like the bar it stands for."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import STEEL, approx, make_faced
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Load,
    Patch,
    SegmentSettings,
)
from headstock.geometry.parts.mass_properties import closed_form_properties
from headstock.geometry.parts.prismatic_bars import prismatic_bar, shear_coefficient
from headstock.geometry.parts.solids import Box, HollowColumn, Solid, Tube
from headstock.reduction.components.segmented import segment_skin
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.motions.compliance_budget import point_compliance
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.static_response import solve_static
from lumped_machines import couple_clamped, reduce_shape

SIZE = (0.038, 0.100, 0.500)
TIMOSHENKO_HZ = {
    "X1": 126.42642,
    "Y1": 324.24962,
    "X2": 771.88119,
    "T1": 993.73119,
    "Y2": 1749.43768,
    "X3": 2079.22362,
}


def bar(count: int, along: str = "z") -> Component:
    size = {"z": SIZE, "x": (SIZE[2], SIZE[0], SIZE[1]), "y": (SIZE[1], SIZE[2], SIZE[0])}[along]
    faces = {"foot": f"{along}-", "tip": f"{along}+"}
    return make_segmented(Box(size), faces, count)


def make_segmented(solid: Solid, faces: dict[str, str], count: int) -> Component:
    settings = {"fidelity": "segmented", "segments": SegmentSettings(count)}
    return make_faced("bar", solid, faces, **settings)


def cantilever(component: Component) -> CoupledMachine:
    return couple_clamped(component, reduce_shape(component))


def compliance(component: Component) -> FloatArray:
    return point_compliance(cantilever(component), "tcp")


@pytest.mark.parametrize("count", [1, 2, 5, 17])
def test_end_loads_are_answered_as_timoshenko_s_beam_with_any_number_of_segments(
    count: int,
) -> None:
    width, depth, length = SIZE[1], SIZE[0], SIZE[2]
    area, second, shear = width * depth, width * depth**3 / 12.0, STEEL.youngs_modulus / 2.6
    kappa = 13.0 / 15.3
    found = compliance(bar(count))
    bending = length**3 / (3.0 * STEEL.youngs_modulus * second) + length / (kappa * shear * area)
    assert found[0, 0] == approx(bending, rel=1e-9)
    assert found[2, 2] == approx(length / (STEEL.youngs_modulus * area), rel=1e-9)
    assert found[4, 0] == approx(length**2 / (2.0 * STEEL.youngs_modulus * second), rel=1e-9)
    assert found[3, 1] == approx(
        -6.0 * length**2 / (STEEL.youngs_modulus * depth * width**3), rel=1e-9
    )


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_bar_along_another_axis_has_the_same_compliances(along: str) -> None:
    upright, lying = compliance(bar(6)), compliance(bar(6, along))
    # axis of the lying bar that stands for x, y, z of the upright one
    order = {"x": [1, 2, 0], "y": [2, 0, 1]}[along]
    picked = [*order, *(3 + i for i in order)]
    np.testing.assert_allclose(lying[np.ix_(picked, picked)], upright, rtol=1e-8, atol=1e-14)


def test_frequencies_approach_timoshenko_s_with_second_order() -> None:
    errors = []
    for count in (10, 20, 40):
        found = solve_modal(cantilever(bar(count)).system, count=6).frequencies_hz
        errors.append(np.abs(found / np.array(list(TIMOSHENKO_HZ.values())) - 1.0))
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (np.array(errors[-1]) < 1.5e-3).all()
    assert (np.abs(slopes - 2.0) < 0.2).all()


def test_mass_centre_and_inertia_are_those_of_the_solid() -> None:
    component = dataclasses.replace(bar(7), mass=12.0)
    part, properties = reduce_shape(component), closed_form_properties(component)
    assert properties is not None
    assert part.mass_kg == approx(12.0, rel=1e-12) and part.full_dofs == 42
    np.testing.assert_allclose(
        part.inertia, 12.0 / properties.volume * properties.inertia, rtol=1e-12, atol=1e-14
    )
    np.testing.assert_allclose(part.center_of_mass, properties.center, atol=1e-15)


def side_patch(coupling: str, low: float, high: float, *, count: int = 10) -> Component:
    patch = Patch("x+", "rect", (0.0, 0.0, 0.5 * (low + high)), (0.1, high - low))
    side = Interface("tip", (patch,), "average" if coupling == "average" else "rigid")
    plain = bar(count)
    return dataclasses.replace(plain, interfaces={**plain.interfaces, "tip": side})


BENDING = STEEL.youngs_modulus * SIZE[1] * SIZE[0] ** 3 / 12.0
SHEARING = 13.0 / 15.3 * STEEL.youngs_modulus / 2.6 * SIZE[0] * SIZE[1]


@settings(deadline=None, max_examples=40)
@given(low=st.floats(0.01, 0.4), length=st.floats(1e-3, 0.1), count=st.integers(1, 24))
def test_under_a_rigid_patch_the_bar_is_rigid_from_edge_to_edge_wherever_segments_end(
    low: float, length: float, count: int
) -> None:
    found = compliance(side_patch("rigid", low, low + length, count=count))
    lever = 0.5 * length
    bending = low**3 / 3.0 + lever * low**2 + lever**2 * low
    assert found[0, 0] == approx(bending / BENDING + low / SHEARING, rel=1e-3)
    assert found[4, 4] == approx(low / BENDING, rel=1e-3)
    assert found[2, 2] == approx(
        low / (STEEL.youngs_modulus * SIZE[0] * SIZE[1]) + 0.019**2 * low / BENDING, rel=1e-3
    )


def test_one_rigid_interface_of_two_patches_bridges_what_lies_between_them() -> None:
    near, far = (Patch("x+", "rect", (0.0, 0.0, middle), (0.1, 0.05)) for middle in (0.125, 0.375))
    plain = bar(7)
    both = dataclasses.replace(
        plain, interfaces={**plain.interfaces, "tip": Interface("tip", (near, far))}
    )
    # the bar bends up to 100 mm, where the first patch begins; from there on everything is rigid
    assert compliance(both)[4, 4] == approx(0.1 / BENDING, rel=1e-9)


def mean_compliances(low: float, high: float) -> tuple[float, float]:
    """Compliance of the mean deflection and of the mean slope of a stretch of a cantilever, by
    double integration.
    """
    nodes, weights = np.polynomial.legendre.leggauss(1000)
    z, w = 0.5 * (low + high) + 0.5 * (high - low) * nodes, 0.5 * (high - low) * weights
    near, far = np.minimum.outer(z, z), np.maximum.outer(z, z)
    influence = near**2 * (3.0 * far - near) / (6.0 * BENDING) + near / SHEARING
    slope = (z - 0.5 * (low + high)) * w * 12.0 / (high - low) ** 3
    mean = w / (high - low)
    return float(mean @ influence @ mean), float(slope @ influence @ slope)


def test_an_averaging_patch_takes_the_best_fit_of_its_surface_and_approaches_the_beam_s_with_second_order() -> (
    None
):
    deflection, slope = mean_compliances(0.2, 0.4)
    errors = []
    for count in (5, 10, 20, 40):
        found = compliance(side_patch("average", 0.2, 0.4, count=count))
        errors.append([abs(found[0, 0] / deflection - 1.0), abs(found[4, 4] / slope - 1.0)])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert max(errors[0]) < 0.01
    assert (np.abs(orders[1:] - 2.0) < 0.2).all()


@pytest.mark.parametrize("count", [4, 6, 9, 13])
@pytest.mark.parametrize(("low", "high"), [(0.22, 0.36), (0.345, 0.5), (0.40, 0.42)])
def test_an_averaging_patch_is_right_wherever_segments_end(
    count: int, low: float, high: float
) -> None:
    found = compliance(side_patch("average", low, high, count=count))
    deflection, slope = mean_compliances(low, high)
    assert found[0, 0] == approx(deflection, rel=2e-3)
    # not shown is what gives way between two nodes that are fixed: shear under the couple, and the
    # bend of a clamped segment
    hidden = 1.2 / (SHEARING * (high - low)) + SIZE[2] / count / (16.0 * BENDING)
    assert slope - hidden < found[4, 4] < slope * (1.0 + 1e-6)


def test_an_averaging_patch_stiffens_nothing() -> None:
    free = solve_modal(cantilever(bar(10)).system, count=1).frequencies_hz[0]
    averaged = solve_modal(
        cantilever(side_patch("average", 0.30, 0.50)).system, count=1
    ).frequencies_hz[0]
    assert averaged == approx(free, rel=1e-9)


def test_a_disk_and_a_strip_are_averaged_like_the_areas_they_are() -> None:
    plain = bar(10)
    patches = {
        "disk": Patch("x+", "disk", (0.0, 0.0, 0.30), (0.06,)),
        "strip": Patch("y-", "strip", (0.0, 0.0, 0.30), (0.08,), "x"),
        "whole": Patch("x-"),
    }
    faces = {name: Interface(name, (patch,), "average") for name, patch in patches.items()}
    found = cantilever(dataclasses.replace(plain, interfaces={**plain.interfaces, **faces}))
    motion = solve_static(found.system, found.system.inputs["tcp", "x"]).displacements
    at = {name: float(found.system.outputs[f"bar.{name}", "x"] @ motion) for name in patches}

    def deflection(z: FloatArray) -> FloatArray:
        return z**2 * (1.5 - z) / (6.0 * BENDING) + z / SHEARING

    z = np.linspace(0.0, 0.5, 100001, dtype=np.float64)
    chord = np.sqrt(np.maximum(0.0, 0.03**2 - (z - 0.3) ** 2))
    assert at["disk"] == approx(chord @ deflection(z) / chord.sum(), rel=1e-4)
    assert at["strip"] == approx(deflection(z)[(z > 0.26) & (z < 0.34)].mean(), rel=1e-4)
    assert at["whole"] == approx(deflection(z).mean(), rel=1e-4)


def test_the_surface_of_a_segmented_tube_bends_with_it() -> None:
    tube = make_segmented(Tube(0.1, 0.06, 0.8), {"foot": "z-", "tip": "z+"}, 5)
    found, skin = cantilever(tube), segment_skin(tube)
    motion = found.basis @ solve_static(found.system, found.system.inputs["tcp", "x"]).displacements
    part = found.layout.superelements["bar"]
    assert part.recovery is not None
    shift = (part.recovery.basis @ motion).reshape(-1, 3)
    second, area = np.pi * (0.05**4 - 0.03**4) / 4.0, np.pi * (0.05**2 - 0.03**2)
    kappa = shear_coefficient(prismatic_bar(tube.solid), 0.3)
    z = skin.points[:, 2]
    wanted = z**2 * (2.4 - z) / (6.0 * 2.1e11 * second) + z / (kappa * 2.1e11 / 2.6 * area)
    np.testing.assert_allclose(shift[:, 0], wanted, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(
        shift[:, 2],
        -skin.points[:, 0] * z * (1.6 - z) / (2.0 * 2.1e11 * second),
        rtol=1e-9,
        atol=1e-18,
    )


def test_models_of_one_body_share_the_surface_that_is_shown() -> None:
    first, second = (
        make_segmented(Tube(0.1, 0.08, 1.0), {"foot": "z-"}, count) for count in (4, 8)
    )
    assert segment_skin(first) is segment_skin(second)


def test_a_traction_acts_where_it_is_and_a_body_load_on_all() -> None:
    load = Load(
        "wind",
        "bar",
        "traction",
        (Patch("x-", "rect", (0.0, 0.0, 0.43), (0.1, 0.06)),),
        vector=(1.0, 0.0, 0.0),
    )
    own = Load("own", "bar", "body", vector=(1.0, 0.0, 0.0))
    part = reduce_shape(bar(10), load, own)
    moments = [6 * node + 4 for node in range(len(part.frames))]
    arms = np.array([frame.origin[2] for frame in part.frames])
    vector = part.loads["wind:x"].vector
    assert vector[::6].sum() == approx(0.006, rel=1e-12)
    assert vector[::6] @ arms + vector[moments].sum() == approx(0.006 * 0.43, rel=1e-12)
    assert part.loads["own:x"].vector[::6].sum() == approx(part.mass_kg, rel=1e-12)


@pytest.mark.parametrize(
    ("solid", "along", "reason"),
    [
        (HollowColumn((0.3, 0.3, 1.0), 0.02, 0.02), None, "section changes"),
        (Tube(0.1, 0.08, 1.0), "x", "along z only"),
    ],
)
def test_what_is_no_bar_of_one_section_is_refused_with_the_reason(
    solid: HollowColumn | Tube, along: str | None, reason: str
) -> None:
    component = Component(
        "c", solid, STEEL, fidelity="segmented", segments=SegmentSettings(5, "x" if along else None)
    )
    with pytest.raises(ModelError, match=reason):
        reduce_shape(component)
