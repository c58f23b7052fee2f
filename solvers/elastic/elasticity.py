"""Stiffness and mass of a meshed component: linear elasticity with dolfinx, distributed over a
communicator.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.solvers.elastic.corner_level import CornerLevel, interpolate_corners
from headstock.solvers.elastic.form_cache import compile_form
from headstock.solvers.elastic.kernels import KernelPart, kernel_name
from headstock.solvers.elastic.libraries import dolfinx, fem, la, ufl
from headstock.solvers.errors import AccuracyError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import rows_from_root, sum_over_ranks
from headstock.solvers.recovery.libraries import basix

CELL_TYPES = {
    "tet4": ("tetrahedron", 1),
    "tet10": ("tetrahedron", 2),
    "hex8": ("hexahedron", 1),
    "hex27": ("hexahedron", 2),
}
CORNERS = {"tetrahedron": 4, "hexahedron": 8}
ROWS_AT_A_TIME = 20_000
SUMMED_AT_A_TIME = 500  # rows of blocks: extended copies of them stay in the cache
RELEASE = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
# the reader of gmsh models was renamed in 0.10
_GMSH: Any = import_module("dolfinx.io.gmsh" if RELEASE >= (0, 10) else "dolfinx.io.gmshio")


def gmsh_cell_order(shape: str, nodes: int) -> NDArray[np.int32]:
    """Return the place in gmsh's order of each node of a cell in dolfinx's.

    Args:
        shape: ``tetrahedron`` or ``hexahedron``.
    """
    return _GMSH.cell_perm_array(dolfinx.cpp.mesh.to_type(shape), nodes)


def _create_mesh(
    comm: MPI.Comm, cells: NDArray[np.int64], points: FloatArray, element: basix.ufl._ElementBase
) -> dolfinx.mesh.Mesh:
    """Return the cells of this rank ``(n, k)`` with numbers of points ``(m, 3)`` [m] in dolfinx's
    order, partitioned over the ranks.
    """
    # element and points changed places in 0.10; their names are the same
    return dolfinx.mesh.create_mesh(comm, cells=cells, x=points, e=element)


@dataclass(frozen=True, eq=False)
class ElasticOperators:
    """Stiffness and mass of one component, rows distributed over the ranks of a communicator.

    Each rank owns whole nodes. ``(3 n_owned, k)`` blocks of vectors are ordered node by node, x y
    z.

    Attributes:
        comm: Communicator the rows are distributed over.
        nodes: ``(n_owned,)`` mesh point behind each owned node.
        points: ``(n_owned, 3)`` their coordinates [m].
        stiffness: ``(3 n_owned, 3 n_local)`` in 3 x 3 blocks [N/m]; columns of owned nodes first,
            then ghosts.
        scalar_mass: ``(n_owned, n_local)`` mass per direction [kg], or None when nothing dynamic is
            asked for.
        column_map: Which node stands behind each column of the matrices, owned ones first (a
            dolfinx index map).
        cells: Cells of the mesh that this rank owns.
        total_nodes: Number of mesh points over all ranks.
        stiffness_scale: Largest entry of the stiffness over all ranks [N/m].
        row_sizes: ``(3 n_owned,)`` sums of the absolute values in each row of the stiffness [N/m].
        translation_noise: ``(n_owned, 3, 3)`` sums of each row of stiffness blocks [N/m]. A uniform
            translation causes no force, so these are what rounding left; a thin sheet would respond
            to them like springs to the ground.
    """

    comm: MPI.Comm
    nodes: IntArray
    points: FloatArray
    stiffness: scipy.sparse.bsr_matrix
    scalar_mass: scipy.sparse.csr_matrix | None
    column_map: dolfinx.common.IndexMap
    cells: IntArray
    total_nodes: int
    stiffness_scale: float
    row_sizes: FloatArray
    translation_noise: FloatArray
    corners: CornerLevel | None = None

    @property
    def owned_dofs(self) -> int:
        """Number of displacement dofs this rank owns."""
        return 3 * len(self.nodes)

    def apply_stiffness(self, vectors: FloatArray) -> FloatArray:
        """Return ``K x`` for a block of owned vectors ``(3 n_owned, k)``, less what rounding of K
        makes of uniform translations.
        """
        count = vectors.shape[1]
        if count == 0:
            return np.zeros(vectors.shape)
        forces = np.asarray(self.stiffness @ self.with_ghosts(vectors))
        forces -= (self.translation_noise @ vectors.reshape(-1, 3, count)).reshape(-1, count)
        return forces

    def apply_stiffness_precisely(self, vectors: FloatArray) -> FloatArray:
        """Return the same with products and sums in extended precision: where forces of a thin part
        all but cancel, for several times the time.

        Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), sec. 12.1, on
        residuals of iterative refinement.
        """
        count = vectors.shape[1]
        if count == 0:
            return np.zeros(vectors.shape)
        whole = self.with_ghosts(vectors).astype(np.longdouble)
        nodal = vectors.reshape(-1, 3, count).astype(np.longdouble)
        forces = np.zeros(nodal.shape)
        matrix = self.stiffness
        for first in range(0, len(nodal), ROWS_AT_A_TIME):
            last = min(first + ROWS_AT_A_TIME, len(nodal))
            pointers = matrix.indptr[first : last + 1]
            entries = slice(pointers[0], pointers[-1])
            rows = scipy.sparse.bsr_matrix(
                (
                    matrix.data[entries].astype(np.longdouble),
                    matrix.indices[entries],
                    pointers - pointers[0],
                ),
                shape=(3 * (last - first), matrix.shape[1]),
            )
            forces[first:last] = (rows @ whole).reshape(-1, 3, count) - self.translation_noise[
                first:last
            ] @ nodal[first:last]
        return forces.reshape(vectors.shape)

    def energy_roundoff(self, vectors: FloatArray) -> FloatArray:
        """Return what rounding can make of ``x^T K x`` for each column of ``(3 n_owned, k)``: at
        most ``eps |x|^T |K| |x|`` (Gershgorin).
        """
        return np.finfo(float).eps * sum_over_ranks(self.comm, self.row_sizes @ vectors**2)

    def apply_mass(self, vectors: FloatArray) -> FloatArray:
        """Return ``M x`` for a block of owned vectors ``(3 n_owned, k)``; x, y, z are alike."""
        if self.scalar_mass is None:
            raise AccuracyError(
                "the mass matrix was not assembled, yet a dynamic quantity was asked for"
            )
        count = vectors.shape[1]
        if count == 0:
            return np.zeros(vectors.shape)
        local = self.with_ghosts(vectors).reshape(-1, 3 * count)
        return np.asarray(self.scalar_mass @ local).reshape(-1, count)

    def with_ghosts(self, vectors: FloatArray) -> FloatArray:
        """Return the rows ``(3 n_local, k)`` of all nodes that the columns of the matrices stand
        for.
        """
        if self.comm.size == 1:
            return np.ascontiguousarray(vectors)
        count = vectors.shape[1]
        buffer = la.vector(self.column_map, bs=3 * count)
        buffer.array[: vectors.size] = vectors.ravel()
        buffer.scatter_forward()
        return np.array(buffer.array).reshape(-1, count)


@dataclass(frozen=True)
class _MeshFacts:
    """Facts that every rank knows of a mesh that rank 0 alone holds."""

    kind: CellKind
    straight: bool
    volume: float

    def kernel(self, part: KernelPart) -> str:
        """Return the name of the kernel for one of the matrices."""
        return kernel_name(part, self.kind, straight=self.straight)


def assemble_elasticity(
    mesh: ComponentMesh | None,
    material: Material,
    *,
    comm: MPI.Comm,
    with_mass: bool,
    with_corners: bool = False,
) -> ElasticOperators:
    """Return the stiffness and, when asked for, mass of a component.

    Args:
        mesh: On rank 0; what others hand in is not looked at.
        comm: Communicator to distribute over; collective.

    Raises:
        AccuracyError: The assembled operators fail their symmetry or mass check.

    Source: Hughes, The Finite Element Method (1987), ch. 3; consistent mass.
    """
    mesh = mesh if comm.rank == 0 else None
    facts: _MeshFacts = comm.bcast(
        None if mesh is None else _MeshFacts(mesh.kind, mesh.straight, mesh.quality.volume)
    )
    shape, order = CELL_TYPES[facts.kind]
    domain = _distribute_mesh(mesh, facts, comm)
    cells = domain.topology.original_cell_index
    space = fem.functionspace(domain, basix.ufl.element("Lagrange", shape, order, shape=(3,)))
    scalar = fem.functionspace(domain, basix.ufl.element("Lagrange", shape, order))
    if not np.array_equal(space.dofmap.list, scalar.dofmap.list):
        raise AccuracyError(
            "vector and scalar dofs are numbered differently; the scalar mass cannot serve the displacement"
        )
    node_map = space.dofmap.index_map
    owned = node_map.size_local
    nodes = np.full(owned + node_map.num_ghosts, -1, dtype=np.int64)
    nodes[space.dofmap.list] = rows_from_root(
        comm, None if mesh is None else mesh.cells[:, _cell_order(facts.kind)], cells
    )
    (degree, mass_degree), mass = _quadrature_degrees(facts, order), None
    stiffness, column_map = _assemble_stiffness(space, material, degree, facts.kernel("stiffness"))
    if with_mass:
        mass = _assemble_mass(scalar, material, mass_degree, facts.kernel("mass"))
    sizes, noise = _measure_rows(stiffness)
    operators = ElasticOperators(
        comm=comm,
        nodes=nodes[:owned],
        points=rows_from_root(comm, None if mesh is None else mesh.points, nodes[:owned]),
        stiffness=stiffness,
        scalar_mass=mass,
        column_map=column_map,
        cells=cells[: domain.topology.index_map(3).size_local],
        total_nodes=node_map.size_global,
        stiffness_scale=comm.allreduce(float(np.abs(stiffness.data).max(initial=0.0)), op=MPI.MAX),
        row_sizes=sizes,
        translation_noise=noise,
        corners=_assemble_corners(scalar, material, degree, facts.kernel("corners"))
        if with_corners
        else None,
    )
    _check_operators(operators, facts.volume * material.density)
    return operators


def _distribute_mesh(
    mesh: ComponentMesh | None, facts: _MeshFacts, comm: MPI.Comm
) -> dolfinx.mesh.Mesh:
    """Return the cells of the mesh on rank 0, partitioned over the ranks."""
    shape, order = CELL_TYPES[facts.kind]
    geometry_order = 1 if facts.straight else order
    element = basix.ufl.element("Lagrange", shape, geometry_order, shape=(3,))
    if mesh is None:
        nothing = np.zeros((0, element.basix_element.dim), dtype=np.int64)
        return _create_mesh(comm, nothing, np.zeros((0, 3)), element)
    points, cells = mesh.points, mesh.cells[:, _cell_order(facts.kind)]
    if geometry_order == 1:
        corners, numbers = np.unique(cells[:, : CORNERS[shape]], return_inverse=True)
        points, cells = points[corners], numbers.reshape(len(cells), -1)
    return _create_mesh(comm, cells.astype(np.int64), points, element)


def _cell_order(kind: CellKind) -> NDArray[np.int32]:
    """Return the place in gmsh's order of each node of a cell in dolfinx's."""
    return gmsh_cell_order(CELL_TYPES[kind][0], int(kind[3:]))


def _assemble_stiffness(
    space: fem.FunctionSpace, material: Material, degree: int, kernel: str
) -> tuple[scipy.sparse.bsr_matrix, dolfinx.common.IndexMap]:
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    young, poisson = float(material.youngs_modulus), float(material.poisson_ratio)
    shear = fem.Constant(space.mesh, young / (2.0 * (1.0 + poisson)))
    lame = fem.Constant(space.mesh, young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)))
    strain_u, strain_v = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))
    stress = 2.0 * shear * strain_u + lame * ufl.tr(strain_u) * ufl.Identity(3)
    form = compile_form(
        ufl.inner(stress, strain_v) * ufl.dx(metadata={"quadrature_degree": degree}),
        space.mesh.comm,
        kernel,
    )
    matrix = fem.create_matrix(form, block_mode=la.BlockMode.compact)
    fem.assemble_matrix(matrix, form)
    matrix.scatter_reverse()
    # the sparsity pattern may hold more ghosts than the space, so the columns have a map of their
    # own
    return _owned_rows(matrix, 3), matrix.index_map(1)


def _assemble_corners(
    scalar: fem.FunctionSpace, material: Material, degree: int, kernel: str
) -> CornerLevel:
    # by the same quadrature, so that it is the fine stiffness on interpolated displacements
    domain = scalar.mesh
    shape = domain.topology.cell_name()
    space = fem.functionspace(domain, basix.ufl.element("Lagrange", shape, 1, shape=(3,)))
    stiffness, columns = _assemble_stiffness(space, material, degree, kernel)
    corners = fem.functionspace(domain, basix.ufl.element("Lagrange", shape, 1))
    transfer, reached = interpolate_corners(corners, scalar)
    points = corners.tabulate_dof_coordinates()[: corners.dofmap.index_map.size_local]
    return CornerLevel(domain.comm, points, stiffness, columns, transfer, reached)


def _assemble_mass(
    space: fem.FunctionSpace, material: Material, degree: int, kernel: str
) -> scipy.sparse.csr_matrix:
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    density = fem.Constant(space.mesh, float(material.density))
    form = compile_form(
        density * u * v * ufl.dx(metadata={"quadrature_degree": degree}), space.mesh.comm, kernel
    )
    matrix = fem.create_matrix(form)
    fem.assemble_matrix(matrix, form)
    matrix.scatter_reverse()
    return _owned_rows(matrix, 1)


def _owned_rows(
    matrix: la.MatrixCSR, block: int
) -> scipy.sparse.bsr_matrix | scipy.sparse.csr_matrix:
    rows = matrix.index_map(0).size_local
    columns = matrix.index_map(1).size_local + matrix.index_map(1).num_ghosts
    pointers = np.array(matrix.indptr[: rows + 1])
    entries = pointers[-1]
    indices = np.array(matrix.indices[:entries])
    values = np.asarray(_Values(matrix))[: entries * block * block]
    if block == 1:
        return scipy.sparse.csr_matrix((values, indices, pointers), shape=(rows, columns))
    data = values.reshape(-1, block, block)
    return scipy.sparse.bsr_matrix((data, indices, pointers), shape=(block * rows, block * columns))


class _Values:
    """The values of a dolfinx matrix, which die with it: an array made of this keeps it alive,
    where a copy would cost as much as assembling does.
    """

    def __init__(self, matrix: la.MatrixCSR) -> None:
        self._matrix = matrix
        self.__array_interface__ = matrix.data.__array_interface__


def _measure_rows(stiffness: scipy.sparse.bsr_matrix) -> tuple[FloatArray, FloatArray]:
    """Return the sums of absolute values by row ``(3 n_owned,)``, and symmetric sums of blocks by
    row of blocks ``(n_owned, 3, 3)``.
    """
    pointers, rows = stiffness.indptr, len(stiffness.indptr) - 1
    sizes, sums = np.zeros((rows, 3)), np.zeros((rows, 3, 3))
    for first in range(0, rows, SUMMED_AT_A_TIME):
        last = min(first + SUMMED_AT_A_TIME, rows)
        starts = pointers[first:last] - pointers[first]
        data = stiffness.data[pointers[first] : pointers[last]]
        sizes[first:last] = np.add.reduceat(np.abs(data).sum(axis=2), starts)
        # in double precision this sum would itself round by as much as it is to find
        sums[first:last] = np.add.reduceat(data.astype(np.longdouble), starts)
    return sizes.ravel(), 0.5 * (sums + sums.transpose(0, 2, 1))


def _check_operators(operators: ElasticOperators, expected: float) -> None:
    """Refuse operators that are off, the mass from that expected [kg]."""
    comm = operators.comm
    scale = operators.stiffness_scale
    image = comm.allreduce(float(np.abs(operators.translation_noise).max(initial=0.0)), op=MPI.MAX)
    if not np.isfinite(image) or image > 1e-9 * scale:
        raise AccuracyError(
            f"a rigid translation causes forces: {image:.3g} N/m against a largest stiffness of {scale:.3g} N/m"
        )
    if operators.scalar_mass is not None:
        mass = comm.allreduce(float(operators.scalar_mass.sum()), op=MPI.SUM)
        if not abs(mass - expected) < 1e-8 * expected:
            raise AccuracyError(
                f"the assembled mass is {mass:.12g} kg, density times mesh volume {expected:.12g} kg"
            )


def _quadrature_degrees(mesh: _MeshFacts, order: int) -> tuple[int, int]:
    """Return the degrees to which stiffness and mass are integrated: exact on affine tets; curved and
    hexahedral maps are rational and get the customary full rule.
    """
    if not mesh.kind.startswith("tet"):
        return (3 if order == 1 else 5), (2 * order + 1 if mesh.straight else 7)
    if mesh.straight or order == 1:
        return 2 * (order - 1), 2 * order
    return 4, 7
