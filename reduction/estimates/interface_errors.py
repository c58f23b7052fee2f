"""What deformation shapes of joints change: how much of a motion lies in them, and how far a
response may be off without them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.solvers.second_order import ComplexArray

PASSING = 3  # peaks that may pass over a line


def shape_energies(
    coupled: CoupledMachine, joints: Mapping[str, Joint], motions: FloatArray
) -> dict[str, FloatArray]:
    """Return twice the strain energies ``(m,)`` that the shapes at each joint hold.

    In the strong form this is, to first order, by how much the squares of the angular frequencies
    of mass-normalised modes fall when the joint gets its shapes.

    Args:
        joints: By name; only those with shapes are among the result.
        motions: ``(n, m)`` generalised displacements.
    """
    stacked = coupled.basis @ motions
    energies: dict[str, FloatArray] = {}
    for name, joint in joints.items():
        for end in joint.ends:
            part = coupled.layout.superelements.get(end.component or "")
            entry = None if part is None else part.interface_maps.get(end.interface or "")
            if part is None or entry is None or entry.shapes is None:
                continue
            columns = slice(entry.shapes.first, entry.shapes.first + entry.shapes.count)
            moved = stacked[coupled.offsets[end.component or ""]][columns]
            energy = np.einsum("im,ij,jm->m", moved, part.stiffness[columns, columns], moved)
            energies[name] = energies.get(name, np.zeros(motions.shape[1])) + energy
    return energies


@dataclass(frozen=True, eq=False)
class FormResponse:
    """The response of a machine whose joints have deformation shapes in one form.

    Attributes:
        receptance: ``(n_freq, n_outputs, n_inputs)`` at the lines that are evaluated.
        peaks_hz: ``(m,)`` natural frequencies, rising from the lowest one on [Hz].
        tops: ``(m, n_outputs, n_inputs)`` receptance there.
    """

    receptance: ComplexArray
    peaks_hz: FloatArray
    tops: ComplexArray


def bound_response_changes(
    plain: ComplexArray, frequencies_hz: FloatArray, forms: Sequence[FormResponse]
) -> FloatArray:
    """Return how far every line ``(n_freq, n_outputs, n_inputs)`` of a response may be off by
    shapes that joints leave out; NaN where a peak without damping passes.

    The strong form is too stiff and the weak one too soft, so each peak of the truth lies between
    its two places: the lines between them may carry its top.

    Args:
        plain: ``(n_freq, n_outputs, n_inputs)`` the response that is evaluated.
        frequencies_hz: ``(n_freq,)``.
        forms: Of the same machine with shapes.
    """
    changes = np.max([np.abs(form.receptance - plain) for form in forms], axis=0)
    below = np.array(
        [np.searchsorted(form.peaks_hz, frequencies_hz, side="right") for form in forms]
    )
    count = min(len(form.peaks_hz) for form in forms)
    least, most = below.min(axis=0), np.minimum(below.max(axis=0), count)
    for step in range(PASSING):
        lines = np.flatnonzero(least + step < most)
        for form in forms:
            moved = np.abs(form.tops[least[lines] + step] - plain[lines])
            changes[lines] = np.maximum(changes[lines], moved)
    return np.asarray(changes)
