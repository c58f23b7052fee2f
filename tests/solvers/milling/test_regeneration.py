"""Milling that meets its own waves: small motions are the linear delay equation, large ones end in
a limit cycle.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import GuideFriction
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import (
    CuttingCoefficients,
    EndMill,
    MillingCut,
    cutting_forces,
    regeneration_stiffness,
)
from headstock.solvers.milling.regeneration import (
    RegenerativeCut,
    _CuttingPhase,
    cutting_phases,
    integrate_regenerative,
)
from headstock.solvers.milling.tip_poles import tip_dynamics
from headstock.solvers.motion.alpha import LinearMotion, Regeneration, integrate_linear
from headstock.solvers.motion.friction import CoordinateFriction, friction_force, stack_laws
from headstock.validation.mechanisms.semi_discretisation import largest_multiplier, milling_gains

pytestmark = pytest.mark.slow

COEFFICIENTS = CuttingCoefficients((600e6, 180e6, 0.0), (18e3, 20e3, 0.0), "test")
STEPS, TURNS, MASS, HZ, ZETA = 96, 120, 2.0, 700.0, 0.03
SPINDLE = 2.0 * np.pi * 200.0
FEED = 0.1e-3
ENTRY = 0.01  # seconds in which the tool enters


def cut_of(depth: float, runout: float = 0.0) -> MillingCut:
    mill = EndMill(0.02, 4, np.radians(30.0), runout)
    return MillingCut(mill, COEFFICIENTS, SPINDLE, depth, 0.005)


def machine(turns: int = TURNS) -> LinearMotion:
    times = np.arange(STEPS * turns) * 2.0 * np.pi / SPINDLE / STEPS
    one = np.eye(2) * MASS
    omega = 2.0 * np.pi * HZ
    tool = np.zeros((2, 3, 2))
    tool[:, 0, 0] = tool[:, 1, 1] = 1.0
    both = [np.stack([matrix, matrix]) for matrix in (one, 2.0 * ZETA * omega * one)]
    return LinearMotion(
        times,
        times[[0, -1]],
        both[0],
        both[1],
        np.stack([MASS * omega**2 * np.eye(2)] * 2),
        tool,
        np.zeros((2, 2)),
        np.zeros((len(times), 2)),
    )


def teeth(cut: MillingCut, count: int) -> RegenerativeCut:
    return RegenerativeCut(
        cutting_phases(cut, STEPS),
        STEPS // 4,
        np.full(count, FEED),
        np.ones(count),
        np.broadcast_to(np.eye(3), (count, 3, 3)),
    )


def march(cut: MillingCut, motion: LinearMotion, load: FloatArray) -> tuple[FloatArray, FloatArray]:
    history, force = integrate_regenerative(motion, load, teeth(cut, len(motion.times)))
    return history.compliant, force


@pytest.mark.parametrize(("runout", "allowed"), [(0.0, 1e-3), (1e-5, 20.0)])
def test_without_motion_the_forces_are_those_of_rigid_teeth(runout: float, allowed: float) -> None:
    motion = machine(3)
    stiff = replace(motion, stiffness=1e9 * motion.stiffness, damping=1e9 * motion.damping)
    cut = cut_of(0.01, runout)
    feed = np.full(len(motion.times), FEED / cut.tooth_period)
    expected = cutting_forces(cut, motion.times, feed)[1:]
    # runout hides the thin end of a chip behind that of an earlier tooth
    assert (
        np.abs(march(cut, stiff, motion.load)[1][1:] - expected).max()
        < allowed
        < 0.03 * np.abs(expected).max()
    )


def test_small_motions_follow_the_linear_delay_equation() -> None:
    # no edge forces: they jump where a tooth leaves the thin end of its chip
    motion, cut = (
        machine(40),
        replace(cut_of(2e-4), coefficients=replace(COEFFICIENTS, edge=(0.0, 0.0, 0.0))),
    )
    feed = np.full(len(motion.times), FEED / cut.tooth_period)
    rigid = cutting_forces(cut, motion.times, feed)
    rigid[0] = 0.0
    moved, _ = march(cut, motion, motion.load)
    linear = integrate_linear(
        motion,
        motion.load + motion.tool_load(rigid),
        regeneration=Regeneration(regeneration_stiffness(cut, motion.times), STEPS // 4),
    ).compliant
    plain = integrate_linear(motion, motion.load + motion.tool_load(rigid)).compliant
    # at rest before, the first teeth leave waves; a settled motion repeats with every tooth and has
    # none
    effect = np.abs(linear - plain).max()
    assert effect > 1e-9 > 1e5 * np.abs(linear[-STEPS:] - plain[-STEPS:]).max()
    assert np.abs(moved - linear).max() < 0.1 * effect


@pytest.mark.parametrize("depth", [0.002, 0.04])
def test_waves_grow_where_the_multiplier_says_so_and_end_in_a_limit_cycle(depth: float) -> None:
    motion, cut = machine(), cut_of(depth)
    omega = 2.0 * np.pi * HZ
    tip = tip_dynamics(
        MASS * np.eye(2),
        2.0 * ZETA * omega * MASS * np.eye(2),
        MASS * omega**2 * np.eye(2),
        forced=np.eye(3)[:, :2],
        seen=np.eye(2),
    )
    multiplier = largest_multiplier(tip, milling_gains(cut, 96), cut.tooth_period)
    moved, force = march(cut, motion, motion.load)
    # what differs from one tooth to the next is no forced motion
    waves = np.abs(moved[STEPS // 4 :] - moved[: -STEPS // 4]).max(axis=1)
    early, late = waves[20 * STEPS : 30 * STEPS].max(), waves[-10 * STEPS :].max()
    if multiplier < 1.0:
        assert late < 1e-2 * waves[: 10 * STEPS].max()
    else:
        assert multiplier > 1.05
        assert 0.3 * FEED < late < 20.0 * FEED and late < 3.0 * early
        assert (force[-10 * STEPS :] == 0.0).all(axis=1).any()


def test_a_cut_and_friction_meet_as_in_a_fine_integration_of_the_delay_equation() -> None:
    # one edge that always cuts, and dry friction on the motion along the feed
    law = GuideFriction(40.0, 60.0, stribeck_speed=5e-3, viscous=200.0, smoothing=2e-3)
    phase = _CuttingPhase(
        normals=np.array([[0.6], [0.8]]),
        chip=np.array([[-1.2e6], [-2.0e6], [0.0]]),
        edge=np.array([[-20.0], [-30.0], [0.0]]),
        runout=np.zeros((3, 1)),
    )
    motion = machine(8)
    count, still = len(motion.times), np.zeros((len(motion.times), 1))
    rubbing = CoordinateFriction(np.array([0], dtype=np.intp), stack_laws([law]), still)
    cut = RegenerativeCut(
        (phase,),
        STEPS // 4,
        np.full(count, FEED),
        np.minimum(motion.times / ENTRY, 1.0),
        np.broadcast_to(np.eye(3), (count, 3, 3)),
    )
    load = 300.0 * np.sin(2.0 * np.pi * 90.0 * motion.times)[:, None] * np.array([1.0, 0.3])
    found, plain = (
        integrate_regenerative(each, load, cut)[0].compliant
        for each in (replace(motion, friction=rubbing), motion)
    )
    exact = _integrate_finely(law, phase, motion.times)
    size = np.abs(exact).max()
    assert np.abs(plain - exact).max() > 0.05 * size
    assert np.abs(found - exact).max() < 5e-3 * size


def _integrate_finely(law: GuideFriction, phase: _CuttingPhase, times: FloatArray) -> FloatArray:
    """Motion ``(n, 2)`` by scipy, one tooth period after the other: what is older is known."""
    omega, period = 2.0 * np.pi * HZ, float(times[1]) * (STEPS // 4)
    pieces: list[Callable[[float], FloatArray]] = []

    def before(time: float) -> FloatArray:
        if time <= 0.0:
            return np.zeros(2)
        return pieces[min(int(time / period), len(pieces) - 1)](time)[:2]

    def rate(time: float, state: FloatArray) -> FloatArray:
        place, speed = state[:2], state[2:]
        chips = [
            float((place - before(time - wave * period) + [wave * FEED, 0.0]) @ phase.normals[:, 0])
            for wave in (1, 2, 3)
        ]
        chip = min(chips)
        force = 300.0 * np.sin(2.0 * np.pi * 90.0 * time) * np.array([1.0, 0.3])
        if chip > 0.0:
            share = min(time / ENTRY, 1.0)
            force = force + share * (phase.chip[:2, 0] * chip + phase.edge[:2, 0])
        force[0] -= friction_force(law, speed[0])
        own = force / MASS - 2.0 * ZETA * omega * speed - omega**2 * place
        return np.concatenate([speed, own])

    state, found = np.zeros(4), []
    for number in range(round((times[-1] + times[1]) / period)):
        ends = (number * period, (number + 1) * period)
        within = times[(times >= ends[0] - 1e-9) & (times < ends[1] - 1e-9)]
        run = solve_ivp(
            rate, ends, state, "RK45", rtol=1e-7, atol=1e-12, max_step=1e-4, dense_output=True
        )
        pieces.append(run.sol)
        state = run.y[:, -1]
        found.append(run.sol(within)[:2].T)
    return np.concatenate(found)


def test_steps_that_miss_a_tooth_are_refused() -> None:
    with pytest.raises(ModelError, match="multiple"):
        cutting_phases(cut_of(0.01), 98)
