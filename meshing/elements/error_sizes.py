"""Where the error of a mesh asks for small elements."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.elements.topology import cell_order
from headstock.meshing.size_field import SizeField

# from one mesh to the next an estimate can be trusted for this much
FINEST_STEP, COARSEST_STEP = 0.2, 3.0
HALVINGS = 60
ENDS = ((np.min, FINEST_STEP), (np.max, COARSEST_STEP))


def spread_error(mesh: ComponentMesh, energies: FloatArray, target: float) -> SizeField:
    """The sizes with which the fewest cells miss no more than a given energy in sum.

    A cell of size h misses ``e h^(2p)`` per volume, with e known from a first mesh. Sizes with
    ``h^(2p + 3) e`` equal everywhere need the fewest cells.

    Args:
        mesh: First mesh, of tetrahedra.
        energies: ``(n_cells,)`` what each of its cells misses, in any unit.
        target: What all may miss in sum, in that unit.

    Source: Zienkiewicz and Zhu (1987), Int. J. Numer. Meth. Engng. 24, 337-357; Diez and Huerta
    (1999), Comput. Methods Appl. Mech. Engng. 176, 215-229, for the least number of cells.
    """
    power = 2 * cell_order(mesh.kind)
    corners = mesh.points[mesh.cells[:, :4]]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = np.abs(np.linalg.det(edges)) / 6.0
    old = np.cbrt(6.0 * np.sqrt(2.0) * volumes)
    density = np.maximum(energies / volumes, 1e-12 * energies.sum() / volumes.sum())
    shape = (density / old**power) ** (-1.0 / (power + 3))

    def sizes(scale: float) -> FloatArray:
        return np.asarray(np.clip(scale * shape, FINEST_STEP * old, COARSEST_STEP * old))

    low, high = (float(change(old / shape)) * step for change, step in ENDS)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        missed = float(np.sum(energies * (sizes(middle) / old) ** power))
        low, high = (low, middle) if missed > target else (middle, high)
    used, cells = np.unique(mesh.cells[:, :4], return_inverse=True)
    cells = cells.reshape(-1, 4)
    # of a corner the mean, in logarithms, of the cells that meet in it
    total = np.bincount(cells.ravel(), np.repeat(np.log(sizes(low)), 4))
    return SizeField(mesh.points[used], cells, np.exp(total / np.bincount(cells.ravel())))
