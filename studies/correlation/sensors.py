"""Measured points and shapes at the sensors of a scene: their names, and along which of their directions."""

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.scene.building.sensors import name_directions
from headstock.scene.test_data.records import TestChannel, Vector, as_vector
from headstock.solvers.pairing.mode_pairing import Field

type SensorDof = tuple[str, str]  # a sensor and one of its directions
type Motions = Mapping[SensorDof, complex]
ALLOWED = re.compile(r"[^A-Za-z0-9_-]")
LONGEST = 60
ALIGNED = 1.0 - 1e-9


def find_sensor(known: Mapping[str, Sensor], point: str) -> Sensor | None:
    """Return the sensor of a scene that has the name of a point, alone or as ``TABLE.POINT``, or the
    name that it would be given; None without one.
    """
    for name, sensor in known.items():
        if point in (name, name.partition(".")[2]) or name == name_sensor(point, ()):
            return sensor
    return None


def name_sensor(point: str, taken: Collection[str]) -> str:
    """Return the name of a sensor at a point: the point's own where a scene allows it, ``p12`` for
    ``12``.
    """
    name = ALLOWED.sub("_", point)[:LONGEST]
    name = name if name[:1].isalpha() else f"p{name}"
    number, free = 2, name
    while free in taken:
        number, free = number + 1, f"{name}_{number}"
    return free


def locate_channels(
    channels: Sequence[TestChannel], sensors: Mapping[str, Sensor], rotation: FloatArray
) -> list[tuple[SensorDof, float] | None]:
    """Return sensor and direction of each channel, and with which sign; None where no sensor sees it.

    Args:
        sensors: Measured point to its sensor in the model.
        rotation: ``(3, 3)`` from the axes of the test to those of the machine.
    """
    places: list[tuple[SensorDof, float] | None] = []
    for channel in channels:
        sensor = sensors[channel.point]
        dofs: Mapping[str, Vector] = sensor.directions
        if len(dofs) == len(DIRECTIONS):
            dofs = measured_directions(channels, channel.point, rotation)
        cosines = {
            dof: float(np.dot(vector, rotation @ channel.direction)) for dof, vector in dofs.items()
        }
        seen = (
            ((sensor.name, dof), float(np.sign(cosine)))
            for dof, cosine in cosines.items()
            if abs(cosine) > ALIGNED
        )
        places.append(next(seen, None))
    return places


def list_motions(places: Sequence[tuple[SensorDof, float] | None], shapes: Field) -> list[Motions]:
    """Return shapes ``(c, k)`` by sensor and direction; what no sensor sees is left out."""
    return [
        {
            place[0]: place[1] * complex(value)
            for place, value in zip(places, shape, strict=True)
            if place is not None
        }
        for shape in shapes.T
    ]


def measured_directions(
    channels: Sequence[TestChannel], point: str, rotation: FloatArray
) -> dict[str, Vector]:
    """Return the directions in which a point was measured, in machine axes as a sensor has them.

    Args:
        rotation: ``(3, 3)`` from the axes of the test to those of the machine.
    """
    return name_directions(
        as_vector(rotation @ channel.direction) for channel in channels if channel.point == point
    )
