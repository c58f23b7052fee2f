"""a planar 3-RPR at its singular pose: named, its frequency goes to zero as it should, and a
motion runs through.

``headstock validate singular-passage`` runs it for 20 s.
"""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

from common import approx
from headstock.geometry.errors import SingularPoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import find_mobility
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import linearise_poses, solve_lumped_modes
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.validation.mechanisms.generalized_alpha import (
    LOCAL_ERROR,
    Linearisation,
    MotionState,
    integrate_constrained,
)
from headstock.validation.mechanisms.motion import PartitionedMotion
from headstock.validation.mechanisms.motion_cases import (
    BASE,
    INERTIA,
    INNER,
    OUTER,
    PLATFORM,
    _leg_length,
    _planar_machine,
    _planar_mechanism,
    _swing_through,
)
from headstock.validation.mechanisms.platforms import planar_3rpr_state

pytestmark = pytest.mark.hard("H37")

STIFFNESS = 1e7
MECHANISM = _planar_mechanism()


def machine() -> CompliantMechanism:
    return _planar_machine(STIFFNESS)


def at_rest(lengths: FloatArray) -> Drive:
    return Drive(lengths, np.zeros(3), np.zeros(3))


def no_force(time: float) -> FloatArray:
    return np.zeros(3)


@pytest.mark.parametrize("degrees", [10.0, 1.0, 0.1, 0.01])
def test_the_lowest_frequency_falls_to_zero_as_the_closed_form_does(degrees: float) -> None:
    angle = np.radians(degrees)
    state = planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), angle)
    found = solve_lumped_modes(linearise_poses(machine(), state)).frequencies_hz[0]
    slope = OUTER * INNER * np.sin(angle) / _leg_length(angle)
    assert found == approx(np.sqrt(3.0 * STIFFNESS * slope**2 / INERTIA) / (2.0 * np.pi), rel=1e-8)


def test_the_condition_number_tells_how_near_the_singular_pose_is() -> None:
    numbers = [
        find_mobility(
            MECHANISM, planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), np.radians(d))
        ).passive_condition
        for d in (10, 1, 0.1)
    ]
    assert numbers[1] / numbers[0] == approx(10.0, rel=0.1) and numbers[2] / numbers[1] == approx(
        10.0, rel=0.1
    )
    singular = find_mobility(MECHANISM, planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), 0.0))
    assert singular.passive_condition > 1e14


def test_small_motions_about_the_singular_pose_are_refused_by_name() -> None:
    states = np.array(
        [
            planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), np.radians(degrees))
            for degrees in (5.0, 0.0)
        ]
    )
    with pytest.raises(SingularPoseError, match="singular"):
        linearise_poses(machine(), states)
    assert np.isfinite(
        solve_lumped_modes(linearise_poses(machine(), states[0])).frequencies_hz
    ).all()


def test_partitioned_coordinates_stop_at_the_singular_pose_by_name() -> None:
    start = planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), np.radians(2.0))
    motion = PartitionedMotion(
        machine(), lambda time: at_rest(np.full(3, _leg_length(0.0) - time)), no_force, start
    )
    assert motion.at(-0.0001, np.zeros(3), np.zeros(3)).mass.shape == (3, 3)

    def shorten() -> None:
        for time in np.linspace(0.0, 0.01, 30):
            motion.at(float(time), np.zeros(3), np.zeros(3))

    with pytest.raises(SingularPoseError, match="singular"):
        shorten()


def test_the_full_equations_run_through_the_singular_pose_and_keep_their_energy() -> None:
    # legs too long for the middle: two wells at either side, and a spin that carries the platform
    # over the singular pose
    found = _swing_through(0.3)
    assert found.report.constraint_violation < 1e-14
    assert np.sum(np.diff(np.sign(found.angles)) != 0) >= 2
    assert np.abs(found.energies / found.energies[0] - 1.0).max() < 1e-3
    assert found.violations.max() < 1e-12


class FourBars:
    """Two parallelograms of bars of 1 m and 1 kg side by side, in the places of their three free
    joints.

    Every time all bars lie in one line two more motions become possible (library of benchmarks of
    the IFToMM, "N four-bar mechanism").
    """

    def __init__(self) -> None:
        self.feet = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
        along = np.array(
            [[2.0 / 3.0, 1.0 / 6.0, 0.0], [1.0 / 6.0, 1.0, 1.0 / 6.0], [0.0, 1.0 / 6.0, 2.0 / 3.0]]
        )
        self.mass = np.kron(along, np.eye(2))
        self.weight = np.array([0.0, -1.0, 0.0, -1.5, 0.0, -1.0]) * 9.81

    def constraints(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Half the squares of the bars' lengths less one ``(5,)``, and their derivatives ``(5,
        6)``.
        """
        joints = position.reshape(3, 2)
        bars = np.vstack([joints - self.feet, np.diff(joints, axis=0)])
        ends = np.vstack([np.eye(3), np.diff(np.eye(3), axis=0)])
        return 0.5 * ((bars**2).sum(axis=1) - 1.0), (ends[:, :, None] * bars[:, None, :]).reshape(
            5, 6
        )

    def residual(self, state: MotionState) -> tuple[FloatArray, FloatArray]:
        violation, slopes = self.constraints(state.position)
        return (
            self.mass @ state.acceleration - self.weight + slopes.T @ state.multipliers,
            violation,
        )

    def linearise(self, state: MotionState) -> Linearisation:
        ends = np.vstack([np.eye(3), np.diff(np.eye(3), axis=0)])
        stiffness = np.kron((ends.T * state.multipliers) @ ends, np.eye(2))
        return Linearisation(
            self.mass, np.zeros((6, 6)), stiffness, self.constraints(state.position)[1]
        )

    def energy(self, state: MotionState) -> float:
        return float(
            0.5 * state.velocity @ self.mass @ state.velocity - self.weight @ state.position
        )

    def start(self) -> MotionState:
        position, velocity = (self.feet + np.array([0.0, 1.0])).ravel(), np.tile([1.0, 0.0], 3)
        slopes = self.constraints(position)[1]
        matrix = np.block([[self.mass, slopes.T], [slopes, np.zeros((5, 5))]])
        found = np.linalg.solve(matrix, np.concatenate([self.weight, [-1.0, -1.0, -1.0, 0.0, 0.0]]))
        return MotionState(0.0, position, velocity, found[:6], found[6:])


STEPS = (
    *(0.005, 0.0125, 0.0225, 0.03, 0.04),
    *(
        pytest.param(step, marks=pytest.mark.trials)
        for step in (0.01, 0.015, 0.0175, 0.02, 0.025, 0.0275, 0.0325, 0.035)
    ),
)


def swing(
    step: float, span: float, accuracy: float = LOCAL_ERROR
) -> tuple[FourBars, list[MotionState]]:
    problem = FourBars()
    states: list[MotionState] = []
    integrate_constrained(
        problem,
        problem.start(),
        step,
        round(span / step),
        observe=states.append,
        tolerance=1e-12,
        accuracy=accuracy,
    )
    return problem, states


def bar_angles(states: list[MotionState]) -> FloatArray:
    """Of the first bar from upright [rad]."""
    return np.asarray(
        np.unwrap([np.arctan2(state.position[0], state.position[1]) for state in states]),
        dtype=np.float64,
    )


@pytest.mark.parametrize("step", STEPS)
def test_a_linkage_passes_the_poses_in_which_it_may_fold_with_any_step(step: float) -> None:
    problem, states = swing(step, 12.0)
    heights = np.array([state.position[1] for state in states])
    assert np.sum(np.diff(np.sign(heights)) != 0) >= 5
    assert max(np.abs(problem.constraints(state.position)[0]).max() for state in states) < 1e-10
    # it stays a parallelogram
    assert (
        max(
            np.abs(state.position.reshape(3, 2) - problem.feet - state.position[:2]).max()
            for state in states
        )
        < 1e-9
    )
    drift = max(
        abs(problem.energy(state) - problem.energy(problem.start()))
        for state in states[: round(5.0 / step)]
    )
    # second order in the step: 34 J are at play
    assert drift < 2.0 * (step / 0.01) ** 2


@pytest.fixture(scope="module")
def pendulum() -> Callable[[FloatArray], FloatArray]:
    """Angle of the bars at times: three bars' inertia on one coordinate, by a Runge-Kutta method of
    order 8.
    """

    def rates(time: float, state: FloatArray) -> list[float]:
        return [float(state[1]), 3.5 * 9.81 / 3.0 * float(np.sin(state[0]))]

    done = scipy.integrate.solve_ivp(
        rates, (0.0, 4.1), [0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-12, dense_output=True
    )
    return lambda times: np.asarray(done.sol(times)[0])


@pytest.mark.parametrize("step", STEPS)
def test_with_a_local_error_asked_for_every_step_gives_the_same_motion(
    step: float, pendulum: Callable[[FloatArray], FloatArray]
) -> None:
    problem, states = swing(step, 4.0, accuracy=1e-7)
    assert (
        max(abs(problem.energy(state) - problem.energy(problem.start())) for state in states) < 0.01
    )
    off = bar_angles(states) - pendulum(np.array([state.time for state in states]))
    assert np.abs(off).max() < 0.01


def test_a_step_may_end_in_the_singular_pose_itself() -> None:
    def height(step: float) -> float:
        return float(swing(step, 20.0 * step)[1][-1].position[1])

    step = float(scipy.optimize.brentq(height, 0.034, 0.038, xtol=1e-16))
    problem, states = swing(step, 60.0 * step)
    assert abs(states[19].position[1]) < 1e-12
    assert (
        max(
            np.abs(state.position.reshape(3, 2) - problem.feet - state.position[:2]).max()
            for state in states
        )
        < 1e-9
    )


@pytest.mark.parametrize("weight", [(1.0, 3.0, 1.0), (1.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
def test_a_motion_that_branches_where_it_rests_ends_with_a_name_and_a_remedy(
    weight: tuple[float, float, float],
) -> None:
    problem = FourBars()
    problem.weight[1::2] = -9.81 * np.array(weight)
    lying = (problem.feet + np.array([1.0, 0.0])).ravel()
    slopes = problem.constraints(lying)[1]
    matrix = np.block([[problem.mass, slopes.T], [slopes, np.zeros((5, 5))]])
    found = np.linalg.lstsq(matrix, np.concatenate([problem.weight, np.zeros(5)]), rcond=1e-12)[0]
    start = MotionState(0.0, lying, np.zeros(6), found[:6], found[6:])
    with pytest.raises(ConvergenceError, match=r"singular pose.*more speed"):
        integrate_constrained(problem, start, 0.01, 10, observe=lambda state: None, tolerance=1e-12)


def test_a_force_that_has_no_answer_is_not_taken_for_a_singular_pose() -> None:
    problem = FourBars()
    start = problem.start()
    # weights that are not numbers: no sub-step is small enough
    problem.weight = np.full(6, np.nan)
    with pytest.raises(ConvergenceError, match="The pose is not singular"):
        integrate_constrained(problem, start, 0.01, 10, observe=lambda state: None)
