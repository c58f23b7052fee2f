"""Which mode of a case meets which target: by frequency and shape, by following modes from one
machine to another.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import assign_modes, correlate_modes, match_frequencies
from headstock.studies.identification.cases import CaseState, shape_rows
from headstock.studies.identification.targets import ShapeTarget

# which mode of a case meets which target: index into modes above the floor, one per target
type Pairing = tuple[int, ...]
OTHER_NUMBER = 1e12  # cost of a mode of another number than the one that a target names


def pair_targets(state: CaseState) -> Pairing:
    """Return the pairing of targets and modes that leaves the smallest sum of squares in frequencies
    and shapes.

    Held-out targets take part: they are distinguished by what is known of them, and add nothing to
    the fit.
    """
    targets = state.model.case.modes
    if not targets:
        return ()
    wanted = np.log([target.frequency_hz for target in targets])
    sigmas = np.array([target.sigma for target in targets])
    return match_frequencies(
        np.log(state.frequencies_hz), wanted, sigmas=sigmas, costs=shape_costs(state)
    )


def shape_costs(state: CaseState) -> FloatArray:
    """Return what each target ``(t, m)`` would pay for the shape of each mode, and for another number than its
    own.
    """
    cost = np.zeros((len(state.model.case.modes), len(state.frequencies_hz)))
    for row, target in enumerate(state.model.case.modes):
        if target.shape is not None:
            cost[row] = (1.0 - compare_shape(state, target.shape)) / target.shape.tolerance**2
        if target.number is not None:
            others = np.arange(cost.shape[1]) != target.number - 1 - state.below
            cost[row, others] += OTHER_NUMBER
    return cost


def compare_shape(state: CaseState, shape: ShapeTarget) -> FloatArray:
    """Return the MAC ``(m,)`` of a target shape with every undamped mode."""
    return correlate_modes(shape.direction[:, None], shape_rows(state, shape) @ state.motions)[0]


def follow_modes(before: CaseState, pairing: Pairing, state: CaseState) -> Pairing:
    """Return the same modes in another state of a machine, found by MAC in the norm of the mass matrix
    of the first.

    Components that only one of the machines has, or has with other dofs, are left out.

    Args:
        before: The machine whose modes are known.
        pairing: Which of its modes each target goes with.
        state: The same machine after a step of the parameters, or with modifications.
    """
    if not pairing:
        return pairing
    weighed = before.slopes.times("mass", before.motions[:, list(pairing)])
    offsets, others = before.coupled.offsets, state.coupled.offsets
    moved = np.zeros((len(before.motions), state.motions.shape[1]))
    for name, rows in offsets.items():
        other = others.get(name, slice(0, 0))
        if other.stop - other.start == rows.stop - rows.start:
            moved[rows] = state.motions[other]
    products = (weighed.T @ moved) ** 2
    sizes = np.einsum("ij,ij->j", moved, before.slopes.times("mass", moved))
    macs = products / np.maximum(sizes, np.finfo(float).tiny)
    pairs = assign_modes(macs, np.zeros(1), mac_threshold=0.0)
    return tuple(pair.second for pair in pairs)
