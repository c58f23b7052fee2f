"""Errors of frequency responses and of what they say about cutting, from the modes that components leave out."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.damped_machines import DAMPING
from headstock.pipeline.frf_results import PortFigures
from headstock.pipeline.run_state import RunState
from headstock.reduction.frequency_errors import TruncatedPart
from headstock.reduction.response_errors import ResponseErrors, bound_response_errors
from headstock.solvers.frequency_response import BoolArray, FrequencyResponse
from headstock.solvers.modal_analysis import ModalResult
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem
from headstock.solvers.system_ports import input_columns, output_rows


def estimate_response_errors(
    state: RunState,
    system: SecondOrderSystem,
    parts: Mapping[str, TruncatedPart],
    modes: ModalResult,
    response: FrequencyResponse,
) -> ResponseErrors:
    """Change of every line of a response by the modes left out.

    Args:
        state: Of the run.
        system: With the damping of the scene.
        parts: Components that leave modes out.
        modes: All undamped modes of the system.
        response: What is judged.
    """
    lossy = DAMPING in state.scene.effects and not state.scene.modal_damping
    losses = {name: state.plan.components[name].material.loss_factor if lossy else 0.0 for name in parts}
    ports = (input_columns(system, response.inputs), output_rows(system, response.outputs))
    return bound_response_errors(system, parts, modes, ports, response.frequencies_hz, loss_factors=losses)


def add_figure_errors(
    figures: tuple[PortFigures, ...], response: FrequencyResponse, errors: ResponseErrors | None
) -> tuple[PortFigures, ...]:
    """The figures with the change of their most negative real part: a peak that moves keeps its depth."""
    if errors is None:
        return figures
    found = []
    for own in figures:
        row, column = response.outputs.index(own.port), response.inputs.index(own.port)
        plain = response.receptance[:, row, column]
        low, high = (change[:, row, column] for change in (errors.least, errors.most))
        bounded = np.isfinite(plain) & np.isfinite(high)
        if own.worst_real is None or own.worst_real_hz is None or not _reaches(response.frequencies_hz, bounded, own.worst_real_hz):
            found.append(own)
            continue
        depths = [_deepest(plain[bounded] + change[bounded]) for change in (np.zeros_like(plain), low, high)]
        spread = max(abs(depths[1] - depths[0]), abs(depths[2] - depths[0])) + abs(depths[2] - depths[1])
        found.append(dataclasses.replace(own, worst_real_error=spread))
    return tuple(found)


def _deepest(values: ComplexArray) -> float:
    return float(values.real.min())


def _reaches(frequencies_hz: FloatArray, bounded: BoolArray, hz: float) -> bool:
    return bool(bounded.any()) and float(frequencies_hz[bounded].max()) >= hz
