from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import (
    close_chains,
    closure_bias,
    closure_residual,
    evaluate_kinematics,
    find_mobility,
)
from headstock.geometry.mechanisms.exechon import ExechonDimensions, exechon_mechanism
from headstock.geometry.mechanisms.kinematics import marker_bias, place_markers
from headstock.geometry.mechanisms.mechanism import (
    CoordinateConstraint,
    Marker,
    Mechanism,
    OrientationConstraint,
    PointConstraint,
    prismatic,
    revolute,
)
from headstock.validation.mechanisms.platforms import hexapod, planar_3rpr, tricept

EXECHON = exechon_mechanism(
    ExechonDimensions(
        (-0.44, 0.78, 0.35),
        (-0.15, 0.25, 0.13),
        (0.1, 0.15),
        (0.04, 0.02),
        (0.28, 0.33),
        tool_length=0.31,
    )
)
BASE, PLATFORM = (
    np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]]),
    np.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]]),
)
CIRCLE = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([0, 20, 120, 140, 240, 260])])
SIX = hexapod(CIRCLE, 0.5 * CIRCLE[[5, 2, 1, 4, 3, 0]])
TRIPOD = tricept(CIRCLE[::2], 0.3 * CIRCLE[::2])
ALL = [EXECHON, planar_3rpr(BASE, PLATFORM), SIX, TRIPOD]


def complex_step(function: Callable[[FloatArray], FloatArray], state: FloatArray) -> FloatArray:
    columns = []
    for index in range(len(state)):
        moved = state.astype(complex)
        moved[index] += 1e-40j
        columns.append(np.asarray(function(moved)).imag / 1e-40)
    return np.stack(columns, axis=-1)


def random_motion(mechanism: Mechanism, seed: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=len(mechanism.coordinates)), rng.normal(size=len(mechanism.coordinates))


@pytest.mark.parametrize("mechanism", ALL, ids=lambda mechanism: mechanism.name)
@given(seed=st.integers(0, 2**31))
@settings(max_examples=5, deadline=None)
def test_jacobians_are_those_of_the_complex_step(mechanism: Mechanism, seed: int) -> None:
    state, _ = random_motion(mechanism, seed)
    found = evaluate_kinematics(mechanism, state)
    closures = complex_step(lambda q: closure_residual(mechanism, q), state)
    places = complex_step(lambda q: place_markers(mechanism, q).positions, state)
    size = max(1.0, np.abs(closures).max(), np.abs(places).max())
    assert np.abs(found.closure_jacobian - closures).max() < 1e-12 * size
    assert np.abs(found.of_position - places).max() < 1e-12 * size


@pytest.mark.parametrize("mechanism", ALL, ids=lambda mechanism: mechanism.name)
def test_bias_is_the_second_derivative_along_constant_rates(mechanism: Mechanism) -> None:
    state, rates = random_motion(mechanism, 7)
    placement = place_markers(mechanism, state)
    bias = marker_bias(placement, rates)
    closures = complex_step(lambda q: evaluate_kinematics(mechanism, q).closure_jacobian, state)
    places = complex_step(lambda q: evaluate_kinematics(mechanism, q).of_position, state)
    turns = complex_step(lambda q: evaluate_kinematics(mechanism, q).of_rotation, state)
    gamma = np.einsum("ijk,j,k->i", closures, rates, rates)
    assert np.allclose(closure_bias(mechanism, placement, bias), gamma, rtol=1e-12, atol=1e-12)
    assert np.allclose(
        bias.acceleration, np.einsum("pijk,j,k->pi", places, rates, rates), rtol=1e-12, atol=1e-12
    )
    assert np.allclose(
        bias.alpha, np.einsum("pijk,j,k->pi", turns, rates, rates), rtol=1e-12, atol=1e-12
    )


def test_a_batch_gives_what_its_states_give_one_by_one() -> None:
    rng = np.random.default_rng(1)
    states, rates = rng.normal(size=(2, 2, 3, len(EXECHON.coordinates)))
    together = evaluate_kinematics(EXECHON, states)
    bias = marker_bias(together.placement, rates)
    gamma = closure_bias(EXECHON, together.placement, bias)
    flat = states.reshape(6, -1), rates.reshape(6, -1)
    alone = [evaluate_kinematics(EXECHON, state) for state in flat[0]]
    jacobians = [one.closure_jacobian for one in alone]
    own = [marker_bias(one.placement, rate) for one, rate in zip(alone, flat[1], strict=True)]
    biases = [closure_bias(EXECHON, a.placement, b) for a, b in zip(alone, own, strict=True)]
    np.testing.assert_allclose(
        [*together.closure_jacobian[0], *together.closure_jacobian[1]], jacobians, atol=1e-14
    )
    np.testing.assert_allclose([*gamma[0], *gamma[1]], biases, atol=1e-12)


def straight_legs(mechanism: Mechanism, base: FloatArray, pose: dict[str, float]) -> FloatArray:
    """State with the platform in a pose and its legs from joint to joint."""
    state = np.array([pose.get(name, 0.0) for name in mechanism.coordinates])
    placement = place_markers(mechanism, state)
    for number, foot in enumerate(base, 1):
        leg = placement.positions[mechanism.markers.index(f"foot_{number}")] - foot
        length = float(np.linalg.norm(leg))
        values = {"q": length, "be": np.arcsin(leg[0] / length), "al": np.arctan2(-leg[1], leg[2])}
        for name, value in values.items():
            state[mechanism.index(f"{name}{number}")] = value
    return state


@pytest.mark.parametrize(("mechanism", "base", "freedom"), [
    (TRIPOD, CIRCLE[::2], 3), (SIX, CIRCLE, 6),
], ids=["Tricept", "hexapod"])  # fmt: skip
def test_other_machines_are_data(mechanism: Mechanism, base: FloatArray, freedom: int) -> None:
    pose = {"x": 0.1, "y": -0.05, "z": 1.0, "rx": 0.1, "ry": -0.2, "rz": 0.05}
    state = straight_legs(mechanism, base, pose)
    assert np.abs(closure_residual(mechanism, state)).max() < 1e-15
    nearby = state.copy()
    nearby[mechanism.passive_slice] += 0.02
    assert np.allclose(close_chains(mechanism, nearby), state, atol=1e-11)
    mobility = find_mobility(mechanism, state)
    assert (mobility.freedom, mobility.redundant) == (freedom, 0)
    assert mobility.passive_condition < 100.0


@pytest.mark.parametrize(("change", "message"), [
    ({"driven": ("nothing",)}, "different ones of the chains"),
    ({"closures": (CoordinateConstraint({"x": 1.0, "who": 1.0}),)}, "names who"),
    ({"closures": (PointConstraint("end", "somewhere"),)}, "names somewhere"),
    ({"closures": (OrientationConstraint("end", "end", ("x",)), PointConstraint("end", "end", frame="off"))}, "names off"),
    ({"chains": ((prismatic("x", "x"), Marker("end"), Marker("end")),)}, "named twice"),
])  # fmt: skip
def test_a_mechanism_with_a_wrong_name_is_refused(change: dict[str, Any], message: str) -> None:
    data: dict[str, Any] = {
        "chains": ((revolute("z", "x"), Marker("end")),),
        "closures": (),
        "driven": ("x",),
    }
    with pytest.raises(ValueError, match=message):
        Mechanism("test", **(data | change))
