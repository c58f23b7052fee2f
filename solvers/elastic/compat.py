"""What dolfinx 0.9 and 0.11 call differently: readers of gmsh's order of nodes and makers of meshes."""

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.libraries import dolfinx
from headstock.solvers.mpi import MPI
from headstock.solvers.recovery.libraries import basix

RELEASE = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
# the reader of gmsh models was renamed in 0.10
_GMSH: Any = import_module("dolfinx.io.gmsh" if RELEASE >= (0, 10) else "dolfinx.io.gmshio")


def gmsh_cell_order(shape: str, nodes: int) -> NDArray[np.int32]:
    """Return the place in gmsh's order of each node of a cell in dolfinx's.

    Args:
        shape: ``tetrahedron`` or ``hexahedron``.
    """
    return np.asarray(_GMSH.cell_perm_array(dolfinx.cpp.mesh.to_type(shape), nodes))


def create_mesh(
    comm: MPI.Comm, cells: NDArray[np.int64], points: FloatArray, element: basix.ufl._ElementBase
) -> dolfinx.mesh.Mesh:
    """Return the cells of this rank ``(n, k)`` with numbers of points ``(m, 3)`` [m] in dolfinx's
    order, partitioned over the ranks.
    """
    # element and points changed places in 0.10; their names are the same
    return dolfinx.mesh.create_mesh(comm, cells=cells, x=points, e=element)
