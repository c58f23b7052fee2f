"""How large elements should be, and how many that makes, before anything is meshed."""

import math

import numpy as np

from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.patches import FACE_DIRECTIONS
from headstock.geometry.parts.plane_shapes import flatten_patch, patch_width, plane_axes
from headstock.geometry.parts.solids import HollowColumn, ParametricSolid, Plate, Tube

CELL_BUDGET = 3_000_000
UNCOUNTED = 1e30  # beyond this the number of cells says nothing, and overflows
TETS_PER_CUBE = 5.2  # measured: tets per (volume / size^3) in blocks
TETS_PER_SHEET = (
    7.0  # measured: tets per (mid-surface / size^2) where walls are thinner than the elements
)
LARGEST_SHARE = 6.0
SMALLEST_SHARE = 40.0
DEFAULT_CELLS = 150_000
DEFAULT_FILE_CELLS = 75_000  # of CAD parts, whose thin walls have more nodes per cell than blocks
SIZE_STEP = 1.25
SMALLEST_SIZE = 0.05  # of the element size: what curvature and short edges do not go below
DETAIL_SHARE = 0.5  # of the element size: narrower holes, recesses and pads in planes are closed
CELLS_AT_RIM = (
    5.0  # times length / (size * growth^2): measured on blocks with patches and clamped faces
)
# Elements across a patch that are smaller than this share of the others grow from its rim: meshed
# evenly up to the next edge of the face they are too thin to use (a strip of 0.5 mm among elements
# of 25 mm: scaled Jacobians of 5e-4, growing ones 5e-2)
NARROW_PATCH = 1.0 / 64.0
NARROW_GROWTH = 0.5
PATCH_CELLS = 300_000  # that one narrow patch may ask for
# Measured on ten STEP parts, sheets and blocks, from 1.6 to 2.5 cells per triangle: within 0.7 to
# 1.4 of the cells
CELLS_PER_TRIANGLE = 1.2
CELLS_PER_VOLUME = 4.5


def round_length(value: float) -> float:
    """Return a length rounded to 12 digits: units and float noise must not change a mesh."""
    return float(f"{value:.12g}")


def thinnest_feature(solid: ParametricSolid) -> float:
    """Return the smallest thickness of material in a parametric solid [m]."""
    if isinstance(solid, Tube):
        wall = (solid.outer_diameter - solid.inner_diameter) / 2
        return min(solid.length, wall if solid.inner_diameter > 0.0 else solid.outer_diameter)
    if isinstance(solid, HollowColumn):
        ribs = [solid.rib] if solid.ribs_x or solid.ribs_y or solid.ribs_z else []
        return min(solid.wall, solid.cap, *ribs) if ribs else min(solid.wall, solid.cap)
    if isinstance(solid, Plate) and solid.rib_height > 0.0 and solid.ribs_x + solid.ribs_y > 0:
        return min(*solid.size, solid.rib_thickness)
    return min(solid.size)


def largest_extent(solid: ParametricSolid) -> float:
    """Return the longest side of a parametric solid's bounding box [m]."""
    if isinstance(solid, Tube):
        return max(solid.outer_diameter, solid.length)
    height = solid.rib_height if isinstance(solid, Plate) else 0.0
    return max(solid.size[0], solid.size[1], solid.size[2] + height)


def default_size(volume: float, thinnest: float, extent: float) -> float:
    """Return the element size [m] from a solid's volume [m^3], thinnest feature [m] and longest
    side [m].

    Two elements through the thinnest feature, but between 1/40 and 1/6 of the longest side, and
    coarser where that would make more than 150 000 elements.

    Args:
        volume: Of the solid [m^3].
        thinnest: Its thinnest feature [m].
        extent: Its longest side [m].
    """
    size = min(max(thinnest / 2, extent / SMALLEST_SHARE), extent / LARGEST_SHARE)
    while estimate_tets(volume, thinnest, size) > DEFAULT_CELLS and size < extent / LARGEST_SHARE:
        size *= SIZE_STEP
    return size


def estimate_tets(volume: float, thinnest: float, size: float) -> int:
    """Return the number of tets of a given size in a solid, as a block or as a sheet, whichever is
    more.

    Args:
        volume: Of the solid [m^3].
        thinnest: Its thinnest feature [m].
        size: Of the tets [m].
    """
    block = TETS_PER_CUBE * volume / size / size / size
    sheet = TETS_PER_SHEET * volume / thinnest / size / size
    return int(min(max(block, sheet), UNCOUNTED))


def count_rim_cells(length: float, at_rim: float, *, growth: float, size: float) -> float:
    """Return the number of cells that growing from a curve adds, roughly.

    Around a curve of length L in a half-space, elements of size ``s + g r`` at the distance r make
    up ``L / (s g^2)`` times a number.

    Args:
        length: Of the curve [m].
        at_rim: Element size there [m].
        growth: Of the element size per distance from the curve.
        size: Largest element size [m].
    """
    return max(CELLS_AT_RIM * length / growth**2 * (1.0 / at_rim - 1.0 / size), 0.0)


def count_patch_cells(patch: Patch, solid: ParametricSolid, *, across: int, size: float) -> float:
    """Return the number of cells that a patch asks for, roughly, if it is so narrow that elements
    grow from its rim, else 0.

    Args:
        solid: On which it is; strips run all along it.
        size: Element size elsewhere [m].
    """
    if patch.shape == "whole" or patch_width(patch) / across >= NARROW_PATCH * size:
        return 0.0
    if patch.shape == "strip":
        rim = 2.0 * _length_along(solid, patch.along)
    elif patch.shape == "band":
        rim = 2.0 * math.pi * largest_extent(solid)
    else:
        normal = FACE_DIRECTIONS[patch.face][0]
        rim = flatten_patch(patch, plane_axes(np.eye(3)[normal])).perimeter
    return count_rim_cells(rim, patch_width(patch) / across, growth=NARROW_GROWTH, size=size)


def _length_along(solid: ParametricSolid, axis: str | None) -> float:
    if isinstance(solid, Tube) or axis not in ("x", "y", "z"):
        return largest_extent(solid)
    return float(solid.size["xyz".index(axis)])


def dense_patch_message(count: float, width: float, across: int) -> str:
    """Return the message for when a patch asks for too many elements; width in [m].

    Args:
        width: Narrowest side of the patch [m].
    """
    return (
        f"the patch is {1e3 * width:.4g} mm wide, and elements of {1e3 * width / across:.3g} mm at its rim make about {count:.2g} cells;"
        f" more than {PATCH_CELLS:.2g} for one patch are refused: write one at least {float(f'{1.1e3 * width * count / PATCH_CELLS:.2g}'):g}"
        " mm wide, fewer mesh.across_patches, or take the whole face"
    )


def estimate_behind_faces(triangles: int, cubes: float, order: int) -> tuple[int, int]:
    """Return the number of tets and of nodes behind a meshed surface.

    Args:
        cubes: Volume over the third power of the element size inside.
    """
    cells = CELLS_PER_TRIANGLE * triangles + CELLS_PER_VOLUME * cubes
    vertices = triangles / 2 + max(cells - 1.5 * triangles, 0.0) / 5.5
    nodes = vertices if order == 1 else count_quadratic_nodes(vertices, cells, triangles)
    return int(min(cells, UNCOUNTED)), int(min(nodes, UNCOUNTED))


def count_quadratic_nodes(vertices: float, cells: float, triangles: float) -> int:
    """Return the number of corners and middles of edges of a mesh of tets.

    Source: Euler's formula; edges of tets are ``vertices + cells + triangles / 2``.
    """
    return int(min(2 * vertices + cells + triangles / 2, UNCOUNTED))


def budget_message(count: int, size: float) -> str:
    """Return the message for when a mesh would be too large; size in [m]."""
    coarser = size * (count / CELL_BUDGET) ** (1.0 / 3.0) * 1.1
    return (
        f"elements of {1e3 * size:.6g} mm would make about {count:.3g} cells, more than the budget of {CELL_BUDGET:.3g}; "
        f"write a mesh size of {float(f'{1e3 * coarser:.2g}'):g} mm or more"
    )
