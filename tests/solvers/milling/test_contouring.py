"""The whole contour at once, linear and nonlinear, against marching step by step."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from headstock.geometry.errors import JointLimitError, UnreachablePoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import close_chains
from headstock.geometry.mechanisms.exechon import LENGTHS, survey_tool_poses
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.solvers.errors import ConvergenceError, ModelError
from headstock.solvers.mechanisms.modes import PoseDamping, linearise_poses, tool_compliance
from headstock.solvers.milling.contouring import (
    drive_forces,
    linear_motion,
    refine_motion,
    tool_gaps,
)
from headstock.solvers.milling.forces import (
    EndMill,
    MillingCut,
    cutting_forces,
    regeneration_stiffness,
)
from headstock.solvers.milling.path_drives import (
    PathDrive,
    find_tool_positions,
    follow_path,
    smooth_samples,
)
from headstock.solvers.milling.regeneration import (
    RegenerativeCut,
    cutting_phases,
    integrate_regenerative,
)
from headstock.solvers.milling.tool_path import SquareContour, ToolPath, plan_contour
from headstock.solvers.motion.alpha import (
    CompliantHistory,
    LinearMotion,
    Regeneration,
    integrate_linear,
)
from headstock.validation.mechanisms.generalized_alpha import MotionState, integrate_constrained
from headstock.validation.mechanisms.motion import PartitionedMotion
from headstock.validation.mechanisms.tripteor_machine import Tripteor, load_tripteor

pytestmark = pytest.mark.slow

STEP = 5e-5
CONTOUR = SquareContour(0.2, (0.0, 0.0), 0.2, 0.01, 0.02, 5.0 / 60.0, 0.01)


@cache
def machine() -> Tripteor:
    return load_tripteor()


@cache
def path_drive() -> tuple[ToolPath, PathDrive]:
    path = plan_contour(CONTOUR).path
    nodes = np.linspace(0.0, 0.4, 101, dtype=np.float64)
    return path, follow_path(machine().scene.mounted, nodes, path.at(nodes), machine().scene.tool)


def moving(count: int, damping: float) -> tuple[LinearMotion, FloatArray]:
    times: FloatArray = STEP * np.arange(count, dtype=np.float64)
    motion = linear_motion(machine().model, path_drive()[1], times, PoseDamping((damping,)))
    force = 300.0 * np.stack(
        [np.sin(400.0 * times), np.cos(300.0 * times) - 1.0, np.sin(5400.0 * times)], axis=-1
    )
    return motion, force


def test_drives_lead_the_tool_along_the_path() -> None:
    path, drive = path_drive()
    mechanism = machine().model.mechanism
    times = np.linspace(0.003, 0.39, 57, dtype=np.float64)
    points = path.at(times)
    none = np.zeros((len(times), 6))
    gaps = tool_gaps(machine().model, drive, times, CompliantHistory(none, none, none))
    assert np.abs(gaps).max() == 0.0
    speeds = drive.at(times)
    later, earlier = drive.at(times + 1e-6).position, drive.at(times - 1e-6).position
    assert np.allclose((later - earlier) / 2e-6, speeds.speed, atol=1e-7)
    states = drive.rigid_states(times)
    tool = mechanism.markers.index("tcp")
    states[:, mechanism.driven_slice] = speeds.position
    placed = place_markers(mechanism, close_chains(mechanism, states)).positions[:, tool]
    mounting = machine().scene.mounted.mounting
    assert np.abs(mounting.origin + placed @ mounting.rotation.T - points.position).max() < 2e-8


def test_measured_leg_lengths_lead_the_tool_where_closed_loops_put_it() -> None:
    path, drive = path_drive()
    machine_ = machine().scene.mounted
    mechanism, times = machine().model.mechanism, np.linspace(0.01, 0.39, 40, dtype=np.float64)
    legs = [mechanism.index(name) for name in LENGTHS]
    # longer and shorter than planned by tenths of a millimetre
    lengths = drive.rigid_states(times)[:, legs] + 3e-4 * np.sin(
        np.outer(times, [70.0, 90.0, 110.0])
    )
    found = find_tool_positions(machine_, lengths, path.at(times), machine().scene.tool)
    assert np.abs(found - path.at(times).position).max() > 1e-4
    states = survey_tool_poses(machine_, found, machine().scene.tool).states
    states[:, legs] = lengths
    closed = place_markers(mechanism, close_chains(mechanism, states))
    tool = closed.positions[:, mechanism.markers.index("tcp")]
    mounting = machine_.mounting
    assert np.abs(mounting.origin + tool @ mounting.rotation.T - found).max() < 1e-11
    with pytest.raises(ModelError, match="start with the path"):
        find_tool_positions(machine_, lengths + 5.0, path.at(times), machine().scene.tool)


@dataclass(frozen=True, eq=False)
class Tried:
    history: CompliantHistory
    carried: FloatArray


def march_by_steps(motion: LinearMotion, force: FloatArray, start: FloatArray) -> FloatArray:
    """The full equations under a force step by step ``(n, 6)``."""
    model, (_, drive) = machine().model, path_drive()
    stepped = [start]
    problem = PartitionedMotion(
        model, drive.at, lambda time: force[round(time / STEP)], drive.states[0]
    )
    first = problem.start(0.0, start, np.zeros(6))
    assert np.abs(first.acceleration).max() < 1e-6

    def observe(state: MotionState) -> None:
        stepped.append(state.position)

    integrate_constrained(
        problem, first, STEP, len(motion.times) - 1, observe=observe, tolerance=1e-14
    )
    return np.array(stepped)


def test_waves_of_the_teeth_before_meet_the_full_equations() -> None:
    """Under the force that was found the full equations march step by step to the same motion, and that
    force is the rigid one and cutting stiffness times what the tool has moved since the last tooth.
    """
    model, (_, drive) = machine().model, path_drive()
    motion, _ = moving(240, 0.0)
    turn, teeth = 80, 4
    mill = EndMill(0.02, teeth, np.radians(30.0))
    milling = MillingCut(
        mill, catalogue_coefficients("al7075-t6"), 2.0 * np.pi / (turn * STEP), 3e-3, 8e-3
    )
    delay, speed = turn // teeth, 0.05
    cut = RegenerativeCut(
        phases=cutting_phases(milling, turn),
        delay=delay,
        feed=np.full(len(motion.times), speed * milling.tooth_period),
        share=np.clip(motion.times / (40 * STEP), 0.0, 1.0),
        frame=np.broadcast_to(np.eye(3), (len(motion.times), 3, 3)),
    )

    def gaps(history: CompliantHistory) -> FloatArray:
        return tool_gaps(model, drive, motion.times, history)

    def solve(extra: FloatArray, before: Tried | None) -> Tried:
        rest = None
        if before is not None:
            rest = gaps(before.history) - motion.tool_motion(before.history.compliant)
        loaded = replace(motion, rest=rest)
        return Tried(*integrate_regenerative(loaded, motion.load + extra, cut))

    linear = solve(np.zeros_like(motion.load), None)
    whole = refine_motion(model, drive, motion, solve)
    stepped = march_by_steps(motion, whole.carried, whole.history.compliant[0])
    assert np.abs(stepped - whole.history.compliant).max() < 1e-11
    late = slice(160, None)  # the surface before the tool was in the part is cut away
    feed = np.full(len(motion.times), speed)
    rigid = cutting_forces(milling, motion.times, feed)
    moved = gaps(whole.history)
    waves = moved[late] - moved[160 - delay : -delay]
    expected = np.einsum("nij,nj->ni", regeneration_stiffness(milling, motion.times[late]), waves)
    added = (whole.carried - rigid)[late]
    size = np.abs(added).max()
    assert np.abs(added - expected).max() < 1e-4 * size
    # that of the linear model is not this one
    assert np.abs(whole.carried - linear.carried)[late].max() > 1e-3 * size


def test_a_slow_force_moves_the_tool_as_the_static_compliance_says() -> None:
    model, (_, drive) = machine().model, path_drive()
    motion, _ = moving(2000, 0.6)
    ramp = 1.0 - np.cos(np.pi * np.minimum(motion.times / 0.08, 1.0))
    push = 100.0 * ramp[:, None] * np.array([1.0, 0.5, -0.3])
    moved = (
        integrate_linear(motion, motion.load + motion.tool_load(push)).compliant
        - integrate_linear(motion, motion.load).compliant
    )
    compliance = tool_compliance(
        model, linearise_poses(model, drive.rigid_states(motion.times[-1:]))
    )[0, :3, :3]
    assert np.allclose(motion.tool_motion(moved)[-1], compliance @ push[-1], rtol=5e-3, atol=0.0)


def test_drive_forces_at_rest_hold_the_weight() -> None:
    model, (_, drive) = machine().model, path_drive()
    motion, force = moving(3, 0.0)
    rest = integrate_linear(motion, motion.load)
    legs = drive_forces(
        model,
        drive,
        motion.times[:1],
        replace(
            rest,
            compliant=rest.compliant[:1],
            rate=rest.rate[:1],
            acceleration=rest.acceleration[:1],
        ),
        0.0 * force[:1],
    )
    still = linearise_poses(model, drive.states[0])
    # the springs along the legs give under what the drives hold, but for the beams' own weight
    springs = -(still.stiffness * rest.compliant[0])[1::2]
    own = 65.0 * 9.81
    assert np.allclose(legs[0, :3], springs, atol=own)
    assert np.abs(legs[0, :3]).max() > 500.0


def test_regeneration_without_delay_does_nothing_and_a_strong_one_grows() -> None:
    motion, force = moving(4000, 0.0)
    load = motion.load + motion.tool_load(force)
    plain = integrate_linear(motion, load)
    none = Regeneration(np.zeros((len(motion.times), 3, 3)), 24)
    assert np.allclose(
        integrate_linear(motion, load, regeneration=none).compliant, plain.compliant, atol=1e-16
    )
    strong = Regeneration(np.broadcast_to(1e11 * np.eye(3), (len(motion.times), 3, 3)), 24)
    with (
        pytest.raises(ConvergenceError, match="without bound"),
        np.errstate(over="ignore", invalid="ignore"),
    ):
        integrate_linear(motion, load, regeneration=strong)


def test_a_path_out_of_reach_is_refused_at_its_time() -> None:
    far = replace(CONTOUR, center=(0.9, 0.0))
    path = plan_contour(far).path
    nodes = np.linspace(0.0, 0.4, 101, dtype=np.float64)
    with pytest.raises((JointLimitError, UnreachablePoseError), match=r"t = 0 s"):
        follow_path(machine().scene.mounted, nodes, path.at(nodes), machine().scene.tool)


def test_noisy_lengths_become_a_law_with_calm_accelerations() -> None:
    times, rng = np.arange(0.0, 1.0, 1e-3, dtype=np.float64), np.random.default_rng(1)
    clean = 1.0 + 0.05 * np.sin(2.0 * np.pi * times)
    noisy = clean + 1e-6 * rng.normal(size=len(times))
    law = smooth_samples(times, noisy, 0.05)
    exact = -0.05 * (2.0 * np.pi) ** 2 * np.sin(2.0 * np.pi * times)
    differenced = np.diff(noisy, 2) / 1e-6
    assert np.std(differenced - exact[1:-1]) > 2.0
    assert np.std(law(times, nu=2) - exact) < 0.02
    for bad, message in ((times[::-1], "must rise"), (times * np.nan, "not finite")):
        with pytest.raises(ModelError, match=message):
            smooth_samples(bad, noisy, 0.05)
    with pytest.raises(ModelError, match="wider spacing"):
        smooth_samples(times, noisy, 0.002)
