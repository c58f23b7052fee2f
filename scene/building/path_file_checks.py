"""The files that sweeps take their ways from, held against the axes of the scene."""

from pathlib import Path

import numpy as np

from headstock.geometry.machine.machine import show_position
from headstock.scene.reading.axis_paths import AxisPath, PathFileError, read_path
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.reading.positions import KeyPath
from headstock.scene.schema.scene import SceneTable

SUFFIXES = (".csv",)
UNITS = {"m": "mm", "rad": "deg"}


def read_sweep_paths(scene: SceneTable, units: dict[str, str], folder: Path, findings: Findings) -> dict[str, AxisPath]:
    """The way of each sweep that names a file, where it could be read; what is wrong is reported.

    Args:
        scene: With sweeps.
        units: ``m`` or ``rad`` of every axis a sweep may name.
        folder: Of the scene.
        findings: Receives problems, each with the line of the file.
    """
    found: dict[str, AxisPath] = {}
    for name, table in scene.sweeps.items():
        if not isinstance(table.path, str):
            continue
        key: KeyPath = ("sweeps", name, "path")
        try:
            found[name] = read_path(resolve_file(folder, table.path, SUFFIXES))
        except (ValueError, PathFileError) as error:
            findings.add(key, str(error))
            continue
        for column, axis in enumerate(found[name].axes):
            if fault := _find_fault(found[name], column, axis, scene, units):
                findings.add(key, fault)
    return found


def _find_fault(path: AxisPath, column: int, axis: str, scene: SceneTable, units: dict[str, str]) -> str:
    """Why an axis cannot follow its column; empty where it can."""
    if axis not in units:
        return f"{path.name}:1: unknown axis {axis[:80]!r}; {suggest_names(axis, units, what='axes')}"
    if units[axis] != path.units[column]:
        kind = "linear" if units[axis] == "m" else "rotary"
        return f"{path.name}:1: axis {axis} is {kind}; write for example {axis} [{UNITS[units[axis]]}]"
    limits = scene.axes[axis].limits if axis in scene.axes else None
    if limits is None:
        return ""
    low, high = (limit.value for limit in limits)
    outside = np.flatnonzero((path.positions[:, column] < low) | (path.positions[:, column] > high))
    if not len(outside):
        return ""
    first, unit = int(outside[0]), path.units[column]
    more = f" ({len(outside) - 1} rows more)" if len(outside) > 1 else ""
    places = [show_position(float(place), unit) for place in (path.positions[first, column], low, high)]
    return f"{path.name}:{path.lines[first]}: {places[0]} is outside the limits of axis {axis}: {places[1]} to {places[2]}{more}"
