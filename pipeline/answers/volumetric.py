"""Position errors of a tool over a volume as a result: the types, and how they read in both files."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, TypedDict

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.libraries import h5py
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.map import GridSummary, nest_grid
from headstock.pipeline.numbers.estimates import Estimate, scale_parts, scale_shares
from headstock.pipeline.numbers.numbers import Number, Series, make_key
from headstock.pipeline.storage.json_texts import check_finite
from headstock.solvers.linear.volumetric import AxisMotions, Squareness, measure_range

SYMBOLS = ("EX", "EY", "EZ", "EA", "EB", "EC")
TOTAL = "total"
MICRO = 1e6


class AxisMotionsSummary(TypedDict):
    """Error motions along one axis; values by symbol without the axis' name. ``along``: where the
    tool travels against the work, ``-x`` where the axis moves the work along x; ``errors``: how far
    the deviations may be off.
    """

    unit: str
    positions: list[float]
    motions: dict[str, list[float]]
    deviations: dict[str, float]
    errors: dict[str, float | None]
    along: str | None


class SquarenessSummary(TypedDict):
    """Squareness of two axes."""

    first: str
    second: str
    symbol: str
    angle_urad: float
    error_urad: float | None


class VolumetricSummary(GridSummary):
    """The entry of a point in ``volumetric``; micrometres and microradians but for positions.
    ``range_errors``: how far ranges may be off, of all sources together by source of error in
    ``error_share`` and by component in ``error_parts``.
    """

    ranges: dict[str, dict[str, float]]
    range_errors: dict[str, dict[str, float | None]]
    error_share: dict[str, dict[str, float | None]]
    error_parts: dict[str, dict[str, dict[str, float]]]
    error_left_out: list[str]
    largest_um: float
    largest_error_um: float | None
    largest_at: dict[str, float]
    budget: dict[str, dict[str, float]]
    lines: dict[str, AxisMotionsSummary]
    squareness: list[SquarenessSummary]
    failed: int


@dataclass(frozen=True, eq=False)
class VolumetricAnswer(Answer):
    """Position error of the tool against the work over a grid of poses.

    Attributes:
        point: Where.
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
        range_errors: Source to how far its range may be off, in the order of the symbols.
        total_errors: The same of all sources together.
        largest_error: How far the largest error may be off.
        line_errors: How far the deviations of each line may be off.
        squareness_errors: How far each squareness may be off.
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
    range_errors: dict[str, list[Estimate]]
    total_errors: list[Estimate]
    largest_error: Estimate
    line_errors: tuple[list[Estimate], ...]
    squareness_errors: tuple[Estimate, ...]
    failed: int = 0
    units: ClassVar[dict[str, str]] = {
        r"volumetric/.*/positions/.*": "m or rad",
        r"volumetric/.*": "SI: m, m, m, rad, rad, rad",
    }
    entry: ClassVar[str] = "volumetric"

    @property
    def place(self) -> str:
        """Its pose or point."""
        return self.point

    @property
    def total(self) -> FloatArray:
        """``(n0, n1, ..., 6)`` of all sources together."""
        return np.asarray(np.sum(list(self.sources.values()), axis=0))

    def list_numbers(self) -> Iterator[Number]:
        """Yield ranges by source, the largest error, deviations along axes and squareness."""
        at = {"point": self.point}
        every = {TOTAL: (self.total, self.total_errors)} | {
            source: (values, self.range_errors.get(source, ()))
            for source, values in self.sources.items()
        }
        for source, (values, errors) in every.items():
            for number, size in enumerate(measure_range(values)):
                key = make_key("volumetric_range", source=source, component=SYMBOLS[number], **at)
                error = errors[number] if errors else None
                yield Number(key, float(size), _unit_of(number), error)
        largest = float(np.nanmax(np.linalg.norm(self.total[..., :3], axis=-1)))
        yield Number(make_key("volumetric_error", **at), largest, "m", self.largest_error)
        for line, errors in zip(self.lines, self.line_errors, strict=True):
            for number, size in enumerate(line.deviations):
                key = make_key("line_deviation", axis=line.axis, component=SYMBOLS[number], **at)
                yield Number(key, float(size), _unit_of(number), errors[number])
        for each, error in zip(self.squareness, self.squareness_errors, strict=True):
            key = make_key("squareness", axes=f"{each.first}-{each.second}", **at)
            yield Number(key, float(each.angle), "rad", error)

    def list_series(self) -> Iterator[Series]:
        """Yield the error over the grid by source and component."""
        axes = {
            f"{axis} [{self.axis_units[axis]}]": values
            for axis, values in zip(self.axes, self.positions, strict=True)
        }
        for source, values in {TOTAL: self.total, **self.sources}.items():
            for number, symbol in enumerate(SYMBOLS):
                key = f"volumetric(point={self.point},source={source},component={symbol})"
                errors = {"all": self.grid_errors[..., number]} if source == TOTAL else {}
                yield Series(key, axes, values[..., number], _unit_of(number), errors)

    def summarise(self) -> VolumetricSummary:
        """As it stands in ``summary.json``."""
        total = self.total
        sizes = np.linalg.norm(total[..., :3], axis=-1)
        worst = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        every = {TOTAL: total, **self.sources}
        grids = every | ({"error": self.grid_errors} if np.isfinite(self.grid_errors).any() else {})
        return {
            "axes": list(self.axes),
            "units": self.axis_units,
            "positions": [
                check_finite("positions of the volumetric map", values) for values in self.positions
            ],
            "fixed": self.fixed,
            "quantities": {
                f"{source}_{symbol}": nest_grid(MICRO * values[..., dof])
                for source, values in grids.items()
                for dof, symbol in enumerate(SYMBOLS)
            },
            "ranges": {
                source: _by_symbol(measure_range(values)) for source, values in every.items()
            },
            "range_errors": {
                source: _errors_by_symbol(errors)
                for source, errors in {TOTAL: self.total_errors, **self.range_errors}.items()
            },
            "error_share": {
                symbol: scale_shares(error, MICRO)
                for symbol, error in zip(SYMBOLS, self.total_errors, strict=True)
            },
            "error_parts": {
                symbol: scale_parts(error, MICRO)
                for symbol, error in zip(SYMBOLS, self.total_errors, strict=True)
            },
            "error_left_out": list(self.largest_error.left_out),
            "largest_um": MICRO * float(sizes[worst]),
            "largest_error_um": _scale(self.largest_error),
            "largest_at": {
                axis: float(values[place])
                for axis, values, place in zip(self.axes, self.positions, worst, strict=True)
            },
            "budget": self.budget,
            "lines": {
                line.axis: self._summarise_line(line, errors)
                for line, errors in zip(self.lines, self.line_errors, strict=True)
            },
            "squareness": [
                {
                    "first": each.first,
                    "second": each.second,
                    "symbol": each.symbol,
                    "angle_urad": MICRO * each.angle,
                    "error_urad": _scale(error),
                }
                for each, error in zip(self.squareness, self.squareness_errors, strict=True)
            ],
            "failed": self.failed,
        }

    def _summarise_line(self, line: AxisMotions, errors: list[Estimate]) -> AxisMotionsSummary:
        return {
            "unit": self.axis_units[line.axis],
            "positions": [float(value) for value in line.positions],
            "motions": {
                symbol: [MICRO * float(value) for value in line.motions[:, dof]]
                for dof, symbol in enumerate(SYMBOLS)
            },
            "deviations": _by_symbol(line.deviations),
            "errors": _errors_by_symbol(errors),
            "along": None
            if line.along is None
            else f"{'-' if line.travel[line.along] < 0.0 else ''}{'xyz'[line.along]}",
        }

    def fill(self, file: "h5py.File") -> None:
        """Write the positions and every source."""
        group = file.create_group(f"volumetric/{self.point}")
        for axis, values in zip(self.axes, self.positions, strict=True):
            group[f"positions/{axis}"] = values
        for source, values in self.sources.items():
            group[source.replace(" ", "_")] = values
        group["error"] = self.grid_errors


def _unit_of(number: int) -> str:
    """Return the unit of a component by its number."""
    return "m" if number < 3 else "rad"


def _scale(error: Estimate) -> float | None:
    return None if error.total is None else MICRO * error.total


def _by_symbol(values: FloatArray) -> dict[str, float]:
    return {symbol: MICRO * float(value) for symbol, value in zip(SYMBOLS, values, strict=True)}


def _errors_by_symbol(errors: list[Estimate]) -> dict[str, float | None]:
    return {symbol: _scale(error) for symbol, error in zip(SYMBOLS, errors, strict=True)}
