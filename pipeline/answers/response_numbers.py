"""Peaks and static levels of a frequency response as requested numbers."""

from collections.abc import Sequence

from headstock.pipeline.answers.frf import ResponseNumber
from headstock.scene.requests import FrfRequest
from headstock.solvers.linear.frequency_response import FrfModel
from headstock.solvers.pairing.response_peaks import (
    ResponseLevel,
    ResponsePeak,
    find_levels,
    find_response_peaks,
)


def list_numbers(model: FrfModel, request: FrfRequest) -> tuple[ResponseNumber, ...]:
    """Peaks and levels of a response, without errors; of an entry and its reciprocal one the first
    stands for both.

    Args:
        model: The response.
        request: Its channels and range.
    """
    peaks = find_response_peaks(model, request.from_hz, request.to_hz)
    levels = find_levels(model, request.from_hz)
    numbers = (
        *(
            ResponseNumber(
                "peak",
                model.outputs[peak.output],
                model.inputs[peak.given],
                peak.hz,
                peak.height,
                peak.mode,
            )
            for peak in peaks
        ),
        *(
            ResponseNumber(
                "level", model.outputs[own.output], model.inputs[own.given], own.hz, own.height
            )
            for own in levels
        ),
    )
    return tuple(
        {(frozenset((own.output, own.given)), own.mode): own for own in reversed(numbers)}.values()
    )[::-1]


def place_peaks(numbers: Sequence[ResponseNumber], request: FrfRequest) -> list[ResponsePeak]:
    """Peaks by rows and columns of their entries."""
    return [
        ResponsePeak(
            request.outputs.index(own.output),
            request.inputs.index(own.given),
            own.mode,
            own.hz,
            own.size,
        )
        for own in numbers
        if own.kind == "peak"
    ]


def place_levels(numbers: Sequence[ResponseNumber], request: FrfRequest) -> list[ResponseLevel]:
    """Levels by rows and columns of their entries."""
    return [
        ResponseLevel(
            request.outputs.index(own.output), request.inputs.index(own.given), own.hz, own.size
        )
        for own in numbers
        if own.kind == "level"
    ]
