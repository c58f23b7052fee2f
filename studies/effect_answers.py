"""The answers of a run by kind, and how far apart those of two runs are."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.json_texts import Json

RIGID_HZ = 1e-2  # below it a frequency is a rigid-body mode's

# answer: unit of its numbers
UNITS = {
    "frequencies": "Hz",
    "static compliance": "µm/kN",
    "displacement under loads": "µm",
    "dynamic stiffness": "N/µm",
    "path deviation": "µm",
    "control poles": "Hz",
    "velocity lag": "µm",
    "sag on the contour": "µm",
    "contour gap": "µm",
    "contour ripple": "µm",
    "leg forces": "N",
    "variation of leg forces": "N",
    "map of frequencies": "Hz",
}

# numbers that are each held against themselves; of the others, components of a vector say, the largest of the group counts
EACH_ITS_OWN = {"frequencies", "dynamic stiffness", "control poles", "map of frequencies"}


@dataclass(frozen=True)
class Change:
    """How far an answer of two runs is apart.

    Attributes:
        answer: Which, of :data:`UNITS`.
        share: Largest difference of one number in either run, over that number, or over the largest of its group.
        entry: Where it is largest.
        without: Its number without the effect; None where that run has no such answer.
        present: Its number with it.
    """

    answer: str
    share: float
    entry: str
    without: float | None
    present: float | None


def list_answers(summary: Json) -> dict[str, dict[str, FloatArray]]:
    """Answer to entry to its numbers, of what a summary holds."""
    found: dict[str, dict[str, FloatArray]] = {}
    for answer, entry, numbers in _entries(summary):
        values = np.array(
            [np.nan if number is None else number for number in np.ravel(np.array(numbers, dtype=object))], dtype=float
        )
        if values.size:
            found.setdefault(answer, {})[entry] = values
    return found


def compare_answers(without: Json, present: Json) -> list[Change]:
    """Every answer of two summaries, the largest difference of each."""
    before, after = list_answers(without), list_answers(present)
    changes = []
    for answer in UNITS:
        first, second = before.get(answer, {}), after.get(answer, {})
        found = [_compare(answer, entry, first.get(entry), second.get(entry)) for entry in dict.fromkeys((*first, *second))]
        if found:
            changes.append(max(found, key=lambda change: change.share))
    return changes


def _compare(answer: str, entry: str, first: FloatArray | None, second: FloatArray | None) -> Change:
    if first is None or second is None or first.shape != second.shape:
        return Change(answer, 1.0, entry, _largest(first), _largest(second))
    sizes = np.maximum(np.abs(np.nan_to_num(first)), np.abs(np.nan_to_num(second)))
    scale = sizes if answer in EACH_ITS_OWN else np.full_like(sizes, sizes.max())
    off = np.abs(np.nan_to_num(second) - np.nan_to_num(first)) / np.where(scale > 0.0, scale, 1.0)
    place = int(np.argmax(off))
    return Change(answer, float(off[place]), entry, _number(first[place]), _number(second[place]))


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _largest(values: FloatArray | None) -> float | None:
    return None if values is None or not np.isfinite(values).any() else float(values[np.nanargmax(np.abs(values))])


def _entries(summary: Json) -> Iterator[tuple[str, str, Any]]:
    yield from _machine_entries(summary)
    for run in summary.get("path", {}).get("feeds", []):
        for output in run["outputs"]:
            for zone, figures in output.items():
                if zone != "port" and "peak_um" in figures:
                    where = f"{' '.join(output['port'])}, {zone}, {run['name']}"
                    yield "path deviation", where, [figures["peak_um"], figures["span_um"]]
    for pose, found in summary.get("control", {}).items():
        yield "control poles", f"pose {pose}", [pole["frequency_hz"] for pole in found["poles"]]
        for name, drive in found["drives"].items():
            yield "velocity lag", f"drive {name} in pose {pose}", [drive["velocity_lag_um"]]
    contour = summary.get("contouring")
    if contour:
        yield "sag on the contour", "all faces", contour["sag_um"]["most"]
        for answer, key in (("contour gap", "mean_um"), ("contour ripple", "peak_to_peak_um"), ("leg forces", "leg_force_mean_n"),
                            ("variation of leg forces", "leg_force_peak_to_peak_n")):  # fmt: skip
            yield from ((answer, f"face {face['face']}", face[key]) for face in contour["faces"])
    for name, values in summary.get("map", {}).get("quantities", {}).items():
        if name.endswith("_hz"):
            yield "map of frequencies", name, np.array(values, dtype=object).astype(float)


def _machine_entries(summary: Json) -> Iterator[tuple[str, str, Any]]:
    for modes in summary["modal"]:
        elastic = [hz for hz in modes["frequencies_hz"] if hz > RIGID_HZ]
        yield "frequencies", f"pose {modes['pose_name']}", elastic
    points = summary.get("static_poses") or {"": summary["static"]}
    for pose, found in points.items():
        for name, point in found.items():
            where = f"{name} in pose {pose}" if pose else name
            yield "static compliance", where, _open_as_nan(point["compliance_um_per_kN"])
            # zeros without a load or gravity: a displacement that comes with an effect is a change of all of it
            yield "displacement under loads", where, 1e6 * _open_as_nan(point.get("displacement", [0.0] * 6)[:3])
    for pose, response in summary.get("frf", {}).items():
        for port in response["ports"]:
            if port.get("softest_N_per_um") is not None:
                yield "dynamic stiffness", f"{' '.join(port['port'])} in pose {pose}", [port["softest_N_per_um"]]


def _open_as_nan(values: Any) -> Any:
    return np.array(values, dtype=object).astype(float)
