"""Errors of figures of a machine's response: limit depths of cut over the speeds, peaks, and static
levels. The machine is solved again in its trial space with changes for finer meshes, true faces and
the modes left out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.reduction.estimates.response_errors import ResponseSpace, SystemChange
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.frequency_response import FrfModel
from headstock.solvers.pairing.mode_pairing import ModeSet, pair_modes
from headstock.solvers.pairing.response_peaks import (
    ResponseLevel,
    ResponsePeak,
    follow_peaks,
    measure_levels,
)

GROUPS = 0.1  # of the logarithm of chatter frequencies: modes left out are linearised once in it

# numbers of further modes in which partners of the modes with peaks are searched
BEYOND, FURTHER = 2, 6
Respond = Callable[[SystemChange | None], FrfModel]


@dataclass(frozen=True, eq=False)
class Border:
    """Store the stability limit of a machine over the speeds, or the difference between two.

    Attributes:
        depth: ``(n,)`` limits, or their difference, over those of the unchanged machine.
        chatter: ``(n,)`` angular frequency of chatter [rad/s].
    """

    depth: FloatArray
    chatter: FloatArray

    def distance(self, other: "Border") -> "Border":
        """Return the sizes of the differences in depth and frequency."""
        return Border(np.abs(self.depth - other.depth), np.abs(self.chatter - other.chatter))


# returns the limit of the machine with a change, at some of the speeds
FindBorder = Callable[[SystemChange | None, BoolArray], Border]


@dataclass(frozen=True, eq=False)
class _BorderChanges:
    """Store the changes of a stability limit by source, None where there is no such source.

    Attributes:
        mesh: Change by finer meshes; NaN where modes without an estimate take part.
        faces: Possible change by true faces.
        modes: Change by the modes left out; NaN where there is no bound.
    """

    mesh: Border | None
    faces: Border | None
    modes: Border | None


def find_border_changes(
    space: ResponseSpace, find: FindBorder, chatter: FloatArray
) -> _BorderChanges:
    """Find the possible errors of stability limits.

    Args:
        find: Returns the limit of the machine with a change; NaN at speeds other than those asked
            for.
        chatter: ``(n,)`` angular frequency of chatter; NaN where there is no limit.
    """
    limited = np.isfinite(chatter)
    plain = find(None, limited)
    mesh = faces = modes = None
    if space.sources.meshed:
        changes = [find(change, limited).distance(plain) for change in (space.finer, *space.faces)]
        reach = 2.0 * np.pi * min(part.reach_hz for part in space.sources.meshed.values())
        reached, change = chatter < reach, changes[0]
        mesh = Border(
            np.where(reached, change.depth, np.nan), np.where(reached, change.chatter, np.nan)
        )
        if changes[1:]:
            faces = Border(
                np.maximum(
                    0.0, np.max([border.depth - mesh.depth for border in changes[1:]], axis=0)
                ),
                np.maximum(
                    0.0, np.max([border.chatter - mesh.chatter for border in changes[1:]], axis=0)
                ),
            )
    if space.sources.truncated:
        modes = _add_modes_at_chatter(space, find, chatter, plain)
    return _BorderChanges(mesh, faces, modes)


def _add_modes_at_chatter(
    space: ResponseSpace, find: FindBorder, chatter: FloatArray, plain: Border
) -> Border:
    """Return changes by the lower and upper bound of modes left out, at chatter frequencies."""
    unknown = np.full(len(chatter), np.nan)
    bounds = Border(unknown.copy(), unknown.copy())
    with np.errstate(invalid="ignore"):
        bounded = chatter**2 < space.limit
    group = np.round(np.log(np.where(bounded, chatter, 1.0)) / GROUPS)
    for number in np.unique(group[bounded]):
        some = bounded & (group == number)
        square = float(np.median(chatter[some])) ** 2
        least, most = (find(line, some) for line in space.linearise_modes(square))
        first, second, apart = least.distance(plain), most.distance(plain), least.distance(most)
        bounds.depth[some] = (np.maximum(first.depth, second.depth) + apart.depth)[some]
        bounds.chatter[some] = (np.maximum(first.chatter, second.chatter) + apart.chatter)[some]
    return bounds


@dataclass(frozen=True, eq=False)
class _PeakErrors:
    """Store sizes of changes ``(n,)`` of peaks, then levels [m/N, ...]; NaN where unknown.

    Attributes:
        left_out: Changes by small features that meshes lack.
    """

    finer: dict[str, FloatArray] = field(default_factory=dict)
    faces: dict[str, FloatArray] = field(default_factory=dict)
    left_out: dict[str, FloatArray] = field(default_factory=dict)
    modes: dict[str, FloatArray] = field(default_factory=dict)


class _Follower:
    """Track peaks and levels of a machine in its trial space through changes."""

    def __init__(
        self, plain: FrfModel, peaks: Sequence[ResponsePeak], levels: Sequence[ResponseLevel]
    ) -> None:
        count = max((peak.mode for peak in peaks), default=-1) + 1
        self._peaks, self._levels = peaks, levels
        self._modes, self._count = _mode_set(plain, count), count
        self._hz = (
            np.array([self._modes.frequencies_hz[peak.mode] for peak in peaks])
            if peaks
            else np.zeros(0)
        )
        self.before = self.measure(plain)

    def measure(self, model: FrfModel) -> FloatArray:
        """Return the heights ``(n,)`` of peaks, then of levels."""
        partners = {
            pair.first: pair.second
            for pair in pair_modes(self._modes, _mode_set(model, BEYOND * self._count + FURTHER))
        }
        partner_modes = [partners.get(peak.mode, -1) for peak in self._peaks]
        heights = [
            peak_now.height
            for peak_now in follow_peaks(model, self._peaks, partner_modes, self._hz)
        ]
        return np.concatenate([heights, measure_levels(model, self._levels)])

    def shape(self, mode: int) -> FloatArray:
        """Return the coordinates ``(m,)`` of a mode."""
        return self._modes.field[:, mode]


def _mode_set(model: FrfModel, count: int) -> ModeSet:
    coordinates = model.coordinates
    if coordinates is None:
        raise ValueError("peaks are those of modes")
    # the trial space is mass-orthonormal, so that products of coordinates are those of motions
    hz = np.asarray(coordinates.omega[:count] / (2.0 * np.pi), dtype=np.float64)
    return ModeSet(hz, coordinates.shapes[:, :count], min(coordinates.rigid_count, len(hz)))


def find_peak_errors(
    space: ResponseSpace,
    respond: Respond,
    peaks: Sequence[ResponsePeak],
    levels: Sequence[ResponseLevel],
) -> _PeakErrors:
    """Find the changes of the heights of peaks and of levels by each source of error.

    Near a resonance ``|H| = phi_i phi_o / (2 zeta omega^2)`` plus the contribution of other modes,
    so that a peak changes with its mode's shape at both channels, twice with its frequency, and
    with its damping. The machine is solved again with each change in the trial space, damped as the
    scene says: this contains all of these changes, to any order.

    Args:
        space: The machine in its trial space, without modal damping.
        respond: Returns its response with a change, damped as the scene says.

    Source: Prudhomme and Oden (1999) for changes by meshes and Leung (1978) for those by modes left
    out (see ``bound_response_errors``).
    """
    follower = _Follower(respond(None), peaks, levels)

    def change(by: SystemChange) -> FloatArray:
        try:
            changed = respond(by)
        except ModelError:
            # the unchanged machine has been solved: with the change its stiffness is no longer positive
            return np.full(len(hz), np.nan)
        return np.abs(follower.measure(changed) - follower.before)

    errors = _PeakErrors()
    hz = np.array([*(peak.hz for peak in peaks), *(level.hz for level in levels)])
    for name, part in space.parts.items():
        silent = hz >= space.sources.meshed[name].reach_hz
        errors.finer[name] = np.where(silent, np.nan, change(part.finer))
        if part.faces is not None and part.faces.stiffness.any():
            errors.faces[name] = change(part.faces)
        if part.left_out is not None:
            errors.left_out[name] = change(part.left_out)
    errors.modes.update(_add_modes(space, respond, follower, peaks, len(levels)))
    return errors


def _add_modes(
    space: ResponseSpace,
    respond: Respond,
    follower: _Follower,
    peaks: Sequence[ResponsePeak],
    levels: int,
) -> dict[str, FloatArray]:
    """Return the changes by the upper bound of the modes left out, split among components by
    energy; none at rest.
    """
    names = list(space.sources.truncated)
    changes: dict[str, FloatArray] = {name: np.zeros(len(peaks) + levels) for name in names}
    for mode in {peak.mode: None for peak in peaks} if names else ():
        peaks_of_mode = [number for number, peak in enumerate(peaks) if peak.mode == mode]
        square = (2.0 * np.pi * peaks[peaks_of_mode[0]].hz) ** 2
        if not square < space.limit:
            for name in names:
                if not square < space.sources.truncated[name].truncation.limit:
                    changes[name][peaks_of_mode] = np.nan
            continue
        model = respond(space.linearise_modes(square)[1])
        sizes = np.abs(follower.measure(model) - follower.before)[peaks_of_mode]
        shape = follower.shape(mode)
        energies = np.array(
            [
                abs(shape @ space.participations(np.array([square]), name)[1][0] @ shape)
                for name in names
            ]
        )
        for name, share in zip(names, energies / max(energies.sum(), 1e-300), strict=True):
            changes[name][peaks_of_mode] = share * sizes
    return changes
