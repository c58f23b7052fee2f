"""Position errors of a tool over a volume as a result: the types, and how they read in both files."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.answers.map import name_axes
from headstock.pipeline.numbers.estimates import scale_parts, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, Series, make_key
from headstock.pipeline.storage.json_texts import check_finite, nest_known
from headstock.solvers.linear.volumetric import AxisMotions, Squareness, measure_range

SYMBOLS = ("EX", "EY", "EZ", "EA", "EB", "EC")
TOTAL = "total"
MICRO = 1e6


@dataclass(frozen=True, eq=False)
class VolumetricAnswer(Answer):
    """Position error of the tool against the work over a grid of poses.

    Attributes:
        axes: Names of the two or three axes of the grid.
        axis_units: Axis to ``m`` or ``rad``.
        positions: Their positions [m, rad].
        fixed: Positions of the other axes.
        sources: Source to its part ``(n0, n1, ..., 6)`` of the error, machine axes [m, rad]; NaN
            where the machine cannot stand.
        budget: Direction x, y, z to the share of each part in the variation over the volume.
        lines: Error motions along each axis through the middle of the grid.
        squareness: Of each pair of linear axes.
        grid_errors: ``(n0, n1, ..., 6)`` how far the error of each pose may be off; NaN where nobody knows.
        failed: Poses without an answer.
    """

    point: str
    axes: tuple[str, ...]
    axis_units: dict[str, str]
    positions: tuple[FloatArray, ...]
    fixed: dict[str, float]
    sources: dict[str, FloatArray]
    budget: dict[str, dict[str, float]]
    lines: tuple[AxisMotions, ...]
    squareness: tuple[Squareness, ...]
    grid_errors: FloatArray
    failed: int = 0
    units: ClassVar[dict[str, str]] = {
        r"volumetric/.*/positions/.*": "m or rad",
        r"volumetric/.*": "SI: m, m, m, rad, rad, rad",
    }
    entry: ClassVar[str] = "volumetric"
    keys: ClassVar[str] = """volumetric.*(axes[] units.* positions[][] fixed.* quantities.*.**
        ranges.*.* range_errors.*.* error_share.*.* error_parts.*.*.* error_left_out[]
        largest_um largest_error_um largest_at.* budget.*.*
        lines.*(unit positions[] motions.*[] deviations.* errors.* along)
        squareness[](first second symbol angle_urad error_urad) failed)"""

    @property
    def place(self) -> str:
        """Its pose or point."""
        return self.point

    @property
    def total(self) -> FloatArray:
        """``(n0, n1, ..., 6)`` of all sources together."""
        return np.sum(list(self.sources.values()), axis=0)

    @cached_property
    def grids(self) -> dict[str, FloatArray]:
        """The whole error, then its part by source ``(n0, n1, ..., 6)`` [m, rad]."""
        return {TOTAL: self.total, **self.sources}

    @cached_property
    def quantities(self) -> dict[str, FloatArray]:
        """Error by source and component, and its ± where there is one [um, urad]."""
        known = {"error": self.grid_errors} if np.isfinite(self.grid_errors).any() else {}
        return {
            f"{source}_{symbol}": MICRO * values[..., dof]
            for source, values in (self.grids | known).items()
            for dof, symbol in enumerate(SYMBOLS)
        }

    def find_largest(self) -> tuple[float, dict[str, float]]:
        """Return the largest position error [m], and where the axes of the grid are then."""
        sizes = np.linalg.norm(self.total[..., :3], axis=-1)
        worst = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        places = zip(self.axes, self.positions, worst, strict=True)
        return float(sizes[worst]), {axis: float(values[place]) for axis, values, place in places}

    def list_numbers(self) -> Iterator[Number]:
        """Yield ranges by source, the largest error, deviations along axes and squareness."""
        values: dict[Key, tuple[float, str]] = {}
        for source, grid in self.grids.items():
            for symbol, size in zip(SYMBOLS, measure_range(grid), strict=True):
                values[range_key(self.point, source, symbol)] = float(size), _unit_of(symbol)
        values[largest_key(self.point)] = self.find_largest()[0], "m"
        for line in self.lines:
            for symbol, size in zip(SYMBOLS, line.deviations, strict=True):
                values[line_key(self.point, line.axis, symbol)] = float(size), _unit_of(symbol)
        for pair in self.squareness:
            values[squareness_key(self.point, pair)] = float(pair.angle), "rad"
        for key, (value, unit) in values.items():
            yield Number(key, value, unit, self.errors.get(key))

    def list_series(self) -> Iterator[Series]:
        """Yield the error over the grid by source and component."""
        axes = name_axes(self)
        for source, values in self.grids.items():
            for number, symbol in enumerate(SYMBOLS):
                unit = _unit_of(symbol)
                key = f"volumetric(point={self.point},source={source},component={symbol})"
                errors = {"all": self.grid_errors[..., number]} if source == TOTAL else {}
                yield Series(key, axes, values[..., number], unit, errors)

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        every, (largest, largest_at) = self.grids, self.find_largest()
        return {
            "axes": list(self.axes),
            "units": self.axis_units,
            "positions": [
                check_finite("positions of the volumetric map", values) for values in self.positions
            ],
            "fixed": self.fixed,
            "quantities": {name: nest_known(values) for name, values in self.quantities.items()},
            "ranges": {
                source: _by_symbol(measure_range(values)) for source, values in every.items()
            },
            "range_errors": {
                source: {
                    symbol: scale_total(self.errors[range_key(self.point, source, symbol)], MICRO)
                    for symbol in SYMBOLS
                }
                for source in every
            },
            "error_share": {
                symbol: scale_shares(self.errors[range_key(self.point, TOTAL, symbol)], MICRO)
                for symbol in SYMBOLS
            },
            "error_parts": {
                symbol: scale_parts(self.errors[range_key(self.point, TOTAL, symbol)], MICRO)
                for symbol in SYMBOLS
            },
            "error_left_out": list(self.errors[largest_key(self.point)].left_out),
            "largest_um": MICRO * largest,
            "largest_error_um": scale_total(self.errors[largest_key(self.point)], MICRO),
            "largest_at": largest_at,
            "budget": self.budget,
            "lines": {line.axis: self._summarise_line(line) for line in self.lines},
            "squareness": [
                {
                    "first": each.first,
                    "second": each.second,
                    "symbol": each.symbol,
                    "angle_urad": MICRO * each.angle,
                    "error_urad": scale_total(self.errors[squareness_key(self.point, each)], MICRO),
                }
                for each in self.squareness
            ],
            "failed": self.failed,
        }

    def _summarise_line(self, line: AxisMotions) -> Entry:
        return {
            "unit": self.axis_units[line.axis],
            "positions": [float(value) for value in line.positions],
            "motions": {
                symbol: [MICRO * float(value) for value in line.motions[:, dof]]
                for dof, symbol in enumerate(SYMBOLS)
            },
            "deviations": _by_symbol(line.deviations),
            "errors": {
                symbol: scale_total(self.errors[line_key(self.point, line.axis, symbol)], MICRO)
                for symbol in SYMBOLS
            },
            "along": name_travel(line),
        }

    def fill(self, file: "h5py.File") -> None:
        """Write the positions and every source."""
        group = file.create_group(f"volumetric/{self.point}")
        for axis, values in zip(self.axes, self.positions, strict=True):
            group[f"positions/{axis}"] = values
        for source, values in self.sources.items():
            group[source.replace(" ", "_")] = values
        group["error"] = self.grid_errors


def name_travel(line: AxisMotions) -> str | None:
    """Return where the tool travels against the work, ``-x`` where the axis moves the work along x."""
    if line.along is None:
        return None
    return f"{'-' if line.travel[line.along] < 0.0 else ''}{'xyz'[line.along]}"


def range_key(point: str, source: str, symbol: str) -> Key:
    """Return the key of the range of a component over the volume."""
    return make_key("volumetric_range", point=point, source=source, component=symbol)


def largest_key(point: str) -> Key:
    """Return the key of the largest error over the volume."""
    return make_key("volumetric_error", point=point)


def line_key(point: str, axis: str, symbol: str) -> Key:
    """Return the key of the deviation of a component along an axis."""
    return make_key("line_deviation", point=point, axis=axis, component=symbol)


def squareness_key(point: str, pair: Squareness) -> Key:
    """Return the key of the squareness of two axes."""
    return make_key("squareness", point=point, axes=f"{pair.first}-{pair.second}")


def _unit_of(symbol: str) -> str:
    """Return the SI unit of a component."""
    return "m" if symbol in SYMBOLS[:3] else "rad"


def _by_symbol(values: FloatArray) -> dict[str, float]:
    return {symbol: MICRO * float(value) for symbol, value in zip(SYMBOLS, values, strict=True)}
