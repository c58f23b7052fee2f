import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common import approx
from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.mechanisms.closures import (
    close_loops,
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
    solve_tool_pose,
    survey_tool_poses,
)
from headstock.geometry.mechanisms.kinematics import place_markers

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
    assert np.allclose(close_loops(MACHINE.mechanism, start), there, atol=1e-12)


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
