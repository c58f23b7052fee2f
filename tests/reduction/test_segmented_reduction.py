"""A row of rigid segments on beam springs behaves like the bar it stands for."""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.components import Component, Interface, Patch, SegmentSettings
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.joints import Joint, JointEnd
from headstock.geometry.machines import Machine, Point, Pose, orient_machine
from headstock.geometry.mass_properties import closed_form_properties
from headstock.geometry.materials import Material
from headstock.geometry.solids import Box, HollowColumn, Tube
from headstock.reduction.coupling import CoupledMachine, couple
from headstock.reduction.segmented_reduction import reduce_segmented
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.modal_analysis import solve_modal
from headstock.solvers.static_response import solve_static

STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
SIZE = (0.038, 0.100, 0.500)
ENDS = {"x": ("x-", "x+"), "y": ("y-", "y+"), "z": ("z-", "z+")}
TIMOSHENKO_HZ = {"X1": 126.42642, "Y1": 324.24962, "X2": 771.88119, "T1": 993.73119, "Y2": 1749.43768, "X3": 2079.22362}


def bar(count: int, along: str = "z") -> Component:
    size = {"z": SIZE, "x": (SIZE[2], SIZE[0], SIZE[1]), "y": (SIZE[1], SIZE[2], SIZE[0])}[along]
    faces = {name: Interface(name, (Patch(face),)) for name, face in zip(("foot", "tip"), ENDS[along], strict=True)}
    return Component("bar", Box(size), STEEL, interfaces=faces, fidelity="segmented", segments=SegmentSettings(count))


def reduce(component: Component) -> Superelement:
    properties = closed_form_properties(component)
    assert properties is not None
    return reduce_segmented(component, properties)


def cantilever_machine(component: Component) -> Machine:
    clamp = Joint("clamp", (JointEnd(), JointEnd("bar", "foot")), "rigid", held=tuple(range(6)))
    return Machine("m", {"bar": component}, {"clamp": clamp}, {"tcp": Point("tcp", JointEnd("bar", "tip"), JointEnd())})


def cantilever(component: Component) -> CoupledMachine:
    return couple({"bar": reduce(component)}, cantilever_machine(component), Pose("home"))


def compliance(coupled: CoupledMachine) -> FloatArray:
    ports = np.column_stack([coupled.system.inputs["tcp", dof] for dof in ("x", "y", "z", "rx", "ry", "rz")])
    return np.asarray(ports.T @ solve_static(coupled.system, ports).displacements)


@pytest.mark.parametrize("count", [1, 2, 5, 17])
def test_end_loads_are_answered_as_timoshenko_s_beam_with_any_number_of_segments(count: int):
    width, depth, length = SIZE[1], SIZE[0], SIZE[2]
    area, second, shear = width * depth, width * depth**3 / 12.0, STEEL.youngs_modulus / 2.6
    kappa = 13.0 / 15.3
    found = compliance(cantilever(bar(count)))
    bending = length**3 / (3.0 * STEEL.youngs_modulus * second) + length / (kappa * shear * area)
    assert found[0, 0] == pytest.approx(bending, rel=1e-9)
    assert found[2, 2] == pytest.approx(length / (STEEL.youngs_modulus * area), rel=1e-9)
    assert found[4, 0] == pytest.approx(length**2 / (2.0 * STEEL.youngs_modulus * second), rel=1e-9)
    assert found[3, 1] == pytest.approx(-6.0 * length**2 / (STEEL.youngs_modulus * depth * width**3), rel=1e-9)


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_bar_along_another_axis_has_the_same_compliances(along: str):
    upright, lying = compliance(cantilever(bar(6))), compliance(cantilever(bar(6, along)))
    order = {"x": [1, 2, 0], "y": [2, 0, 1]}[along]  # axis of the lying bar that stands for x, y, z of the upright one
    picked = [*order, *(3 + i for i in order)]
    np.testing.assert_allclose(lying[np.ix_(picked, picked)], upright, rtol=1e-8, atol=1e-14)


def test_frequencies_approach_timoshenko_s_with_second_order():
    errors = []
    for count in (10, 20, 40):
        found = solve_modal(cantilever(bar(count)).system, count=6).frequencies_hz
        errors.append(np.abs(found / np.array(list(TIMOSHENKO_HZ.values())) - 1.0))
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (np.array(errors[-1]) < 1.5e-3).all()
    assert (np.abs(slopes - 2.0) < 0.2).all()


def test_mass_centre_and_inertia_are_those_of_the_solid():
    component = dataclasses.replace(bar(7), mass=12.0)
    part, properties = reduce(component), closed_form_properties(component)
    assert properties is not None
    assert part.mass_kg == pytest.approx(12.0, rel=1e-12) and part.full_dofs == 42
    np.testing.assert_allclose(part.inertia, 12.0 / properties.volume * properties.inertia, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(part.center_of_mass, properties.center, atol=1e-15)


def test_frequencies_do_not_depend_on_the_orientation_of_the_machine():
    component = bar(8)
    machine = cantilever_machine(component)
    turned = orient_machine(machine, Frame(np.array([3.0, -1.0, 0.5]), rotation_about(np.array([1.0, 2.0, 3.0]), 0.7)))
    parts = {"bar": reduce(component)}
    wanted = solve_modal(couple(parts, machine, Pose("home")).system, count=6).frequencies_hz
    found = solve_modal(couple(parts, turned, Pose("home")).system, count=6).frequencies_hz
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def side_patch(coupling: str, low: float, high: float) -> Component:
    patch = Patch("x+", "rect", (0.0, 0.0, 0.5 * (low + high)), (0.05, high - low))
    side = Interface("tip", (patch,), "average" if coupling == "average" else "rigid")
    plain = bar(10)
    return dataclasses.replace(plain, interfaces={**plain.interfaces, "tip": side})


def test_a_narrow_patch_acts_on_the_segment_under_it():
    part = reduce(side_patch("rigid", 0.36, 0.38))
    assert part.attachments["tip"].node == 7 and len(part.constraints) == 0
    np.testing.assert_allclose(part.attachments["tip"].frame.origin, [0.019, 0.0, 0.37])


def test_a_rigid_patch_over_several_segments_stiffens_them_and_an_averaging_one_does_not():
    rigid, mean = (compliance(cantilever(side_patch(kind, 0.30, 0.50))) for kind in ("rigid", "average"))
    # centres at 325, 375, 425 and 475 mm: the rigid patch turns like the first, a quarter of the moment on each turns their mean
    pairs = [min(a, b) for a in (325, 375, 425, 475) for b in (325, 375, 425, 475)]
    assert rigid[4, 4] / mean[4, 4] == pytest.approx(325.0 / np.mean(pairs), rel=1e-9)
    assert rigid[0, 0] < mean[0, 0]
    free = solve_modal(cantilever(bar(10)).system, count=1).frequencies_hz[0]
    averaged = solve_modal(cantilever(side_patch("average", 0.30, 0.50)).system, count=1).frequencies_hz[0]
    assert averaged == pytest.approx(free, rel=1e-9)


@pytest.mark.parametrize(
    ("solid", "along", "reason"),
    [(HollowColumn((0.3, 0.3, 1.0), 0.02, 0.02), None, "section changes"), (Tube(0.1, 0.08, 1.0), "x", "along z only")],
)
def test_what_is_no_bar_of_one_section_is_refused_with_the_reason(solid: HollowColumn | Tube, along: str | None, reason: str):
    component = Component("c", solid, STEEL, fidelity="segmented", segments=SegmentSettings(5, "x" if along else None))
    properties = closed_form_properties(component)
    assert properties is not None
    with pytest.raises(ModelError, match=reason):
        reduce_segmented(component, properties)
