"""Measured shapes at the sensors of a scene, along the directions that these have."""

import math
from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.studies.correlation.correlation import Correlation

type Motions = Mapping[tuple[str, str], complex]  # by sensor and its direction
AXES = "xyz"
ALIGNED = 1.0 - 1e-9


def list_places(found: Correlation) -> list[tuple[tuple[str, str], float] | None]:
    """Return sensor and direction of each channel, and with which sign; None where no sensor sees it."""
    places: list[tuple[tuple[str, str], float] | None] = []
    for channel in found.channels:
        sensor = found.sensors[channel.point]
        direction = found.rotation @ channel.direction
        place = _find_dof(sensor, direction, measured_directions(found, channel.point))
        places.append(None if place is None else ((sensor.name, place[0]), place[1]))
    return places


def list_motions(found: Correlation) -> list[Motions]:
    """Return each measured shape by sensor and direction; what no sensor sees is left out."""
    places = list_places(found)
    return [
        {
            place[0]: place[1] * complex(value)
            for place, value in zip(places, shape, strict=True)
            if place is not None
        }
        for shape in found.measured.shapes.T
    ]


def _find_dof(
    sensor: Sensor, direction: FloatArray, written: dict[str, FloatArray]
) -> tuple[str, float] | None:
    """Return along which of its directions a sensor sees a channel, and with which sign; None where it
    does not.
    """
    measured = written if len(sensor.directions) == len(AXES) else sensor.directions
    for dof, vector in measured.items():
        along = float(np.dot(vector, direction))
        if abs(along) > ALIGNED:
            return dof, math.copysign(1.0, along)
    return None


def measured_directions(found: Correlation, point: str) -> dict[str, FloatArray]:
    """Return the directions of a point in machine axes as a sensor has them: along axes under their
    letters, others under the letters that are left.
    """
    directions = [
        found.rotation @ np.array(channel.direction)
        for channel in found.channels
        if channel.point == point
    ]
    named: dict[str, FloatArray] = {}
    for vector in directions:
        axis = int(np.argmax(np.abs(vector)))
        if abs(vector[axis]) > ALIGNED:
            named[AXES[axis]] = np.eye(3)[axis]
    for vector in directions:
        left = [letter for letter in AXES if letter not in named]
        if np.abs(vector).max() <= ALIGNED and left:
            named[left[0]] = vector
    return {dof: named[dof] for dof in AXES if dof in named}
