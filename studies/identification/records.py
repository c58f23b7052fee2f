"""A compliance from a record of forces and displacements: a straight line, and what is not straight
about it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import linregress

from headstock.geometry.frames import FloatArray


@dataclass(frozen=True)
class LineFit:
    """A straight line through a record.

    Attributes:
        compliance: Displacement per force [m/N].
        error: Standard error of the compliance, relative.
        residual: Root mean square distance from the line [m].
        hysteresis: Area that a cycle of the record encloses, of that of the rectangle around it.
    """

    compliance: float
    error: float
    residual: float
    hysteresis: float

    def __str__(self) -> str:
        return (
            f"{1e9 * self.compliance:.4g} um/kN, standard error {100.0 * self.error:.2g} %, residual {1e6 * self.residual:.2g} um, "
            f"hysteresis {100.0 * self.hysteresis:.2g} %"
        )


def fit_line(record: FloatArray | Sequence[tuple[float, float]]) -> LineFit:
    """Fit displacements [m] over forces [N] by a straight line, wherever it crosses zero force.

    Args:
        record: Force and displacement, at least three pairs in the order in which they were measured;
            of whole cycles for their hysteresis.

    Raises:
        ValueError: There are fewer pairs, all forces are equal, or there is no displacement.
    """
    if len(record) < 3:
        raise ValueError(f"it holds {len(record)} pairs; a line and its residual take three")
    forces, motions = np.array(record, dtype=float).T
    reach, stroke = float(np.ptp(forces)), float(np.ptp(motions))
    if reach == 0.0 or stroke == 0.0:
        raise ValueError(
            "its forces, or its displacements, are all equal: no line has a slope there"
        )
    line = linregress(forces, motions)
    if line.slope == 0.0:
        raise ValueError("its displacements do not depend on the force")
    left = motions - line.intercept - line.slope * forces
    following = np.roll(forces, -1), np.roll(motions, -1)
    area = 0.5 * abs(float(forces @ following[1] - motions @ following[0]))
    cycles = float(np.abs(following[0] - forces).sum()) / (2.0 * reach)
    return LineFit(
        compliance=float(line.slope),
        error=float(line.stderr / abs(line.slope)),
        residual=float(np.sqrt(np.mean(left**2))),
        hysteresis=area / (cycles * reach * stroke),
    )
