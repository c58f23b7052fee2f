"""What a fit needs of a test: its target file, with its sensors and the stiffnesses of joints that may be
fitted.
"""

import math
import re
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from headstock.geometry.frames import DIRECTIONS, find_axis
from headstock.pipeline.stages.machine import DAMPING
from headstock.reduction.motions.part_names import split_number
from headstock.scene.reading.files import TomlTable, TomlValue, write_toml, write_value
from headstock.scene.reading.findings import show_key
from headstock.scene.reading.keys import read_entries, read_number, write_number, written_unit
from headstock.scene.scene import Scene
from headstock.scene.test_data.records import Vector
from headstock.studies.correlation.base_case import BaseCase
from headstock.studies.correlation.correlation import CorrelatedMode, Correlation
from headstock.studies.correlation.modal_fit import COVERAGE
from headstock.studies.correlation.sensors import Motions, SensorDof, measured_directions

TARGETS_FILE = "targets.toml"
TOLERANCE = "1 %"
LEAST_TOLERANCE = 1e-3  # of a frequency: two tests of one machine differ by more
NOT_MEASURED = "-"
REAL = 1e-3  # imaginary part over the largest motion of a shape that counts as real
DIGITS = 4
# a stiffness may be so many times smaller or larger; its prior is a factor of e, one standard deviation
BOUND = 10.0
PRIOR_SIGMA = 1.0


def write_targets(
    found: Correlation, shapes: Sequence[Motions], scene: Scene, base: BaseCase | None = None
) -> str:
    """Return the text of a target file: every measured mode by name, with its shape at sensors, and the
    sensors that the scene lacks.

    Channels that look wrong are left out.

    Args:
        shapes: Of the measured modes.
        scene: Whose joints may be fitted.
        base: Case before the machine was modified, whose file this one is written behind.
    """
    sensors = _write_sensors(found, scene)
    case: TomlTable = {
        **({"variant": found.variant} if found.variant else {}),
        "pose": found.pose,
        "tolerance": TOLERANCE,
        **({} if base is None else {"like": base.case}),
        **_leave_out_lower(found),
        **({"sensors": sensors} if sensors else {}),
        "modes": [
            _write_mode(row, shapes[row.measured], found.faulty, damped=DAMPING in scene.effects)
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
    return "\n".join([*lines, write_toml(table)])


def _write_sensors(found: Correlation, scene: Scene) -> TomlTable:
    """Return the sensors that the scene lacks, by name."""
    points = {channel.point for channel in found.channels}
    known = read_entries(scene.raw, "sensors")
    return {
        sensor.name: {
            "component": sensor.component,
            "at": [f"{1e3 * value:.6g} mm" for value in sensor.position],
            "directions": [
                _write_direction(vector)
                for vector in measured_directions(found.channels, point, found.rotation).values()
            ],
            "reach": f"{1e3 * sensor.reach:.3g} mm",
        }
        for point, sensor in found.sensors.items()
        if point in points and sensor.name.partition(".")[0] not in known
    }


def _name_case(test: str) -> str:
    """Return the name of the case of a test file."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", test.rpartition(".")[0] or test)[:60]
    return name if name[:1].isalpha() else f"test_{name}"


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
    computed = [row.computed_hz for row in found.modes if row.computed_hz is not None]
    first = min(float(found.measured.frequencies_hz.min()), *computed)
    return {"modes_above": f"{math.sqrt(max(lower[-1], 0.01 * first) * first):.3g} Hz"}


def _write_mode(
    row: CorrelatedMode, motions: Motions, faulty: Collection[SensorDof], *, damped: bool
) -> TomlTable:
    ratio, sigma = row.measured_damping or 0.0, _deviation(row)
    name = f"m{(row.measured or 0) + 1}" + (f" {row.name}" if row.name is not None else "")
    return {
        "name": row.label or name,
        "frequency": f"{row.measured_hz:.6g} Hz",
        **({} if sigma is None else {"tolerance": f"{sigma:.3g} Hz"}),
        **({"damping": f"{100.0 * ratio:.4g} %"} if damped and ratio > 0.0 else {}),
        # what no mode of the model looks like would pull parameters to wherever it looks like one
        **({"hold_out": True} if row.computed is None or row.doubts else {}),
        "vectors": _write_vectors(motions, faulty),
    }


def _deviation(row: CorrelatedMode) -> float | None:
    """Return the standard deviation of a measured from a computed frequency [Hz], from the ± of both; None
    where one is not known.
    """
    measured, computed = row.measured_error_hz, row.computed_error_hz
    if row.measured_hz is None or measured is None or computed is None:
        return None
    return max(LEAST_TOLERANCE * row.measured_hz, math.hypot(measured, computed) / COVERAGE)


def _write_vectors(motions: Motions, faulty: Collection[SensorDof]) -> TomlTable:
    """Return sensor to motions along its x, y and z, the largest motion of the shape one."""
    values = np.array(list(motions.values()))
    turned = values * np.exp(-0.5j * np.angle(np.sum(values * values)))
    turned /= max(float(np.abs(turned).max(initial=0.0)), np.finfo(float).tiny)
    is_real = bool(np.abs(turned.imag).max(initial=0.0) < REAL)
    vectors: dict[str, list[TomlValue]] = {}
    for (name, dof), value in zip(motions, turned, strict=True):
        if (name, dof) not in faulty:
            written = vectors.setdefault(name, [NOT_MEASURED] * 3)
            parts: list[TomlValue] = [
                round(float(x), DIGITS) + 0.0 for x in (value.real, value.imag)
            ]
            written[DIRECTIONS.index(dof)] = parts[0] if is_real else parts
    return dict(vectors)


def _write_direction(vector: Vector) -> TomlValue:
    axis = find_axis(vector)
    return [round(value, 9) for value in vector] if axis is None else axis[0]


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
        name = f"{stem}_{direction}"
        name = f"{joints[0]}_{direction}" if name in taken else name
        taken.add(name)
        bounds = (value / BOUND, value * BOUND)
        yield (
            name,
            {
                "keys": [show_key(("joints", joint, kind, direction)) for joint in joints],
                "bounds": [write_number(bound, unit, DIGITS) for bound in bounds],
                "prior": write_number(value, unit, DIGITS),
                "prior_sigma": PRIOR_SIGMA,
            },
        )
