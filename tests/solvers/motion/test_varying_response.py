"""Systems that change along a path: where nothing changes the frozen answer, else that of an
integrator at tight tolerance.
"""

import dataclasses

import numpy as np
import pytest

from common import approx
from direct_integration import integrate_pieces
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.exact import (
    PathModel,
    _step_pose,
    make_step_table,
    solve_path,
    solve_varying_path,
)
from headstock.solvers.motion.plant import PosedModes, VaryingSystem
from headstock.solvers.motion.sampling import sample_system
from headstock.solvers.motion.set_points import PathLoads, Ramp, SetPoint, sample_move, sample_times
from headstock.solvers.second_order import SecondOrderSystem

pytestmark = pytest.mark.slow

SOURCE, TIP = ("path", "acceleration"), ("tip", "x")
LENGTH = 0.08
# 30 g would be needed to stop a machine so: much happens within a few periods
MOVE = SetPoint(LENGTH, 0.5, Ramp("linear", 0.02))
MODEL = PathModel(SOURCE, (TIP,), low_frequency_limit_hz=50.0, up_to_hz=2000.0)
MASSES = np.diag([30.0, 20.0, 5.0])
PUSHED = np.array([0.0, 0.0, 1.0])


def place_bare(position: float, strength: float = 1.0) -> SecondOrderSystem:
    """Three masses in a row; a spring, a damper, the load and the place of observation change along
    the path.
    """
    share = strength * position / LENGTH
    springs = np.array([2e7 * (1.0 + 0.5 * share), 8e6, 4e6 * (1.0 + share**2)])
    stretch = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    stiffness = stretch.T @ np.diag(springs) @ stretch
    damping = stretch.T @ np.diag([800.0, 300.0 * (1.0 + share), 200.0]) @ stretch
    load, row = np.array([0.0, -20.0, -5.0]), np.array([0.0, share, 1.0])
    return SecondOrderSystem(
        MASSES, damping, stiffness, {SOURCE: load, TIP: PUSHED}, {TIP: row}, ("a", "b", "c")
    )


def place_chain(position: float, strength: float = 1.0) -> PosedModes:
    system = place_bare(position, strength)
    modes = solve_modal(system)
    return PosedModes(system, modes, modes.shapes, MASSES @ modes.shapes)


def stand(time: float) -> float:
    """Position along the path: constant acceleration, constant speed, constant deceleration."""
    if time <= 0.02:
        return 12.5 * time**2
    return (
        0.005 + 0.5 * (time - 0.02) if time <= 0.16 else LENGTH - 12.5 * max(0.18 - time, 0.0) ** 2
    )


def travel_speed(time: float) -> float:
    return 25.0 * float(np.clip(min(time, 0.18 - time), 0.0, 0.02))


def integrate(samples: FloatArray, push: float = 0.0) -> FloatArray:
    """Deviation by an explicit integrator of high order, from break to break, while the tip is pushed
    with a force that is so large at a speed of 1 m/s [N].
    """

    def slope(time: float, state: FloatArray) -> FloatArray:
        system = place_bare(stand(time))
        acceleration = 25.0 if time < 0.02 else -25.0 if 0.16 <= time < 0.18 else 0.0
        assert system.damping is not None
        force = (
            acceleration * system.inputs[SOURCE]
            + push * travel_speed(time) * PUSHED
            - system.damping @ state[3:]
            - system.stiffness @ state[:3]
        )
        return np.concatenate([state[3:], force / MASSES.diagonal()])

    breaks = (0.0, 0.02, 0.16, 0.18, float(samples[-1]))
    found = integrate_pieces(slope, breaks, np.zeros(6), samples, atol=1e-13)[:, :3]
    rows = np.array([place_bare(stand(time)).outputs[TIP] for time in samples])
    return np.asarray(np.einsum("nm,nm->n", rows, found))


def follow(strength: float = 1.0) -> VaryingSystem:
    return sample_system(lambda position: place_chain(position, strength), LENGTH, MODEL)


def solve(system: VaryingSystem, sampling_hz: float = 2500.0) -> PathDeviation:
    return solve_varying_path(system, MODEL, MOVE, sample_times(MOVE, sampling_hz, 0.05))


def test_where_nothing_changes_the_answer_is_the_frozen_one() -> None:
    found = solve(follow(strength=0.0))
    frozen = solve_path(
        place_bare(0.0), PathModel(SOURCE, (TIP,), MODEL.low_frequency_limit_hz), MOVE, found.times
    )
    size = np.abs(frozen.total).max()
    for part in ("total", "quasi_static", "low_frequency", "dynamic"):
        np.testing.assert_allclose(getattr(found, part), getattr(frozen, part), atol=1e-9 * size)


def test_a_changing_system_follows_an_integrator_at_tight_tolerance() -> None:
    found = solve(follow())
    reference = integrate(found.times)
    size = np.abs(reference).max()
    np.testing.assert_allclose(found.total[:, 0], reference, atol=2e-5 * size)
    # the frozen pose is not the answer here
    frozen = solve_path(
        place_bare(0.5 * LENGTH),
        PathModel(SOURCE, (TIP,), MODEL.low_frequency_limit_hz),
        MOVE,
        found.times,
    )
    assert np.abs(frozen.total[:, 0] - reference).max() > 0.1 * size


def test_a_load_on_the_way_adds_what_an_integrator_says() -> None:
    """A force in proportion to the feed, in steps of its own; where nothing changes the end is the
    static deflection.
    """
    loads = PathLoads((TIP,), lambda times, speeds: 4e3 * speeds[:, None], step=2.5e-4)
    model = dataclasses.replace(MODEL, loads=loads)
    along = sample_system(place_chain, LENGTH, model)
    samples = sample_times(MOVE, 2500.0, 0.05)
    found = solve_varying_path(along, model, MOVE, samples)
    reference, bare = integrate(samples, 4e3), integrate(samples)
    size = np.abs(reference - bare).max()
    assert size > 0.1 * np.abs(bare).max()
    np.testing.assert_allclose(found.total[:, 0], reference, atol=2e-5 * size)
    heavy = dataclasses.replace(place_bare(0.0), damping=np.diag([1e5, 6.7e4, 1.7e4]))
    steady = dataclasses.replace(
        model,
        loads=PathLoads((TIP,), lambda times, speeds: np.full((len(times), 1), 7.0), step=1.0),
    )
    late = solve_path(heavy, steady, MOVE, sample_times(MOVE, 1000.0, 1.0)).total[-1, 0]
    static = 7.0 * heavy.outputs[TIP] @ np.linalg.solve(heavy.stiffness, PUSHED)
    assert late == approx(static, rel=1e-9)


def test_a_mode_may_pass_the_limit_of_low_frequencies_on_the_way() -> None:
    """Its part of the deviation is that of a limit that it does not pass; the total is the same."""
    ends, middle = (
        [float(place_chain(place).modes.frequencies_hz[0]) for place in places]
        for places in ((0.0, LENGTH), (0.5 * LENGTH,))
    )
    limit = 0.5 * (middle[0] + max(ends))
    assert min(ends) < limit < max(ends)
    parts = {}
    for name, hz in (("passed", limit), ("above", 1.1 * max(ends)), ("below", 0.9 * min(ends))):
        model = dataclasses.replace(MODEL, low_frequency_limit_hz=hz)
        parts[name] = solve(sample_system(place_chain, LENGTH, model))
    size = np.abs(parts["below"].total).max()
    for part in ("total", "quasi_static", "low_frequency", "dynamic"):
        passed, above = getattr(parts["passed"], part), getattr(parts["above"], part)
        np.testing.assert_allclose(passed, above, atol=1e-4 * size)
    np.testing.assert_allclose(parts["passed"].total, parts["below"].total, atol=1e-4 * size)
    assert (
        np.abs(parts["below"].low_frequency).max()
        < 0.1 * np.abs(parts["passed"].low_frequency).max()
    )


def test_the_error_falls_with_the_square_of_the_step() -> None:
    system = follow()
    finest = solve(system, 40_000.0).total[:, 0]

    def miss(rate: float) -> float:
        found = solve(system, rate).total[:, 0]
        same = finest[:: round(40_000.0 / rate)]
        count = min(len(found), len(same))
        return float(np.abs(found[:count] - same[:count]).max())

    errors = [miss(rate) for rate in (1250.0, 2500.0, 5000.0)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.2)


def test_a_break_between_samples_is_met() -> None:
    system = follow()
    odd, fine = solve(system, 2345.0), solve(system, 23_450.0)
    np.testing.assert_allclose(
        odd.total[:530], fine.total[:5300:10], atol=1e-4 * np.abs(fine.total).max()
    )


def test_parts_add_up_and_the_quasi_static_one_is_that_of_the_pose() -> None:
    found = solve(follow())
    np.testing.assert_allclose(
        found.quasi_static + found.low_frequency + found.dynamic, found.total, atol=1e-18
    )
    number = int(np.searchsorted(found.times, 0.17))
    position = float(sample_move(MOVE, found.times[number : number + 1]).positions[0])
    system = place_bare(position)
    # no mode is slow here: all of them follow
    static = system.outputs[TIP] @ np.linalg.solve(system.stiffness, system.inputs[SOURCE]) * -25.0
    assert found.quasi_static[number, 0] == approx(static, rel=1e-6)


def test_stations_meet_the_system_between_them() -> None:
    system = follow()
    for position in np.linspace(0.0, LENGTH, 41):
        eigenvalues = np.linalg.eigvalsh(system.at(float(position)).stiffness)
        np.testing.assert_allclose(
            np.sqrt(eigenvalues) / (2.0 * np.pi),
            place_chain(float(position)).modes.frequencies_hz,
            rtol=1e-6,
        )


def test_a_system_that_jumps_is_refused() -> None:
    def jump(position: float) -> PosedModes:
        return place_chain(0.0 if position < 0.033 else 0.5 * LENGTH)

    with pytest.raises(AccuracyError, match="poses along the path leave an error of"):
        sample_system(jump, LENGTH, MODEL)


def test_a_step_table_is_exact_at_and_between_its_places() -> None:
    system = follow()
    table = make_step_table(system, 4e-4)
    for position in np.linspace(0.0, LENGTH, 17) * 0.987:
        np.testing.assert_allclose(
            table.spline(position), _step_pose(system.at(position), system.scales, 4e-4), atol=2e-9
        )
