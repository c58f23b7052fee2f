"""Numbers of a machine, tracked in the same machine with other bodies or joints: small coupled
machines whose modes are paired by shape.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.frf import Height, PoseResponse
from headstock.pipeline.answers.modal import (
    DAMPED_FREQUENCY,
    DAMPING_RATIO,
    FREQUENCY,
    PoseModes,
)
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Key, Number
from headstock.pipeline.stages.frf import estimate_heights, prepare_response
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import MachineParts
from headstock.pipeline.stages.static import solve_points
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.estimates.model_errors import WatchedModes, compare_modes, watch_modes
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, place_motion
from headstock.reduction.motions.compliance_budget import point_compliance
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import keep_lowest
from headstock.solvers.pairing.response_peaks import (
    ResponseLevel,
    ResponsePeak,
    follow_peaks,
    measure_levels,
)

type Followed = PoseModes | StaticAnswer | PoseResponse  # answers with numbers that can be tracked
FOLLOWED = (PoseModes, StaticAnswer, PoseResponse)


class MachineFamily:
    """Watch machines of the same bodies in different models at the same points.

    Attributes:
        places: By body, points that represent its mass.
        memo: What couplings of its machines share.
    """

    def __init__(self, parts: MachineParts) -> None:
        self.base = ComparedMachine(self, parts)
        self.places: dict[str, BodyPlaces] = {
            name: choose_places(part) for name, part in parts.superelements.items()
        }
        self.memo = CouplingMemo()
        self._motions: WeakKeyDictionary[Superelement, FloatArray] = WeakKeyDictionary()

    def change(self, parts: MachineParts) -> "ComparedMachine":
        """Return another machine of the family."""
        return ComparedMachine(self, parts)

    def move(self, name: str, element: Superelement) -> FloatArray:
        """Return the motion of the points of a body per dof of a model of it ``(3 k, n)``."""
        if element not in self._motions:
            self._motions[element] = place_motion(element, self.places[name].points)
        return self._motions[element]


@dataclass(eq=False)
class ComparedMachine:
    """Couple a machine of a family, once in each pose."""

    family: MachineFamily
    parts: MachineParts
    _posed: dict[str, CoupledPose] = field(default_factory=dict)
    _watched: dict[tuple[str, int], WatchedModes] = field(default_factory=dict)

    def at(self, pose: str) -> CoupledPose:
        """Return the machine coupled in a pose."""
        if pose not in self._posed:
            place = self.parts.plan.poses[pose]
            self._posed[pose] = couple_pose(self.parts, place, memo=self.family.memo)
        return self._posed[pose]

    def watch(self, pose: str, count: int) -> WatchedModes:
        """Return enough modes to find partners of the first ``count`` of another machine."""
        if (pose, count) not in self._watched:
            self._watched[pose, count] = watch_modes(
                self.at(pose).coupled, self.family.places, self._motions, count=count
            )
        return self._watched[pose, count]

    @cached_property
    def _motions(self) -> Mapping[str, FloatArray]:
        elements = self.parts.superelements
        return {name: self.family.move(name, elements[name]) for name in self.family.places}


@dataclass(frozen=True, eq=False)
class _FollowedNumbers:
    """Store numbers of an answer in a changed machine, under the keys of the answer.

    Attributes:
        numbers: With the ± that the changed machine has, where it was asked for; NaN for one that has no
            partner.
        motion: Motion ``(n, m)`` of the changed machine that a number depends on.
        missing: Natural modes of the changed machine without a partner in the answer.
    """

    numbers: tuple[Number, ...]
    motion: Callable[[Key], FloatArray]
    missing: tuple[int, ...] = ()


def list_followed(answer: Answer) -> list[Number]:
    """Return the numbers of an answer that can be tracked: frequencies of elastic modes,
    compliances in x, y, z that are not zero, peaks and levels.
    """
    if isinstance(answer, PoseModes):
        elastic = {
            answer.key(FREQUENCY, index)
            for index in range(answer.rigid_count, len(answer.frequencies_hz))
        }
        return [number for number in answer.list_numbers() if number.key in elastic]
    if isinstance(answer, StaticAnswer):
        return [
            number
            for number in answer.list_numbers()
            if number.key.kind == "compliance"
            and number.key in answer.errors
            and number.value > 0.0
        ]
    return list(answer.list_heights()) if isinstance(answer, PoseResponse) else []


def follow_numbers(
    answer: Answer, base: ComparedMachine, changed: ComparedMachine, *, with_errors: bool = False
) -> _FollowedNumbers:
    """Return the numbers of a machine's answer in a changed machine.

    Args:
        answer: With modes, compliances or a frequency response.
        with_errors: Estimate the ± of the changed machine.

    Raises:
        TypeError: The answer has no numbers that can be tracked.
    """
    if isinstance(answer, PoseModes):
        return _follow_modes(answer, base, changed, with_errors=with_errors)
    if isinstance(answer, StaticAnswer):
        return _follow_compliances(answer, changed, with_errors=with_errors)
    if isinstance(answer, PoseResponse):
        return _follow_heights(answer, base, changed, with_errors=with_errors)
    raise TypeError(f"numbers of {type(answer).__name__} cannot be followed")


def _follow_modes(
    answer: PoseModes, base: ComparedMachine, changed: ComparedMachine, *, with_errors: bool
) -> _FollowedNumbers:
    pose, count = answer.pose.name, answer.below + len(answer.frequencies_hz)
    watched = changed.watch(pose, count)
    compared = compare_modes(base.watch(pose, count), watched, count=count)
    errors: tuple[Estimate, ...] = ()
    if with_errors:
        last = max((*compared.partners, *compared.missing), default=-1) + 1
        kept = keep_lowest(watched.modes, count=max(1, last))
        errors = changed.at(pose).estimate_mode_errors(kept)
    numbers: list[Number] = []
    partners: dict[Key, int] = {}
    for index in range(answer.rigid_count, len(answer.frequencies_hz)):
        key, partner = answer.key(FREQUENCY, index), compared.partners[answer.below + index]
        value = float(answer.frequencies_hz[index] + compared.changes_hz[answer.below + index])
        known = with_errors and partner >= 0
        numbers.append(Number(key, value, "Hz", errors[partner] if known else None))
        partners[key] = partner
    return _FollowedNumbers(
        tuple(numbers),
        lambda key: watched.modes.shapes[:, [partners[key]]],
        compared.missing,
    )


def _follow_compliances(
    answer: StaticAnswer, changed: ComparedMachine, *, with_errors: bool
) -> _FollowedNumbers:
    model = changed.at(answer.pose)
    if with_errors:
        solved = solve_points(model, answer.points).answer
    else:
        points = {
            name: PointCompliance(point_compliance(model.coupled, name), {})
            for name in answer.points
        }
        solved = StaticAnswer(answer.pose, points)
    return _FollowedNumbers(
        tuple(number for number in solved.list_numbers() if number.key in answer.errors),
        lambda key: model.push((str(key["point"]), str(key["direction"])))[:, None],
    )


def _follow_heights(
    answer: PoseResponse, base: ComparedMachine, changed: ComparedMachine, *, with_errors: bool
) -> _FollowedNumbers:
    pose, count = answer.curves.pose, max((peak.mode for peak in answer.peaks), default=-1) + 1
    model = changed.at(pose)
    if not answer.heights:
        return _FollowedNumbers((), lambda key: np.zeros((len(model.system.mass), 0)))
    watched = changed.watch(pose, count)
    peaks, levels = _match_heights(answer, model, base.watch(pose, count), watched)
    pairs: dict[Key, Height] = dict(
        zip(map(answer.key, answer.heights), (*peaks, *levels), strict=True)
    )
    errors: dict[Key, Estimate] = {}
    if with_errors:
        found = {key: height for key, height in pairs.items() if np.isfinite(height.height)}
        known = dataclasses.replace(
            answer,
            peaks=tuple(each for each in found.values() if isinstance(each, ResponsePeak)),
            levels=tuple(each for each in found.values() if isinstance(each, ResponseLevel)),
        )
        errors = dict(zip(found, estimate_heights(model, known), strict=True))

    def motion(key: Key) -> FloatArray:
        height = pairs[key]
        if isinstance(height, ResponsePeak):
            return watched.modes.shapes[:, [height.mode]]
        return model.push(answer.curves.outputs[height.output])[:, None]

    return _FollowedNumbers(
        tuple(
            dataclasses.replace(
                number, value=pairs[number.key].height, error=errors.get(number.key)
            )
            for number in answer.list_heights()
        ),
        motion,
    )


def _match_heights(
    answer: PoseResponse, model: CoupledPose, own: WatchedModes, other: WatchedModes
) -> tuple[list[ResponsePeak], list[ResponseLevel]]:
    """Return the peaks and levels of a response in another model of the machine, NaN in height where a
    mode has no partner.
    """
    prepared = prepare_response(model)
    modes = [peak.mode for peak in answer.peaks]
    partners = compare_modes(own, other, count=max(modes, default=-1) + 1).partners
    peaks = follow_peaks(
        prepared,
        answer.peaks,
        [partners[mode] for mode in modes],
        own.modes.frequencies_hz[modes],
    )
    sizes = measure_levels(prepared, answer.levels)
    levels = [
        dataclasses.replace(level, height=float(size))
        for level, size in zip(answer.levels, sizes, strict=True)
    ]
    return peaks, levels


def put_errors[A: Answer](
    answer: A,
    errors: Mapping[Key, Estimate],
    source: str,
    how: Literal["add", "replace"],
) -> A:
    """Return an answer with the ± of its numbers, and with the part of ± that changes of
    frequencies cause in damped frequencies, which change as much, and damping ratios, whose change
    is unknown.

    Args:
        how: Add to the ± that numbers have, or replace it.
    """
    added: dict[Key, Estimate] = {}
    if isinstance(answer, PoseModes):
        for index in range(answer.rigid_count, len(answer.frequencies_hz)):
            size = errors[answer.key(FREQUENCY, index)].shares.get(source)
            damped, ratio = answer.key(DAMPED_FREQUENCY, index), answer.key(DAMPING_RATIO, index)
            if damped in answer.errors:
                added[damped] = Estimate({source: size})
            if ratio in answer.errors and answer.errors[ratio].total:
                added[ratio] = Estimate({source: None})
    return answer.with_errors(added, "add").with_errors(errors, how)
