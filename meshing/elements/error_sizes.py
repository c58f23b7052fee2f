"""Where the error of a mesh asks for small elements."""

import dataclasses

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.size_field import SizeField
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.elements.topology import EDGES

EDGE_OVER_SIZE = 1.1  # of tetrahedra that gmsh makes for a size, in the mean
# Power of the element size with which squared errors fall: 4 of second-order tetrahedra where
# stresses are smooth, about 1 at inner edges and at the rims of what is held rigidly
RATE = 1.8
FINEST_STEP = 0.2  # from one mesh to the next an estimate can be trusted for this much
MOST_TIMES = 5.0  # as many cells; where it was very coarse, the next mesh tells what is needed
HALVINGS = 60


def mean_edges(field: SizeField) -> FloatArray:
    """Root mean square ``(m,)`` of the six edges of each tetrahedron [m]: of a flat one its width, as
    its size was.
    """
    corners = field.points[field.tets]
    squares = [np.square(corners[:, i] - corners[:, j]).sum(axis=1) for i, j in EDGES["tet"]]
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def spread_error(mesh: ComponentMesh, energies: FloatArray, share: float) -> SizeField:
    """The sizes with which the fewest cells miss so much of what a mesh misses, or what five times as
    many can; none is larger than those of the mesh.

    A cell of size h misses ``e h^RATE`` per volume, with e known from the mesh. Sizes with ``h^(RATE
    + 3) e`` equal everywhere need the fewest cells.

    Args:
        mesh: Of tetrahedra.
        energies: ``(n_cells,)`` what each of its cells misses, in any unit.
        share: What all may miss in sum, over what they miss.

    Source: Zienkiewicz and Zhu (1987), Int. J. Numer. Meth. Engng. 24, 337-357; Diez and Huerta
    (1999), Comput. Methods Appl. Mech. Engng. 176, 215-229, for the least number of cells.
    """
    used, tets = np.unique(mesh.cells[:, :4], return_inverse=True)
    field = SizeField(mesh.points[used], tets.reshape(-1, 4), np.ones(len(used)))
    old, total = mean_edges(field) / EDGE_OVER_SIZE, float(energies.sum())
    density = np.maximum(energies / field.volumes, 1e-12 * total / field.volumes.sum())
    shape = (density / old**RATE) ** (-1.0 / (RATE + 3.0)) / old

    def steps(scale: float) -> FloatArray:
        return np.asarray(np.clip(scale * shape, FINEST_STEP, 1.0))

    low, high = FINEST_STEP / float(shape.max()), 1.0 / float(shape.min())
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        finer = steps(middle)
        missed, cells = float(np.sum(energies * finer**RATE)), float(np.sum(finer**-3.0))
        enough = missed <= share * total or cells > MOST_TIMES * len(finer)
        low, high = (middle, high) if enough else (low, middle)
    # at a corner, as many cells per volume as the mean of those that meet in it
    ends = field.tets.ravel()
    crowds = np.bincount(ends, np.repeat((steps(low) * old) ** -3.0, 4)) / np.bincount(ends)
    return dataclasses.replace(field, sizes=np.asarray(crowds ** (-1.0 / 3.0)))
