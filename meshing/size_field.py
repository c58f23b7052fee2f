"""Element sizes from place to place."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray


@dataclass(frozen=True, eq=False)
class SizeField:
    """Element sizes at the corners of tetrahedra.

    Attributes:
        points: ``(n, 3)`` corners [m].
        tets: ``(m, 4)`` indices into ``points``.
        sizes: ``(n,)`` element size at each [m].
    """

    points: FloatArray
    tets: IntArray
    sizes: FloatArray

    def scaled(self, unit: float) -> "SizeField":
        """The same in another unit of length [m]."""
        return SizeField(np.asarray(self.points / unit), self.tets, np.asarray(self.sizes / unit))
