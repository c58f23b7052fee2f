"""Results of a sweep as arrays over its poses, with the names of its tracked modes and the errors
in the pose nearest to the middle.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.lobes import MM, RPM
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import N_PER_UM, UM_PER_KN, PointCompliance, StaticAnswer
from headstock.pipeline.numbers.estimates import Estimate, list_left_out, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, Numbers, make_key
from headstock.pipeline.results.short_forms import Displayed, ShortForm, list_few
from headstock.pipeline.stages.mechanism import pose_machine
from headstock.pipeline.stages.modal import solve_pose_modes
from headstock.pipeline.stages.run_state import MachineParts
from headstock.pipeline.stages.static import solve_points
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import Analyses, Scene
from headstock.scene.studies import Sweep, describe_positions, sweep_neighbours, sweep_pose
from headstock.solvers.pairing.mode_tracking import (
    SweptModes,
    TrackedModes,
    track_modes,
    tracked_frequencies,
)
from headstock.solvers.second_order import Channel
from headstock.studies.sweeps.journals import FIGURES, PoseResult, PoseState, SingleArray

MOST_SHOWN = 6  # modes of a sweep in a notebook
# of a frequency response to the end of its name with the unit, and the factor from SI
FIGURE_UNITS = {
    "most_negative_real": ("_um_per_kN", UM_PER_KN),
    "chatter_limit": ("_N_per_um", N_PER_UM),
    "minimum_dynamic_stiffness": ("_N_per_um", N_PER_UM),
}


@dataclass(frozen=True, eq=False)
class PointMap:
    """Compliance at a point over the poses.

    Attributes:
        compliance: ``(n, 3, 3)`` [m/N], machine axes; NaN where there is none.
        largest: ``(n,)`` largest motion per unit force [m/N].
        direction: ``(n, 3)`` unit vector of the force that makes it.
        ratio: ``(n,)`` largest over smallest.
        links: ``(n, 3)`` names of the part that gives most in x, y, z.
        link_shares: ``(n, 3)`` its share.
    """

    compliance: FloatArray
    largest: FloatArray
    direction: FloatArray
    ratio: FloatArray
    links: tuple[tuple[str, ...], ...]
    link_shares: FloatArray


@dataclass(frozen=True, eq=False)
class LimitMap:
    """Limit depth of cut over poses and speeds, for one direction of travel.

    Attributes:
        directions: ``(n, 3)`` of the travel in each pose, machine frame; NaN where there is none.
        speeds: ``(s,)`` of the spindle [rad/s].
        depths: ``(n, s)`` [m]; NaN where none was looked for.
        chatter_hz: ``(n,)`` frequency of chatter at the lowest limit of each pose.
        modes: ``n`` names of the mode behind it.
    """

    directions: FloatArray
    speeds: FloatArray
    depths: FloatArray
    chatter_hz: FloatArray
    modes: tuple[str, ...]

    @property
    def everywhere(self) -> FloatArray:
        """``(s,)`` depth that is stable in every pose at a speed [m]; NaN where one was not looked at."""
        looked_at = self.depths[np.isfinite(self.depths).any(axis=1)]
        return looked_at.min(axis=0) if len(looked_at) else np.full(len(self.speeds), np.nan)

    @property
    def rpm(self) -> FloatArray:
        """``(s,)`` speeds [rev/min]."""
        return RPM * self.speeds

    @property
    def common_best(self) -> int | None:
        """Index of the speed whose limit is deepest in the worst pose; None without a limit."""
        everywhere = self.everywhere
        return int(np.nanargmax(everywhere)) if np.isfinite(everywhere).any() else None

    @property
    def figures(self) -> dict[str, FloatArray]:
        """Limits of each pose and their speeds by name with the unit ``(n,)``; NaN where none was looked for."""
        looked, best = np.isfinite(self.depths), self.common_best
        low, high = (np.where(looked, self.depths, side) for side in (np.inf, -np.inf))
        extremes = {
            "lowest_mm": MM * low.min(axis=1),
            "lowest_rpm": self.rpm[np.argmin(low, axis=1)],
            "best_mm": MM * high.max(axis=1),
            "best_rpm": self.rpm[np.argmax(high, axis=1)],
        }
        known = looked.any(axis=1)
        return {name: np.where(known, values, np.nan) for name, values in extremes.items()} | {
            "chatter_hz": self.chatter_hz,
            "at_common_best_mm": np.full(len(self.depths), np.nan)
            if best is None
            else MM * self.depths[:, best],
        }


class PoseErrors(NamedTuple):
    """± in a pose: of modes by their number [Hz], of compliances by point and direction [um/kN]."""

    pose: int
    modes: dict[int, float | None]
    compliances: dict[str, dict[str, float | None]]
    left_out: list[str]


@dataclass(frozen=True, eq=False, repr=False)
class SweepResults(Displayed):
    """Everything a sweep found.

    Attributes:
        key: Of everything a pose's results depend on.
        states: ``done``, ``failed`` or ``unreachable`` per pose.
        errors: Why, per pose.
        modes: Of every pose; None without a modal analysis.
        tracked: The same modes followed from pose to pose.
        shapes: ``(n, d, m)`` mass-normalised; zero beyond the last mode.
        condition: ``(n,)`` condition number of a mechanism; None for other machines.
        figures: Input port to ``(n, f)``, as ``FIGURES`` names them.
        limits: Limit depths of cut by the name of the direction of travel.
        limits_confirmed: Whether multipliers found the limits of every pose.
        mode_names: Of the tracked modes, as they are called in one pose; empty where they were not
            named.
        sampled_errors: Number of a pose in which modes got their names to the ± of its numbers; of other
            poses none is known.
    """

    name: str
    key: str
    sweep: Sweep
    states: tuple[PoseState, ...]
    errors: tuple[str, ...]
    modes: SweptModes | None
    tracked: TrackedModes | None
    shapes: SingleArray
    points: dict[str, PointMap]
    condition: FloatArray | None
    figures: dict[Channel, FloatArray]
    limits: dict[str, LimitMap] = field(default_factory=dict)
    limits_confirmed: bool = True
    warnings: tuple[str, ...] = ()
    mode_names: tuple[str, ...] = ()
    sampled_errors: Mapping[int, Mapping[Key, Estimate]] = field(default_factory=dict)

    def _short_form(self) -> ShortForm:
        states = {state: self.states.count(state) for state in dict.fromkeys(self.states)}
        counts = ", ".join(f"{count} {state}" for state, count in states.items())
        facts = [("poses", f"{len(self.states)} of axes {list_few(self.sweep.axes)}: {counts}")]
        if len(present := self.frequencies_hz[~np.isnan(self.frequencies_hz)]):
            span = f"{present.min():.4g} to {present.max():.4g} Hz"
            facts.append(("frequencies_hz", f"{self.frequencies_hz.shape[1]} modes, {span}"))
        if self.points:
            facts.append(("points", list_few(list(self.points))))
        if self.limits:
            facts.append(("limits", list_few(list(self.limits))))
        if self.warnings:
            facts.append(("warnings", str(len(self.warnings))))
        count = min(MOST_SHOWN, self.frequencies_hz.shape[1])
        rows = [
            [
                sweep_pose(self.sweep, number).name,
                state,
                *(f"{hz:.5g}" for hz in self.frequencies_hz[number, :count]),
            ]
            for number, state in enumerate(self.states)
        ]
        head = ["pose", "state", *(f"mode {number + 1} [Hz]" for number in range(count))]
        return ShortForm(f"Sweep {self.sweep.name} of {self.name}", facts, head, rows)

    @cached_property
    def numbers(self) -> Numbers:
        """Every number of every pose by name, modes as tracked; with ± in the poses in which modes got
        their names. Limit depths and frequencies of chatter are those of the speed with the lowest limit.
        """
        tracked = self.frequencies_hz
        return Numbers.collect(
            number
            for pose in range(len(self.states))
            for number in self._list_numbers(pose, tracked[pose])
            if np.isfinite(number.value)
        )

    def _list_numbers(self, place: int, tracked: FloatArray) -> Iterator[Number]:
        """Yield the numbers of a pose, NaN where they are undetermined.

        Args:
            tracked: Frequencies of its tracked modes ``(t,)`` [Hz].
        """
        pose, errors = sweep_pose(self.sweep, place).name, self.sampled_errors.get(place, {})
        for mode, hz in enumerate(tracked):
            key = make_key("frequency", pose=pose, mode=mode + 1)
            yield Number(key, float(hz), "Hz", errors.get(key))
        points = {
            name: PointCompliance(point.compliance[place], {})
            for name, point in self.points.items()
        }
        yield from StaticAnswer(pose, points, errors=errors).list_numbers()
        if self.condition is not None:
            key = make_key("condition_number", pose=pose)
            yield Number(key, float(self.condition[place]), "1")
        for channel, values in self.figures.items():
            soft, stiff = ("rad/(N m)", "N m/rad") if channel[1].startswith("r") else ("m/N", "N/m")
            for kind, figure, unit in (
                ("negative_real", "most_negative_real", soft),
                ("dynamic_stiffness", "minimum_dynamic_stiffness", stiff),
            ):
                key = make_key(kind, pose=pose, output=" ".join(channel))
                yield Number(key, float(values[place, FIGURES.index(figure)]), unit)
        for direction, limits in self.limits.items():
            depths = limits.depths[place]
            lowest = float(np.nanmin(depths)) if np.isfinite(depths).any() else np.nan
            key = make_key("limit_depth", pose=pose, direction=direction)
            yield Number(key, lowest, "m")
            key = make_key("chatter_frequency", pose=pose, direction=direction)
            yield Number(key, float(limits.chatter_hz[place]), "Hz")

    def without_shapes(self) -> "SweepResults":
        """Return what is drawn of it, without large arrays."""
        modes, none = self.modes, np.zeros((0, 0, 0), dtype=np.float32)
        return dataclasses.replace(
            self, shapes=none, modes=modes and dataclasses.replace(modes, fields=none)
        )

    @property
    def status(self) -> Literal["done", "failed"]:
        """``failed`` where a pose failed."""
        return "failed" if self.failed else "done"

    @property
    def responses(self) -> dict[str, dict[str, FloatArray]]:
        """Input port to what its frequency response says of each pose, by name with the unit ``(n,)``."""
        return {
            " ".join(channel): {
                f"{name}{ending}": scale * values[:, column]
                for column, name in enumerate(FIGURES)
                for ending, scale in [FIGURE_UNITS.get(name, ("", 1.0))]
            }
            for channel, values in self.figures.items()
        }

    @property
    def pose_errors(self) -> list[PoseErrors]:
        """± of the poses in which they were estimated."""
        found = []
        for pose, errors in self.sampled_errors.items():
            own = PoseErrors(pose, {}, {}, list_left_out(errors.values()))
            for key, error in errors.items():
                if key.kind == "frequency":
                    own.modes[int(key["mode"])] = error.total
                else:
                    point = own.compliances.setdefault(str(key["point"]), {})
                    point[str(key["direction"])] = scale_total(error, UM_PER_KN)
            found.append(own)
        return found

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the poses that failed."""
        return tuple(number for number, state in enumerate(self.states) if state == "failed")

    @property
    def frequencies_hz(self) -> FloatArray:
        """``(n, t)`` of each tracked mode, NaN where it is not."""
        if self.modes is None or self.tracked is None:
            return np.zeros((len(self.states), 0))
        return tracked_frequencies(self.modes.frequencies_hz, self.tracked.index)


def collect_results(
    scene: Scene,
    sweep: Sweep,
    found: Sequence[PoseResult],
    superelements: Mapping[str, Superelement],
    *,
    key: str,
    remarks: tuple[str, ...] = (),
) -> SweepResults:
    """Arrays over all poses from the results of each, modes followed from pose to pose.

    Args:
        scene: Tells what was asked for.
        found: One result per pose, in order.
        superelements: By component name, in the order of the shapes' dofs.
    """
    shapes = _stack_shapes(found)
    weighed = {} if scene.is_lumped else superelements
    modes = _stack_modes(found, shapes, weighed) if shapes.shape[2] else None
    tracked = None
    if modes is not None:
        tracked = track_modes(modes, sweep_neighbours(sweep, modes.present))
    static, frf = scene.analyses.get(StaticRequest), scene.analyses.get(FrfRequest)
    channels = (
        () if frf is None else tuple(channel for channel in frf.inputs if channel in frf.outputs)
    )
    conditions = _pad([result.condition for result in found])
    return SweepResults(
        name=scene.name,
        key=key,
        sweep=sweep,
        states=tuple(result.state for result in found),
        errors=tuple(result.error for result in found),
        modes=modes,
        tracked=tracked,
        shapes=shapes,
        points={
            name: _map_point(found, index)
            for index, name in enumerate(() if static is None else static.at)
        },
        condition=conditions[:, 0] if conditions.shape[1] else None,
        figures={channel: _figures(found, index) for index, channel in enumerate(channels)},
        limits=_map_limits(scene.analyses.get(LobesRequest), found),
        limits_confirmed=all(result.limits_confirmed for result in found),
        warnings=remarks,
    )


def _stack_modes(
    found: Sequence[PoseResult], shapes: SingleArray, weighed: Mapping[str, Superelement]
) -> SweptModes:
    """Return the modes of every pose.

    Args:
        weighed: Components whose masses weigh the shapes; none where these are of energies already.
    """
    return SweptModes(
        frequencies_hz=_pad([result.frequencies_hz for result in found]),
        fields=_weigh_shapes(shapes, weighed) if weighed else shapes,
        wanted=np.array([result.wanted for result in found], dtype=np.int64),
        rigid=np.array([result.rigid_count for result in found], dtype=np.int64),
    )


def _map_limits(request: LobesRequest | None, found: Sequence[PoseResult]) -> dict[str, LimitMap]:
    if request is None:
        return {}
    blank = np.full((len(request.directions), len(request.speeds)), np.nan)
    unknown = np.full(len(request.directions), np.nan)
    depths = np.array([result.limits if result.limits.size else blank for result in found])
    chatter = np.array([result.chatter_hz if result.limits.size else unknown for result in found])
    return {
        travel.name: LimitMap(
            np.array([result.feed if travel.along is None else travel.along for result in found]),
            request.speeds,
            depths[:, index],
            chatter[:, index],
            tuple(result.chatter_modes[index] if result.chatter_modes else "" for result in found),
        )
        for index, travel in enumerate(request.directions)
    }


def _weigh_shapes(shapes: SingleArray, superelements: Mapping[str, Superelement]) -> SingleArray:
    """Shapes ``(n, d, m)`` times the root of the mass matrix: their scalar products are the kinetic
    energy they share.
    """
    weighed = np.empty_like(shapes)
    first = 0
    for part in superelements.values():
        levels, vectors = np.linalg.eigh(0.5 * (part.mass + part.mass.T))
        root = (vectors * np.sqrt(np.maximum(levels, 0.0))) @ vectors.T
        last = first + len(root)
        weighed[:, first:last] = root.astype(np.float32) @ shapes[:, first:last]
        first = last
    return weighed


class _PrincipalCompliance(NamedTuple):
    """Largest motion per unit force ``(n,)`` [m/N], the force's direction ``(n, 3)`` and largest
    over smallest ``(n,)``.
    """

    largest: FloatArray
    direction: FloatArray
    ratio: FloatArray


def _principal_compliance(compliance: FloatArray) -> _PrincipalCompliance:
    """Largest and smallest of the directions in which force and motion are parallel.

    The eigenvectors of the symmetric ``(n, 3, 3)`` are the directions in which force and motion are
    parallel.
    """
    determined = np.isfinite(compliance).all(axis=(1, 2))
    largest, ratio = np.full(len(compliance), np.nan), np.full(len(compliance), np.nan)
    direction = np.full((len(compliance), 3), np.nan)
    symmetric = 0.5 * (compliance[determined] + np.swapaxes(compliance[determined], 1, 2))
    levels, vectors = np.linalg.eigh(symmetric)
    largest[determined] = levels[:, 2]
    # a direction and its opposite are the same: the largest part points forward
    axis = vectors[:, :, 2]
    ahead = np.take_along_axis(axis, np.argmax(np.abs(axis), axis=1)[:, None], axis=1)
    direction[determined] = axis * np.sign(ahead)
    stiff = levels[:, 0] > 0.0
    ratio[determined] = np.where(stiff, levels[:, 2] / np.where(stiff, levels[:, 0], 1.0), np.nan)
    return _PrincipalCompliance(largest, direction, ratio)


def _map_point(found: Sequence[PoseResult], place: int) -> PointMap:
    present = [len(result.compliance) > place for result in found]
    blank = np.full((3, 3), np.nan)
    compliance = np.array(
        [
            result.compliance[place] if has else blank
            for result, has in zip(found, present, strict=True)
        ]
    )
    span = slice(3 * place, 3 * place + 3)
    links = tuple(
        result.links[span] if has else ("", "", "")
        for result, has in zip(found, present, strict=True)
    )
    shares = np.array(
        [
            result.link_shares[span] if has else np.full(3, np.nan)
            for result, has in zip(found, present, strict=True)
        ]
    )
    principal = _principal_compliance(compliance)
    return PointMap(
        compliance, principal.largest, principal.direction, principal.ratio, links, shares
    )


def _figures(found: Sequence[PoseResult], place: int) -> FloatArray:
    blank = np.full(len(FIGURES), np.nan)
    return np.array(
        [result.figures[place] if len(result.figures) > place else blank for result in found]
    )


def _stack_shapes(found: Sequence[PoseResult]) -> SingleArray:
    rows, columns = (
        max((result.shapes.shape[axis] for result in found), default=0) for axis in (0, 1)
    )
    shapes = np.zeros((len(found), rows, columns), dtype=np.float32)
    for number, result in enumerate(found):
        if result.shapes.size:
            shapes[number, :, : result.shapes.shape[1]] = result.shapes
    return shapes


def _pad(rows: Sequence[FloatArray]) -> FloatArray:
    """Rows of different lengths as one array, NaN where there is nothing."""
    table = np.full((len(rows), max((len(row) for row in rows), default=0)), np.nan)
    for number, row in enumerate(rows):
        table[number, : len(row)] = row
    return table


def name_tracked_modes(parts: MachineParts, results: SweepResults) -> SweepResults:
    """The results with a name per tracked mode, and the errors of its frequency and of the
    compliances in the pose it was named in.
    """
    if results.tracked is None:
        return results
    index = results.tracked.index
    spread = results.sweep.positions - results.sweep.positions.mean(axis=0)
    far = (np.abs(spread) / np.maximum(np.ptp(results.sweep.positions, axis=0), 1e-12)).sum(axis=1)
    names: dict[int, str] = {}
    samples: dict[int, Mapping[Key, Estimate]] = {}
    for number in np.argsort(far, kind="stable"):
        here = [mode for mode in np.flatnonzero(index[number] >= 0) if int(mode) not in names]
        if here:
            modes, points = _name_pose_modes(parts, results, int(number), with_static=not samples)
            names |= {int(mode): modes.mode_names[index[number, mode]] for mode in here}
            errors = {
                make_key(
                    "frequency", pose=modes.pose.name, mode=int(mode) + 1
                ): modes.list_errors()[index[number, mode]]
                for mode in here
                if index[number, mode] >= modes.rigid_count
            }
            samples[int(number)] = errors | dict(points.errors)
        if len(names) == index.shape[1]:
            break
    ordered = tuple(names[mode] for mode in range(index.shape[1]))
    return dataclasses.replace(results, mode_names=ordered, sampled_errors=samples)


def _name_pose_modes(
    parts: MachineParts, results: SweepResults, number: int, *, with_static: bool
) -> tuple[PoseModes, StaticAnswer]:
    """All modes of a pose with names and errors, and its compliances.

    Args:
        with_static: Compute the compliances that are swept, too; empty where the machine moves
            freely.
    """
    pose = dataclasses.replace(
        sweep_pose(results.sweep, number), name=describe_positions(results.sweep, number)
    )
    request = ModalRequest(
        count=0
        if results.modes is None
        else int(np.isfinite(results.modes.frequencies_hz[number]).sum())
    )
    static = parts.scene.analyses.get(StaticRequest) if with_static else None
    alone = dataclasses.replace(
        parts,
        scene=dataclasses.replace(parts.scene, analyses=Analyses(request, static)),
    )
    model = pose_machine(alone, pose)
    points = solve_points(model, () if static is None else static.at)
    return solve_pose_modes(model, request).answer, points.answer
