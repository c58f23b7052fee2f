"""Changes of a machine by better models of some bodies and by deformation shapes of joints: of its
modes, paired by shape, and of its responses; and the share of a motion in the shapes.
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

# number of further modes in which partners are searched
BEYOND, FURTHER = 2, 6

PASSING = 3  # number of peaks that may pass over a line


@dataclass(frozen=True, eq=False)
class WatchedModes:
    """Store modes of a machine, and their motions at points that all models of its bodies share."""

    modes: ModalResult
    shapes: ModeSet


@dataclass(frozen=True, eq=False)
class _ModeChanges:
    """Compare the modes of a machine with those of the same machine with refined bodies.

    Attributes:
        changes_hz: ``(m,)`` frequency with refined bodies minus that without [Hz]; NaN for a mode
            without a partner of its shape, 0 for rigid-body modes.
        partners: ``(m,)`` index of each partner among the refined modes, -1 without one.
        missing: Indices of refined modes, below the highest of the ``m``, that are partners of no
            mode.
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
    """Return enough modes to find partners of the lowest modes of another model.

    Args:
        places: By component, points that represent its mass.
        motions: By component, motion ``(3 k, n)`` of those points per unit dof of this model of it.
        count: Number of modes of the other model that need partners.
    """
    modes = solve_modal(coupled.system, count=BEYOND * count + FURTHER)
    field = machine_field(coupled, places, modes.shapes, motions)
    return WatchedModes(
        modes, ModeSet(modes.frequencies_hz, field, min(modes.rigid_count, field.shape[1]))
    )


def compare_modes(plain: WatchedModes, refined: WatchedModes, *, count: int) -> _ModeChanges:
    """Compare the lowest modes of a machine with those of the same machine with refined bodies.

    Modes are partners where their motions agree at points that represent the mass of every body,
    whatever their order; close modes are compared by the space they span (see ``pair_modes``).
    First-order changes from strain energies fail beyond a tenth of a number, where modes change
    their order or come from far above. Both machines are small, so both are solved.

    Args:
        refined: Modes of the same machine with better models of some bodies.
        count: Number of modes of the machine that are compared, rigid-body modes included.

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
    """Divide the size of a change among bodies, in proportion to their single changes.

    Args:
        singles: Body to the change by it alone; NaN where unknown.
    """
    sizes = {name: abs(single) for name, single in singles.items() if np.isfinite(single)}
    total = sum(sizes.values())
    return (
        {name: size * part_size / total for name, part_size in sizes.items()} if total > 0.0 else {}
    )


def shape_energies(
    coupled: CoupledMachine, joints: Mapping[str, Joint], motions: FloatArray
) -> dict[str, FloatArray]:
    """Return twice the strain energies ``(m,)`` in the shapes at each joint.

    In the strong form this is, to first order, the decrease of the squares of the angular
    frequencies of mass-normalised modes when the joint gets its shapes.

    Args:
        joints: Joints by name; only those with shapes are in the result.
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
    """Store the response of a machine whose joints have deformation shapes in one form.

    Attributes:
        receptance: ``(n_freq, n_outputs, n_inputs)`` at the lines that are evaluated.
        peaks_hz: ``(m,)`` natural frequencies in ascending order, the lowest first [Hz].
        tops: ``(m, n_outputs, n_inputs)`` receptance at these frequencies.
    """

    receptance: ComplexArray
    peaks_hz: FloatArray
    tops: ComplexArray


def bound_response_changes(
    plain: ComplexArray, frequencies_hz: FloatArray, forms: Sequence[FormResponse]
) -> FloatArray:
    """Bound the error of every line ``(n_freq, n_outputs, n_inputs)`` of a response by shapes that
    joints leave out; NaN where a peak without damping passes.

    The strong form is too stiff and the weak one too soft, so each true peak lies between its
    frequencies in the two forms: its height counts at all lines between them.

    Args:
        plain: ``(n_freq, n_outputs, n_inputs)`` the response that is evaluated.
        frequencies_hz: ``(n_freq,)``.
        forms: Responses of the same machine with shapes.
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
