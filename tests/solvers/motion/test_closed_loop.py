"""Deviation from a path under control: lag, linearity, the limit of fixed motors, and the
steps of motions with friction.
"""

import dataclasses

import numpy as np
import pytest

from common import present
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, GuideFriction
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.errors import ModelError
from headstock.solvers.motion.closed_loop import (
    ControlledPath,
    solve_controlled_path,
)
from headstock.solvers.motion.exact import PathModel, solve_path
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.motion.set_points import Ramp, SetPoint
from headstock.solvers.second_order import SecondOrderSystem
from headstock.validation.machines.drive_cases import LOAD, _TwoMasses, make_drive

MASSES = _TwoMasses()
CONTROL = Cascade(position_gain=40.0, velocity_gain=2e4, integral_time=0.02, dead_time=1e-4)
MOVE = SetPoint(0.05, 0.05, Ramp("s_curve", 0.1, 0.03))
SAMPLES: FloatArray = 4e-4 * np.arange(3500.0, dtype=np.float64)


def path_with(
    control: Cascade = CONTROL, masses: _TwoMasses = MASSES, law: GuideFriction | None = None
) -> ControlledPath:
    system, train = make_drive(masses, control, law)
    loop = close_loops(system, [train], inputs=friction_channels((train,)), outputs=[LOAD])
    return ControlledPath(loop, (LOAD,), {"X": 1.0}, np.ones(1), low_frequency_limit_hz=5.0)


def test_at_constant_speed_it_lags_by_the_speed_over_kv_and_the_parts_add_up() -> None:
    found = solve_controlled_path(path_with(), MOVE, SAMPLES)
    steady = (SAMPLES > 0.8) & (SAMPLES < 0.98)
    np.testing.assert_allclose(found.total[steady], -0.05 / 40.0, rtol=1e-6)
    np.testing.assert_allclose(found.quasi_static[steady], -0.05 / 40.0, rtol=1e-9)
    np.testing.assert_allclose(
        found.total, found.quasi_static + found.low_frequency + found.dynamic, atol=1e-15
    )
    assert np.abs(found.total[-1]).max() < 1e-7


def test_a_motor_that_follows_perfectly_leaves_the_deviation_of_a_fixed_one() -> None:
    heavy = dataclasses.replace(MASSES, motor=1e8)
    control = Cascade(
        300.0, 1e11, velocity_feed_forward=1.0, acceleration_feed_forward=heavy.motor + heavy.load
    )
    found = solve_controlled_path(path_with(control, heavy), MOVE, SAMPLES)
    fixed = SecondOrderSystem(
        MASSES.load * np.eye(1), MASSES.damping * np.eye(1), MASSES.stiffness * np.eye(1),
        {("path", "acceleration"): -MASSES.load * np.ones(1)}, {LOAD: np.ones(1)}, ("load",),
    )  # fmt: skip
    expected = solve_path(fixed, PathModel(("path", "acceleration"), (LOAD,), 5.0), MOVE, SAMPLES)
    np.testing.assert_allclose(
        found.total, expected.total, atol=2e-5 * np.abs(expected.total).max()
    )


def test_set_points_act_at_once_through_the_flexibility_of_modes_left_out() -> None:
    """A drive force strains what has no mode of its own; forgotten, the load stopped 191 um off."""
    found = []
    for up_to_hz in (None, 60.0):
        system, train = make_drive(MASSES, CONTROL)
        loop = close_loops(system, [train], outputs=[LOAD], up_to_hz=up_to_hz)
        path = ControlledPath(loop, (LOAD,), {"X": 1.0}, np.ones(1), low_frequency_limit_hz=5.0)
        found.append(solve_controlled_path(path, MOVE, SAMPLES))
    whole, cut = found
    # the mode at 160 Hz is left out; the move is slow against it
    size = np.abs(whole.total).max()
    assert np.abs(cut.total - whole.total).max() < 1e-3 * size
    assert np.abs(cut.total[-1]).max() < 1e-6
    steady = (SAMPLES > 0.8) & (SAMPLES < 0.98)
    np.testing.assert_allclose(cut.quasi_static[steady], -0.05 / 40.0, rtol=1e-9)


def test_a_machine_that_floats_is_refused() -> None:
    system, train = make_drive(MASSES, CONTROL)
    wide = [
        np.pad(present(matrix), ((0, 1), (0, 1)))
        for matrix in (system.mass, system.stiffness, system.damping)
    ]
    wide[0][2, 2] = 10.0
    channels = {channel: np.append(row, 0.0) for channel, row in system.outputs.items()}
    loads = {channel: np.append(row, 0.0) for channel, row in system.inputs.items()}
    apart = SecondOrderSystem(wide[0], wide[2], wide[1], loads, channels, (*system.labels, "apart"))
    path = dataclasses.replace(path_with(), loop=close_loops(apart, [train], outputs=[LOAD]))
    with pytest.raises(ModelError, match="floats"):
        solve_controlled_path(path, MOVE, SAMPLES)
