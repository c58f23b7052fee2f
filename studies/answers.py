"""Answers of two runs compared by kind: how far each moves, and where most."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypedDict

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.summary import RunSummary

RIGID_HZ = 1e-2  # below it a frequency is a rigid-body mode's
# answer: unit of its numbers
UNITS = {
    "frequencies": "Hz",
    "static compliance": "µm/kN",
    "displacement under loads": "µm",
    "dynamic stiffness": "N/µm",
    "lines of frequency responses": "m/N",
    "limit depth of cut": "mm",
    "frequency of chatter": "Hz",
    "volumetric error": "µm",
    "path deviation": "µm",
    "peaks over time": "µm",
    "rest positions": "µm",
    "settling times": "s",
    "motor torques": "N m",
    "position errors": "µm",
    "control poles": "Hz",
    "velocity lag": "µm",
    "deflection under gravity on the contour": "µm",
    "contour gap": "µm",
    "contour ripple": "µm",
    "location error of faces": "µm",
    "roughness Ra": "µm",
    "waviness Wt": "µm",
    "drive forces": "N",
    "variation of drive forces": "N",
    "map of frequencies": "Hz",
}
# numbers that are each compared with themselves; of the others, components of a vector say, the
# largest of the group counts
EACH_ITS_OWN = {
    "frequencies",
    "dynamic stiffness",
    "limit depth of cut",
    "frequency of chatter",
    "settling times",
    "control poles",
    "location error of faces",
    "roughness Ra",
    "waviness Wt",
    "map of frequencies",
}


class ChangeSummary(TypedDict):
    """How far an answer moves, and where most: its number without the effect and with it."""

    answer: str
    share: float
    entry: str
    without: float | None
    present: float | None


ROUNDING = 1e-9  # beside the largest number of an answer


@dataclass(frozen=True)
class Change:
    """How far an answer of two runs is apart.

    Attributes:
        answer: Which, of :data:`UNITS`.
        share: Largest difference of one number in either run, over that number, or over the largest
            of its group.
        entry: Where it is largest.
        without: Its number without the effect; None where that run has no such answer.
        present: Its number with it.
    """

    answer: str
    share: float
    entry: str
    without: float | None
    present: float | None

    def summarise(self) -> ChangeSummary:
        """As it stands in JSON."""
        return {
            "answer": self.answer,
            "share": self.share,
            "entry": self.entry,
            "without": self.without,
            "present": self.present,
        }


def list_answers(summary: RunSummary) -> dict[str, dict[str, FloatArray]]:
    """Answer to entry to its numbers, of what a summary holds."""
    found: dict[str, dict[str, FloatArray]] = {}
    for entry in _entries(summary):
        values = np.ravel(np.array(entry.numbers, dtype=np.float64))  # None becomes NaN
        if values.size:
            found.setdefault(entry.answer, {})[entry.where] = values
    return found


def compare_answers(without: RunSummary, present: RunSummary) -> list[Change]:
    """Every answer of two summaries, the largest difference of each."""
    before, after = list_answers(without), list_answers(present)
    changes = []
    for answer in UNITS:
        first, second = before.get(answer, {}), after.get(answer, {})
        found = [
            _compare(answer, entry, first.get(entry), second.get(entry))
            for entry in dict.fromkeys((*first, *second))
            if answer in EACH_ITS_OWN or _counts(entry, first, second)
        ]
        if found:
            changes.append(max(found, key=lambda change: change.share))
    return changes


def _counts(entry: str, first: Mapping[str, FloatArray], second: Mapping[str, FloatArray]) -> bool:
    """Whether an entry is more than rounding beside the largest of its answer: by symmetry some are
    zero.
    """
    sizes = [
        np.nanmax(np.abs(values), initial=0.0)
        for found in (first, second)
        for values in found.values()
    ]
    own = [
        np.nanmax(np.abs(found[entry]), initial=0.0) for found in (first, second) if entry in found
    ]
    return not max(own) < ROUNDING * max(sizes)


def _compare(
    answer: str, entry: str, first: FloatArray | None, second: FloatArray | None
) -> Change:
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
    return (
        None
        if values is None or not np.isfinite(values).any()
        else float(values[np.nanargmax(np.abs(values))])
    )


class _Entry(NamedTuple):
    """Numbers of an answer, where they stand, None where there is none."""

    answer: str
    where: str
    numbers: Sequence[object] | FloatArray


def _entries(summary: RunSummary) -> Iterator[_Entry]:
    yield from _machine_entries(summary)
    for run in summary["path"]["feeds"] if "path" in summary else ():
        for output in run["outputs"]:
            for zone, figures in (
                ("accelerating", output["accelerating"]),
                ("decelerating", output["decelerating"]),
            ):
                if "peak_um" in figures:
                    where = f"{' '.join(output['dof'])}, {zone}, {run['name']}"
                    yield _Entry("path deviation", where, [figures["peak_um"], figures["span_um"]])
        for name, motor in run["drives"].items():
            where = f"{name}, {run['name']}"
            yield _Entry("motor torques", where, [motor["torque_nm"]])
            yield _Entry("position errors", where, [motor["position_error_um"]])
    for pose, transient in summary.get("transient", {}).items():
        for name, moved in transient["outputs"].items():
            if moved["unit"] == "um":
                where = f"{name} in pose {pose}"
                yield _Entry("peaks over time", where, [moved["peak"]])
                yield _Entry("rest positions", where, [moved["final"]])
                yield _Entry("settling times", where, [moved["settling_s"]])
        for name, motor in transient["drives"].items():
            where = f"{name} in pose {pose}"
            yield _Entry("motor torques", where, [motor["torque_nm"]])
            yield _Entry("position errors", where, [motor["position_error_um"]])
    for pose, lobes in summary.get("lobes", {}).items():
        for direction in lobes["directions"]:
            if (lowest := direction["lowest"]) is not None:
                where = f"{direction['name']} in pose {pose}"
                yield _Entry("limit depth of cut", where, [lowest["limit_depth_mm"]])
                yield _Entry("frequency of chatter", where, [lowest["chatter_hz"]])
    for name, volume in summary.get("volumetric", {}).items():
        ranges = volume["ranges"]["total"]
        yield _Entry("volumetric error", name, [ranges[symbol] for symbol in ("EX", "EY", "EZ")])
    for pose, found in summary.get("control", {}).items():
        yield _Entry(
            "control poles", f"pose {pose}", [pole["frequency_hz"] for pole in found["poles"]]
        )
        for name, drive in found["drives"].items():
            yield _Entry("velocity lag", f"drive {name} in pose {pose}", [drive["velocity_lag_um"]])
    contour = summary.get("contouring")
    if contour:
        yield _Entry(
            "deflection under gravity on the contour",
            "all faces",
            contour["gravity_deflection_um"]["maximum"],
        )
        for face in contour["faces"]:
            where = f"face {face['face']}"
            yield _Entry("contour gap", where, face["mean_um"])
            yield _Entry("contour ripple", where, face["peak_to_peak_um"])
            yield _Entry("drive forces", where, face["drive_force_mean_n"])
            yield _Entry("variation of drive forces", where, face["drive_force_peak_to_peak_n"])
        for milled in contour.get("milled_faces", []):
            where = f"face {milled['face']}"
            yield _Entry("location error of faces", where, [milled["location_error_um"]])
            yield _Entry("roughness Ra", where, [milled["ra_um"]])
            yield _Entry("waviness Wt", where, [milled["wt_um"]])
    for name, values in summary["map"]["quantities"].items() if "map" in summary else ():
        if name.endswith("_hz"):
            yield _Entry("map of frequencies", name, values)


def _machine_entries(summary: RunSummary) -> Iterator[_Entry]:
    for modes in summary["modal"]:
        elastic = [hz for hz in modes["frequencies_hz"] if hz > RIGID_HZ]
        yield _Entry("frequencies", f"pose {modes['pose_name']}", elastic)
    points = summary.get("static_poses") or {"": summary["static"]}
    for pose, found in points.items():
        for name, point in found.items():
            where = f"{name} in pose {pose}" if pose else name
            yield _Entry("static compliance", where, point["compliance_um_per_kN"])
            # zeros without a load or gravity: a displacement that comes with an effect is a change
            # of all of it
            moved = np.array(point.get("displacement", [0.0] * 6)[:3], dtype=np.float64)
            yield _Entry("displacement under loads", where, 1e6 * moved)
    for pose, response in summary.get("frf", {}).items():
        for channel in response["drive_points"]:
            if channel.get("minimum_dynamic_stiffness_N_per_um") is not None:
                yield _Entry(
                    "dynamic stiffness",
                    f"{' '.join(channel['dof'])} in pose {pose}",
                    [channel["minimum_dynamic_stiffness_N_per_um"]],
                )
