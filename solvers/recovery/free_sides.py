"""Stresses recovered where single tetrahedra fill a part: there only the sides, on which nothing acts,
tell what the elements miss.

The samples of a bar with one tetrahedron across its section lie on one smooth polynomial whatever
they miss: a twisted square bar shows stresses that grow evenly from its axis, also at its sides,
where they have to vanish. Polynomials that are fitted to the samples and to free sides at once show
what is missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import EDGE_GROUP, Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.elements.quality import facet_moments, facet_tables
from headstock.meshing.elements.surface import corner_normals, extract_surface, match_facets
from headstock.solvers.stresses import true_stresses

# Cubic stresses hold those of a twisted bar, quadratic ones do not
DEGREE = 3
# two per coefficient: sides help to determine them
SAMPLES_BESIDE_SIDES = 2.0 * 20.0
SIDE_PLACES = 2  # along each edge of a facet: as many places as a tetrahedron has samples
RIDGE = 1e-10  # of the mean diagonal: what neither samples nor sides determine stays small
# Area of the sides in the second of their main directions over that in the first, from which on they
# lie around a bar and not along a wall
AROUND = 0.25
# Width of a wall's cells over its thickness, up to which the shear through it shows at its sides
STOUT_WALL = 1.1


@dataclass(frozen=True, eq=False)
class FreeSides:
    """Corners at which single tetrahedra fill a part, and its sides there.

    Attributes:
        alone: ``(n_points,)`` mesh points that are corners of such cells only.
        facets: ``(n, 6)`` of the surface on which nothing acts.
        cells: ``(n,)`` that they belong to.
    """

    alone: NDArray[np.bool_]
    facets: IntArray
    cells: IntArray

    def within(self, nodes: IntArray, cells: IntArray) -> "FreeSides":
        """Return those of a part of the mesh.

        Args:
            nodes: ``(n,)`` its points, sorted.
        """
        row_of = np.full(int(max(cells.max(initial=0), self.cells.max(initial=0))) + 1, -1)
        row_of[cells] = np.arange(len(cells))
        mine = row_of[self.cells] >= 0
        facets = np.searchsorted(nodes, self.facets[mine])
        return FreeSides(self.alone[nodes], facets, row_of[self.cells[mine]])


def find_free_sides(mesh: ComponentMesh) -> FreeSides | None:
    """Find where single second-order tetrahedra fill a part; None where they do nowhere.

    Args:
        mesh: Whole, with the areas that something holds or loads.
    """
    if mesh.kind != "tet10":
        return None
    surface = extract_surface(mesh.cells, mesh.kind)
    corners = mesh.cells[:, :4]
    at_surface = np.zeros(len(mesh.points), dtype=bool)
    at_surface[surface.facets[:, :3]] = True
    if not at_surface[corners].all(axis=1).any():
        return None
    held = [
        match_facets(surface, facets)[0]
        for name, facets in mesh.patches.items()
        if not name.endswith(EDGE_GROUP)
    ]
    free = np.setdiff1d(
        np.arange(len(surface.facets)), np.concatenate([np.zeros(0, dtype=int), *held])
    )
    owners = _find_owners(mesh, surface.facets[free])
    areas, _ = facet_moments(mesh.points, surface.facets[free])
    normals = corner_normals(mesh.points, surface)[free]
    # where free sides look one way alone, or two opposite ones, they are those of a wall
    facing = np.zeros((len(mesh.points), 3, 3))
    np.add.at(
        facing,
        corners[owners],
        (areas[:, None, None] * normals[:, :, None] * normals[:, None])[:, None],
    )
    spread = np.linalg.eigvalsh(facing)
    around = at_surface & (spread[:, 1] >= AROUND * spread[:, 2]) & (spread[:, 2] > 0.0)
    around |= at_surface & _find_stout(mesh, owners, areas)
    # at edges of a block the cells beyond have corners inside
    around[corners[~at_surface[corners].all(axis=1)]] = False
    alone = around.copy()
    alone[corners[~around[corners].all(axis=1)]] = False
    return FreeSides(alone, surface.facets[free], owners) if alone.any() else None


def _find_stout(mesh: ComponentMesh, owners: IntArray, areas: FloatArray) -> NDArray[np.bool_]:
    """Find the corners ``(n_points,)`` at which walls are as thick as their cells are wide, from
    free facets with areas ``(n,)``.
    """
    corners = mesh.cells[:, :4]
    volumes = np.abs(np.linalg.det(mesh.points[corners[:, 1:]] - mesh.points[corners[:, :1]])) / 6.0
    volume, area, count = (np.zeros(len(mesh.points)) for _ in range(3))
    np.add.at(volume, corners, volumes[:, None])
    np.add.at(area, corners[owners], areas[:, None])
    np.add.at(count, corners[owners], 1.0)
    # an even triangle of a side has 0.43 times its square; a wall has two sides
    widths = np.sqrt(2.3 * area / np.maximum(count, 1.0))
    return widths * area < STOUT_WALL * 2.0 * volume


def _find_owners(mesh: ComponentMesh, facets: IntArray) -> IntArray:
    """Find the cell ``(n,)`` that each facet of the surface belongs to."""
    points = len(mesh.points)
    incidence = scipy.sparse.csr_matrix(
        (
            np.ones(mesh.cells[:, :4].size, dtype=np.int8),
            (np.repeat(np.arange(len(mesh.cells)), 4), mesh.cells[:, :4].ravel()),
        ),
        shape=(len(mesh.cells), points),
    )
    corners = scipy.sparse.csr_matrix(
        (
            np.ones(3 * len(facets), dtype=np.int8),
            (np.repeat(np.arange(len(facets)), 3), facets[:, :3].ravel()),
        ),
        shape=(len(facets), points),
    )
    shared = (corners @ incidence.T).tocsr()
    owners: IntArray = shared.indices[shared.data == 3].astype(np.int64)
    return owners


@dataclass(frozen=True, eq=False)
class _SideFit:
    """Fits polynomials of stresses to samples in cells and to free sides at once.

    Attributes:
        places: ``(n, q, 3)`` places on free facets [m].
        tractions: ``(n, q, 3, 6)`` tractions there per scaled stress, in its scale.
    """

    places: FloatArray
    tractions: FloatArray
    of_cells: Sequence[IntArray]

    def fit(
        self,
        offsets: FloatArray,
        cells: Sequence[IntArray],
        middles: FloatArray,
        samples: FloatArray | NDArray[np.float32],
    ) -> tuple[FloatArray, FloatArray]:
        """Return the coefficients ``(n_v, n, m)`` of the polynomials around some corners, and the
        length ``(n_v,)`` that coordinates are divided by.

        Args:
            offsets: ``(n_v, n_samples, 3)`` of the samples from the corners; NaN for fillers.
            cells: ``(n_v,)`` of each corner.
            middles: ``(n_v, 3)`` the corners [m].
            samples: ``(n_v, n_samples, 6 k)`` scaled stresses.

        Source: Wiberg, Abdulwahab and Ziukas (1994), Int. J. Numer. Meth. Engng. 37, 3417-3440,
        recovery with boundary conditions; Prager and Synge (1947), Quart. Appl. Math. 5, 241-269: the
        distance to stresses in balance is the energy that a displacement field misses.
        """
        real = ~np.isnan(offsets[..., :1])
        lengths = np.nanmax(np.abs(offsets), axis=(1, 2))
        table = np.where(real, raise_powers(offsets / lengths[:, None, None]), 0.0)
        alone = np.matmul(table.swapaxes(1, 2), table)
        corners, size, width = len(alone), alone.shape[1], samples.shape[2]
        blocks = np.zeros((corners, 6, size, 6, size))
        for component in range(6):
            blocks[:, component, :, component] = alone
        normal: FloatArray = blocks.reshape(corners, 6 * size, 6 * size)
        for row, around in enumerate(cells):
            facets = np.concatenate([self.of_cells[cell] for cell in around])
            terms = raise_powers((self.places[facets] - middles[row]) / lengths[row])
            acts = np.einsum("fqic,fqa->fqica", self.tractions[facets], terms)
            acts = acts.reshape(-1, 6 * size)
            normal[row] += acts.T @ acts
        diagonal = np.einsum("vii->vi", normal)
        diagonal += RIDGE * diagonal.mean(axis=1, keepdims=True)
        right = np.matmul(table.swapaxes(1, 2), samples).reshape(corners, size, 6, -1)
        right = right.swapaxes(1, 2).reshape(corners, 6 * size, -1)
        fitted = np.linalg.solve(normal, right).reshape(corners, 6, size, -1)
        return fitted.swapaxes(1, 2).reshape(corners, size, width), lengths


def prepare_fit(mesh: ComponentMesh, material: Material, sides: FreeSides) -> _SideFit:
    """Return the free sides of a mesh, ready for fits.

    Args:
        mesh: Of second-order tetrahedra.
    """
    values, gradients, _ = facet_tables(sides.facets.shape[1], SIDE_PLACES)
    nodes = mesh.points[sides.facets]
    first, second = np.einsum("aqn,fni->afqi", gradients, nodes)
    normals = np.cross(first, second)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    # as shear is scaled in samples, so that a place on a side counts like one within
    scale = np.sqrt(material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio)))
    order = np.argsort(sides.cells, kind="stable")
    ends = np.searchsorted(sides.cells[order], np.arange(1, len(mesh.cells)))
    return _SideFit(
        np.einsum("qn,fni->fqi", values, nodes),
        np.einsum("cij,fqj->fqic", true_stresses(material, np.eye(6)) / scale, normals),
        np.split(order, ends),
    )


def raise_powers(places: FloatArray) -> FloatArray:
    """Return the monomials ``(..., n)`` of the fits at places ``(..., 3)``."""
    powers = [np.ones_like(places)]
    for _ in range(DEGREE):
        powers.append(powers[-1] * places)
    terms = [one for one in product(range(DEGREE + 1), repeat=3) if sum(one) <= DEGREE]
    return np.stack(
        [powers[a][..., 0] * powers[b][..., 1] * powers[c][..., 2] for a, b, c in terms], axis=-1
    )
