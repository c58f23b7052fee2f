"""The one file of a sweep's results, ``sweep.h5``: the same bytes however often the sweep was
interrupted.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, NotRequired, TypedDict

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.lobes import MM, RPM
from headstock.pipeline.answers.static import N_PER_UM, UM_PER_KN
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Key
from headstock.pipeline.results.files import mark_units
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.scene.studies import SweepKind
from headstock.studies.sweeps.journals import FIGURES, PoseState
from headstock.studies.sweeps.results import LimitMap, PointMap, SweepResults

# nested like the dimensions of an array, None for NaN
type Numbers = float | None | Sequence[Numbers]

SWEEP_FILE = "sweep.h5"
FORMAT, VERSION = "headstock sweep", 2
# pattern of the path of a data set to its unit
UNITS = {
    r"axes|units|states|errors|shape|modal/tracked/(names|index)|static/.*/weakest": "",
    r"positions": "SI: m or rad, by units",
    r"modal/(tracked/)?frequencies_hz|frf/.*_hz": "Hz",
    r"modal/shapes": "SI: m or rad per sqrt(kg)",
    r"modal/rigid_count|modal/tracked/correlation|condition_number|static/.*/(direction|ratio|weakest_share)": "1",
    r"static/.*/largest": "m/N",
    r"static/.*/compliance": "m/N",
    r"lobes/.*/speeds": "rad/s",
    r"lobes/.*/directions": "1",
    r"lobes/.*/limit_depth": "m",
    r"lobes/.*/chatter_hz": "Hz",
    r"lobes/.*/mode": "",
    r"frf/.* r[xyz]/most_negative_real": "rad/(N m)",
    r"frf/.* r[xyz]/.*": "N m/rad",
    r"frf/.*/most_negative_real": "m/N",
    r"frf/.*": "N/m",
}


def write_sweep(folder: Path, results: SweepResults) -> None:
    """Write ``sweep.h5``: it is the old one or the whole new one.

    Raises:
        OutputError: It cannot be written.
    """
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        _fill(file, results)
    write_output(folder / SWEEP_FILE, image.getvalue())


def _fill(file: "h5py.File", results: SweepResults) -> None:
    sweep = results.sweep
    file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
    file.attrs["name"], file.attrs["sweep"], file.attrs["kind"] = (
        results.name,
        sweep.name,
        sweep.kind,
    )
    file.attrs["key"] = results.key
    file["axes"], file["units"] = _words(sweep.axes), _words(sweep.units)
    file["shape"], file["positions"] = np.array(sweep.shape), sweep.positions
    file["states"], file["errors"] = _words(results.states), _words(results.errors)
    if results.modes is not None and results.tracked is not None:
        group = file.create_group("modal")
        group["frequencies_hz"], group["rigid_count"] = (
            results.modes.frequencies_hz,
            results.modes.rigid,
        )
        group["shapes"] = results.shapes
        tracked = group.create_group("tracked")
        tracked["frequencies_hz"], tracked["index"] = results.frequencies_hz, results.tracked.index
        tracked["correlation"] = results.tracked.correlation
        tracked["names"] = _words(results.mode_names)
    for name, point in results.points.items():
        _fill_point(file.create_group(f"static/{name}"), point)
    if results.condition is not None:
        file["condition_number"] = results.condition
    for (name, direction), values in results.figures.items():
        group = file.create_group(f"frf/{name} {direction}")
        for column, figure in enumerate(FIGURES):
            group[figure] = values[:, column]
    for name, limits in results.limits.items():
        group = file.create_group(f"lobes/{name}")
        group["speeds"], group["limit_depth"] = limits.speeds, limits.depths
        group["chatter_hz"], group["mode"] = limits.chatter_hz, _words(limits.modes)
        group["directions"] = limits.directions
    mark_units(file, UNITS)


def _fill_point(group: h5py.Group, point: PointMap) -> None:
    group["compliance"], group["largest"] = point.compliance, point.largest
    group["direction"], group["ratio"] = point.direction, point.ratio
    group["weakest"], group["weakest_share"] = (
        _words([name for names in point.links for name in names], (-1, 3)),
        point.link_shares,
    )


def _words(words: tuple[str, ...] | list[str], shape: tuple[int, ...] = (-1,)) -> object:
    return np.char.encode(np.array(words, dtype=str), "utf-8").reshape(shape)


class _SampleSummary(TypedDict):
    """Errors in a pose: of modes by their number [Hz], of compliances by point and direction x, y,
    z.
    """

    pose: int
    error_hz: dict[str, float | None]
    error_um_per_kN: dict[str, dict[str, float | None]]
    error_left_out: list[str]


class _CrossingSummary(TypedDict):
    """Two modes, numbered from 1, and between how many pairs of neighbouring poses they cross."""

    modes: list[int]
    between_neighbours: int


class PointMapSummary(TypedDict):
    """Compliance at a point; the first dimension of everything is the pose."""

    compliance_um_per_kN: Numbers
    largest_um_per_kN: Numbers
    direction: Numbers
    ratio: Numbers
    weakest: list[list[str]]
    weakest_share: Numbers


class LimitMapSummary(TypedDict):
    """Limit depth of cut of a direction of travel over the poses, its vector in each of them, and the depth that is stable in all
    of them over the speeds; every speed of every pose is in ``sweep.h5``. The common best speed is
    the one whose limit is deepest in the worst pose.
    """

    directions: Numbers
    lowest_mm: Numbers
    lowest_rpm: Numbers
    best_mm: Numbers
    best_rpm: Numbers
    chatter_hz: Numbers
    modes: list[str]
    rpm: Numbers
    everywhere_mm: Numbers
    common_best_mm: float | None
    common_best_rpm: float | None
    at_common_best_mm: Numbers


class SweptAxes(TypedDict):
    """Axes that are set, the unit ``m`` or ``rad`` of each, and its position in every pose."""

    axes: list[str]
    units: list[str]
    positions: list[list[float]]


class SweepSummary(SweptAxes):
    """The content of ``sweep.json``; the first dimension of numbers is the pose, errors have its
    number as key.
    """

    name: str
    sweep: str
    kind: SweepKind
    status: Literal["done", "failed"]
    shape: list[int]
    labels: list[str]
    states: list[PoseState]
    errors: dict[str, str]
    frequencies_hz: Numbers
    mode_names: list[str]
    sampled_errors: list[_SampleSummary]
    correlation: Numbers
    crossings: list[_CrossingSummary]
    tracking_breaks: int
    static: dict[str, PointMapSummary]
    condition_number: Numbers
    frf: dict[str, dict[str, Numbers]]
    lobes: dict[str, LimitMapSummary]
    limits_confirmed: bool
    warnings: list[str]
    provenance: NotRequired[ProvenanceSummary]


def summarise_sweep(results: SweepResults) -> SweepSummary:
    """The sweep as JSON: what is printed and drawn; null where there is nothing."""
    sweep = results.sweep
    crossings = {} if results.tracked is None else results.tracked.crossings
    return {
        "name": results.name,
        "sweep": sweep.name,
        "kind": sweep.kind,
        "status": "failed" if results.failed else "done",
        "axes": list(sweep.axes),
        "units": list(sweep.units),
        "shape": list(sweep.shape),
        "labels": list(sweep.labels),
        "positions": [row.tolist() for row in sweep.positions],
        "states": list(results.states),
        "errors": {str(number): error for number, error in enumerate(results.errors) if error},
        "frequencies_hz": _nulls(results.frequencies_hz),
        "mode_names": list(results.mode_names),
        "sampled_errors": [_summarise_errors(*sample) for sample in results.sampled_errors.items()],
        "correlation": [] if results.tracked is None else _nulls(results.tracked.correlation),
        "crossings": [
            {"modes": [one + 1, other + 1], "between_neighbours": count}
            for (one, other), count in crossings.items()
        ],
        "tracking_breaks": 0 if results.tracked is None else results.tracked.tracking_breaks,
        "static": {name: _summarise_point(point) for name, point in results.points.items()},
        "condition_number": None if results.condition is None else _nulls(results.condition),
        "frf": {
            " ".join(channel): _summarise_figures(values)
            for channel, values in results.figures.items()
        },
        "lobes": {name: _summarise_limits(limits) for name, limits in results.limits.items()},
        "limits_confirmed": results.limits_confirmed,
        "warnings": list(results.warnings),
    }


def _summarise_errors(pose: int, errors: Mapping[Key, Estimate]) -> _SampleSummary:
    summary: _SampleSummary = {
        "pose": pose,
        "error_hz": {},
        "error_um_per_kN": {},
        "error_left_out": sorted({words for each in errors.values() for words in each.left_out}),
    }
    for key, error in errors.items():
        total = error.total
        if key.kind == "frequency":
            summary["error_hz"][str(key["mode"])] = total
        else:
            point = summary["error_um_per_kN"].setdefault(str(key["point"]), {})
            point[str(key["direction"])] = None if total is None else UM_PER_KN * total
    return summary


def _summarise_point(point: PointMap) -> PointMapSummary:
    return {
        "compliance_um_per_kN": _nulls(UM_PER_KN * point.compliance),
        "largest_um_per_kN": _nulls(UM_PER_KN * point.largest),
        "direction": _nulls(point.direction),
        "ratio": _nulls(point.ratio),
        "weakest": [list(names) for names in point.links],
        "weakest_share": _nulls(point.link_shares),
    }


def _summarise_limits(limits: LimitMap) -> LimitMapSummary:
    rpm, everywhere = RPM * limits.speeds, MM * limits.everywhere
    looked = np.isfinite(limits.depths)
    looked_at = np.asarray(looked.any(axis=1))
    low, high = (np.where(looked, limits.depths, side) for side in (np.inf, -np.inf))
    best = int(np.nanargmax(everywhere)) if np.isfinite(everywhere).any() else None
    return {
        "directions": _nulls(limits.directions),
        "lowest_mm": _nulls(np.where(looked_at, MM * low.min(axis=1), np.nan)),
        "lowest_rpm": _nulls(np.where(looked_at, rpm[np.argmin(low, axis=1)], np.nan)),
        "best_mm": _nulls(np.where(looked_at, MM * high.max(axis=1), np.nan)),
        "best_rpm": _nulls(np.where(looked_at, rpm[np.argmax(high, axis=1)], np.nan)),
        "chatter_hz": _nulls(limits.chatter_hz),
        "modes": list(limits.modes),
        "rpm": _nulls(rpm),
        "everywhere_mm": _nulls(everywhere),
        "common_best_mm": None if best is None else float(everywhere[best]),
        "common_best_rpm": None if best is None else float(rpm[best]),
        "at_common_best_mm": _nulls(
            np.full(len(looked_at), np.nan) if best is None else MM * limits.depths[:, best]
        ),
    }


def _summarise_figures(values: FloatArray) -> dict[str, Numbers]:
    scales = {
        "most_negative_real": ("_um_per_kN", UM_PER_KN),
        "chatter_limit": ("_N_per_um", N_PER_UM),
        "minimum_dynamic_stiffness": ("_N_per_um", N_PER_UM),
    }
    summary = {}
    for column, name in enumerate(FIGURES):
        suffix, scale = scales.get(name, ("", 1.0))
        summary[name + suffix] = _nulls(scale * values[:, column])
    return summary


def _nulls(values: FloatArray) -> Numbers:
    content = values.astype(object)
    content[~np.isfinite(values)] = None
    nested: Numbers = content.tolist()
    return nested
