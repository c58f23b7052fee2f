"""Frequency response of any second-order system between named channels, where to compute it, and
its figures of stability.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose search of minima, a tenth of a second, is loaded where it is used
from scipy.sparse.csgraph import connected_components

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.damper_sum import MANY_DAMPERS, DamperSum, sum_over_dampers
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.linear.modal_coordinates import (
    ModalCoordinates,
    damps_rigid_motion,
    rigid_response,
    to_modal_coordinates,
)
from headstock.solvers.linear.response_forms import (
    DirectResponse,
    ModalSum,
    PoleSum,
    ResponseForm,
    sum_over_modes,
    sum_over_poles,
)
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    Motion,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

DERIVATIVES: dict[Motion, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
METHODS = {ModalSum: "modal", DamperSum: "dampers", PoleSum: "poles", DirectResponse: "direct"}
RESTING_HZ = 1e-100  # slower than this is at rest: its square has no place among numbers
AGREEMENT = 1e-8  # of the sum over poles with direct solves, where it is tried
PEAK_MARGIN = 1.2  # beyond the range: peaks whose flank reaches into it
PROBED_QUANTILES = (0.0, 0.1, 0.3, 0.7)  # of the poles: the gaps after them
# distances from a resonance in half-power half-widths; doubled further out until they meet the even
# grid
OFFSETS = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
GROWTH = 1.5
UNDAMPED = 1e-9  # half-width over frequency below which a peak has no top
NEAREST = 1e-6  # how near the grid comes to an undamped resonance
REFINEMENT = 1e-9  # of the frequency of a stability figure
# of the root of both diagonal entries: less is roundoff of zero
UNCONNECTED = 1e-13


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Receptance between channels: displacement per unit load.

    Attributes:
        frequencies_hz: ``(n_freq,)``.
        inputs: Where the loads act.
        outputs: Where the motion is seen.
        receptance: ``(n_freq, n_outputs, n_inputs)`` [m/N, rad/(N m), ...]; NaN where there is no
            value.
        free_body: The same shape: at 0 Hz an unbalanced load meets a motion that nothing holds.
        singular: The same shape: exactly on the pole of an undamped mode.
        method: ``modal`` sum, the same with few ``dampers`` that couple modes, ``poles`` of coupled
            modes, ``direct`` solves, or ``closed loops`` around one of them.
    """

    frequencies_hz: FloatArray
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    receptance: ComplexArray
    free_body: BoolArray
    singular: BoolArray
    method: str


@dataclass(frozen=True, eq=False)
class FrfModel:
    """A system made ready to be asked for its response at many frequencies.

    Attributes:
        inputs: Where the loads act.
        outputs: Where the motion is seen.
        form: Sum over modes or poles, direct solves, or loops of drives closed around one of them.
        at_rest: ``(n_outputs, n_inputs)`` static compliance, NaN where nothing holds.
        coordinates: Modal coordinates, where the system has them.
        method: What the form is called in results.
        linked: ``(n_outputs, n_inputs)`` whether anything connects both; the others are zero. None
            where all are.
    """

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    form: ResponseForm
    direct: DirectResponse
    at_rest: FloatArray
    coordinates: ModalCoordinates | None
    method: str
    linked: BoolArray | None = None


def solve_frf(
    system: SecondOrderSystem,
    frequencies_hz: FloatArray,
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> FrequencyResponse:
    """Return the receptance at given frequencies; at 0 Hz the static compliance, at negative ones
    the complex conjugate.

    Structural (hysteretic) damping acts at every frequency but 0 Hz.

    Args:
        system: Any linear system; unsymmetric terms are found and are solved directly.
        frequencies_hz: ``(n_freq,)`` finite [Hz].

    Raises:
        ModelError: A channel is unknown, a frequency is not finite, or a matrix has no physical
            meaning.
    """
    return evaluate_frf(prepare_frf(system, inputs=inputs, outputs=outputs), frequencies_hz)


def prepare_frf(
    system: SecondOrderSystem,
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    modes: ModalResult | None = None,
) -> FrfModel:
    """Bring a system into the form that answers fastest.

    All modes of the (reduced) system are used, so nothing is truncated; without dampers that couple
    modes the response is a sum over real modes; with few of them each frequency takes a solve of
    their number besides; with many it is a sum over poles, and for unsymmetric terms or critical
    damping by many dampers a solve per frequency. A sum over poles is compared with direct solves at a few
    frequencies before it is used.

    Args:
        modes: All undamped modes, where they are already known.

    Raises:
        ModelError: A channel is unknown, or a matrix has no physical meaning.
    """
    direct = DirectResponse(system, input_columns(system, inputs), output_rows(system, outputs))
    coordinates = to_modal_coordinates(system, inputs, outputs, modes)
    if coordinates is None:
        rest = _general_rest(direct)
        return FrfModel(
            tuple(inputs), tuple(outputs), direct, direct, rest, None, METHODS[DirectResponse]
        )
    _, moves = rigid_response(coordinates)
    form = _choose_form(coordinates, direct)
    return FrfModel(
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        form=form,
        direct=direct,
        at_rest=np.where(moves, np.nan, coordinates.elastic),
        coordinates=coordinates,
        method=METHODS[type(form)],
    )


def evaluate_frf(model: FrfModel, frequencies_hz: FloatArray) -> FrequencyResponse:
    """Return the receptance at given frequencies; see ``solve_frf``.

    Raises:
        ModelError: A frequency is not finite.
    """
    frequencies = np.atleast_1d(np.asarray(frequencies_hz, dtype=float))
    if not np.isfinite(frequencies).all():
        raise ModelError("a frequency is not finite; write numbers in Hz")
    omega = 2.0 * np.pi * np.where(np.abs(frequencies) < RESTING_HZ, 0.0, np.abs(frequencies))
    moving = np.flatnonzero(omega > 0.0)
    values = np.empty((len(omega), *model.at_rest.shape), dtype=complex)
    values[:] = model.at_rest
    if len(moving):
        values[moving] = model.form.evaluate(omega[moving])
    values[frequencies < 0.0] = values[frequencies < 0.0].conj()
    if model.linked is not None:
        values[:, ~model.linked] = 0.0
    missing = np.isnan(values)
    rest = (omega == 0.0)[:, None, None]
    return FrequencyResponse(
        frequencies_hz=frequencies,
        inputs=model.inputs,
        outputs=model.outputs,
        receptance=values,
        free_body=missing & rest,
        singular=missing & ~rest,
        method=model.method,
    )


def find_peaks(model: FrfModel, to_hz: float) -> ComplexArray:
    """Find the poles at positive frequencies, and real ones [rad/s], that may shape a response up
    to a frequency; perhaps others too.
    """
    if isinstance(model.form, DamperSum):
        return model.form.poles(2.0 * np.pi * PEAK_MARGIN * to_hz)
    return model.form.poles()


def convert_receptance(
    receptance: ComplexArray, frequencies_hz: FloatArray, motion: Motion
) -> ComplexArray:
    """Return a receptance as receptance, mobility or accelerance: displacement, velocity or
    acceleration per unit load.

    Args:
        receptance: ``(n_freq, n_outputs, n_inputs)`` [m/N, rad/N, ...].
        frequencies_hz: ``(n_freq,)`` [Hz].
        motion: What the result is per unit load.

    Returns:
        ``(n_freq, n_outputs, n_inputs)``, the receptance times ``(i omega)^0``, ``^1`` or ``^2``.
    """
    factor = (2j * np.pi * frequencies_hz) ** DERIVATIVES[motion]
    return receptance * factor[:, None, None]


def _choose_form(
    coordinates: ModalCoordinates, direct: DirectResponse
) -> ModalSum | DamperSum | PoleSum | DirectResponse:
    free = not damps_rigid_motion(coordinates)
    if free and coordinates.damped_apart:
        return sum_over_modes(coordinates)
    dampers = sum_over_dampers(coordinates)
    if dampers is not None:
        return dampers
    if not free:
        return direct
    try:
        form = sum_over_poles(coordinates)
    except AccuracyError:
        form = None
    if form is not None and _agrees(form, direct):
        return form
    return sum_over_dampers(coordinates, MANY_DAMPERS) or direct


def _agrees(form: PoleSum, direct: DirectResponse) -> bool:
    """Return whether a sum over poles equals direct solves between poles, where no peak magnifies
    the roundoff of either.
    """
    sizes = np.sort(np.abs(form.poles()))
    sizes = sizes[np.isfinite(sizes)]
    gaps = sorted({int(share * (len(sizes) - 1)) for share in PROBED_QUANTILES})
    omega = np.array([np.sqrt(sizes[i] * sizes[min(i + 1, len(sizes) - 1)]) for i in gaps])
    expected, summed = direct.evaluate(omega), form.evaluate(omega)
    error = np.abs(summed - expected).max(axis=(1, 2))
    return bool((error <= AGREEMENT * np.abs(expected).max(axis=(1, 2))).all())


def _general_rest(direct: DirectResponse) -> FloatArray:
    """Return the static compliance of a system without modal coordinates; NaN where it has none."""
    system = dataclasses.replace(direct.system, damping=None, hysteretic=None)
    try:
        return direct.rows @ solve_static(system, direct.loads).displacements
    except ModelError:
        return np.full((len(direct.rows), direct.loads.shape[1]), np.nan)


def refine_grid(base_hz: FloatArray, poles: ComplexArray) -> FloatArray:
    """Return a grid with every pole's damped frequency in it and points from its half-power width
    outwards.

    Args:
        base_hz: ``(n,)`` rising [Hz]; its ends are the ends of the result.
        poles: At positive frequencies [rad/s]; real ones have no peak and are left out.

    Returns:
        ``(m,)`` rising, the base grid among them. An undamped resonance itself is left out.
    """
    base = np.asarray(base_hz, dtype=float)
    low, high = base[0], base[-1]
    grids = [base]
    for pole in np.asarray(poles)[np.asarray(poles).imag > 0.0]:
        center, width = pole.imag / (2.0 * np.pi), abs(pole.real) / (2.0 * np.pi)
        step = _local_step(base, center)
        if not low - step <= center <= high + step:
            continue
        bare = width < UNDAMPED * center
        offsets = _offsets(NEAREST * center if bare else width, step)
        offsets = offsets[offsets > 0.0] if bare else offsets
        grids.append(np.concatenate([center - offsets, center + offsets]))
    grid = np.unique(np.concatenate(grids))
    return grid[(grid >= low) & (grid <= high)]


def _local_step(base: FloatArray, center: float) -> float:
    if len(base) < 2:
        return 0.0
    index = int(np.clip(np.searchsorted(base, center), 1, len(base) - 1))
    return float(base[index] - base[index - 1])


def _offsets(width: float, step: float) -> FloatArray:
    """Return the distances from a resonance, out to the step of the even grid."""
    largest = OFFSETS[-1] * width
    count = (
        max(0, int(np.ceil(np.log(max(step / largest, 1.0)) / np.log(GROWTH))))
        if largest > 0.0
        else 0
    )
    outer = largest * GROWTH ** np.arange(1, count + 1)
    offsets = np.concatenate([width * np.array(OFFSETS), outer])
    return offsets[offsets <= max(step, width)]


@dataclass(frozen=True)
class StabilityFigures:
    """Of the response of a drive point: load and motion at the same channel.

    Attributes:
        most_negative_real: Most negative real part [m/N]; None where it is never negative.
        most_negative_real_hz: Its frequency [Hz].
        chatter_limit: ``-1 / (2 Re)`` [N/m]: over the cutting stiffness per width it is the
            width of cut below which no regenerative chatter occurs at any speed; None where the
            real part is never negative.
        minimum_dynamic_stiffness: Smallest dynamic stiffness ``1 / |H|`` [N/m].
        minimum_dynamic_stiffness_hz: Its frequency [Hz].
    """

    channel: Channel
    most_negative_real: float | None
    most_negative_real_hz: float | None
    chatter_limit: float | None
    minimum_dynamic_stiffness: float
    minimum_dynamic_stiffness_hz: float


def find_stability_figures(
    model: FrfModel, response: FrequencyResponse
) -> tuple[StabilityFigures, ...]:
    """Find the figures of every drive point (a channel that is both input and output), refined
    between the points of the grid.

    Args:
        model: What the response was computed from.
        response: On a grid that shows every peak; entries without a value are left out.

    Source: Tlusty and Polacek (1963); Altintas (2012), Manufacturing Automation, section 4.3: a_lim
    = -1 / (2 K_s Re G).
    """
    return tuple(
        _find_figures(model, response, channel)
        for channel in response.inputs
        if channel in response.outputs and not np.isnan(_entry(response, channel)).all()
    )


def _find_figures(
    model: FrfModel, response: FrequencyResponse, channel: Channel
) -> StabilityFigures:
    values = _entry(response, channel)
    row, column = response.outputs.index(channel), response.inputs.index(channel)
    real_parts, sizes = np.array(values.real, dtype=float), np.array(np.abs(values), dtype=float)

    def value_at(hz: float) -> complex:
        return complex(model.form.evaluate(np.array([2.0 * np.pi * hz]))[0, row, column])

    real_hz, real = _lowest(response.frequencies_hz, real_parts, lambda hz: value_at(hz).real)
    soft_hz, soft = _lowest(response.frequencies_hz, -sizes, lambda hz: -abs(value_at(hz)))
    negative = real < 0.0
    return StabilityFigures(
        channel=channel,
        most_negative_real=real if negative else None,
        most_negative_real_hz=real_hz if negative else None,
        chatter_limit=-0.5 / real if negative else None,
        minimum_dynamic_stiffness=-1.0 / soft,
        minimum_dynamic_stiffness_hz=soft_hz,
    )


def _lowest(
    frequencies_hz: FloatArray, values: FloatArray, function: Callable[[float], float]
) -> tuple[float, float]:
    """Return the frequency and value of the lowest point, by Brent's method between the neighbours
    of the lowest grid point; those without a value, such as rest where a motion is free, are left
    out.
    """
    finite = np.flatnonzero(~np.isnan(values))
    frequencies_hz, values = frequencies_hz[finite], values[finite]
    index = int(np.argmin(values))
    low, high = frequencies_hz[max(0, index - 1)], frequencies_hz[min(len(values) - 1, index + 1)]
    best = float(frequencies_hz[index]), float(values[index])
    if low == high:
        return best
    minimum = scipy.optimize.minimize_scalar(
        function, bounds=(low, high), method="bounded", options={"xatol": REFINEMENT * high}
    )
    return (float(minimum.x), float(minimum.fun)) if minimum.fun < best[1] else best


def _entry(response: FrequencyResponse, channel: Channel) -> ComplexArray:
    return response.receptance[:, response.outputs.index(channel), response.inputs.index(channel)]


def find_links(system: SecondOrderSystem, loads: FloatArray, rows: FloatArray) -> BoolArray:
    """Return whether something connects where a load acts with where motion is seen
    ``(n_outputs, n_inputs)``.

    Args:
        system: Without modal damping, whose roundoff connects everything.
        loads: ``(n, n_inputs)``.
        rows: ``(n_outputs, n)``.
    """
    connected = np.zeros(system.mass.shape, dtype=bool)
    for matrix in (system.mass, system.stiffness, system.damping, system.hysteretic):
        if matrix is not None:
            scale = np.sqrt(np.abs(np.diag(matrix)))
            connected |= np.abs(matrix) > UNCONNECTED * np.outer(scale, scale)
    count, part = connected_components(connected, directed=False)
    members = part == np.arange(count)[:, None]
    return np.asarray((rows != 0.0) @ members.T @ members @ (loads != 0.0) > 0)
