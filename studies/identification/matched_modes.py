"""Modal dofs of a component that was meshed and reduced anew, in the order and with the signs they
had before: only then have differences of its matrices a meaning.
"""

import dataclasses

import numpy as np
import scipy.linalg
from scipy.optimize import linear_sum_assignment

from headstock.geometry.frames import FloatArray
from headstock.reduction.superelement import Superelement

# neighbours nearer than this share of their frequency are turned together: two bending modes of a
# square section are any two of their plane
CLOSE = 0.02
# how far apart in ln f two modes cost as much as no likeness at all
FAR = 0.5


def match_modes(before: Superelement, after: Superelement) -> Superelement:
    """A superelement with its modal dofs turned to those of another.

    Modes are compared by how they are coupled to the boundary through the mass matrix.

    Args:
        after: Of the changed component; as many boundary and modal dofs.
    """
    size, count = before.boundary_size, min(before.modal_count, after.modal_count)
    if count == 0 or before.modal_count != after.modal_count:
        return after
    wanted, found = (
        _couplings(part.mass[size:, :size], before.node_size) for part in (before, after)
    )
    logs = [np.log(part.modal_frequencies_hz) for part in (before, after)]
    alike = np.abs(wanted @ found.T) / np.outer(_sizes(wanted), _sizes(found))
    order = linear_sum_assignment(alike - np.abs(np.subtract.outer(*logs)) / FAR, maximize=True)[1]
    turned = np.zeros((count, count))
    start = 0
    for end in range(1, count + 1):
        if end == count or logs[0][end] - logs[0][end - 1] > CLOSE:
            group = slice(start, end)
            left, _, right = np.linalg.svd(wanted[group] @ found[order[group]].T)
            turned[group, order[group]] = left @ right
            start = end
    turn = scipy.linalg.block_diag(np.eye(size), turned)
    return dataclasses.replace(
        after,
        stiffness=turn @ after.stiffness @ turn.T,
        mass=turn @ after.mass @ turn.T,
        damping=None if after.damping is None else turn @ after.damping @ turn.T,
        constraints=after.constraints @ turn.T,
        recovery=None,
        modal_frequencies_hz=after.modal_frequencies_hz[order],
    )


def _couplings(mass: FloatArray, nodes: int) -> FloatArray:
    """Coupling of each mode ``(m, b)`` to the boundary; rotations at the scale of translations."""
    scaled = mass.copy()
    turns = np.arange(nodes) % 6 > 2
    sizes = [float(np.linalg.norm(mass[:, :nodes][:, part])) for part in (~turns, turns)]
    if min(sizes) > 0.0:
        scaled[:, :nodes][:, turns] *= sizes[0] / sizes[1]
    return scaled


def _sizes(couplings: FloatArray) -> FloatArray:
    """Length of each row, far above the noise of a mode that no boundary drives."""
    sizes = np.linalg.norm(couplings, axis=1)
    return np.asarray(np.maximum(sizes, 1e-6 * sizes.max(initial=np.finfo(float).tiny)))
