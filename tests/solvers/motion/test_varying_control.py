"""Drives along a path on which the machine changes: where nothing changes the frozen answer, else
that of an integrator in absolute coordinates with controllers written by hand.
"""

import dataclasses
import functools

import numpy as np
import pytest

from common import approx
from direct_integration import integrate_pieces
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, GuideFriction
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import DriveTrain, free_motors
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.motion.closed_loop import (
    ControlledPath,
    RigidTravel,
    VaryingLoop,
    _close_loops_along,
    loop_channels,
    make_loop_table,
    solve_controlled_path,
    solve_path_with_friction,
    solve_varying_control,
    solve_varying_friction,
)
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.friction import friction_force
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.motion.plant import PlantChannels, PosedModes, sample_pose, turn_plant
from headstock.solvers.motion.sampling import sample_plant
from headstock.solvers.motion.set_points import PathLoads, Ramp, SetPoint, sample_move, sample_times
from headstock.solvers.second_order import SecondOrderSystem

pytestmark = pytest.mark.slow

PATH, TIP, PUSH = ("path", "acceleration"), ("tip", "x"), ("tip", "x")
LENGTH, LIMIT_HZ, UP_TO_HZ = 0.08, 4.0, 5000.0
MOVE = SetPoint(LENGTH, 0.5, Ramp("linear", 0.02))
# base, carriage, tool
MASSES = np.diag([300.0, 40.0, 5.0])
TRAVEL = np.array([0.0, 1.0, 1.0])
SCREW, SCREW_DAMPING = 6e7, 900.0
MOTOR, SCREW_TURN, COUPLING = 90.0, 20.0, 9e7
STATOR = np.array([0.03, 0.0, 0.0])
CONTROL = Cascade(
    position_gain=50.0,
    velocity_gain=2e4,
    integral_time=0.015,
    velocity_feed_forward=0.6,
    acceleration_feed_forward=80.0,
    current_lag=3e-4,
)
LAW = GuideFriction(
    coulomb=40.0, breakaway=60.0, stribeck_speed=5e-3, viscous=150.0, smoothing=2e-3
)
# the base stands on the ground and carries the screw's nut; the tool hangs on the carriage
STRETCH = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
LOADS = PathLoads((PUSH,), lambda times, speeds: (30.0 * np.sin(300.0 * times))[:, None], step=1e-4)


@dataclasses.dataclass(frozen=True)
class Case:
    """What is the same along the path, and how much is not."""

    strength: float = 1.0
    friction: GuideFriction | None = None
    control: Cascade = CONTROL
    loads: PathLoads | None = None


def springs_at(case: Case, position: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Springs, dampers, and motion at the tool's tip, which sees the base turn."""
    share = case.strength * position / LENGTH
    springs = np.array([3e7 * (1.0 + 0.8 * share), SCREW, 8e6 * (1.0 + 1.5 * share**2)])
    return springs, np.array([8e3, SCREW_DAMPING, 250.0]), np.array([0.4 * share, 0.0, 1.0])


def locked(case: Case, position: float) -> SecondOrderSystem:
    springs, dampers, row = springs_at(case, position)
    return SecondOrderSystem(
        MASSES,
        STRETCH.T @ np.diag(dampers) @ STRETCH,
        STRETCH.T @ np.diag(springs) @ STRETCH,
        {PUSH: row},
        {TIP: row},
        ("base", "carriage", "tool"),
    )


def make_train(case: Case) -> DriveTrain:
    return DriveTrain(
        name="X", axis="X", joint="screw", control=case.control.control, stretch=STRETCH[1],
        stiffness=SCREW, thread=SCREW, slide=STRETCH[1], scale=STRETCH[1], stator=STATOR,
        motor_mass=MOTOR, screw_mass=SCREW_TURN, coupling=COUPLING, damping=SCREW_DAMPING,
        friction=case.friction,
    )  # fmt: skip


def place(case: Case, position: float) -> PosedModes:
    train = make_train(case)
    system = free_motors(locked(case, position), [train])
    turns = np.zeros((2, 5))
    turns[:, :3], turns[:, 3:] = STATOR, np.eye(2)
    nominal = np.concatenate([TRAVEL, [1.0, 1.0]])
    system = dataclasses.replace(system, inputs={**system.inputs, PATH: -system.mass @ nominal})
    modes = solve_modal(system)
    motions = np.vstack([modes.shapes[:3], turns @ modes.shapes])
    heavy = np.concatenate([MASSES.diagonal(), [MOTOR, SCREW_TURN]])
    return PosedModes(system, modes, motions, heavy[:, None] * motions)


def make_loop(case: Case) -> VaryingLoop:
    train = make_train(case)
    loads = (PUSH,) if case.loads else ()
    channels = loop_channels([train], path=PATH, loads=loads, outputs=(TIP,), up_to_hz=UP_TO_HZ)
    plant = sample_plant(functools.partial(place, case), LENGTH, channels)
    return VaryingLoop(
        plant,
        PATH,
        (TIP,),
        (train,),
        (RigidTravel(1.0, 1.0, 1.0, 1.0),),
        LIMIT_HZ,
        case.loads,
    )


def freeze(case: Case, position: float) -> ControlledPath:
    train = make_train(case)
    loads = (PUSH,) if case.loads else ()
    loop = close_loops(
        free_motors(locked(case, position), [train]),
        [train],
        inputs=(*loads, *friction_channels((train,))),
        outputs=(TIP,),
    )
    return ControlledPath(loop, (TIP,), {"X": 1.0}, np.ones(1), LIMIT_HZ, case.loads)


def samples(rate: float = 2500.0) -> FloatArray:
    return sample_times(MOVE, rate, 0.05)


def stand(time: float) -> tuple[float, float, float]:
    """Position, speed and acceleration: constant acceleration, speed, deceleration."""
    if time < 0.02:
        return 12.5 * time**2, 25.0 * time, 25.0
    if time < 0.16:
        return 0.005 + 0.5 * (time - 0.02), 0.5, 0.0
    left = max(0.18 - time, 0.0)
    return LENGTH - 12.5 * left**2, 25.0 * left, -25.0 if left else 0.0


def integrate(case: Case, times: FloatArray) -> FloatArray:
    """Deviation in absolute coordinates: base, carriage, tool, motor, screw; then the integrator
    and the current.
    """
    mass = np.zeros((5, 5))
    mass[:3, :3] = MASSES
    for number, inertia in ((3, MOTOR), (4, SCREW_TURN)):
        turn = np.concatenate([STATOR, np.zeros(2)])
        turn[number] = 1.0
        mass += inertia * np.outer(turn, turn)
    inverse = np.linalg.inv(mass)
    law = case.friction or GuideFriction()
    control = case.control

    def rate(time: float, state: FloatArray) -> FloatArray:
        at, speed, pull = stand(time)
        springs, dampers, row = springs_at(case, at)
        places, rates, (total, current) = state[:5], state[5:10], state[10:]
        force = np.zeros(5)
        for number, (spring, damper) in enumerate(zip(springs, dampers, strict=True)):
            strain, strain_rate = STRETCH[number] @ places[:3], STRETCH[number] @ rates[:3]
            back = STRETCH[number]
            if number == 1:
                strain, strain_rate = strain - places[4], strain_rate - rates[4]
                force[4] += spring * strain + damper * strain_rate
            force[:3] -= (spring * strain + damper * strain_rate) * back
        twist = COUPLING * (places[3] - places[4])
        force[3] += current - twist
        force[4] += twist
        evaluate_friction = friction_force(law, np.array(STRETCH[1] @ rates[:3]))
        force[:3] -= float(evaluate_friction) * STRETCH[1]
        if case.loads is not None:
            force[:3] += float(case.loads.at(np.array([time]), np.array([speed]))[0, 0]) * row
        wanted = control.position_gain * (at - places[3]) + control.velocity_feed_forward * speed
        error = wanted - rates[3]
        asked = control.velocity_gain * error + total + control.acceleration_feed_forward * pull
        integrated = control.velocity_gain / control.integral_time * error
        lagging = (asked - current) / control.current_lag
        return np.array([*rates, *(inverse @ force), integrated, lagging])

    breaks = [*(edge for edge in (0.0, 0.02, 0.16, 0.18) if edge < times[-1]), float(times[-1])]
    method = "DOP853" if case.friction is None else "Radau"
    found = integrate_pieces(rate, breaks, np.zeros(12), times, method=method, atol=1e-11)
    positions = sample_move(MOVE, times).positions
    rows = np.array([springs_at(case, float(at))[2] for at in positions])
    return np.asarray(np.einsum("nm,nm->n", rows, found[:, :3]) - positions)


def parts_agree(found: PathDeviation, expected: PathDeviation, share: float) -> None:
    size = np.abs(expected.total).max()
    for part in ("total", "quasi_static", "low_frequency", "dynamic"):
        np.testing.assert_allclose(
            getattr(found, part), getattr(expected, part), atol=share * size, err_msg=part
        )


@pytest.mark.parametrize("dead_time", [0.0, 3e-4])
@pytest.mark.parametrize("loads", [None, LOADS])
def test_where_nothing_changes_the_answer_is_the_frozen_one(
    dead_time: float, loads: PathLoads | None
) -> None:
    control = dataclasses.replace(CONTROL, dead_time=dead_time)
    case = Case(strength=0.0, control=control, loads=loads)
    frozen = solve_controlled_path(freeze(case, 0.0), MOVE, samples())
    parts_agree(solve_varying_control(make_loop(case), MOVE, samples()), frozen, 1e-9)


def test_a_changing_machine_follows_an_integrator_in_absolute_coordinates() -> None:
    case = Case(loads=LOADS)
    times = samples()
    found = solve_varying_control(make_loop(case), MOVE, times)
    reference = integrate(case, times)
    # the lag is large beside what the pose changes, so both are measured
    frozen = solve_controlled_path(freeze(case, 0.5 * LENGTH), MOVE, times).total[:, 0]
    effect = np.abs(frozen - reference).max()
    assert effect > 1e-3 * np.abs(reference).max()
    np.testing.assert_allclose(found.total[:, 0], reference, atol=2e-3 * effect)


@pytest.mark.trials
def test_with_friction_it_follows_that_integrator_too() -> None:
    case = Case(friction=LAW)
    times = samples(500.0)
    times = times[times <= 0.05]
    found, motion = solve_varying_friction(make_loop(case), MOVE, times)
    reference = integrate(case, times)
    effect = np.abs(
        solve_path_with_friction(freeze(case, 0.5 * LENGTH), MOVE, times)[0].total[:, 0] - reference
    ).max()
    np.testing.assert_allclose(found.total[:, 0], reference, atol=2e-3 * effect)
    smooth = solve_varying_control(make_loop(case), MOVE, times)
    assert np.abs(found.total - smooth.total).max() > 0.1 * effect
    # the work of the change of pose is needed for the balance
    energy = motion.energy
    assert energy.error < 1e-7
    without = dataclasses.replace(energy, pose=np.zeros_like(energy.pose))
    assert without.error > 100.0 * energy.error


def test_parts_are_those_of_the_pose() -> None:
    """At constant speed the drive lags by what feed-forward leaves of v / kv, in every pose."""
    case = Case()
    loop = make_loop(case)
    found = solve_varying_control(loop, MOVE, samples())
    number = int(np.searchsorted(found.times, 0.1))
    lag = (1.0 - CONTROL.velocity_feed_forward) * MOVE.feed / CONTROL.position_gain
    assert found.quasi_static[number, 0] == approx(-lag, rel=1e-9)
    np.testing.assert_allclose(
        found.quasi_static + found.low_frequency + found.dynamic, found.total, atol=1e-16
    )


def test_a_pole_that_passes_the_limit_on_the_way_counts_as_what_it_is_all_along() -> None:
    """The base sways at 48 to 64 Hz; all else is below 18 Hz or above 170 Hz."""
    loop = make_loop(Case())
    passed, above = (
        solve_varying_control(
            dataclasses.replace(loop, low_frequency_limit_hz=limit), MOVE, samples(1000.0)
        )
        for limit in (55.0, 100.0)
    )
    np.testing.assert_array_equal(passed.low_frequency, above.low_frequency)
    np.testing.assert_array_equal(passed.quasi_static, above.quasi_static)


def test_poles_between_sampled_poses_are_those_of_the_machine_there() -> None:
    case = Case()
    loop = make_loop(case)
    places = [float(place) for place in np.linspace(0.0, LENGTH, 9) * 0.93]
    own = np.array([np.linalg.eigvals(freeze(case, place).loop.space.a) for place in places])
    found = np.array(
        [np.linalg.eigvals(_close_loops_along(loop, place).space.a) for place in places]
    )
    missed = np.abs(found[:, :, None] - own[:, None]).min(axis=2)
    assert (missed <= 1e-6 * np.abs(found)).all()


def test_a_floating_machine_is_refused() -> None:
    case = Case()
    loop = make_loop(case)
    free = np.zeros_like(loop.plant.at(0.0).stiffness)
    spline = loop.plant.splines["stiffness"]
    splines = loop.plant.splines | {"stiffness": type(spline)([0.0, 0.04, LENGTH], [free] * 3)}
    floating = dataclasses.replace(loop, plant=dataclasses.replace(loop.plant, splines=splines))
    with pytest.raises(Exception, match="the machine floats"):
        make_loop_table(floating, 4e-4)


def test_a_travel_that_bends_nothing_is_not_followed_to_its_roundoff() -> None:
    """Of a free chain that is pulled at every mass, elastic modes take nothing but roundoff, which no
    number of poses makes smooth.
    """
    heavy, size = np.diag([3.0, 1.0, 2.0, 0.7]), 4
    stiffness = np.zeros((size, size))
    for number, spring in enumerate((1e6, 2e6, 3e7)):
        apart = np.eye(size)[number + 1] - np.eye(size)[number]
        stiffness += spring * np.outer(apart, apart)
    end = ("last", "x")
    pulled = {PATH: -heavy @ np.ones(size), end: np.eye(size)[-1]}
    rows = {("first", "x"): np.eye(size)[0], end: np.eye(size)[-1]}
    system = SecondOrderSystem(heavy, None, stiffness, pulled, rows, tuple("abcd"))
    modes = solve_modal(system)
    channels = PlantChannels((PATH, end), (("first", "x"), end), up_to_hz=400.0)
    posed = sample_pose(PosedModes(system, modes, modes.shapes, heavy @ modes.shapes), channels)
    found = turn_plant(posed, np.eye(3))
    assert found.direct.any()  # the fourth mode is left out
    travel, force = np.abs(found.sizes()["direct"]).T
    assert np.abs(found.direct[:, 0]).max() < 1e-6 * travel.min()
    # what a force does at once is much more than that
    assert 1e-3 < np.abs(found.direct[1, 1]) / force[1] < 1.0
