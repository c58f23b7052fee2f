"""control that makes a motion grow is reported from its poles, before any time run, with a
gain that would do.
"""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest

from common import approx, present
from headstock.geometry.machine.drives import Cascade
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.stability import (
    _scale_velocity_gain,
    find_largest_gain,
    find_loop_poles,
    require_stable,
    scale_position_gain,
)
from headstock.solvers.errors import UnstableControlError
from headstock.validation.machines.drive_cases import _TwoMasses, make_drive

pytestmark = pytest.mark.hard("H31")

MASSES = _TwoMasses(damping=50.0)
SOFT = Cascade(position_gain=40.0, velocity_gain=2e4, integral_time=0.02)
soft_with = partial(dataclasses.replace, SOFT)


def test_a_stable_loop_is_not_refused() -> None:
    system, train = make_drive(MASSES, soft_with())
    assert not len(require_stable(system, [train]).growing())


def test_a_position_gain_that_is_too_high_is_named_with_the_largest_that_is_stable() -> None:
    system, train = make_drive(
        MASSES, soft_with(position_gain=500.0, velocity_gain=1e5, encoder="scale")
    )
    with pytest.raises(
        UnstableControlError, match=r"axis X is unstable.* Hz.*largest stable kv"
    ) as caught:
        require_stable(system, [train])
    growing = find_loop_poles(close_loops(system, [train]))
    assert caught.value.frequency_hz == approx(growing.frequencies_hz[growing.growing()[0]])
    largest = present(find_largest_gain(system, [train], "X", scale_position_gain))
    for factor, stable in ((0.999, True), (1.001, False)):
        changed = dataclasses.replace(
            train, control=scale_position_gain(train.control, factor * largest)
        )
        assert (not len(find_loop_poles(close_loops(system, [changed])).growing())) == stable


def test_the_largest_stable_kv_of_a_rigid_axis_is_that_of_rouths_criterion() -> None:
    # M s^3 + kp s^2 + kp (kv + 1/Tn) s + kp kv / Tn: stable while kp (kv + 1/Tn) > M kv / Tn
    rigid = _TwoMasses(stiffness=1e13, damping=1e9)
    control = Cascade(position_gain=500.0, velocity_gain=8e3, integral_time=0.01)
    system, train = make_drive(rigid, control)
    mass, kp, rate = rigid.motor + rigid.load, control.velocity_gain, 1.0 / control.integral_time
    expected = kp * rate / (mass * rate - kp)
    found = present(find_largest_gain(system, [train], "X", scale_position_gain))
    assert found * control.position_gain == approx(expected, rel=1e-3)


def test_a_velocity_gain_that_no_kv_helps_is_named() -> None:
    system, train = make_drive(MASSES, soft_with(velocity_gain=2e6, dead_time=1e-3))
    with pytest.raises(UnstableControlError, match=r"velocity loop.*largest stable velocity_gain"):
        require_stable(system, [train])
    largest = present(find_largest_gain(system, [train], "X", _scale_velocity_gain))
    gains = [_scale_velocity_gain(train.control, factor * largest) for factor in (0.999, 1.001)]
    loops = [close_loops(system, [dataclasses.replace(train, control=gain)]) for gain in gains]
    assert [len(find_loop_poles(loop).growing()) > 0 for loop in loops] == [False, True]


def test_what_grows_without_oscillation_is_told_so() -> None:
    system, train = make_drive(MASSES, soft_with(position_gain=-5.0))
    with pytest.raises(UnstableControlError, match="without oscillation"):
        require_stable(system, [train])


def test_an_undamped_motion_that_control_does_not_reach_is_not_called_unstable() -> None:
    system, train = make_drive(dataclasses.replace(MASSES, damping=0.0), SOFT)
    # a third body on a spring of its own, which the drive does not feel
    wide = [np.pad(matrix, ((0, 1), (0, 1))) for matrix in (system.mass, system.stiffness)]
    wide[0][2, 2], wide[1][2, 2] = 10.0, 1e6
    channels = {channel: np.append(row, 0.0) for channel, row in system.outputs.items()}
    loads = {channel: np.append(row, 0.0) for channel, row in system.inputs.items()}
    apart = dataclasses.replace(
        system,
        mass=wide[0],
        damping=None,
        stiffness=wide[1],
        inputs=loads,
        outputs=channels,
        labels=(*system.labels, "apart"),
    )
    poles = require_stable(apart, [train])
    assert np.abs(poles.frequencies_hz - math.sqrt(1e5) / (2.0 * math.pi)).min() < 1e-6
