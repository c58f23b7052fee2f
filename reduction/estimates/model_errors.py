"""What better models of some bodies and deformation shapes of joints change of a machine: its modes,
paired by shape, its responses, and how much of a motion lies in the shapes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.motions.body_fields import BodyPlaces, machine_field
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.pairing.mode_pairing import ModeSet, pair_modes
from headstock.solvers.second_order import ComplexArray

# more modes than are compared: partners lie further up, or come from there
BEYOND, FURTHER = 2, 6

PASSING = 3  # peaks that may pass over a line


@dataclass(frozen=True, eq=False)
class WatchedModes:
    """Modes of a machine, and their motions at places that all models of its bodies share."""

    modes: ModalResult
    shapes: ModeSet


@dataclass(frozen=True, eq=False)
class _ModeChanges:
    """The modes of a machine compared with those of the same machine with refined bodies.

    Attributes:
        changes_hz: ``(m,)`` frequency with better bodies less that without [Hz]; NaN for a mode that
            has no partner of its shape, 0 for rigid-body modes.
        partners: ``(m,)`` index of each partner among the better modes, -1 without one.
        missing: Indices of better modes below the highest of the ``m`` that are partners of no mode.
    """

    changes_hz: FloatArray
    partners: tuple[int, ...]
    missing: tuple[int, ...]


def watch_modes(
    coupled: CoupledMachine,
    places: Mapping[str, BodyPlaces],
    motions: Mapping[str, FloatArray],
    *,
    count: int,
) -> WatchedModes:
    """Return enough modes of a machine for the first of another model of it to find theirs.

    Args:
        places: By component, points that stand for its mass.
        motions: By component, motion ``(3 k, n)`` of those points per unit dof of this model of it.
        count: Modes of the other model that look for theirs.
    """
    modes = solve_modal(coupled.system, count=BEYOND * count + FURTHER)
    field = machine_field(coupled, places, modes.shapes, motions)
    return WatchedModes(
        modes, ModeSet(modes.frequencies_hz, field, min(modes.rigid_count, field.shape[1]))
    )


def compare_modes(plain: WatchedModes, refined: WatchedModes, *, count: int) -> _ModeChanges:
    """Return what refined bodies change of the first modes of a machine.

    Modes are one where their motions at places that stand for the mass of every body are, whatever
    their order; close ones are compared by the space they span (see ``pair_modes``). First-order
    changes from strain energies fail beyond a tenth of a number, where modes trade places or come
    from far above. Both machines are small, so both are solved.

    Args:
        refined: Of the same with better models of some bodies.
        count: How many modes of the machine are compared, rigid-body modes included.

    Source: Allemang and Brown (1982) for MAC; Bjoerck and Golub (1973) for angles between spaces.
    """
    own_hz, better_hz = plain.shapes.frequencies_hz, refined.shapes.frequencies_hz
    rigid = plain.shapes.rigid_count
    changes = np.where(np.arange(count) < rigid, 0.0, np.nan)
    partners = [-1] * count
    pairs = pair_modes(plain.shapes, refined.shapes)
    for pair in pairs:
        if pair.first < count:
            partners[pair.first] = pair.second
            if pair.first >= rigid:
                changes[pair.first] = better_hz[pair.second] - own_hz[pair.first]
    highest = float(own_hz[:count].max(initial=0.0))
    # the partner of a mode beyond the last may lie below it: half of a pair that the count cuts
    paired = {pair.second for pair in pairs}
    missing = tuple(
        index
        for index in range(refined.shapes.rigid_count, len(better_hz))
        if better_hz[index] < highest and index not in paired
    )
    return _ModeChanges(changes, tuple(partners), missing)


def split_change(size: float, singles: Mapping[str, float]) -> dict[str, float]:
    """Return the parts of the size of a change that several bodies make together: as their single
    changes are to one another, and together that size.

    Args:
        singles: Body to the change that it alone makes; NaN where nobody knows.
    """
    sizes = {name: abs(single) for name, single in singles.items() if np.isfinite(single)}
    total = sum(sizes.values())
    return (
        {name: size * part_size / total for name, part_size in sizes.items()} if total > 0.0 else {}
    )


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
