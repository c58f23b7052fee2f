"""unreachable poses, joint limits and several assemblies: an error with a name, or the
assembly that was meant.
"""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.errors import (
    ClosureError,
    JointLimitError,
    SingularPoseError,
    UnreachablePoseError,
)
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.mechanisms.closures import close_chains
from headstock.geometry.mechanisms.exechon import (
    ASSEMBLIES,
    Assembly,
    ExechonDimensions,
    MountedExechon,
    platform_states,
    solve_tool_pose,
    survey_tool_poses,
)
from headstock.solvers.milling.path_drives import follow_path
from headstock.solvers.milling.tool_path import PathPoints
from headstock.validation.mechanisms.platforms import (
    planar_3rpr,
    planar_3rpr_assemblies,
    planar_3rpr_state,
)

pytestmark = pytest.mark.hard("H39")

DOWN = np.array([0.0, 0.0, -1.0])
DIMENSIONS = ExechonDimensions(
    (-0.57, 0.57, 0.73), (-0.22, 0.22, 0.20), wrist=(0.0, 0.33), tool_length=0.31
)
MOUNTING = Frame(
    np.array([-0.99, 0.0, 1.295]), rotation_about(np.array([0.0, 1.0, 0.0]), np.radians(135.0))
)
MACHINE = MountedExechon(
    DIMENSIONS, MOUNTING, {"q1": (0.6, 1.6), "q2": (0.6, 1.6), "q3": (0.6, 1.6)}
)


def above_base(machine: MountedExechon, x: float, z: float) -> FloatArray:
    """Tool point that puts the wrist centre beside the common axis of legs 1 and 2."""
    return machine.mounting.origin + [x, 0.0, z] + machine.dimensions.tool_length * DOWN


def test_a_wrist_centre_inside_its_offset_is_out_of_reach() -> None:
    aside = dataclasses.replace(
        MACHINE, dimensions=dataclasses.replace(DIMENSIONS, wrist=(0.1, 0.33))
    )
    with pytest.raises(UnreachablePoseError, match="comes no closer than 100 mm"):
        solve_tool_pose(aside, above_base(aside, 0.05, 0.0), DOWN)


def test_a_wrist_centre_on_the_common_axis_is_singular() -> None:
    with pytest.raises(SingularPoseError, match="common axis"):
        solve_tool_pose(MACHINE, above_base(MACHINE, 0.0, 0.0), DOWN)


def test_a_tool_along_the_fourth_axis_leaves_that_axis_undetermined() -> None:
    state = platform_states(DIMENSIONS, np.array([0.0, 0.0, 1.2]))
    assert np.isfinite(state).all()
    straight = MountedExechon(DIMENSIONS)
    with pytest.raises(SingularPoseError, match="undetermined"):
        solve_tool_pose(
            straight, np.array([0.0, 0.0, 1.2 + DIMENSIONS.tool_length]), np.array([0.0, 0.0, 1.0])
        )


def test_a_leg_beyond_its_limit_is_named_with_its_length() -> None:
    with pytest.raises(JointLimitError, match=r"q\d would be \d+.* mm, outside 600 to 1600 mm"):
        solve_tool_pose(MACHINE, np.array([0.9, 0.0, 0.1]), DOWN)


def test_a_survey_flags_what_single_poses_refuse() -> None:
    points = np.array([[0.0, 0.0, 0.2], [0.9, 0.0, 0.1], above_base(MACHINE, 0.0, 0.0)])
    survey = survey_tool_poses(MACHINE, points, DOWN)
    assert survey.reached.tolist() == [True, True, False]
    assert survey.within.tolist() == [True, False, False]
    assert np.isinf(survey.condition[2])


@pytest.mark.parametrize("assembly", ASSEMBLIES)
def test_the_assembly_that_was_asked_for_is_kept_along_a_path(assembly: Assembly) -> None:
    points = np.stack(
        [np.linspace(-0.3, 0.3, 61), np.linspace(-0.3, 0.3, 61), np.full(61, 0.2)], axis=-1
    )
    machine = dataclasses.replace(MACHINE, assembly=assembly, limits={})
    states = survey_tool_poses(machine, points, DOWN).states[:, :3]
    assert np.abs(np.diff(states, axis=0)).max() < 0.03


def test_a_path_that_changes_the_assembly_is_refused_at_its_time() -> None:
    # straight through the common axis: the plane of legs 1 and 2 would have to turn half around
    times = np.linspace(0.0, 1.0, 40, dtype=np.float64)
    across = np.stack(
        [above_base(MACHINE, x, 0.0) for x in np.linspace(-0.3, 0.3, 40, dtype=np.float64)]
    )
    speed = np.tile([0.6, 0.0, 0.0], (40, 1))
    free = dataclasses.replace(MACHINE, limits={})
    with pytest.raises(SingularPoseError, match=r"t = 0\.\d+ s jumps to another assembly"):
        follow_path(free, times, PathPoints(across, speed, np.zeros_like(speed)), DOWN)


def test_newton_keeps_the_assembly_it_starts_in_and_names_what_it_cannot_close() -> None:
    base, platform = (
        np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]]),
        np.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]]),
    )
    mechanism = planar_3rpr(base, platform)
    start = planar_3rpr_state(base, platform, (0.45, 0.4), 0.3)
    poses = planar_3rpr_assemblies(base, platform, start[:3])
    assert len(poses) >= 2
    for x, y, angle in poses:
        exact = planar_3rpr_state(base, platform, (x, y), angle)
        nearby = exact.copy()
        nearby[mechanism.passive_slice] += 0.01
        assert np.allclose(close_chains(mechanism, nearby), exact, atol=1e-6)
    unreachable = start.copy()
    unreachable[:3] = 0.05
    with pytest.raises(ClosureError, match="planar 3-RPR"):
        close_chains(mechanism, unreachable)
