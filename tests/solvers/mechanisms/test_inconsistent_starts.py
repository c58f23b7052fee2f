"""a start that does not meet the closures is projected and reported; a jump of the load leaves
no spike.
"""

import numpy as np
import pytest

from common import approx
from headstock.geometry.errors import ClosureError
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.solvers.milling.contouring import linear_motion
from headstock.solvers.milling.path_drives import follow_path
from headstock.solvers.milling.tool_path import SquareContour, plan_contour
from headstock.solvers.motion.alpha import integrate_linear
from headstock.validation.mechanisms.generalized_alpha import MotionState, integrate_constrained
from headstock.validation.mechanisms.motion import ConstrainedMotion, project_start
from headstock.validation.mechanisms.tripteor_machine import Tripteor, load_tripteor

pytestmark = pytest.mark.hard("H36")


@pytest.fixture(scope="module")
def machine() -> Tripteor:
    return load_tripteor()


@pytest.fixture(scope="module")
def problem(machine: Tripteor) -> ConstrainedMotion:
    driven = machine.poses["config_1"][machine.model.mechanism.driven_slice]
    rest = np.zeros_like(driven)
    return ConstrainedMotion(
        machine.model, lambda time: Drive(driven, rest, rest), lambda time: np.zeros(3)
    )


def test_a_wrong_start_is_projected_and_the_correction_reported(
    machine: Tripteor, problem: ConstrainedMotion
) -> None:
    exact = machine.poses["config_1"][problem.free]
    wrong, speed = exact.copy(), np.zeros_like(exact)
    wrong[:9] += 1e-3
    speed[:9] += 0.05
    start, report = project_start(problem, 0.0, wrong, speed)
    assert 1e-4 < report.constraint_violation < 1e-2 and report.moved == approx(1e-3, rel=0.01)
    assert report.open_rates > 1e-3 and report.slowed > 1e-3
    assert np.allclose(start.position, exact, atol=1e-13)
    dynamics, _, _ = problem.evaluate(start)
    assert np.abs(dynamics.closure_jacobian[:, problem.free] @ start.velocity).max() < 1e-14


def test_a_projected_start_leaves_no_spike_in_the_accelerations(
    machine: Tripteor, problem: ConstrainedMotion
) -> None:
    wrong = machine.poses["config_1"][problem.free].copy()
    wrong[:9] += 1e-3
    start, _ = project_start(problem, 0.0, wrong, np.zeros_like(wrong))
    seen: list[float] = [float(np.abs(start.acceleration[-6:]).max())]

    def observe(state: MotionState) -> None:
        seen.append(float(np.abs(state.acceleration[-6:]).max()))

    integrate_constrained(problem, start, 5e-5, 60, observe=observe)
    assert max(seen[:5]) < 1.5 * max(seen[5:])


def test_a_start_too_far_from_the_closures_is_refused(machine: Tripteor) -> None:
    driven = machine.poses["config_1"][machine.model.mechanism.driven_slice].copy()
    driven[:3] = 0.05, 3.0, 0.05
    rest = np.zeros_like(driven)
    far = ConstrainedMotion(
        machine.model, lambda time: Drive(driven, rest, rest), lambda time: np.zeros(3)
    )
    with pytest.raises(ClosureError, match="Exechon"):
        project_start(far, 0.0, machine.poses["config_1"][far.free], np.zeros(15))


def test_a_jump_of_the_force_swings_to_twice_its_static_answer_and_no_further(
    machine: Tripteor,
) -> None:
    path = plan_contour(SquareContour(0.2, (0.0, 0.0), 0.2, 0.01, 0.02, 5.0 / 60.0, 0.01)).path
    nodes = np.linspace(0.0, 0.1, 26, dtype=np.float64)
    drive = follow_path(machine.scene.mounted, nodes, path.at(nodes), machine.scene.tool)
    times = np.arange(0.0, 0.1, 5e-5, dtype=np.float64)
    motion = linear_motion(machine.model, drive, times, PoseDamping((0.02,)))
    force = np.zeros((len(times), 3))
    force[times >= 0.03] = 500.0, 0.0, 0.0
    moved = (
        integrate_linear(motion, motion.load + motion.tool_load(force)).compliant
        - integrate_linear(motion, motion.load).compliant
    )
    static = np.linalg.solve(motion.stiffness[-1], motion.tool_load(force)[-1])
    axial = np.abs(static) > 0.05 * np.abs(static).max()
    assert not moved[times < 0.03].any()
    assert (np.abs(moved[:, axial]).max(axis=0) < 2.2 * np.abs(static[axial])).all()
