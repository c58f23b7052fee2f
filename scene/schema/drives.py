"""Schema of drives with their control, and of the analysis of control loops."""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from headstock.scene.reading import units
from headstock.scene.reading.units import Quantity
from headstock.scene.schema.types import (
    Angle,
    Count,
    Names,
    NotNegativeForce,
    NotNegativeShare,
    PositiveFrequency,
    PositiveInertia,
    PositiveLength,
    PositiveMoment,
    PositiveRate,
    PositiveRotationalStiffness,
    PositiveSpeed,
    PositiveTime,
    RequestTable,
    StrictTable,
    Text,
    describe_quantity,
    not_both,
    problem,
    read_quantity,
)

VelocityGain = Annotated[
    Quantity,
    BeforeValidator(read_quantity(units.DAMPING, units.ROTATIONAL_DAMPING)),
    describe_quantity(units.DAMPING, units.ROTATIONAL_DAMPING, sign="positive"),
]
FrictionSlope = Annotated[
    Quantity,
    BeforeValidator(read_quantity(units.DAMPING)),
    describe_quantity(units.DAMPING, sign="not negative"),
]


class FeedForwardTable(StrictTable):
    """Shares of the commanded velocity and of the force the axis' inertia needs that do not wait
    for an error.
    """

    velocity: NotNegativeShare = 0.0
    acceleration: NotNegativeShare = 0.0


class FrictionTable(StrictTable):
    """Friction along the axis, smooth through zero velocity; used with the effect `friction`."""

    coulomb: NotNegativeForce = 0.0
    breakaway: NotNegativeForce | None = None
    stribeck_speed: PositiveSpeed = 1e-3
    viscous: FrictionSlope | None = None
    smoothing: PositiveSpeed = 1e-4

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.breakaway is not None and self.breakaway < self.coulomb:
            raise problem("has a breakaway below coulomb; write a breakaway of at least coulomb")
        if self.viscous is not None and self.viscous.value < 0.0:
            raise problem('viscous friction must not be negative; write for example "200 N s/m"')
        return self


class RippleTable(StrictTable):
    """A wave of the motor's torque over its turn; used with the effect `torque_ripple`."""

    torque: PositiveMoment
    per_turn: Count = 1
    phase: Angle = 0.0


class DriveTable(StrictTable):
    """The drive of an axis through a ball screw, and its control; used with the effect
    `drive_control`.
    """

    model_config = not_both("sampling", "dead_time")

    axis: Text | None = None
    joint: Text | None = None
    inertia: PositiveInertia
    lead: PositiveLength | None = None
    screw_inertia: PositiveInertia | None = None
    coupling: PositiveRotationalStiffness | None = None
    kv: PositiveRate
    velocity_gain: VelocityGain
    integral_time: PositiveTime | None = None
    feed_forward: FeedForwardTable = FeedForwardTable()
    encoder: Literal["motor", "scale"] = "motor"
    scale: Text | None = None
    sampling: PositiveTime | None = None
    dead_time: PositiveTime | None = None
    current_loop: PositiveTime | None = None
    friction: FrictionTable | None = None
    torque_ripple: Annotated[list[RippleTable], Field(min_length=1, max_length=20)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.sampling is not None and self.dead_time is not None:
            raise problem(
                "gives both sampling and dead_time; the dead time of a sampled loop is 1.5 cycles, so keep one"
            )
        if self.velocity_gain.value <= 0.0:
            raise problem('velocity_gain must be above zero; write for example "2e4 N s/m"')
        if self.scale is not None and self.encoder == "motor":
            raise problem(
                'names a scale, but the encoder is that of the motor; write encoder = "scale" or remove scale'
            )
        return self


class ControlTable(RequestTable):
    """Closed-loop poles, margins, bandwidth and tracking error of the drives."""

    up_to: PositiveFrequency = 500.0
    speed: PositiveSpeed = 0.05
    poses: Names | None = None
