"""H37: a planar 3-RPR at its singular pose: named, its frequency goes to zero as it should, and a motion runs through."""

import numpy as np
import pytest

from headstock.geometry.errors import SingularPoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.loop_closures import find_mobility
from headstock.geometry.parallel_platforms import planar_3rpr, planar_3rpr_state
from headstock.solvers.compliant_mechanism import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.coordinate_partitioning import Drive
from headstock.solvers.generalized_alpha import AlphaScheme, MotionState, integrate_motion
from headstock.solvers.mechanism_modes import linearise_poses, solve_pose_modes
from headstock.solvers.mechanism_motion import ConstrainedMotion, PartitionedMotion, project_start

ANGLES = np.radians([90.0, 210.0, 330.0])
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
OUTER, INNER, MASS, INERTIA, STIFFNESS = 1.0, 0.3, 20.0, 0.5, 1e7
BASE, PLATFORM = OUTER * CIRCLE, INNER * CIRCLE
MECHANISM = planar_3rpr(BASE, PLATFORM)


def machine(stiffness: float = STIFFNESS) -> CompliantMechanism:
    springs = LumpedSprings(np.full(3, 1.0 / stiffness), np.zeros(3), np.arange(3, dtype=np.intp), ("leg_1", "leg_2", "leg_3"))
    body = MechanismBody("platform", "platform_1", MASS, inertia=np.diag([0.0, 0.0, INERTIA]))
    return CompliantMechanism(MECHANISM, (body,), springs, tool="platform_1")


def leg_length(angle: float) -> float:
    return float(np.sqrt(OUTER**2 + INNER**2 - 2.0 * OUTER * INNER * np.cos(angle)))


def at_rest(lengths: FloatArray) -> Drive:
    return Drive(lengths, np.zeros(3), np.zeros(3))


def no_force(time: float) -> FloatArray:
    return np.zeros(3)


@pytest.mark.parametrize("degrees", [10.0, 1.0, 0.1, 0.01])
def test_the_lowest_frequency_falls_to_zero_as_the_closed_form_does(degrees: float) -> None:
    angle = np.radians(degrees)
    state = planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), angle)
    found = solve_pose_modes(linearise_poses(machine(), state)).frequencies_hz[0]
    slope = OUTER * INNER * np.sin(angle) / leg_length(angle)
    assert found == pytest.approx(np.sqrt(3.0 * STIFFNESS * slope**2 / INERTIA) / (2.0 * np.pi), rel=1e-8)


def test_the_condition_number_tells_how_near_the_singular_pose_is() -> None:
    numbers = [
        find_mobility(MECHANISM, planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), np.radians(d))).passive_condition
        for d in (10, 1, 0.1)
    ]
    assert numbers[1] / numbers[0] == pytest.approx(10.0, rel=0.1) and numbers[2] / numbers[1] == pytest.approx(10.0, rel=0.1)
    singular = find_mobility(MECHANISM, planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), 0.0))
    assert singular.passive_condition > 1e14


def test_partitioned_coordinates_stop_at_the_singular_pose_by_name() -> None:
    start = planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), np.radians(2.0))
    motion = PartitionedMotion(machine(), lambda time: at_rest(np.full(3, leg_length(0.0) - time)), no_force, start)
    assert motion.at(-0.0001, np.zeros(3), np.zeros(3)).mass.shape == (3, 3)

    def shorten() -> None:
        for time in np.linspace(0.0, 0.01, 30):
            motion.at(float(time), np.zeros(3), np.zeros(3))

    with pytest.raises(SingularPoseError, match="singular"):
        shorten()


def test_the_full_equations_run_through_the_singular_pose_and_keep_their_energy() -> None:
    model = machine(1e5)
    # legs too long for the middle: two wells at either side, and a spin that carries the platform over the singular pose
    lengths = np.full(3, leg_length(np.radians(8.0)))
    problem = ConstrainedMotion(model, lambda time: at_rest(lengths), no_force)
    given = planar_3rpr_state(BASE, PLATFORM, (0.0, 0.0), np.radians(8.0))
    given[:3] = lengths
    closed = given[problem.free]
    speed = np.zeros_like(closed)
    names = [name for name in MECHANISM.coordinates if name not in MECHANISM.driven]
    speed[[names.index(f"ps{leg}") for leg in (1, 2, 3)]] = -6.0
    start, report = project_start(problem, 0.0, closed, speed)
    assert report.open_loops < 1e-14
    angles, energies = [], []

    def observe(state: MotionState) -> None:
        angles.append(state.position[names.index("th1")] + state.position[names.index("ps1")])
        dynamics, coordinates, _ = problem.evaluate(state)
        rates = np.concatenate([np.zeros(3), state.velocity])
        stored = 0.5 * 1e5 * (coordinates[MECHANISM.compliant_slice] ** 2).sum()
        energies.append(0.5 * rates @ dynamics.mass @ rates + stored)

    observe(start)
    integrate_motion(problem, start, 1e-3, 300, observe=observe, scheme=AlphaScheme(1.0))
    crossings = np.sum(np.diff(np.sign(angles)) != 0)
    assert crossings >= 2
    assert np.abs(np.array(energies) / energies[0] - 1.0).max() < 1e-3
