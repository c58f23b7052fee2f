"""Errors of frequency responses and of what they say about cutting, from meshes and from the modes that components leave out."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.estimates import CURVED_FACES, DISCRETISATION, REDUCTION
from headstock.pipeline.results.frf import PortFigures
from headstock.pipeline.stages.damped_machines import DAMPING
from headstock.pipeline.stages.estimates import name_what_is_left_out
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.estimates.frequency_errors import truncated_parts
from headstock.reduction.estimates.mesh_errors import meshed_parts
from headstock.reduction.estimates.response_errors import ErrorSources, ResponseSpace, project_response
from headstock.reduction.estimates.response_errors_2 import ResponseErrors, bound_response_errors, soften_response
from headstock.solvers.linear.frequency_response import BoolArray, FrequencyResponse
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem
from headstock.solvers.system_ports import input_columns, output_rows

NEIGHBOURHOOD = 0.2  # of a peak's frequency: lines that follow it when it moves


@dataclass(frozen=True, eq=False)
class ResponseEstimate:
    """Errors of a response, and what they were found with.

    Attributes:
        errors: Changes of every line.
        space: The machine in its trial space.
        left_out: What is not in them, in plain words.
    """

    errors: ResponseErrors
    space: ResponseSpace
    left_out: tuple[str, ...]

    @property
    def shares(self) -> dict[str, FloatArray]:
        """Source to the size of its part ``(n_freq, n_outputs, n_inputs)``; NaN where there is no bound."""
        sizes = {DISCRETISATION: self.errors.mesh_sizes, CURVED_FACES: self.errors.face_sizes}
        return {source: size for source, size in sizes.items() if size is not None} | {REDUCTION: self.errors.bounds}


def estimate_response_errors(
    state: RunState, system: SecondOrderSystem, coupled: CoupledMachine, modes: ModalResult, response: FrequencyResponse
) -> ResponseEstimate:
    """Change of every line of a response by finer meshes and by the modes left out.

    Args:
        state: Of the run.
        system: With the damping of the scene.
        coupled: The machine.
        modes: All undamped modes of the system.
        response: What is judged.
    """
    lossy = DAMPING in state.scene.effects and not state.scene.modal_damping
    truncated, meshed = truncated_parts(coupled), meshed_parts(coupled)
    names = [name for name in coupled.layout.superelements if lossy and name in truncated.keys() | meshed.keys()]
    losses = {name: state.plan.components[name].material.loss_factor for name in names}
    ports = (input_columns(system, response.inputs), output_rows(system, response.outputs))
    space = project_response(system, ErrorSources(truncated, meshed, losses), modes, ports, float(response.frequencies_hz.max()))
    errors = bound_response_errors(space, response.frequencies_hz)
    return ResponseEstimate(errors, space, name_what_is_left_out(state, coupled).left_out)


def add_figure_errors(
    figures: tuple[PortFigures, ...], response: FrequencyResponse, estimate: ResponseEstimate | None
) -> tuple[PortFigures, ...]:
    """The figures with the change of their most negative real part: a peak that moves keeps its depth."""
    if estimate is None:
        return figures
    found = []
    for own in figures:
        row, column = response.outputs.index(own.port), response.inputs.index(own.port)
        plain = response.receptance[:, row, column]
        low, high = (change[:, row, column] for change in (estimate.errors.least, estimate.errors.most))
        bounded = np.isfinite(plain) & np.isfinite(high)
        if own.worst_real is None or own.worst_real_hz is None or not _reaches(response.frequencies_hz, bounded, own.worst_real_hz):
            found.append(own)
            continue
        depths = [_deepest(plain[bounded] + change[bounded]) for change in (np.zeros_like(plain), low, high)]
        shares = {REDUCTION: max(abs(depths[1] - depths[0]), abs(depths[2] - depths[0])) + abs(depths[2] - depths[1])}
        if estimate.errors.mesh is not None:
            softer = _softer_depth(response, estimate, (row, column), own.worst_real_hz)
            # nothing is known of the mesh near the deepest line: then nothing is known of the depth
            if softer is None:
                found.append(own)
                continue
            shares = {DISCRETISATION: abs(softer - depths[0])} | shares
        found.append(dataclasses.replace(own, worst_real_error=sum(shares.values()), worst_real_error_share=shares))
    return tuple(found)


def _softer_depth(response: FrequencyResponse, estimate: ResponseEstimate, entry: tuple[int, int], hz: float) -> float | None:
    """Most negative real part with finer meshes; lines are dense where peaks are, so those around the deepest move along with it.

    None where nothing is known of any line.
    """
    row, column = entry
    lines, mesh = response.frequencies_hz, estimate.errors.mesh
    softer = response.receptance[:, row, column] + (0.0 if mesh is None else mesh[:, row, column])
    near = lines[np.abs(lines - hz) < NEIGHBOURHOOD * hz]
    moved = soften_response(estimate.space, near * estimate.space.softening(hz))[:, row, column]
    known = np.concatenate([softer[np.isfinite(softer)], moved[np.isfinite(moved)]])
    return _deepest(known) if np.isfinite(softer).any() else None


def _deepest(values: ComplexArray) -> float:
    return float(values.real.min())


def _reaches(frequencies_hz: FloatArray, bounded: BoolArray, hz: float) -> bool:
    return bool(bounded.any()) and float(frequencies_hz[bounded].max()) >= hz
