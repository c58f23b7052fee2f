"""Measures of a volumetric map: ranges, error motions along single axes, squareness, and what each
part has in the variation.

Words and symbols of ISO 230-1 (2012); Schwenke, Knapp, Haitjema, Weckenmann, Schmitt and Delbressine
(2008).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray

DIRECTIONS = 3
PARALLEL = 0.999


@dataclass(frozen=True, eq=False)
class AxisMotions:
    """Error motions of the tool against the work while one axis moves, the others in the middle of
    the map.

    Attributes:
        positions: ``(n,)`` of the axis [m, rad].
        motions: ``(n, 6)`` EX, EY, EZ, EA, EB, EC [m, rad].
        slopes: ``(6,)`` of the least-squares lines through them [1/m or 1/rad times their unit].
        travel: ``(3,)`` of the tool against the work per travel of the axis; zero for a rotary one.
    """

    axis: str
    positions: FloatArray
    motions: FloatArray
    slopes: FloatArray
    travel: FloatArray

    @property
    def along(self) -> int | None:
        """Return which of x, y, z the tool travels in; None for a rotary or an oblique axis."""
        main = int(np.argmax(np.abs(self.travel)))
        return main if abs(self.travel[main]) > PARALLEL else None

    @property
    def deviations(self) -> FloatArray:
        """``(6,)``: straightness across the travel, about the least-squares line; ranges of the
        positioning error and of the angles.
        """
        ranges = np.ptp(self.motions, axis=0)
        if self.along is not None:
            across = [dof for dof in range(DIRECTIONS) if dof != self.along]
            arms = self.positions - self.positions.mean()
            ranges[across] = np.ptp(
                self.motions[:, across] - np.outer(arms, self.slopes[across]), axis=0
            )
        return np.asarray(ranges)


@dataclass(frozen=True)
class Squareness:
    """Squareness error between two axes of linear travel.

    Attributes:
        second: Axis whose line of motion is turned.
        symbol: ``EC0Y`` of Y to X.
        angle: Rotation of the second line, right-handed about the third direction [rad].
    """

    first: str
    second: str
    symbol: str
    angle: float


def measure_range(values: FloatArray) -> FloatArray:
    """Return the range ``(6,)`` over a grid ``(..., 6)``; poses without a number are left out."""
    flat = values.reshape(-1, values.shape[-1])
    return np.nanmax(flat, axis=0) - np.nanmin(flat, axis=0)


def axis_motions(
    axis: str, positions: FloatArray, motions: FloatArray, travel: FloatArray
) -> AxisMotions:
    """Return the error motions along one axis with their lines.

    Args:
        positions: ``(n,)`` rising.
        motions: ``(n, 6)`` deviations; rows that are not known are left out.
        travel: ``(3,)`` of the tool against the work per travel of the axis; zero for a rotary one.
    """
    finite = np.isfinite(motions).all(axis=1)
    positions, motions = positions[finite], motions[finite]
    arms = positions - positions.mean() if len(positions) else positions
    size = float(arms @ arms)
    slopes = arms @ motions / size if size > 0.0 else np.zeros(6)
    return AxisMotions(axis, positions, motions, slopes, travel)


def find_squareness(first: AxisMotions, second: AxisMotions) -> Squareness | None:
    """Find the squareness of the second axis to the first, by the least-squares lines of the tool's
    travel; None where they are not two of x, y and z.
    """
    if first.along is None or second.along is None or first.along == second.along:
        return None
    if first.along > second.along:
        first, second = second, first
    one, other = int(first.along or 0), int(second.along or 0)
    lines = [motion.travel + motion.slopes[:DIRECTIONS] for motion in (first, second)]
    # in the plane of both: how far each line leans towards the other's direction
    turned = float(lines[0][other] / lines[0][one] + lines[1][one] / lines[1][other])
    third = DIRECTIONS - one - other
    # a rotation about y turns z towards x, one about x or z turns the later direction backwards
    angle = turned if third == 1 else -turned
    return Squareness(first.axis, second.axis, f"E{'ABC'[third]}0{second.axis}", angle)


def variance_shares(parts: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return the share of each part ``(n,)`` in the variation of their sum over the poses; shares
    sum to 1, and a part that varies against the others has a negative one.

    Source: ``sum_p cov(c_p, d) = var(d)`` for ``d = sum_p c_p``.
    """
    total = np.sum(list(parts.values()), axis=0)
    finite = np.isfinite(total)
    swing = total[finite] - total[finite].mean() if finite.any() else total[finite]
    variance = float(swing @ swing)
    if not variance > 0.0:
        return {}
    return {name: float(values[finite] @ swing) / variance for name, values in parts.items()}
