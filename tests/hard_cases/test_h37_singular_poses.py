"""H37: a planar 3-RPR at its singular pose: named, its frequency goes to zero as it should, and a motion runs through.

``headstock validate singular-passage`` runs it for 20 s.
"""

import numpy as np
import pytest

from headstock.geometry.errors import SingularPoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.loop_closures import find_mobility
from headstock.geometry.parallel_platforms import planar_3rpr_state
from headstock.solvers.compliant_mechanism import CompliantMechanism
from headstock.solvers.coordinate_partitioning import Drive
from headstock.solvers.mechanism_modes import linearise_poses, solve_pose_modes
from headstock.solvers.mechanism_motion import PartitionedMotion
from headstock.validation.singular_cases import (
    BASE,
    INERTIA,
    INNER,
    OUTER,
    PLATFORM,
    leg_length,
    planar_machine,
    planar_mechanism,
    swing_through,
)

STIFFNESS = 1e7
MECHANISM = planar_mechanism()


def machine() -> CompliantMechanism:
    return planar_machine(STIFFNESS)


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
    # legs too long for the middle: two wells at either side, and a spin that carries the platform over the singular pose
    found = swing_through(0.3)
    assert found.report.open_loops < 1e-14
    assert np.sum(np.diff(np.sign(found.angles)) != 0) >= 2
    assert np.abs(found.energies / found.energies[0] - 1.0).max() < 1e-3
    assert found.violations.max() < 1e-12
