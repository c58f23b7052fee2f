"""Few modes with residual ones answer as all of them do up to the limit, at rest exactly."""

import numpy as np
import pytest

from common import approx
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.modal_coordinates import reduce_to_modes, to_modal_coordinates
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.milling.border import find_border
from headstock.solvers.milling.collocation import PeriodicCut, safe_depth
from headstock.solvers.milling.forces import EndMill, MillingCut
from headstock.solvers.milling.stability import _find_poles, tip_dynamics
from headstock.solvers.second_order import SecondOrderSystem

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
