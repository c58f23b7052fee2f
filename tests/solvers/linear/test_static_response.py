"""Static answers, exact for graded matrices and refused for mechanisms; what modes leave out of them."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.modal_coordinates import reduce_to_modes, to_modal_coordinates
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.milling.border import find_border
from headstock.solvers.milling.collocation import PeriodicCut, safe_depth
from headstock.solvers.milling.forces import EndMill, MillingCut
from headstock.solvers.milling.tip_poles import _find_poles, tip_dynamics
from headstock.solvers.second_order import SecondOrderSystem


def system_of(stiffness: FloatArray) -> SecondOrderSystem:
    size = len(stiffness)
    return SecondOrderSystem(
        np.zeros((size, size)), None, stiffness, {}, {}, tuple(f"q{i}" for i in range(size))
    )


@pytest.mark.parametrize("columns", [(), (1,), (3,)])
def test_displacements_have_the_shape_of_the_loads_and_balance_them(columns: tuple[int]) -> None:
    generator = np.random.default_rng(1)
    factor = generator.normal(size=(15, 15))
    stiffness = factor @ factor.T + np.eye(15)
    loads = generator.normal(size=(15, *columns))
    result = solve_static(system_of(stiffness), loads)
    assert result.displacements.shape == loads.shape
    np.testing.assert_allclose(stiffness @ result.displacements, loads, atol=1e-10)


def test_a_graded_chain_is_solved_to_the_last_digits() -> None:
    levels = np.logspace(14, 0, 8)
    stretch = np.eye(8) - np.eye(8, k=-1)
    # coordinates are the stretches themselves: the matrix is graded and nothing cancels
    result = solve_static(system_of(np.diag(levels)), stretch.T @ np.ones(8))
    np.testing.assert_allclose(result.displacements, (stretch.T @ np.ones(8)) / levels, rtol=1e-14)


def test_an_unsymmetric_stiffness_is_solved_as_it_is() -> None:
    stiffness = np.array([[3.0, 1.0], [-1.0, 2.0]])
    np.testing.assert_allclose(
        solve_static(system_of(stiffness), np.array([1.0, 0.0])).displacements,
        [2.0 / 7.0, 1.0 / 7.0],
        rtol=1e-14,
    )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e9])
def test_a_free_chain_is_refused_and_counted(scale: float) -> None:
    stiffness = scale * np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    with pytest.raises(ModelError, match=r"2 rigid motion\(s\) are free.*q2"):
        solve_static(system_of(stiffness), np.ones(3))


def test_loads_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ModelError, match="not finite"):
        solve_static(system_of(np.eye(2)), np.array([np.nan, 1.0]))


def test_no_dofs_at_all_give_an_empty_answer() -> None:
    assert solve_static(system_of(np.zeros((0, 0))), np.zeros((0, 6))).displacements.shape == (0, 6)


CHANNELS = [("tip", axis) for axis in "xyz"]
LIMIT_HZ = 400.0


@pytest.fixture(scope="module")
def chain() -> SecondOrderSystem:
    """Fourteen masses in a row in three directions, coupled at the tip; modes from 40 to 3000 Hz."""
    count = 14
    line = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    line[-1, -1] = 1.0
    stiffness = np.kron(np.diag([3e8, 5e8, 9e8]), line)
    mass = 5.0 * np.eye(3 * count)
    tip = np.zeros((3, 3 * count))
    for axis in range(3):
        tip[axis, count * (axis + 1) - 1] = 1.0
    tip[1, count - 1] = 0.3
    rows = {channel: tip[axis] for axis, channel in enumerate(CHANNELS)}
    labels = tuple(str(number) for number in range(3 * count))
    return SecondOrderSystem(mass, 3e-5 * stiffness, stiffness, rows, dict(rows), labels)


def test_static_compliance_is_exact_and_the_response_close(chain: SecondOrderSystem) -> None:
    small = reduce_to_modes(chain, CHANNELS, LIMIT_HZ)
    assert len(small.mass) < 0.4 * len(chain.mass)
    loads = np.array([small.inputs[channel] for channel in CHANNELS]).T
    whole = np.array([chain.inputs[channel] for channel in CHANNELS]).T
    np.testing.assert_allclose(
        loads.T @ solve_static(small, loads).displacements,
        whole.T @ solve_static(chain, whole).displacements,
        rtol=1e-9,
        atol=1e-20,
    )
    lines = np.linspace(1.0, LIMIT_HZ, 200, dtype=np.float64)
    expected, found = (
        solve_frf(system, lines, inputs=CHANNELS, outputs=CHANNELS).receptance
        for system in (chain, small)
    )
    # Rubin (1975): what is left is of fourth order in the ratio of the frequencies
    assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()
    bare = solve_modal(chain, up_to_hz=LIMIT_HZ)
    assert len(small.mass) == len(bare.frequencies_hz) + 3


def _limit(system: SecondOrderSystem) -> float:
    rows = np.array([system.outputs[channel] for channel in CHANNELS])
    assert system.damping is not None
    tip = _find_poles(
        tip_dynamics(system.mass, system.damping, system.stiffness, forced=rows, seen=rows[:2])
    )
    assert tip is not None
    cut = MillingCut(EndMill(0.02, 3, 0.5), catalogue_coefficients("al7075-t6"), 300.0, 1e-3, 0.008)
    cuts, safe = [PeriodicCut(tip, cut)], safe_depth(tip, cut)
    (limit,) = find_border(cuts, np.array([np.nan]), safe=safe, deepest=0.1)
    return limit.depth


def test_limit_of_stability_of_few_modes_is_that_of_all_dofs(chain: SecondOrderSystem) -> None:
    full = _limit(chain)
    assert full < 0.1
    assert _limit(reduce_to_modes(chain, CHANNELS, LIMIT_HZ)) == approx(full, rel=0.01)


def test_a_limit_above_all_modes_leaves_no_residual(chain: SecondOrderSystem) -> None:
    assert len(reduce_to_modes(chain, CHANNELS, 1e5).mass) == len(chain.mass)


@pytest.mark.parametrize(("noise", "is_carried"), [(1e-7, True), (1e-2, False)])
def test_roundoff_of_damping_where_there_is_no_mass_is_no_damper(
    noise: float, *, is_carried: bool
) -> None:
    # a dof without mass between two springs; modal damping of the mass behind it
    stiffness = np.array([[8e4, -5e4], [-5e4, 5e4]])
    mass = np.diag([0.0, 2.0])
    square = (3e4 * 5e4 / 8e4) / 2.0
    damping = np.diag([0.0, 2.0 * 0.02 * np.sqrt(square) * 2.0])
    damping[0, 0] = noise * damping[1, 1]
    rows = {("body", "x"): np.array([0.0, 1.0])}
    system = SecondOrderSystem(mass, damping, stiffness, rows, rows, ("point", "body"))
    found = to_modal_coordinates(system, list(rows), list(rows))
    assert (found is not None) == is_carried
