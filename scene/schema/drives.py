"""Schema of drives with their control."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema import types


class _FeedForwardTable(types.StrictTable):
    """Shares of the commanded velocity and of the force the axis' inertia needs that do not wait
    for an error.
    """

    velocity: types.NotNegativeShare = 0.0
    """share of the commanded velocity that is fed forward"""
    acceleration: types.NotNegativeShare = 0.0
    """share of the inertia force of the axis that is fed forward"""


class _FrictionTable(types.StrictTable):
    """Friction along the axis, smooth through zero velocity; used with the effect `friction`."""

    coulomb: types.NotNegativeForce = 0.0
    """friction force while sliding"""
    breakaway: types.NotNegativeForce | None = None
    """friction force at rest, at least `coulomb`; default: `coulomb`"""
    stribeck_speed: types.PositiveSpeed = 1e-3
    """speed at which the difference between `breakaway` and `coulomb` has fallen to 1/e"""
    viscous: types.FrictionSlope | None = None
    """viscous friction per speed"""
    smoothing: types.PositiveSpeed = 1e-4
    """speed over which friction changes its sign: tanh(v / smoothing)"""

    def _faults(self) -> Iterator[str]:
        if self.breakaway is not None and self.breakaway < self.coulomb:
            yield "has a breakaway below coulomb; write a breakaway of at least coulomb"


class _RippleTable(types.StrictTable):
    """A wave of the motor's torque over its turn; used with the effect `torque_ripple`."""

    torque: types.PositiveMoment
    """amplitude of the wave"""
    per_turn: types.Count = 1
    """waves per turn of the motor"""
    phase: types.Angle = 0.0
    """phase at position zero of the axis"""


Coefficients = Annotated[list[types.Number], Field(min_length=1, max_length=50)]
Rows = Annotated[list[Coefficients], Field(min_length=1, max_length=50)]
ControlInput = Literal[
    "position_error", "velocity_error", "set_velocity", "set_acceleration", "motor_velocity"
]


class LinearTable(types.StrictTable):
    """A transfer function or a state space, in continuous time or at a step."""

    num: Coefficients | None = None
    """numerator of a transfer function, highest power first, in s, with a `step` in z"""
    den: Coefficients | None = None
    """denominator, likewise"""
    a: Rows | None = None
    """matrix A of a state space, a list of rows; SI units"""
    b: Rows | None = None
    """matrix B, a column for each input"""
    c: Rows | None = None
    """matrix C, one row"""
    d: Rows | None = None
    """matrix D, one row; default: zero"""
    step: types.PositiveTime | None = None
    """time between two samples of a discrete one, which holds its output; default: continuous time"""

    def _faults(self) -> Iterator[str]:
        for whole, others in ((("num", "den"), "abcd"), (("a", "b", "c"), ("num", "den"))):
            given = [key for key in whole if getattr(self, key) is not None]
            missing = [key for key in whole if key not in given]
            if given and missing:
                yield f"has {' and '.join(given)}, but no {' and no '.join(missing)}; write all of {', '.join(whole)}"
            if given and any(getattr(self, key) is not None for key in others):
                yield "has a transfer function and a state space; keep num and den, or a, b, c and d"


class ControllerTable(LinearTable):
    """A controller in place of the PI velocity control: a transfer function from one input to the force, or
    a state space from several.
    """

    inputs: Annotated[list[ControlInput], Field(min_length=1, max_length=5)] | None = None
    """what it gets: `position_error` (set less measured position), `velocity_error` (behind `kv`; without `kv` set velocity less that of the
    motor), `set_velocity`, `set_acceleration`, `motor_velocity`, in m and s along the axis; default: `velocity_error` with `kv`, else
    `position_error`"""
    output: Literal["force", "torque"] = "force"
    """what comes out: a force along the axis in N, or a torque of the motor in N m"""


class FilterTable(LinearTable):
    """A filter that the force of a controller passes: a notch, a transfer function or a state space."""

    notch: types.PositiveFrequency | None = None
    """frequency that it takes out"""
    depth: types.NotNegativeShare = 0.0
    """share of the force that is left at this frequency"""
    damping: types.PositiveNumber = 0.5
    """damping ratio of the notch: half its width over its frequency"""


class DriveTable(types.StrictTable):
    """The drive of an axis, of a linear one through a ball screw, and its control; used with the effect
    `drive_control`.
    """

    model_config = types.not_both("sampling", "dead_time")

    axis: types.Text | None = None
    """the axis it moves; default: the drive's own name"""
    joint: types.Text | None = None
    """its ball screw: nut at the first end, motor at the second; of a rotary axis the joint that it turns across; default: the only one of
    the axis"""
    inertia: types.PositiveInertia
    """moment of inertia of rotor and coupling"""
    lead: types.PositiveLength | None = None
    """travel of a linear axis per turn of the motor; default: the `lead` of the joint's `screw`, or the `screw_lead` of the mechanism"""
    ratio: types.PositiveNumber | None = None
    """turns of the motor per turn of a rotary axis; default: 1, a direct drive"""
    screw_inertia: types.PositiveInertia | None = None
    """moment of inertia of the screw about its axis; used with the effect `screw_inertia`"""
    coupling: types.PositiveRotationalStiffness | None = None
    """torsional stiffness between motor and screw, unless the joint's `screw` gives it; default: rigid"""
    kv: types.PositiveRate | None = None
    """gain of the P position control, `"50 1/s"` or `"3 m/min/mm"`"""
    velocity_gain: types.VelocityGain | None = None
    """proportional gain of the PI velocity control: force per speed of the axis, or torque per angular speed of the motor"""
    integral_time: types.PositiveTime | None = None
    """integral time of the PI velocity control; default: none, proportional only"""
    controller: ControllerTable | None = None
    """own controller in place of `velocity_gain`: `{ num = [2e4, 1e6], den = [1, 0] }`, see [own controllers](drives.md#own-controllers)"""
    filters: Annotated[list[FilterTable], Field(min_length=1, max_length=20)] | None = None
    """filters of the force: `[{ notch = "48.6 Hz" }]`"""
    feed_forward: _FeedForwardTable = Field(default_factory=_FeedForwardTable.model_construct)
    """shares that do not wait for an error: `{ velocity = "100 %", acceleration = "100 %" }`"""
    encoder: Literal["motor", "scale"] = "motor"
    """feedback of the position control: the motor encoder or a linear scale; the velocity control always uses the motor encoder"""
    scale: types.Text | None = None
    """point where the scale is (motion of its `tool` relative to its `work`); default: at the screw"""
    sampling: types.PositiveTime | None = None
    """cycle of the controller: a dead time of 1.5 cycles; default: none, continuous control"""
    dead_time: types.PositiveTime | None = None
    """dead time of the loop, in place of `sampling`; default: none"""
    current_loop: types.PositiveTime | None = None
    """time constant of the current control; default: none, the torque follows without delay"""
    friction: _FrictionTable | None = None
    """friction of the axis; used with the effect `friction`"""
    torque_ripple: Annotated[list[_RippleTable], Field(min_length=1, max_length=20)] | None = None
    """waves of the motor's torque: `[{ torque = "0.01 N m", per_turn = 8 }]`; used along a path, effect `torque_ripple`"""

    def _faults(self) -> Iterator[str]:
        if (self.controller is None) == (self.velocity_gain is None):
            yield (
                'needs one controller; write velocity_gain = "2e4 N s/m" with kv, or controller = { num = [...], den = [...] }'
            )
        if self.controller is None and self.kv is None:
            yield "'kv' is missing; write the gain of the position control, such as kv = \"50 1/s\""
        if self.controller is not None and self.integral_time is not None:
            yield "has an integral_time, which belongs to velocity_gain; put the integrator into the controller"
        if self.sampling is not None and self.dead_time is not None:
            yield "gives both sampling and dead_time; the dead time of a sampled loop is 1.5 cycles, so keep one"
        if self.scale is not None and self.encoder == "motor":
            yield 'names a scale, but the encoder is that of the motor; write encoder = "scale" or remove scale'
