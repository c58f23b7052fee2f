"""What a fit needs of a test: its target file, with the stiffnesses of joints that may be fitted, and its
sensors as a file to include in the scene.
"""

import math
import re
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.pipeline.stages.machine import DAMPING
from headstock.reduction.motions.part_names import split_number
from headstock.scene.reading.files import TomlTable, TomlValue, write_toml, write_value
from headstock.scene.reading.findings import show_key
from headstock.scene.reading.keys import read_entries, read_number, write_number, written_unit
from headstock.scene.scene import Scene
from headstock.studies.correlation.base_case import BaseCase
from headstock.studies.correlation.correlation import CorrelatedMode, Correlation
from headstock.studies.correlation.modal_fit import COVERAGE
from headstock.studies.correlation.sensor_shapes import (
    ALIGNED,
    AXES,
    Motions,
    list_motions,
    measured_directions,
)

TARGETS_FILE, SENSORS_FILE = "targets.toml", "sensors.toml"
TOLERANCE = "1 %"
LEAST_TOLERANCE = 1e-3  # of a frequency: two tests of one machine differ by more
NOT_MEASURED = "-"
REAL = 1e-3  # imaginary part over the largest motion of a shape that counts as real
DIGITS = 4
# a stiffness may be so many times smaller or larger; its prior is a factor of e, one standard deviation
BOUND = 10.0
PRIOR_SIGMA = 1.0


def write_targets(found: Correlation, scene: Scene, base: BaseCase | None = None) -> str:
    """Return the text of a target file: every measured mode by name, with its shape at sensors.

    Channels that look wrong are left out.

    Args:
        scene: Whose joints may be fitted.
        base: Case before the machine was modified, whose file this one is written behind.
    """
    shapes = list_motions(found)
    case: TomlTable = {
        **({"variant": found.variant} if found.variant else {}),
        "pose": found.pose,
        "tolerance": TOLERANCE,
        **({} if base is None else {"like": base.case}),
        **_leave_out_lower(found),
        "modes": [
            _write_mode(found, row, shapes[row.measured], damped=DAMPING in scene.effects)
            for row in found.modes
            if row.measured is not None
        ],
    }
    name = _name_case(found.test)
    table: TomlTable = {
        "name": f"{found.scene} and {found.test}",
        "parameters": dict(_propose_parameters(scene.raw, scene.written)),
    }
    before: TomlTable = {}
    if base is not None:
        before, table = dict(read_entries(base.raw, "cases")), {**base.raw}
        while name in before:
            name += "_modified"
    table = {**table, "cases": {**before, name: case}}
    lines = [
        f"# Modes of {found.test}, and stiffnesses of joints that may be fitted to them: take out what is known.",
        *(f"# left out: {text}" for text in found.faults),
    ]
    if _list_new(found, scene):
        lines.append(f'# Its sensors: write include = "{SENSORS_FILE}" into the scene.')
    return "\n".join([*lines, write_toml(table)])


def write_sensors(found: Correlation, scene: Scene) -> str:
    """Return the sensors that the scene lacks as a file that it can include; empty where there are
    none.
    """
    sensors: TomlTable = {
        sensor.name: {
            "component": sensor.component,
            "at": [f"{1e3 * value:.6g} mm" for value in sensor.position],
            "directions": [
                _write_direction(vector) for vector in measured_directions(found, point).values()
            ],
            "reach": f"{1e3 * sensor.reach:.3g} mm",
        }
        for point, sensor in _list_new(found, scene)
    }
    return write_toml({"sensors": sensors}) if sensors else ""


def _name_case(test: str) -> str:
    """Return the name of the case of a test file."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", test.rpartition(".")[0] or test)[:60]
    return name if name[:1].isalpha() else f"test_{name}"


def _list_new(found: Correlation, scene: Scene) -> list[tuple[str, Sensor]]:
    """Return the measured points whose sensor the scene has not, with it."""
    points = {channel.point for channel in found.channels}
    known = read_entries(scene.raw, "sensors")
    return [
        (point, sensor)
        for point, sensor in found.sensors.items()
        if point in points and sensor.name.partition(".")[0] not in known
    ]


def _leave_out_lower(found: Correlation) -> TomlTable:
    """Return ``modes_above`` where computed modes lie below the range of the test."""
    paired = {row.computed for row in found.modes}
    lower = [
        float(hz)
        for index, hz in enumerate(found.computed.frequencies_hz)
        if index not in paired and hz < found.range_hz[0]
    ]
    if not lower:
        return {}
    first = min(
        float(found.measured.frequencies_hz.min()),
        *(
            float(found.computed.frequencies_hz[row.computed])
            for row in found.modes
            if row.computed is not None
        ),
    )
    return {"modes_above": f"{math.sqrt(max(lower[-1], 0.01 * first) * first):.3g} Hz"}


def _write_mode(
    found: Correlation, row: CorrelatedMode, motions: Motions, *, damped: bool
) -> TomlTable:
    number = row.measured or 0
    hz, ratio = float(found.measured.frequencies_hz[number]), float(found.measured.damping[number])
    sigma = _deviation(found, row)
    name = "" if row.computed is None else f" {found.computed.mode_names[row.computed]}"
    return {
        "name": found.mode_names[number] or f"m{number + 1}{name}",
        "frequency": f"{hz:.6g} Hz",
        **({} if sigma is None else {"tolerance": f"{sigma:.3g} Hz"}),
        **({"damping": f"{100.0 * ratio:.4g} %"} if damped and ratio > 0.0 else {}),
        # what no mode of the model looks like would pull parameters to wherever it looks like one
        **({"hold_out": True} if row.computed is None or row.doubts else {}),
        "vectors": _write_vectors(motions, found.faulty),
    }


def _deviation(found: Correlation, row: CorrelatedMode) -> float | None:
    """Return the standard deviation of a measured from a computed frequency [Hz], from the ± of both; None
    where one is not known.
    """
    if row.measured is None or row.computed is None:
        return None
    measured, computed = (
        float(found.fit.frequency_errors[row.measured]),
        found.computed.error_hz[row.computed],
    )
    if computed is None or not math.isfinite(measured):
        return None
    least = LEAST_TOLERANCE * float(found.measured.frequencies_hz[row.measured])
    return max(least, math.hypot(measured, computed) / COVERAGE)


def _write_vectors(motions: Motions, faulty: Collection[tuple[str, str]]) -> TomlTable:
    """Return sensor to motions along its x, y and z, the largest motion of the shape one."""
    values = np.array(list(motions.values()))
    turned = values * np.exp(-0.5j * np.angle(np.sum(values * values)))
    turned /= max(float(np.abs(turned).max(initial=0.0)), np.finfo(float).tiny)
    is_real = bool(np.abs(turned.imag).max(initial=0.0) < REAL)
    vectors: dict[str, list[TomlValue]] = {}
    for (name, dof), value in zip(motions, turned, strict=True):
        if (name, dof) not in faulty:
            written = vectors.setdefault(name, [NOT_MEASURED] * 3)
            written[AXES.index(dof)] = _write_motion(complex(value), is_real=is_real)
    return dict(vectors)


def _write_motion(value: complex, *, is_real: bool) -> TomlValue:
    real, imaginary = (round(part, DIGITS) + 0.0 for part in (value.real, value.imag))
    return real if is_real else [real, imaginary]


def _write_direction(vector: FloatArray) -> TomlValue:
    axis = int(np.argmax(np.abs(vector)))
    if abs(vector[axis]) > ALIGNED:
        return AXES[axis]
    return [float(value) for value in np.round(vector, 9)]


def _propose_parameters(raw: TomlTable, written: TomlTable) -> Iterator[tuple[str, TomlValue]]:
    """Yield a parameter for every stiffness of every family of equal joints, with its value as a
    prior.
    """
    families: dict[tuple[str, str, str, str], list[str]] = {}
    for joint, entry in read_entries(raw, "joints").items():
        for kind in ("stiffness", "stiffness_per_area"):
            table = entry.get(kind)
            for direction, value in table.items() if isinstance(table, dict) else ():
                family = (split_number(joint)[0], kind, direction, write_value(value))
                families.setdefault(family, []).append(joint)
    taken: set[str] = set()
    for (stem, kind, direction, _), joints in families.items():
        key = ("joints", joints[0], kind, direction)
        try:
            value, unit = read_number(raw, key).value, written_unit(raw, key, written)
        except ValueError:  # rigid
            continue
        if not value > 0.0:
            continue
        name = (
            f"{stem}_{direction}"
            if f"{stem}_{direction}" not in taken
            else f"{joints[0]}_{direction}"
        )
        taken.add(name)
        yield (
            name,
            {
                "keys": _list_keys(joints, kind, direction),
                "bounds": [
                    write_number(value / BOUND, unit, DIGITS),
                    write_number(value * BOUND, unit, DIGITS),
                ],
                "prior": write_number(value, unit, DIGITS),
                "prior_sigma": PRIOR_SIGMA,
            },
        )


def _list_keys(joints: Sequence[str], kind: str, direction: str) -> list[TomlValue]:
    return [show_key(("joints", joint, kind, direction)) for joint in joints]
