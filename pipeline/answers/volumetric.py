"""Position errors of a tool over a volume as a result: the types, and how they read in both files."""

from dataclasses import dataclass
from typing import ClassVar, TypedDict

import h5py
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.map import GridSummary, nest_grid
from headstock.pipeline.storage.json_texts import check_finite
from headstock.solvers.linear.volumetric import AxisMotions, Squareness

SYMBOLS = ("EX", "EY", "EZ", "EA", "EB", "EC")
TOTAL = "total"
MICRO = 1e6


class AxisMotionsSummary(TypedDict):
    """Error motions along one axis; values by symbol without the axis' name. ``along``: where the
    tool travels against the work, ``-x`` where the axis moves the work along x.
    """

    unit: str
    positions: list[float]
    motions: dict[str, list[float]]
    deviations: dict[str, float]
    along: str | None


class SquarenessSummary(TypedDict):
    """Squareness of two axes."""

    first: str
    second: str
    symbol: str
    angle_urad: float


class VolumetricSummary(GridSummary):
    """The entry of a point in ``volumetric``; micrometres and microradians but for positions."""

    ranges: dict[str, dict[str, float]]
    largest_um: float
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
    failed: int = 0
    units: ClassVar[dict[str, str]] = {
        r"volumetric/.*/positions/.*": "m or rad",
        r"volumetric/.*": "SI: m, m, m, rad, rad, rad",
    }

    @property
    def total(self) -> FloatArray:
        """``(n0, n1, ..., 6)`` of all sources together."""
        return np.asarray(np.sum(list(self.sources.values()), axis=0))

    def summarise(self) -> VolumetricSummary:
        """As it stands in ``summary.json``."""
        total = self.total
        sizes = np.linalg.norm(total[..., :3], axis=-1)
        worst = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        every = {TOTAL: total, **self.sources}
        return {
            "axes": list(self.axes),
            "units": self.axis_units,
            "positions": [
                check_finite("positions of the volumetric map", values) for values in self.positions
            ],
            "fixed": self.fixed,
            "quantities": {
                f"{source}_{symbol}": nest_grid(MICRO * values[..., dof])
                for source, values in every.items()
                for dof, symbol in enumerate(SYMBOLS)
            },
            "ranges": {
                source: {
                    symbol: MICRO * float(np.nanmax(values[..., dof]) - np.nanmin(values[..., dof]))
                    for dof, symbol in enumerate(SYMBOLS)
                }
                for source, values in every.items()
            },
            "largest_um": MICRO * float(sizes[worst]),
            "largest_at": {
                axis: float(values[place])
                for axis, values, place in zip(self.axes, self.positions, worst, strict=True)
            },
            "budget": self.budget,
            "lines": {line.axis: self._summarise_line(line) for line in self.lines},
            "squareness": [
                {
                    "first": each.first,
                    "second": each.second,
                    "symbol": each.symbol,
                    "angle_urad": MICRO * each.angle,
                }
                for each in self.squareness
            ],
            "failed": self.failed,
        }

    def _summarise_line(self, line: AxisMotions) -> AxisMotionsSummary:
        deviations = line.deviations
        return {
            "unit": self.axis_units[line.axis],
            "positions": [float(value) for value in line.positions],
            "motions": {
                symbol: [MICRO * float(value) for value in line.motions[:, dof]]
                for dof, symbol in enumerate(SYMBOLS)
            },
            "deviations": {
                symbol: MICRO * float(deviations[dof]) for dof, symbol in enumerate(SYMBOLS)
            },
            "along": None
            if line.along is None
            else f"{'-' if line.travel[line.along] < 0.0 else ''}{'xyz'[line.along]}",
        }

    def fill(self, file: h5py.File) -> None:
        """Write the positions and every source."""
        group = file.create_group(f"volumetric/{self.point}")
        for axis, values in zip(self.axes, self.positions, strict=True):
            group[f"positions/{axis}"] = values
        for source, values in self.sources.items():
            group[source.replace(" ", "_")] = values
