"""Motions of bodies at the same points whatever their models, so that natural modes of different
models can be compared.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.meshing.scipy_library import scipy
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement import Superelement

POINTS_PER_EDGE = 4
NEIGHBOURS = 48  # more than one section of a regular mesh holds
NEARNESS_POWER = 4
SOFTENING = 0.01  # keeps the weight of a point that is met finite
SMALLEST_MOMENT = 1e-12


@dataclass(frozen=True, eq=False)
class BodyPlaces:
    """Places in a body that stand for its mass.

    Attributes:
        points: ``(k, 3)`` in the component frame [m].
        masses: ``(k,)`` mass of each [kg]; together they have the body's mass, centre and inertia.
    """

    points: FloatArray
    masses: FloatArray


def choose_places(superelement: Superelement) -> BodyPlaces:
    """Return the Gauss points of the block of equal mass, centre and inertia: exact for rigid
    motions, and enough of them to see bending.
    """
    mass = superelement.mass_kg
    if not mass > 0.0:
        return BodyPlaces(np.zeros((0, 3)), np.zeros(0))
    moments, axes = np.linalg.eigh(superelement.inertia / mass)
    half = 0.5 * np.sqrt(
        np.maximum(6.0 * (moments.sum() - 2.0 * moments), SMALLEST_MOMENT * max(1.0, moments.sum()))
    )
    nodes, weights = np.polynomial.legendre.leggauss(POINTS_PER_EDGE)
    grid = np.array(list(itertools.product(nodes, repeat=3)))
    shares = np.prod(list(itertools.product(0.5 * weights, repeat=3)), axis=1)
    return BodyPlaces(superelement.center_of_mass + (grid * half) @ axes.T, mass * shares)


def place_motion(superelement: Superelement, points: FloatArray) -> FloatArray:
    """Return the displacement ``(3 k, n)`` of places ``(k, 3)`` in a component per unit dof,
    component axes.

    Recovered displacements nearby are fitted by a linear field, which gives rigid motions and plane
    sections exactly; without them the boundary nodes carry the places, weighted by their nearness.

    Source: Lancaster and Salkauskas (1981), moving least squares; Shepard (1968).
    """
    if superelement.recovery is None:
        return carried_motion(superelement, points)
    recovery, size = superelement.recovery, len(superelement.recovery.points)
    count = min(NEIGHBOURS, size)
    distances, neighbours = (
        nearest.reshape(-1, count)
        for nearest in scipy.spatial.KDTree(recovery.points).query(points, k=count)
    )
    reaches = np.maximum(distances.max(axis=1, initial=0.0), np.finfo(float).tiny)[:, None]
    arms = np.ones((*neighbours.shape, 4))
    arms[:, :, 1:] = (recovery.points[neighbours] - points[:, None]) / reaches[:, :, None]
    weights = 1.0 / (SOFTENING + (distances / reaches) ** 2)
    # the value of the fit at the place itself is its constant term
    factors = np.linalg.pinv(arms * weights[:, :, None])[:, 0] * weights
    ends = np.arange(0, factors.size + 1, count)
    fit = scipy.sparse.csr_array((factors.ravel(), neighbours.ravel(), ends), (len(points), size))
    moved: FloatArray = fit @ recovery.basis.reshape(size, -1)
    return moved.reshape(3 * len(points), -1)


def carried_motion(superelement: Superelement, points: FloatArray) -> FloatArray:
    """Return the same from the boundary nodes alone: each place takes their rigid motions, weighted
    by nearness (Shepard 1968).
    """
    result = np.zeros((3 * len(points), len(superelement.labels)))
    distances = np.array(
        [np.linalg.norm(points - frame.origin, axis=1) for frame in superelement.frames]
    )
    weights = 1.0 / np.maximum(distances, 1e-9) ** NEARNESS_POWER
    for node, frame in enumerate(superelement.frames):
        share = np.repeat(weights[node] / weights.sum(axis=0), 3)
        result[:, 6 * node : 6 * node + 6] = share[:, None] * rigid_map(points, frame.origin)
    return result


def machine_field(
    coupled: CoupledMachine,
    places: Mapping[str, BodyPlaces],
    shapes: FloatArray,
    motions: Mapping[str, FloatArray] | None = None,
) -> FloatArray:
    """Return the motions of all places in machine axes, each times the root of its mass.

    The scalar product of two columns is the kinetic energy they share, so mass-normalised modes
    have length one.

    Args:
        coupled: The machine with ``n`` free coordinates.
        places: By component, points in its frame [m] and the mass that each stands for [kg].
        shapes: ``(n, m)`` in free coordinates.
        motions: By component, ``place_motion`` of its places where that is known already.

    Returns:
        ``(3 k, m)`` for ``k`` points in all, component by component.
    """
    stacked = coupled.basis @ shapes
    parts = []
    for name, chosen in places.items():
        superelement, placement = coupled.layout.superelements[name], coupled.placements[name]
        local = turn_dofs(superelement, placement) @ stacked[coupled.offsets[name]]
        body_motion = None if motions is None else motions.get(name)
        motion = place_motion(superelement, chosen.points) if body_motion is None else body_motion
        moved = (motion @ local).reshape(-1, 3, shapes.shape[1])
        turned = np.einsum("ij,kjm->kim", placement.rotation, moved)
        parts.append((np.sqrt(chosen.masses)[:, None, None] * turned).reshape(-1, shapes.shape[1]))
    return np.vstack([np.zeros((0, shapes.shape[1])), *parts])
