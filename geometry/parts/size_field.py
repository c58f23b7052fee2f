"""Element sizes from place to place."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray

DECIMALS, DIGITS = 9, 6  # of coordinates [m] and of sizes, in files
# cells of a regular tetrahedron's size in a cube of that side
TETS_PER_CUBE = 6.0 * np.sqrt(2.0)


@dataclass(frozen=True, eq=False)
class SizeField:
    """Element sizes at the corners of tetrahedra.

    Attributes:
        points: ``(n, 3)`` corners [m].
        tets: ``(m, 4)`` indices into ``points``.
        sizes: ``(n,)`` element size at each [m].
    """

    points: FloatArray
    tets: NDArray[np.int64]
    sizes: FloatArray

    @property
    def volumes(self) -> FloatArray:
        """Of the tetrahedra ``(m,)`` [m^3]."""
        corners = self.points[self.tets]
        return np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0

    @property
    def cells(self) -> int:
        """About how many tetrahedra of these sizes fill the same space."""
        means = np.exp(np.log(self.sizes)[self.tets].mean(axis=1))
        return int(TETS_PER_CUBE * np.sum(self.volumes / means**3))

    def settled(self) -> "SizeField":
        """Return the field as it comes out of its file: to nanometres and six digits, corners in
        order.
        """
        points = np.round(self.points, DECIMALS)
        order = np.lexsort(points.T[::-1])
        places = np.empty(len(order), dtype=np.int64)
        places[order] = np.arange(len(order))
        sizes = np.array([float(f"{size:.{DIGITS}g}") for size in self.sizes[order]])
        return SizeField(points[order], places[self.tets], sizes)

    def scaled(self, unit: float) -> "SizeField":
        """Return the field in another unit of length [m]."""
        return SizeField(np.asarray(self.points / unit), self.tets, np.asarray(self.sizes / unit))
