"""Geometric stiffness from gravity: a pendulum in closed form, and the Tripteor against its own
nonlinear forces.
"""

import dataclasses

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.mechanism import (
    Marker,
    Mechanism,
    PointConstraint,
    prismatic,
    revolute,
)
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.mechanisms.modes import (
    _gravity_stiffness,
    linearise_poses,
    pose_system,
    solve_lumped_modes,
    tool_compliance,
)
from headstock.solvers.mechanisms.partitioning import Drive, compose_state, partition_dynamics
from headstock.validation.mechanisms.tripteor_machine import load_tripteor

LENGTH, MASS, SPRING, G = 0.7, 3.0, 40.0, 9.81


def pendulum(stiffening: bool, sign: float) -> CompliantMechanism:
    """A point mass on a rod that hangs (or stands) on a torsion spring, its place driven along
    x.
    """
    chain = (prismatic("x", "u"), revolute("y", "d"), prismatic("z", -sign * LENGTH), Marker("bob"))
    # a second chain that closes a loop through a passive coordinate, so that closures take part
    other = (prismatic("x", "u"), prismatic("x", "v"), Marker("end"))
    mechanism = Mechanism(
        "pendulum", (chain, other), (PointConstraint("bob", "end", ("x",)),), ("u",), ("d",)
    )
    springs = LumpedSprings(
        np.array([1.0 / SPRING]), np.zeros(1), np.zeros(1, dtype=np.intp), ("hinge",)
    )
    gravity = np.array([0.0, 0.0, -G])
    body = MechanismBody("bob", "bob", MASS)
    return CompliantMechanism(
        mechanism, (body,), springs, tool="bob", gravity=gravity, gravity_stiffening=stiffening
    )


@pytest.mark.parametrize("stiffening", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pendulum_hangs_stiffer_and_stands_softer(sign: float, stiffening: bool) -> None:
    state = np.zeros(3)
    stiffness = SPRING + sign * stiffening * MASS * G * LENGTH
    expected = np.sqrt(stiffness / (MASS * LENGTH**2)) / (2.0 * np.pi)
    model = pendulum(stiffening, sign)
    motions = linearise_poses(model, state)
    assert solve_lumped_modes(motions).frequencies_hz[0] == approx(expected, rel=1e-12)
    assert solve_modal(pose_system(model, motions, {}), count=1).frequencies_hz[0] == approx(
        expected, rel=1e-12
    )
    assert tool_compliance(model, motions)[0, 0] == approx(LENGTH**2 / stiffness, rel=1e-12)


def test_it_is_the_slope_of_the_tripteors_own_gravity_forces() -> None:
    tripteor = load_tripteor()
    model, states = tripteor.model, np.stack(list(tripteor.poses.values()))
    found = _gravity_stiffness(model, states)
    assert np.abs(found - np.swapaxes(found, -1, -2)).max() < 1e-9 * np.abs(found).max()

    def load(compliant: FloatArray) -> FloatArray:
        still = np.zeros((len(states), 5))
        driven = states[:, model.mechanism.driven_slice]
        state, kinematics = compose_state(
            model.mechanism, driven, np.broadcast_to(compliant, (len(states), 6)), states
        )
        drive, rates = Drive(driven, still, still), np.zeros((len(states), 6))
        return partition_dynamics(
            model, state, kinematics, drive, rates=rates, force=np.zeros(3)
        ).load

    step = 1e-5
    slopes = np.stack(
        [(load(step * unit) - load(-step * unit)) / (2.0 * step) for unit in np.eye(6)], axis=-1
    )
    assert np.abs(-slopes - found).max() < 1e-6 * np.abs(found).max()
    # kilonewtons on metres: small beside springs of 1e8 N/m, as it should be
    assert 1e2 < np.abs(found).max() < 1e4
    stiff = solve_lumped_modes(
        linearise_poses(dataclasses.replace(model, gravity_stiffening=True), states)
    ).frequencies_hz
    plain = solve_lumped_modes(linearise_poses(model, states)).frequencies_hz
    assert 1e-6 < np.abs(stiff / plain - 1.0).max() < 1e-3
