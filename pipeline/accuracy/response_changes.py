"""Peaks and levels of a frequency response of a machine in which some bodies have other models."""

import dataclasses
from collections.abc import Sequence

from headstock.pipeline.answers.frf import ResponseNumber
from headstock.pipeline.answers.response_numbers import place_levels, place_peaks
from headstock.pipeline.stages.frf import prepare_response
from headstock.pipeline.stages.machine import CoupledPose
from headstock.reduction.estimates.model_errors import WatchedModes, compare_modes
from headstock.scene.requests import FrfRequest
from headstock.solvers.pairing.response_peaks import follow_peaks, measure_levels


def follow_numbers(
    numbers: Sequence[ResponseNumber],
    model: CoupledPose,
    own: WatchedModes,
    other: WatchedModes,
) -> tuple[ResponseNumber, ...]:
    """The same numbers of another model of the machine, NaN in size where a mode has no partner.

    Args:
        numbers: Peaks, then levels.
        model: The other model, in the pose.
        own: Modes of the machine that has these numbers.
        other: Those of the other model.
    """
    if not numbers:
        return ()
    request = _frf_request(model)
    prepared = prepare_response(model)
    peaks, levels = place_peaks(numbers, request), place_levels(numbers, request)
    count = max((peak.mode for peak in peaks), default=-1) + 1
    partners = compare_modes(own, other, count=count).partners
    moved = follow_peaks(
        prepared,
        peaks,
        [partners[peak.mode] for peak in peaks],
        own.modes.frequencies_hz[[peak.mode for peak in peaks]],
    )
    places = [(peak.hz, peak.height, peak.mode) for peak in moved]
    heights = measure_levels(prepared, levels)
    places += [(level.hz, float(size), -1) for level, size in zip(levels, heights, strict=True)]
    return tuple(
        dataclasses.replace(number, hz=hz, size=size, mode=mode)
        for number, (hz, size, mode) in zip(numbers, places, strict=True)
    )


def _frf_request(model: CoupledPose) -> FrfRequest:
    request = model.parts.scene.analyses.get(FrfRequest)
    if request is None:
        raise ValueError("numbers of a frequency response need its analysis in the scene")
    return request
