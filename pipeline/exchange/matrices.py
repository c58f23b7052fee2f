"""Matrices of a body as other programs take them: nodes of up to six dofs, and scalar dofs without a
place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.scipy_library import scipy
from headstock.reduction.rails import CONTROL_POINT_DOFS
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.linear.symmetric_matrices import symmetrise

MOST_DOFS = 20_000  # of dense matrices from files of strangers: 3.2 GB each
DEPENDENT = 1e-9  # of the largest pivot of constraints
MOST_ENTRIES = 50_000_000  # of sparse ones


class ExchangeError(HeadstockError):
    """A file of matrices is damaged, too large, or says something that cannot be taken."""


@dataclass(frozen=True, eq=False)
class BodyMatrices:
    """Matrices of a body in the axes of its frame, SI.

    Attributes:
        nodes: ``(n, 2)`` number of the node of each dof, and which of its dofs: 1 to 6 for x y z rx ry
            rz, 0 for a scalar dof, which has a node of its own.
        points: Position ``(3,)`` of each node that has one [m], by number.
        stiffness: ``(n, n)`` symmetric.
        mass: ``(n, n)`` symmetric.
        damping: ``(n, n)`` viscous; None without.
    """

    name: str
    nodes: IntArray
    points: dict[int, tuple[float, float, float]]
    stiffness: FloatArray
    mass: FloatArray
    damping: FloatArray | None = None

    @property
    def matrices(self) -> dict[str, FloatArray]:
        """Stiffness ``K``, mass ``M``, and damping ``C`` where there is one, by letter."""
        found = {"K": self.stiffness, "M": self.mass}
        return found if self.damping is None else {**found, "C": self.damping}

    @property
    def scalar_nodes(self) -> list[int]:
        """Numbers of the nodes without a place."""
        return [int(node) for node, dof in self.nodes if dof == 0]


def list_matrices(superelement: Superelement) -> BodyMatrices:
    """Return the matrices of a superelement: its boundary nodes from 1 on, then control points of its
    rails, which have one rotation each; all other dofs are scalar.

    Raises:
        ExchangeError: Its interfaces are tied to each other.
    """
    superelement = eliminate_constraints(superelement)
    places: list[tuple[FloatArray, Sequence[int]]] = [
        (frame.origin, range(1, 7)) for frame in superelement.frames
    ]
    places += [
        (control.point, (1, 2, 3, 4 + control.axis)) for control in superelement.control_points
    ]
    dofs = [(number, dof) for number, (_, own) in enumerate(places, 1) for dof in own]
    scalars = range(len(places) + 1, len(places) + 1 + len(superelement.stiffness) - len(dofs))
    nodes = np.array([*dofs, *((number, 0) for number in scalars)], dtype=np.int64)
    points = {
        number: (float(x), float(y), float(z)) for number, ((x, y, z), _) in enumerate(places, 1)
    }
    return BodyMatrices(
        superelement.name,
        nodes.reshape(-1, 2),
        points,
        superelement.stiffness,
        superelement.mass,
        superelement.damping,
    )


def eliminate_constraints(superelement: Superelement) -> Superelement:
    """Return the same body without constraints, which no other format keeps apart from its matrices.

    Dofs of nodes that no interface stands on follow the others, such as those of segments below an
    interface that averages. What is left of such nodes becomes a scalar dof, relative to the rigid
    motion of the first node.

    Raises:
        ExchangeError: Interfaces are tied to each other.
    """
    rows = superelement.constraints
    if not len(rows):
        return superelement
    dofs = np.arange(superelement.node_size).reshape(-1, len(DOF_NAMES))
    named = [entry.node for entry in superelement.interface_maps.values()]
    behind = superelement.node_size + CONTROL_POINT_DOFS * len(superelement.control_points)
    fixed = np.concatenate([dofs[named].ravel(), np.arange(superelement.node_size, behind)])
    free = np.setdiff1d(np.arange(rows.shape[1]), fixed)
    levels, order = scipy.linalg.qr(rows[:, free], mode="r", pivoting=True)
    pivots = np.abs(levels.diagonal())
    if len(free) < len(rows) or pivots.min() <= DEPENDENT * pivots.max():
        raise ExchangeError(
            f"component {superelement.name!r}: its interfaces share nodes with each other or with a support, "
            "which matrices cannot say; leave a gap between patches that touch"
        )
    dependent = free[order[: len(rows)]]
    whole = np.flatnonzero(~np.isin(dofs, dependent).any(axis=1))
    first = np.concatenate([dofs[whole].ravel(), np.arange(superelement.node_size, behind)])
    others = np.setdiff1d(free, [*dependent, *first])
    kept = np.concatenate([first, others])
    basis = np.zeros((rows.shape[1], len(kept)))
    basis[kept, np.arange(len(kept))] = 1.0
    # scalar dofs rest where the body moves rigidly
    origin = superelement.frames[whole[0]].origin
    basis[others, : len(DOF_NAMES)] = rigid_motions(superelement, origin)[others]
    basis[dependent] = -np.linalg.solve(rows[:, dependent], rows[:, kept] @ basis[kept])
    stiffness, mass = (
        symmetrise(basis.T @ matrix @ basis)
        for matrix in (superelement.stiffness, superelement.mass)
    )
    damping = superelement.damping
    if damping is not None:
        damping = symmetrise(basis.T @ damping @ basis)
    return replace(
        superelement,
        labels=(
            *(superelement.labels[row] for row in first),
            *(("mode", str(number)) for number in range(1, len(others) + 1)),
        ),
        frames=tuple(superelement.frames[node] for node in whole),
        interface_maps={
            name: replace(entry, node=int(np.searchsorted(whole, entry.node)), shapes=None)
            for name, entry in superelement.interface_maps.items()
        },
        stiffness=stiffness,
        mass=mass,
        damping=damping,
        constraints=np.zeros((0, len(kept))),
    )


def require_last_line(path: Path) -> None:
    """Refuse a text that ends within a line, whose last number may be cut."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 1, 0))
        if file.read() != b"\n":
            raise ExchangeError(f"{path.name} ends within a line; copy it again")


def fill_matrix(
    size: int, places: IntArray, values: FloatArray, *, symmetric: bool = True
) -> FloatArray:
    """Return a matrix ``(size, size)`` from its entries.

    Args:
        places: Row and column ``(k, 2)`` of each.
        symmetric: An entry is its mirror image, too, where that is not written.
    """
    rows, columns = places.T
    matrix, written = np.zeros((size, size)), np.zeros((size, size), dtype=bool)
    matrix[rows, columns], written[rows, columns] = values, True
    if symmetric:
        mirrored = ~written & written.T
        matrix[mirrored] = matrix.T[mirrored]
    return matrix


def require_matrix(matrix: FloatArray, what: str) -> FloatArray:
    """Refuse a matrix that is not square, not finite or not symmetric; return it exactly symmetric.

    Args:
        what: File and name of the matrix, for errors.
    """
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ExchangeError(
            f"{what} has {' x '.join(map(str, matrix.shape))} entries; it must be square"
        )
    if not np.isfinite(matrix).all():
        raise ExchangeError(f"{what} holds a number that is not finite")
    gap = np.abs(matrix - matrix.T).max(initial=0.0)
    largest = np.abs(matrix).max(initial=0.0)
    if gap > 1e-6 * largest:
        raise ExchangeError(
            f"{what} is not symmetric: entries differ by up to {gap / largest:.1e} of the largest; check which half was written"
        )
    return np.asarray(0.5 * (matrix + matrix.T))
