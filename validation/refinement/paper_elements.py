"""Finite elements as the paper seems to have used them: linear hexahedra with bending shapes, one
through the thickness.

Each direction gets a shape ``1 - xi^2`` of its own in each element, condensed out of its stiffness;
on rectangular bricks this is exact in pure bending. The mass is that of the plain element.
Commercial programs have such elements, Headstock has not.

The paper names neither its elements nor its meshes. These give every statement it makes on figures
7, 9 and 14, which plain linear elements do not: dx(Mc) stays more than 10 % off since one element
across the section cannot warp as the section does.

Source: Wilson, Taylor, Doherty and Ghaboussi (1973), Incompatible displacement models.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.topology import reference_nodes
from headstock.validation.parts.sparse_eigenpairs import lowest_symmetric_pairs, solve_symmetric
from headstock.validation.refinement.points import RefinementPoint, cantilever_displacements
from headstock.validation.refinement.references import ReferenceBeam
from headstock.validation.refinement.theory_shapes import (
    find_theory_shapes,
    read_shape,
    section_motions,
)

CORNERS = reference_nodes("hex8")
GAUSS = 1.0 / np.sqrt(3.0)
# rows of the strain: xx yy zz xy yz zx, each with the displacement component and the derivative it
# takes
STRAINS = (((0, 0),), ((1, 1),), ((2, 2),), ((0, 1), (1, 0)), ((1, 2), (2, 1)), ((2, 0), (0, 2)))
COLUMN_GRIDS = tuple((1, 1, count) for count in (2, 3, 4, 8, 16, 32, 80))
FIXED_GRIDS = tuple((1, 3 * count, count) for count in (1, 2, 3, 4, 5, 6, 8, 12))
MODES = 12
ON_FACE = 1e-9


@dataclass(frozen=True, eq=False)
class _BrickModel:
    """A box of equal bricks.

    Attributes:
        points: ``(n, 3)`` nodes [m].
        stiffness: ``(3 n, 3 n)``.
        mass: ``(3 n, 3 n)``.
    """

    points: FloatArray
    stiffness: scipy.sparse.csr_matrix
    mass: scipy.sparse.csr_matrix


def _brick_model(
    sides: tuple[float, float, float], counts: tuple[int, int, int], material: Material
) -> _BrickModel:
    """Return a box from ``(-x/2, -y/2, -z/2)``, cut into bricks.

    Args:
        sides: Of the box [m].
        counts: Bricks along x, y and z.
    """
    axes = [
        side * (np.arange(count + 1) / count - 0.5)
        for side, count in zip(sides, counts, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = _number_cells(counts)
    brick = np.array(sides) / np.array(counts)
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    rows, columns = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    size = 3 * len(points)
    matrices = (_brick_stiffness(brick, material), _brick_mass(brick, material))
    stiffness, mass = (
        scipy.sparse.csr_matrix(
            (np.tile(matrix.ravel(), len(cells)), (rows, columns)), shape=(size, size)
        )
        for matrix in matrices
    )
    return _BrickModel(points, stiffness, mass)


def _brick_stiffness(brick: FloatArray, material: Material, *, bending: bool = True) -> FloatArray:
    """Stiffness ``(24, 24)`` of one rectangular brick [N/m], with its bending shapes condensed out
    or without them.

    Args:
        brick: ``(3,)`` sides [m].
        bending: With a shape ``1 - xi^2`` in each direction; else the plain trilinear element.
    """
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    lame = 2.0 * shear * material.poisson_ratio / (1.0 - 2.0 * material.poisson_ratio)
    elastic = np.diag([2.0 * shear] * 3 + [shear] * 3)
    elastic[:3, :3] += lame
    half = np.asarray(np.asarray(brick) / 2.0, dtype=np.float64)
    whole = np.zeros((33, 33))
    for place in itertools.product((-GAUSS, GAUSS), repeat=3):
        strain = _strain_rows(np.array(place), half)
        whole += strain.T @ elastic @ strain * float(np.prod(half))
    if not bending:
        return whole[:24, :24]
    return np.asarray(
        whole[:24, :24] - whole[:24, 24:] @ np.linalg.solve(whole[24:, 24:], whole[24:, :24])
    )


def _brick_mass(brick: FloatArray, material: Material) -> FloatArray:
    """Consistent mass ``(24, 24)`` of one brick of sides ``(3,)`` [m]."""
    scalar = np.zeros((8, 8))
    for place in itertools.product((-GAUSS, GAUSS), repeat=3):
        shapes = np.prod((1.0 + CORNERS * place) / 2.0, axis=1)
        scalar += np.outer(shapes, shapes)
    return np.asarray(
        np.kron(scalar * material.density * float(np.prod(np.asarray(brick) / 2.0)), np.eye(3))
    )


def _solve_fixed(model: _BrickModel, fixed: IntArray, loads: FloatArray) -> FloatArray:
    """Static displacements ``(3 n, m)`` [m] with all dofs of some nodes fixed.

    Args:
        model: Of ``n`` nodes.
        loads: ``(3 n, m)`` nodal forces [N].
    """
    free = _free_dofs(model, fixed)
    found = np.zeros_like(loads)
    found[free] = solve_symmetric(model.stiffness[free][:, free], loads[free])
    return found


def _fixed_modes(model: _BrickModel, fixed: IntArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest natural modes with all dofs of some nodes fixed; fewer where there are few
    dofs.

    Args:
        model: Of ``n`` nodes.
        count: How many modes.

    Returns:
        Frequencies ``(m,)`` [Hz] and mass-normalised shapes ``(m, n, 3)``.
    """
    free = _free_dofs(model, fixed)
    stiffness, mass = model.stiffness[free][:, free], model.mass[free][:, free]
    if len(free) <= 2 * count:
        values, vectors = scipy.linalg.eigh(stiffness.toarray(), mass.toarray())
        values, vectors = values[:count], vectors[:, :count]
    else:
        values, vectors = lowest_symmetric_pairs(stiffness, mass, count, shift=0.0)
    shapes = np.zeros((3 * len(model.points), len(values)))
    shapes[free] = vectors
    return np.sqrt(values) / (2.0 * np.pi), shapes.T.reshape(len(values), -1, 3)


def _free_dofs(model: _BrickModel, fixed: IntArray) -> IntArray:
    return np.setdiff1d(
        np.arange(3 * len(model.points)), (3 * np.asarray(fixed)[:, None] + np.arange(3)).ravel()
    )


def _number_cells(counts: tuple[int, int, int]) -> IntArray:
    """Corner nodes ``(n, 8)`` in the order of ``CORNERS``."""
    starts = np.stack(
        np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), axis=-1
    ).reshape(-1, 3)
    index = starts[:, None, :] + ((CORNERS + 1.0) / 2.0).astype(np.int64)[None]
    _, second, third = (count + 1 for count in counts)
    return np.asarray((index[..., 0] * second + index[..., 1]) * third + index[..., 2])


def _strain_rows(place: FloatArray, half: FloatArray) -> FloatArray:
    """Strain ``(6, 33)`` at a place: 8 corners, then the bending shape of each direction."""
    sides = (1.0 + CORNERS * place) / 2.0
    gradients = np.zeros((11, 3))
    for axis in range(3):
        gradients[:8, axis] = (
            CORNERS[:, axis] / 2.0 * np.prod(np.delete(sides, axis, axis=1), axis=1) / half[axis]
        )
        gradients[8 + axis, axis] = -2.0 * place[axis] / half[axis]
    rows = np.zeros((6, 11, 3))
    for row, parts in enumerate(STRAINS):
        for component, derivative in parts:
            rows[row, :, component] += gradients[:, derivative]
    return rows.reshape(6, 33)


def paper_points(beam: ReferenceBeam) -> list[RefinementPoint]:
    """Models of a beam by the paper's elements; static ones of the cantilever only, as the fixed
    beam's mesh is not known.
    """
    column = beam.ends == "clamped-free"
    found: list[RefinementPoint] = []
    for grid in COLUMN_GRIDS if column else FIXED_GRIDS:
        model = _brick_model(beam.size, grid, beam.material)
        ndof = 3 * len(model.points)
        if column:
            found.append(
                RefinementPoint(
                    "wilson8", ndof, "static", _static_values(beam, model), {}, math.nan, math.nan
                )
            )
        values, macs = _modal_values(beam, model)
        found.append(RefinementPoint("wilson8", ndof, "modal", values, macs, math.nan, math.nan))
    return found


def _fixed_nodes(beam: ReferenceBeam, model: _BrickModel) -> IntArray:
    place = model.points[:, beam.axis] / beam.size[beam.axis] + 0.5
    ends = (0.0,) if beam.ends == "clamped-free" else (0.0, 1.0)
    return np.flatnonzero(np.min([np.abs(place - end) for end in ends], axis=0) < ON_FACE)


def _static_values(beam: ReferenceBeam, model: _BrickModel) -> dict[str, float]:
    """Unit forces and moments on the top face, spread evenly over its nodes, and the mean motion of
    that face.
    """
    top = np.flatnonzero(model.points[:, 2] > 0.5 * beam.size[2] - ON_FACE)
    mean = np.linalg.pinv(rigid_map(model.points[top], model.points[top].mean(axis=0)))
    loads = np.zeros((3 * len(model.points), 6))
    dofs = (3 * top[:, None] + np.arange(3)).ravel()
    loads[dofs] = mean.T
    return cantilever_displacements(
        mean @ _solve_fixed(model, _fixed_nodes(beam, model), loads)[dofs]
    )


def _modal_values(
    beam: ReferenceBeam, model: _BrickModel
) -> tuple[dict[str, float], dict[str, float]]:
    frequencies, shapes = _fixed_modes(model, _fixed_nodes(beam, model), MODES)
    half = 0.5 * beam.size[beam.axis]
    sections = section_motions(
        model.points, shapes, axis=beam.axis, span=(-half, half), sides=beam.size
    )
    names = [name for name, reference in beam.references.items() if reference.group == "modal"]
    paired = find_theory_shapes(
        sections, tuple(read_shape(name, beam.axis) for name in names), beam.ends
    )
    return (
        {name: float(frequencies[mode.index]) for name, mode in paired.items()},
        {name: mode.mac for name, mode in paired.items()},
    )
