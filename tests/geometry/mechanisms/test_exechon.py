"""Kinematics of platforms and tools; a mechanism places what it carries where its marks stand."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import approx
from headstock.geometry.errors import ClosureError
from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.machine.machine import Pose, place_components
from headstock.geometry.mechanisms.closures import (
    close_chains,
    closure_residual,
    evaluate_kinematics,
    find_mobility,
)
from headstock.geometry.mechanisms.exechon import (
    ASSEMBLIES,
    ExechonDimensions,
    MountedExechon,
    condition_numbers,
    exechon_mechanism,
    platform_states,
    solve_pose,
    solve_tool_pose,
    survey_tool_poses,
    tool_pose,
)
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.scene.building.loader import load_scene
from headstock.validation.mechanisms.platforms import (
    planar_3rpr,
    planar_3rpr_assemblies,
    planar_3rpr_state,
)

DOWN = np.array([0.0, 0.0, -1.0])
DIMENSIONS = ExechonDimensions(
    (-0.57, 0.57, 0.73), (-0.22, 0.22, 0.20), wrist=(0.0, 0.33), tool_length=0.31
)
MACHINE = MountedExechon(
    DIMENSIONS,
    Frame(
        np.array([-0.99, 0.0, 1.295]), rotation_about(np.array([0.0, 1.0, 0.0]), np.radians(135))
    ),
)


@given(
    st.floats(-0.35, 0.35),
    st.floats(-0.4, 0.4),
    st.floats(0.1, 0.4),
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
)
@settings(max_examples=40, deadline=None)
def test_the_tool_stands_where_it_was_sent_in_closed_loops(
    x: float, y: float, z: float, tx: float, ty: float
) -> None:
    direction = np.array([tx, ty, -1.0]) / np.linalg.norm([tx, ty, -1.0])
    state = solve_tool_pose(MACHINE, np.array([x, y, z]), direction)
    assert np.abs(closure_residual(MACHINE.mechanism, state)).max() < 1e-14
    placement = place_markers(MACHINE.mechanism, state)
    tool = MACHINE.mechanism.markers.index("tcp")
    assert np.allclose(
        MACHINE.mounting.origin + MACHINE.mounting.rotation @ placement.positions[tool],
        [x, y, z],
        atol=1e-14,
    )
    assert np.allclose(
        MACHINE.mounting.rotation @ placement.rotations[tool][:, 2], direction, atol=1e-14
    )


def test_newton_finds_the_closed_form_from_a_pose_nearby() -> None:
    here, there = (solve_tool_pose(MACHINE, np.array([x, 0.1, 0.2]), DOWN) for x in (0.0, 0.05))
    start = here.copy()
    start[MACHINE.mechanism.driven_slice] = there[MACHINE.mechanism.driven_slice]
    assert np.allclose(close_chains(MACHINE.mechanism, start), there, atol=1e-12)


def test_every_assembly_puts_the_wrist_centre_in_the_same_place_with_another_platform() -> None:
    dimensions = ExechonDimensions(
        (-0.44, 0.78, 0.35), (-0.15, 0.25, 0.13), (0.1, 0.15), (0.04, 0.02), (0.28, -0.2)
    )
    mechanism, center = exechon_mechanism(dimensions), np.array([0.02, 0.7, 1.02])
    turned = []
    for assembly in ASSEMBLIES:
        placement = place_markers(mechanism, platform_states(dimensions, center, assembly))
        assert np.allclose(
            placement.positions[mechanism.markers.index("wrist_4")], center, atol=1e-14
        )
        turned.append(placement.rotations[mechanism.markers.index("platform")])
    assert all(np.abs(turned[i] - turned[j]).max() > 0.1 for i in range(4) for j in range(i))


def test_the_tripod_has_three_freedoms_beside_the_wrist_and_no_redundant_closure() -> None:
    state = solve_tool_pose(MACHINE, np.array([0.1, -0.2, 0.2]), DOWN)
    mobility = find_mobility(MACHINE.mechanism, state)
    assert (mobility.freedom, mobility.rank, mobility.closures, mobility.redundant) == (5, 9, 9, 0)


def test_the_plane_above_the_table_is_free_of_singular_poses() -> None:
    x, y = np.meshgrid(np.linspace(-0.35, 0.35, 15), np.linspace(-0.4, 0.4, 17))
    survey = survey_tool_poses(MACHINE, np.stack([x, y, np.full_like(x, 0.2)], -1), DOWN)
    assert survey.reached.all()
    assert survey.condition.max() < 8.0
    passive = evaluate_kinematics(MACHINE.mechanism, survey.states).closure_jacobian[
        ..., MACHINE.mechanism.passive_slice
    ]
    assert np.linalg.cond(passive).max() < 11.0


def test_condition_number_is_that_of_finite_differences() -> None:
    center = np.array([-0.2, 0.1, 1.1])
    states = platform_states(
        DIMENSIONS, np.stack([center, *(center + 1e-6 * np.eye(3)), *(center - 1e-6 * np.eye(3))])
    )
    slopes = (states[1:4, :3] - states[4:, :3]) / 2e-6
    assert condition_numbers(MACHINE.mechanism, states[0]) == approx(
        np.linalg.cond(slopes), rel=1e-8
    )


BASE, PLATFORM = (
    np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]]),
    np.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]]),
)


@pytest.mark.parametrize("seed", range(40))
def test_the_pose_that_gave_the_lengths_is_among_the_assemblies(seed: int) -> None:
    x, y, angle = np.random.default_rng(seed).uniform([-0.5, -0.5, -3.0], [1.5, 1.5, 3.0])
    state = planar_3rpr_state(BASE, PLATFORM, (x, y), angle)
    lengths = state[:3]
    found = planar_3rpr_assemblies(BASE, PLATFORM, lengths)
    assert 2 <= len(found) <= 6 and len(found) % 2 == 0
    for px, py, turned in found:
        other = planar_3rpr_state(BASE, PLATFORM, (px, py), turned)
        assert np.allclose(other[:3], lengths, atol=1e-6)
    assert min(np.hypot(px - x, py - y) + abs(turned - angle) for px, py, turned in found) < 1e-5


def test_six_assemblies_exist() -> None:
    base, platform = (
        np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.9]]),
        np.array([[0.0, 0.0], [1.1, 0.0], [0.3, 0.8]]),
    )
    counts = {
        len(planar_3rpr_assemblies(base, platform, np.array([q, 0.9, 1.1])))
        for q in np.linspace(0.6, 1.4, 41)
    }
    assert 6 in counts and max(counts) == 6


def test_lengths_that_meet_nowhere_give_no_assembly() -> None:
    assert planar_3rpr_assemblies(BASE, PLATFORM, np.array([0.05, 0.05, 0.05])) == []


def test_state_of_a_turned_platform_is_closed() -> None:
    state = planar_3rpr_state(BASE, PLATFORM, (0.2, 0.3), 2.9)
    assert np.abs(closure_residual(planar_3rpr(BASE, PLATFORM), state)).max() == approx(
        0.0, abs=1e-15
    )


@pytest.mark.parametrize("size", [1e-2, 1.0, 30.0])
@pytest.mark.parametrize("turn", [0.0, 0.3, -1.1])
def test_a_closed_singular_pose_stays_as_it_is_and_is_named(size: float, turn: float) -> None:
    # similar triangles: when they are turned alike, all legs point to their common centre
    angles = np.radians([90.0, 210.0, 330.0]) + turn
    base = size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    mechanism = planar_3rpr(base, 0.3 * base)
    state = planar_3rpr_state(base, 0.3 * base, (0.0, 0.0), 0.0)
    np.testing.assert_allclose(close_chains(mechanism, state), state, atol=1e-9)
    both = np.array([state, planar_3rpr_state(base, 0.3 * base, (0.1 * size, 0.0), 0.4)])
    np.testing.assert_allclose(close_chains(mechanism, both), both, atol=1e-9)
    assert find_mobility(mechanism, state).passive_condition > 1e10


def test_a_singular_pose_with_open_loops_is_out_of_reach() -> None:
    angles = np.radians([90.0, 210.0, 330.0])
    base = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    state = planar_3rpr_state(base, 0.3 * base, (0.0, 0.0), 0.0)
    state[:3] *= 0.5
    with pytest.raises(ClosureError):
        close_chains(planar_3rpr(base, 0.3 * base), state)


SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"


def test_the_spindle_points_where_the_pose_says_and_every_leg_runs_to_its_platform_joint() -> None:
    machine = load_scene(SCENE, variant="components").machine
    assert machine.mechanism is not None
    known = machine.mechanism.mounted
    for positions in ({"Z": 0.2}, {"X": -0.1, "Y": 0.3, "Z": 0.25, "A": 0.2, "B": -0.1}):
        frames = place_components(machine, Pose("here", positions))
        point, direction = tool_pose(machine.mechanism, positions)
        spindle = frames["spindle"]
        assert np.allclose(spindle.rotation[:, 2], direction, atol=1e-12)
        tip = spindle.origin + 0.48 * spindle.rotation[:, 2]
        assert np.allclose(tip, point, atol=1e-12)
        markers = place_markers(known.mechanism, solve_pose(machine.mechanism, positions))
        for number in (1, 2, 3):
            sleeve, beam = frames[f"sleeve_{number}"], frames[f"beam_{number}"]
            assert np.allclose(sleeve.rotation, beam.rotation, atol=1e-12)
            joint = markers.positions[known.mechanism.markers.index(f"joint_{number}")]
            at_tip = beam.origin + 1.8 * beam.rotation[:, 2]
            assert np.allclose(
                at_tip, known.mounting.origin + known.mounting.rotation @ joint, atol=1e-12
            )
