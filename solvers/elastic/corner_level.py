"""First-order elements in the cells of a second-order mesh: their stiffness, and how displacements and
forces pass between them and all nodes.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.elastic.libraries import dolfinx, fem, la
from headstock.solvers.mpi import MPI

NO_WEIGHT = 1e-12  # of an interpolation: rounding of a shape function that vanishes at a node


@dataclass(frozen=True, eq=False)
class CornerLevel:
    """The corners of the cells as nodes of first-order elements, distributed like the cells.

    Attributes:
        comm: Communicator the rows are distributed over.
        points: ``(n_owned, 3)`` corners of this rank [m].
        stiffness: ``(3 n_owned, 3 n_local)`` in 3 x 3 blocks [N/m]; that of all nodes on
            interpolated displacements.
        stiffness_map: Which corner stands behind each of its columns.
        transfer: ``(n_fine, n_reached)`` displacements of nodes from those of corners, alike in x, y
            and z.
        transfer_map: Which corner stands behind each of its columns, owned ones first.
    """

    comm: MPI.Comm
    points: FloatArray
    stiffness: scipy.sparse.bsr_matrix
    stiffness_map: dolfinx.common.IndexMap
    transfer: scipy.sparse.csr_matrix
    transfer_map: dolfinx.common.IndexMap

    @property
    def owned_dofs(self) -> int:
        """Number of displacement dofs of the corners this rank owns."""
        return 3 * len(self.points)

    def prolong(self, shape: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n_fine,)`` of all nodes from those of the corners
        ``(3 n_owned,)``.
        """
        local = shape
        if self.comm.size > 1:
            vector = la.vector(self.transfer_map, bs=3)
            vector.array[: len(shape)] = shape
            vector.scatter_forward()
            local = np.array(vector.array)
        return np.asarray(self.transfer @ local.reshape(-1, 3)).ravel()

    def restrict(self, forces: FloatArray) -> FloatArray:
        """Return the forces ``(3 n_owned,)`` on corners that do the same work as those on all nodes
        ``(3 n_fine,)``.
        """
        local = np.asarray(self.transfer.T @ forces.reshape(-1, 3)).ravel()
        if self.comm.size == 1:
            return local
        vector = la.vector(self.transfer_map, bs=3)
        vector.array[:] = local
        vector.scatter_reverse(la.InsertMode.add)
        return np.array(vector.array[: self.owned_dofs])

    def at_corners(self, marked: BoolArray) -> BoolArray:
        """Return the dofs of corners ``(3 n_owned,)`` that are marked on the fine level
        ``(3 n_fine,)``.
        """
        alone = np.diff(self.transfer.indptr) == 1  # a corner interpolates itself only
        chosen = marked.reshape(-1, 3) & alone[:, None]
        return self.restrict(chosen.astype(float).ravel()) > 0.5

    def global_columns(self) -> FloatArray:
        """Return the number over all ranks of the corner behind each column of the stiffness."""
        count = self.stiffness_map.size_local + self.stiffness_map.num_ghosts
        return self.stiffness_map.local_to_global(np.arange(count, dtype=np.int32))


def interpolate_corners(
    corners: fem.FunctionSpace, nodes: fem.FunctionSpace
) -> tuple[scipy.sparse.csr_matrix, dolfinx.common.IndexMap]:
    """Return the weights of corners at the nodes of this rank, and the map of their columns.

    Args:
        corners: Scalar elements of order 1.
        nodes: Scalar elements of the same mesh, of any order.
    """
    # set, not added, cell by cell: rows of ghosts are not to be summed into their owners'
    matrix = fem.interpolation_matrix(corners, nodes)
    rows = matrix.index_map(0).size_local
    columns = matrix.index_map(1)
    pointers = np.array(matrix.indptr[: rows + 1])
    weights = scipy.sparse.csr_matrix(
        (
            np.array(matrix.data[: pointers[-1]]),
            np.array(matrix.indices[: pointers[-1]]),
            pointers,
        ),
        shape=(rows, columns.size_local + columns.num_ghosts),
    )
    weights.data[np.abs(weights.data) < NO_WEIGHT] = 0.0
    weights.eliminate_zeros()
    return weights, columns
