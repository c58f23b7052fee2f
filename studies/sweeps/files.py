"""The one file of a sweep's results, ``sweep.h5``: the same bytes however often the sweep was
interrupted.
"""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Entry
from headstock.pipeline.answers.lobes import MM
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.results.files import mark_units
from headstock.pipeline.storage.outputs import write_output
from headstock.studies.sweeps.journals import FIGURES
from headstock.studies.sweeps.results import LimitMap, PointMap, PoseErrors, SweepResults

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
    file.attrs["name"] = results.name
    file.attrs["sweep"] = sweep.name
    file.attrs["kind"] = sweep.kind
    file.attrs["key"] = results.key
    file["axes"], file["units"] = _words(sweep.axes), _words(sweep.units)
    file["shape"], file["positions"] = np.array(sweep.shape), sweep.positions
    file["states"], file["errors"] = _words(results.states), _words(results.errors)
    if results.modes is not None and results.tracked is not None:
        group = file.create_group("modal")
        group["frequencies_hz"] = results.modes.frequencies_hz
        group["rigid_count"] = results.modes.rigid
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
    group["weakest"] = _words([name for names in point.links for name in names], (-1, 3))
    group["weakest_share"] = point.link_shares


def _words(words: tuple[str, ...] | list[str], shape: tuple[int, ...] = (-1,)) -> object:
    return np.char.encode(np.array(words, dtype=str), "utf-8").reshape(shape)


def summarise_sweep(results: SweepResults) -> Entry:
    """Return the content of ``sweep.json``; the first dimension of numbers is the pose, errors have its
    number as key, null where there is nothing.
    """
    sweep = results.sweep
    crossings = {} if results.tracked is None else results.tracked.crossings
    return {
        "name": results.name,
        "sweep": sweep.name,
        "kind": sweep.kind,
        "status": results.status,
        "axes": list(sweep.axes),
        "units": list(sweep.units),
        "shape": list(sweep.shape),
        "labels": list(sweep.labels),
        "positions": [row.tolist() for row in sweep.positions],
        "states": list(results.states),
        "errors": {str(number): error for number, error in enumerate(results.errors) if error},
        "frequencies_hz": _nulls(results.frequencies_hz),
        "mode_names": list(results.mode_names),
        "sampled_errors": [*map(_summarise_errors, results.pose_errors)],
        "correlation": [] if results.tracked is None else _nulls(results.tracked.correlation),
        "crossings": [
            {"modes": [one + 1, other + 1], "between_neighbours": count}
            for (one, other), count in crossings.items()
        ],
        "tracking_breaks": 0 if results.tracked is None else results.tracked.tracking_breaks,
        "static": {name: _summarise_point(point) for name, point in results.points.items()},
        "condition_number": None if results.condition is None else _nulls(results.condition),
        "frf": {
            channel: {name: _nulls(values) for name, values in figures.items()}
            for channel, figures in results.responses.items()
        },
        "lobes": {name: _summarise_limits(limits) for name, limits in results.limits.items()},
        "limits_confirmed": results.limits_confirmed,
        "warnings": list(results.warnings),
    }


def _summarise_errors(errors: PoseErrors) -> Entry:
    return {
        "pose": errors.pose,
        "error_hz": {str(mode): size for mode, size in errors.modes.items()},
        "error_um_per_kN": errors.compliances,
        "error_left_out": errors.left_out,
    }


def _summarise_point(point: PointMap) -> Entry:
    return {
        "compliance_um_per_kN": _nulls(UM_PER_KN * point.compliance),
        "largest_um_per_kN": _nulls(UM_PER_KN * point.largest),
        "direction": _nulls(point.direction),
        "ratio": _nulls(point.ratio),
        "weakest": [list(names) for names in point.links],
        "weakest_share": _nulls(point.link_shares),
    }


def _summarise_limits(limits: LimitMap) -> Entry:
    rpm, everywhere, best = limits.rpm, MM * limits.everywhere, limits.common_best
    found = {name: _nulls(values) for name, values in limits.figures.items()}
    at_common_best = found.pop("at_common_best_mm")
    chatter = found.pop("chatter_hz")
    return {
        "directions": _nulls(limits.directions),
        **found,
        "chatter_hz": chatter,
        "modes": list(limits.modes),
        "rpm": _nulls(rpm),
        "everywhere_mm": _nulls(everywhere),
        "common_best_mm": None if best is None else float(everywhere[best]),
        "common_best_rpm": None if best is None else float(rpm[best]),
        "at_common_best_mm": at_common_best,
    }


def _nulls(values: FloatArray) -> Numbers:
    content = values.astype(object)
    content[~np.isfinite(values)] = None
    nested: Numbers = content.tolist()
    return nested
