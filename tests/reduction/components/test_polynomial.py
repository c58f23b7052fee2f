"""Displacements as polynomials over the whole body are finite elements without a mesh."""

import dataclasses

import numpy as np
import pytest

from common import STEEL, approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Load,
    Patch,
    RailSettings,
)
from headstock.geometry.parts.mass_properties import closed_form_properties
from headstock.geometry.parts.solids import Box, HollowColumn, Solid, Tube
from headstock.reduction.components.polynomial import reduce_polynomial
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import ModelError
from lumped_machines import reduce_shape

BOX, TUBE = Box((0.04, 0.1, 0.3)), Tube(0.12, 0.09, 0.6)
SIX = ReductionRequest(modes=ModeTarget(count=6))


def part(solid: Solid, coupling: str = "average", **interfaces: Interface) -> Component:
    ends = {
        name: Interface(name, (Patch(face),), "rigid" if coupling == "rigid" else "average")
        for name, face in (("foot", "z-"), ("tip", "z+"))
    }
    return Component("part", solid, STEEL, interfaces={**ends, **interfaces}, fidelity="polynomial")


def reduce(component: Component, *loads: Load) -> Superelement:
    properties = closed_form_properties(component)
    assert properties is not None
    return reduce_polynomial(component, properties, loads, request=SIX)


def free_frequencies(element: Superelement) -> FloatArray:
    """The first elastic frequencies of the free body [Hz]."""
    values = np.linalg.eigvals(np.linalg.solve(element.mass, element.stiffness)).real
    return np.asarray(np.sqrt(np.sort(values)[6:12]) / (2.0 * np.pi))


def condensed(element: Superelement) -> FloatArray:
    """Compliance ``(6, 6)`` of the second node with the first one fixed."""
    return np.asarray(np.linalg.inv(element.stiffness[6:12, 6:12]))


def test_a_pulled_and_a_twisted_tube_are_as_soft_as_in_closed_form() -> None:
    compliance = condensed(reduce(part(TUBE)))
    area = np.pi * (0.06**2 - 0.045**2)
    polar = np.pi * (0.06**4 - 0.045**4) / 2.0
    shear = STEEL.youngs_modulus / 2.6
    assert compliance[2, 2] == approx(0.6 / (STEEL.youngs_modulus * area), rel=1e-9)
    assert compliance[5, 5] == approx(0.6 / (shear * polar), rel=1e-9)


def test_a_slender_tube_on_a_rail_vibrates_as_a_row_of_segments() -> None:
    rail = Interface("rail", (Patch("outer"),), "average", rail=RailSettings("z", 10))
    long = Tube(0.06, 0.04, 1.5)
    polynomial = part(long, rail=rail)
    segmented = dataclasses.replace(
        polynomial,
        fidelity="segmented",
        segments=dataclasses.replace(polynomial.segments, count=40),
    )
    element, row = reduce(polynomial), reduce_shape(segmented)
    assert len(element.control_points) == 10
    moved = np.diag(row.mass) > 0.0
    # nodes at the ends have no mass and follow the segments
    soft = row.stiffness[~moved][:, ~moved]
    follow = -np.linalg.solve(soft, row.stiffness[~moved][:, moved])
    stiffness = row.stiffness[moved][:, moved] + row.stiffness[moved][:, ~moved] @ follow
    values = np.linalg.eigvals(np.linalg.solve(row.mass[moved][:, moved], stiffness)).real
    beams = np.sqrt(np.sort(values)[6:10]) / (2.0 * np.pi)
    assert free_frequencies(element)[:4] == approx(beams, rel=5e-3)


@pytest.mark.parametrize("solid", [Box((0.01, 0.01, 1.0)), Tube(0.02, 0.016, 2.0)])
def test_a_very_slender_bar_keeps_its_mass_and_bends_as_a_beam(solid: Box | Tube) -> None:
    element = reduce(part(solid))
    if isinstance(solid, Box):
        gyration, length = 0.01 / np.sqrt(12.0), 1.0
    else:
        gyration, length = np.hypot(0.01, 0.008) / 2.0, 2.0
    wave = np.sqrt(STEEL.youngs_modulus / STEEL.density)
    clamped = 22.3733 / (2.0 * np.pi) * gyration * wave / length**2
    assert element.modal_frequencies_hz[:2] == approx(clamped, rel=5e-3)


def test_weight_and_traction_have_their_resultants() -> None:
    weight = Load("weight", "part", "body", vector=(0.0, 0.0, 1.0))
    pull = Load("pull", "part", "traction", (Patch("x+"),), vector=(1.0, 0.0, 0.0))
    element = reduce(part(BOX), weight, pull)
    motion = np.zeros(len(element.stiffness))
    motion[[0, 6]] = 1.0
    assert element.loads["weight:x"].vector @ motion == approx(element.mass_kg, rel=1e-9)
    assert element.loads["pull:x"].vector @ motion == approx(0.1 * 0.3, rel=1e-9)


def test_a_free_body_has_its_mean_motion_as_dofs() -> None:
    element = reduce(Component("part", BOX, STEEL, fidelity="polynomial"))
    assert element.boundary_size == 6
    assert np.abs(element.stiffness[:6, :6]).max() < 1e-6 * STEEL.youngs_modulus
    # bending about y of a free bar, Euler-Bernoulli less the shear of a short one
    slender = 22.373 / (2.0 * np.pi) * 0.04 / 0.3**2 * np.sqrt(2.1e11 / (12.0 * 7850.0))
    assert 0.93 * slender < element.modal_frequencies_hz[0] < slender


@pytest.mark.parametrize(
    ("component", "word"),
    [
        (part(HollowColumn((0.2, 0.2, 0.5), 0.02, 0.02)), "caps"),
        (part(BOX, spot=Interface("spot", (Patch("x+"),), flexible=9)), "flexible"),
        (part(BOX, spot=Interface("spot", (Patch("face:3"),))), "face:3"),
    ],
)
def test_what_polynomials_cannot_follow_is_refused(component: Component, word: str) -> None:
    properties = closed_form_properties(part(BOX))
    assert properties is not None
    with pytest.raises(ModelError, match=word):
        reduce_polynomial(component, properties, request=SIX)
