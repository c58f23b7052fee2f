"""A compliance from a record of forces and displacements: a straight line, and what is not straight
about it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LineFit:
    """A straight line through a record.

    Attributes:
        compliance: Displacement per force [m/N].
        error: Standard error of the compliance, relative.
        residual: Root mean square distance from the line [m].
        hysteresis: Area that the record encloses, of that of the rectangle around it.
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


def fit_line(record: Sequence[tuple[float, float]]) -> LineFit:
    """Fit displacements [m] over forces [N] by a straight line, wherever it crosses zero force.

    Args:
        record: Force and displacement, at least three pairs in the order in which they were measured;
            of a whole cycle for its hysteresis.

    Raises:
        ValueError: All forces are equal, or there is no displacement.
    """
    forces, motions = np.array(record, dtype=float).T
    reach, stroke = float(np.ptp(forces)), float(np.ptp(motions))
    if reach == 0.0 or stroke == 0.0:
        raise ValueError(
            "its forces, or its displacements, are all equal: no line has a slope there"
        )
    centered = forces - forces.mean()
    square = float(centered @ centered)
    compliance = float(centered @ motions) / square
    left = motions - motions.mean() - compliance * centered
    if compliance == 0.0:
        raise ValueError("its displacements do not depend on the force")
    scatter = float(left @ left) / (len(record) - 2)
    following = np.roll(forces, -1), np.roll(motions, -1)
    area = 0.5 * abs(float(forces @ following[1] - motions @ following[0]))
    return LineFit(
        compliance=compliance,
        error=float(np.sqrt(scatter / square)) / abs(compliance),
        residual=float(np.sqrt(left @ left / len(record))),
        hysteresis=area / (reach * stroke),
    )
