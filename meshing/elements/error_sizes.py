"""Where the error of a mesh asks for small elements."""

import dataclasses

import numpy as np
import scipy  # whose search of neighbours is loaded where it is used
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.size_field import SizeField
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.elements.surface import corner_normals, extract_surface, match_facets
from headstock.meshing.elements.topology import EDGES

# of tetrahedra that gmsh makes for a size, in the mean: 1.1 where sizes change slowly, up to 1.4
# next to small patches
EDGE_OVER_SIZE = 1.2
# Powers of the element size with which squared errors of second-order tetrahedra fall: 4 where
# stresses are smooth, 1.1 at an inner edge of 270 degrees, 1 to 1.4 at rims of what is held
# rigidly; a coarse element there holds some of both
SMOOTH_RATE, SINGULAR_RATE = 4.0, 1.5
SHARP_COSINE = float(np.cos(np.radians(50.0)))  # of facets that meet at an inner edge
FINEST_STEP = 0.2  # from one mesh to the next an estimate can be trusted for this much
# times as many cells: as a new mesh is computed from the start, few more cost little; what a coarse
# mesh misses is known so roughly that the next should show what is needed rather than be far too
# fine
LEAST_TIMES, MOST_TIMES = 1.25, 4.0
HALVINGS = 60
NEIGHBOURS = 4


def _mean_edges(field: SizeField) -> FloatArray:
    """Return the root mean square ``(m,)`` of the six edges of each tetrahedron [m]: of a flat one
    its width, as its size was.
    """
    corners = field.points[field.tets]
    squares = [np.square(corners[:, i] - corners[:, j]).sum(axis=1) for i, j in EDGES["tet"]]
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def _find_singular(mesh: ComponentMesh) -> NDArray[np.bool_]:
    """Find cells ``(n_cells,)`` with a corner at a sharp inner edge or a patch's rim."""
    surface = extract_surface(mesh.cells, mesh.kind)
    corners, normals = surface.facets[:, :3], corner_normals(mesh.points, surface)
    sides = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(sides.T)
    shared = (np.diff(sides[order], axis=0) == 0).all(axis=1)
    left, right = order[:-1][shared] // 3, order[1:][shared] // 3
    middles = mesh.points[corners].mean(axis=1)
    turned = np.einsum("ij,ij->i", normals[left], normals[right]) < SHARP_COSINE
    inner = np.einsum("ij,ij->i", middles[right] - middles[left], normals[left]) > 0.0
    rims = np.zeros(len(left), dtype=bool)
    for facets in mesh.patches.values():
        held = np.zeros(len(corners), dtype=bool)
        held[match_facets(surface, facets)[0]] = True
        rims |= held[left] != held[right]
    ends = np.unique(sides[order[:-1][shared]][(turned & inner) | rims])
    return np.asarray(np.isin(mesh.cells[:, :4], ends).any(axis=1))


def spread_error(
    mesh: ComponentMesh, energies: FloatArray, share: float, before: SizeField | None = None
) -> SizeField:
    """Return the sizes with which the fewest cells miss so much of what a mesh misses, a quarter
    more of them at least and four times as many at most; none is larger than those of the mesh.

    A cell misses ``e s^p`` when its size becomes ``s`` times what it is, with a power ``p`` that is
    smaller where stresses are singular. The fewest cells are needed where ``p e s^(p + 3)`` is equal
    for all of them.

    Args:
        energies: ``(n_cells,)`` what each of its cells misses, in any unit.
        share: What all may miss in sum, over what they miss.
        before: Sizes that the mesh was made with, if they were given from place to place.

    Source: Zienkiewicz and Zhu (1987), Int. J. Numer. Meth. Engng. 24, 337-357; Diez and Huerta
    (1999), Comput. Methods Appl. Mech. Engng. 176, 215-229, for the least number of cells; Williams
    (1952), J. Appl. Mech. 19, 526-528, on stresses at inner edges.
    """
    used, tets = np.unique(mesh.cells[:, :4], return_inverse=True)
    field = SizeField(mesh.points[used], tets.reshape(-1, 4), np.ones(len(used)))
    old, total = _mean_edges(field) / EDGE_OVER_SIZE, float(energies.sum())
    rates = np.where(_find_singular(mesh), SINGULAR_RATE, SMOOTH_RATE)
    crowd = field.volumes / old**3  # in cells of a regular shape
    least = 1e-12 * total / field.volumes.sum() * field.volumes
    shape = crowd / (rates * np.maximum(energies, least))

    def steps(scale: float) -> FloatArray:
        return np.asarray(np.clip((scale * shape) ** (1.0 / (rates + 3.0)), FINEST_STEP, 1.0))

    highest = SMOOTH_RATE + 3.0
    low, high = FINEST_STEP**highest / float(shape.max()), 1.0 / float(shape.min())
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        finer = steps(middle)
        missed, cells = float(energies @ finer**rates), float(crowd @ finer**-3.0)
        times = cells / crowd.sum()
        enough = (missed <= share * total and times >= LEAST_TIMES) or times > MOST_TIMES
        low, high = (middle, high) if enough else (low, middle)
    # at a corner, as many cells per volume as the mean of those that meet in it
    ends = field.tets.ravel()
    crowds = np.bincount(ends, np.repeat((steps(low) * old) ** -3.0, 4)) / np.bincount(ends)
    sizes = crowds ** (-1.0 / 3.0)
    if before is not None:  # what a mesh generator makes of sizes is coarser here and there
        count = min(NEIGHBOURS, len(before.points))
        away, nearest = scipy.spatial.cKDTree(before.points).query(field.points, k=count)
        weights = 1.0 / np.maximum(away, 1e-9 * away.max()) ** 2
        earlier = np.sum(weights * before.sizes[nearest], axis=1) / weights.sum(axis=1)
        sizes = np.minimum(sizes, earlier)
    return dataclasses.replace(field, sizes=np.asarray(sizes)).settled()
