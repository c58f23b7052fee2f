"""Names of sensors at the points of a test, in scenes and target files."""

import re
from collections.abc import Collection, Mapping

from headstock.geometry.machine.machine import Sensor

ALLOWED = re.compile(r"[^A-Za-z0-9_-]")
LONGEST = 60


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
    number, found = 2, name
    while found in taken:
        number, found = number + 1, f"{name}_{number}"
    return found
