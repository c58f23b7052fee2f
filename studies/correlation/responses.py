"""Measured frequency responses beside those of the model at the same channels and on the same lines."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, find_axis
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.stages.frf import estimate_response_errors
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import PoseModel
from headstock.scene.test_data.records import MeasuredResponses, TestChannel, same_line
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import evaluate_frf, prepare_frf
from headstock.solvers.pairing.mode_pairing import ModePair
from headstock.solvers.pairing.shape_agreement import domain_assurance, response_assurance
from headstock.solvers.second_order import Channel, ComplexArray, SecondOrderSystem
from headstock.studies.correlation.model import ObservedMachine

MOST_LINES = 150  # of the picture of FDAC
MOST_SHOWN = 9  # responses that are drawn, and for which ± is estimated
SAME_LINE = 1e-6  # of the cosine between two directions


@dataclass(frozen=True, eq=False)
class ComparedResponses:
    """Responses of a test and of its model.

    Attributes:
        measured: NaN for entries that were not measured.
        computed: On the same lines; ± of the entries that are shown.
        frac: ``(m, f)`` frequency response assurance criterion; NaN for what was not measured.
        fdac: ``(l, l)`` frequency domain assurance criterion of ``fdac_hz``.
        fdac_hz: Every so many of the lines [Hz].
        shown: Output and input of the entries that are drawn.
        damping: Where the damping of the model comes from.
        left_out: What ± of the computed ones is without.
    """

    measured: ResponseCurves
    computed: ResponseCurves
    frac: FloatArray
    fdac: FloatArray
    fdac_hz: FloatArray
    shown: tuple[tuple[Channel, Channel], ...]
    damping: str
    left_out: tuple[str, ...] = ()

    @property
    def error_shares(self) -> FloatArray:
        """± of the entries that are drawn over their sizes, of all lines that have one."""
        errors, values = self.computed.value_errors, self.computed.values
        if errors is None:
            return np.empty(0)
        shares = errors / np.abs(values)
        return shares[np.isfinite(shares)]

    @property
    def shares(self) -> FloatArray:
        """Root mean square of each measured response over the largest one under the same force ``(m,
        f)``; NaN for what was not measured.
        """
        sizes = _mean_sizes(self.measured.receptance)
        return sizes / np.nanmax(sizes, axis=0)


def response_channel(channel: TestChannel) -> Channel:
    """Return point and direction of a channel as responses name them: ``("12", "-z")``."""
    axis = find_axis(channel.direction, SAME_LINE)
    if axis is not None:
        return channel.point, ("-" if axis[1] < 0.0 else "") + axis[0]
    return channel.point, "(" + " ".join(f"{value:.3g}" for value in channel.direction) + ")"


def compare_responses(
    model: ObservedMachine,
    measured: MeasuredResponses,
    pairs: Sequence[ModePair],
    damping: FloatArray,
) -> ComparedResponses:
    """Compute what a test measured, and compare.

    Args:
        model: In the pose of the test.
        pairs: Of measured and computed modes.
        damping: ``(k,)`` measured ratios, which act where the scene has no damping; nan where unknown.

    Raises:
        ModelError: A matrix has no physical meaning.
    """
    machine = model.machine
    outputs, inputs = (
        dict(zip(map(response_channel, ends), model.observe(ends) @ model.dofs, strict=True))
        for ends in (measured.motions, measured.forces)
    )
    system, damped_by = _damp(machine, _spread_ratios(pairs, damping, model.modes.rigid_count))
    system = dataclasses.replace(
        system, outputs={**system.outputs, **outputs}, inputs={**system.inputs, **inputs}
    )
    frf = prepare_frf(system, inputs=[*inputs], outputs=[*outputs], modes=machine.all_modes)
    response = evaluate_frf(frf, measured.frequencies_hz)
    lines = slice(None, None, -(-len(measured.frequencies_hz) // MOST_LINES))
    curves = ResponseCurves(
        machine.pose.name, (*inputs,), (*outputs,), measured.frequencies_hz, measured.values
    )
    shown = _choose_shown(measured)
    computed = dataclasses.replace(curves, receptance=response.receptance)
    left_out: tuple[str, ...] = ()
    if machine.coupled is not None and shown:
        rows = sorted({curves.outputs.index(output) for output, _ in shown})
        columns = sorted({curves.inputs.index(given) for _, given in shown})
        few = dataclasses.replace(
            response,
            outputs=tuple(curves.outputs[row] for row in rows),
            inputs=tuple(curves.inputs[column] for column in columns),
            receptance=response.receptance[:, rows][:, :, columns],
            free_body=response.free_body[:, rows][:, :, columns],
            singular=response.singular[:, rows][:, :, columns],
        )
        estimate = estimate_response_errors(
            machine.parts, system, machine.coupled, machine.all_modes, few
        )
        errors, left_out = {}, estimate.left_out
        if machine.parts.scene.fit is not None:
            left_out += ("what the fit of the scene leaves open",)
        for source, size in estimate.shares.items():
            errors[source] = np.full(response.receptance.shape, np.nan)
            errors[source][np.ix_(range(len(size)), rows, columns)] = size
        computed = dataclasses.replace(computed, error_share=errors)
    return ComparedResponses(
        curves,
        computed,
        response_assurance(measured.values, response.receptance),
        domain_assurance(measured.values[lines], response.receptance[lines]),
        measured.frequencies_hz[lines],
        shown,
        damped_by,
        left_out,
    )


def _damp(machine: PoseModel, ratios: FloatArray) -> tuple[SecondOrderSystem, str]:
    """Return the system with the damping of the scene, or with measured ratios where it has none."""
    system = damp_system(machine.parts.scene, machine.system, machine.all_modes)
    if system.damping is not None or system.hysteretic is not None:
        return system, "the damping of the scene"
    return (
        add_modal_damping(system, [*map(float, ratios)], machine.all_modes),
        "measured damping ratios: the scene has none",
    )


def _choose_shown(measured: MeasuredResponses) -> tuple[tuple[Channel, Channel], ...]:
    """Choose drive points first, then the responses that move most."""
    sizes = _mean_sizes(measured.values)
    order = np.dstack(np.unravel_index(np.argsort(-np.nan_to_num(sizes), axis=None), sizes.shape))
    entries = [
        (measured.motions[row], measured.forces[column])
        for row, column in order[0]
        if np.isfinite(sizes[row, column])
    ]
    entries.sort(key=lambda entry: not same_line(entry[0], entry[1], SAME_LINE))
    return tuple(
        (response_channel(motion), response_channel(force))
        for motion, force in entries[:MOST_SHOWN]
    )


def _mean_sizes(values: ComplexArray) -> FloatArray:
    """Return root mean squares ``(m, f)`` over the lines; NaN where nothing was measured."""
    known = np.isfinite(values)
    sums = np.sum(np.abs(np.where(known, values, 0.0)) ** 2, axis=0)
    return np.sqrt(np.where(known.any(axis=0), sums / np.maximum(known.sum(axis=0), 1), np.nan))


def _spread_ratios(pairs: Sequence[ModePair], damping: FloatArray, rigid_count: int) -> FloatArray:
    """Return a damping ratio for each elastic mode of a model up to the last pair: that of its partner,
    else the median; the last one is for all others.

    Args:
        pairs: Of measured and computed modes.
        damping: ``(k,)`` measured; nan where unknown.
    """
    known = damping[np.isfinite(damping)]
    usual = float(np.median(known)) if len(known) else 0.0
    last = max((pair.second for pair in pairs), default=rigid_count - 1)
    ratios = np.full(last - rigid_count + 2, usual)
    for pair in pairs:
        if np.isfinite(damping[pair.first]) and pair.second >= rigid_count:
            ratios[pair.second - rigid_count] = damping[pair.first]
    return ratios
