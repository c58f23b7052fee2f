"""constraints of an index-3 solution must not drift; ten thousand steps are in
test_mechanism_cases.py, a million a command.
"""

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.solvers.motion.alpha import AlphaScheme
from headstock.validation.mechanisms.generalized_alpha import (
    MotionState,
    integrate_constrained,
)
from headstock.validation.mechanisms.motion import ConstrainedMotion, PartitionedMotion
from headstock.validation.mechanisms.tripteor_machine import load_tripteor

pytestmark = pytest.mark.hard("H35")

STEPS = 700


def test_positions_velocities_and_energy_stay_with_drives_at_rest() -> None:
    tripteor = load_tripteor()
    model, start = tripteor.model, tripteor.poses["config_3"]
    driven = start[model.mechanism.driven_slice]

    def still(time: float) -> Drive:
        return Drive(driven, np.zeros_like(driven), np.zeros_like(driven))

    def no_force(time: float) -> FloatArray:
        return np.zeros(3)

    reduced, full = (
        PartitionedMotion(model, still, no_force, start),
        ConstrainedMotion(model, still, no_force),
    )
    compliant = np.array([0.0, 4e-5, 0.0, 5e-5, 0.0, -6e-5])
    first = reduced.at(0.0, compliant, np.zeros(6))
    begun = full.start(0.0, first.state[full.free], first.rates[full.free])
    energy, position, velocity = [reduced.energy(0.0, compliant, np.zeros(6))], 0.0, 0.0

    def observe(state: MotionState) -> None:
        nonlocal position, velocity
        position = max(position, float(np.abs(full.residual(state)[1]).max()))
        dynamics, _, _ = full.evaluate(state)
        velocity = max(
            velocity, float(np.abs(dynamics.closure_jacobian[:, full.free] @ state.velocity).max())
        )
        if round(state.time / 4e-5) % 20 == 0:
            energy.append(reduced.energy(state.time, state.position[-6:], state.velocity[-6:]))

    integrate_constrained(full, begun, 4e-5, STEPS, observe=observe, scheme=AlphaScheme(1.0))
    assert position < 1e-12 and velocity < 1e-7
    stored = 0.5 * float((first.stiffness * compliant**2).sum())
    # second order: an oscillation of the fastest mode, no trend
    assert np.ptp(energy) < 0.02 * stored
    assert abs(np.mean(energy[-10:]) - np.mean(energy[:10])) < 0.01 * stored
