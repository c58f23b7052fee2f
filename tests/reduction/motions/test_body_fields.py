"""Bodies move at the same places alike, whatever they are made of."""

import dataclasses

import numpy as np

from common import approx, make_box, make_component, make_faced
from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import (
    Component,
    SegmentSettings,
)
from headstock.geometry.parts.solids import Box
from headstock.reduction.motions.body_fields import choose_places, machine_field, place_motion
from headstock.reduction.superelement import Recovery, Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import couple_clamped, reduce_shape
from reduced_parts import reduce_mesh

SIZE = (0.04, 0.06, 0.4)


def bar() -> Component:
    settings = {"fidelity": "segmented", "segments": SegmentSettings(20)}
    return make_faced("bar", Box(SIZE), {"foot": "z-", "tip": "z+"}, **settings)


def rigid_bar() -> Superelement:
    return reduce_shape(dataclasses.replace(bar(), fidelity="rigid"))


def test_the_places_have_the_mass_the_centre_and_the_inertia_of_the_body() -> None:
    part = rigid_bar()
    places = choose_places(part)
    motions = rigid_map(places.points, part.center_of_mass)
    gram = motions.T @ (np.repeat(places.masses, 3)[:, None] * motions)
    np.testing.assert_allclose(gram[:3, :3], part.mass_kg * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(gram[:3, 3:], 0.0, atol=1e-12)
    np.testing.assert_allclose(gram[3:, 3:], part.inertia, rtol=1e-9, atol=1e-12)


def test_a_body_without_mass_has_no_places() -> None:
    part = dataclasses.replace(rigid_bar(), mass_kg=0.0)
    assert len(choose_places(part).masses) == 0


def test_a_linear_field_known_at_scattered_points_is_met_exactly_between_them() -> None:
    part, random = rigid_bar(), np.random.default_rng(3)
    known = random.uniform(-0.5, 0.5, (80, 3))
    slopes = random.standard_normal((6, 3, 3))
    field = np.stack([(known @ slope.T + 1.0).ravel() for slope in slopes], axis=1)
    measured = dataclasses.replace(part, recovery=Recovery(basis=field, points=known))
    wanted = random.uniform(-0.4, 0.4, (10, 3))
    found = place_motion(measured, wanted)
    for column, slope in enumerate(slopes):
        np.testing.assert_allclose(found[:, column], (wanted @ slope.T + 1.0).ravel(), atol=1e-9)


def test_a_rigid_body_moves_rigidly() -> None:
    part = rigid_bar()
    points = choose_places(part).points
    np.testing.assert_allclose(
        place_motion(part, points), rigid_map(points, part.center_of_mass), atol=1e-15
    )


def test_modes_of_segments_and_of_finite_elements_are_the_same_motions() -> None:
    mesh = make_box((2, 3, 10), SIZE, {"foot": "z-", "tip": "z+"})
    mesh = dataclasses.replace(
        mesh, points=mesh.points - np.array([0.5 * SIZE[0], 0.5 * SIZE[1], 0.0])
    )
    component = dataclasses.replace(make_component({"foot": "rigid", "tip": "rigid"}), name="bar")
    solid = reduce_mesh(component, mesh, modes=12)
    segments = reduce_shape(bar())
    places = {"bar": choose_places(solid)}
    fields: list[FloatArray] = []
    for part in (solid, segments):
        coupled = couple_clamped(bar(), part)
        fields.append(machine_field(coupled, places, solve_modal(coupled.system, count=5).shapes))
    np.testing.assert_allclose(fields[0].T @ fields[0], np.eye(5), atol=0.04)
    units = [field / np.linalg.norm(field, axis=0) for field in fields]
    assert (np.diag(units[0].T @ units[1]) ** 2 > 0.99).all()


def test_a_body_that_only_its_nodes_carry_is_met_in_its_nodes() -> None:
    part = dataclasses.replace(reduce_shape(bar()), recovery=None)
    center = np.array([[0.0, 0.0, 0.19]])  # of segment 10
    found = place_motion(part, center)
    assert found[:, 54:57] == approx(np.eye(3), abs=1e-9)
