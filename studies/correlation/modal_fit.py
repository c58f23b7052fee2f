"""Poles and shapes of a test: fitted to its frequency responses, or taken from its file."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.json_texts import find_known
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import (
    ComplexArray,
    MeasuredModes,
    MeasuredResponses,
    TestData,
    same_line,
)
from headstock.scene.test_data.responses import label_channel
from headstock.solvers.modal_fitting.candidates import OrderPoles
from headstock.solvers.modal_fitting.modal_model import ModalModel
from headstock.solvers.modal_fitting.pole_fit import PoleFit, fit_poles
from headstock.solvers.modal_fitting.shape_scale import (
    mean_phases,
    one_shape_shares,
    phase_collinearity,
    scale_deviations,
    scale_shapes,
    unit_shapes,
)
from headstock.solvers.modal_fitting.stabilisation import MOST_DAMPING, damping_ratios
from headstock.solvers.pairing.shape_agreement import response_assurance

ORDER, LEAST_ORDER = 60, 4
LEAST_LINES = 20
COVERAGE = 1.96  # standard deviations behind ±: 95 %
SAME_DIRECTION = 1e-3  # of the cosine, within which motion and force at a point are along one line
DOUBTFUL_SCALE = 0.1  # ± of the scale of a mode from where it is said
AGREEING = 0.8  # share of residues at driving points that one scale explains
IntArray = NDArray[np.int64]
Source = Literal["file", "noise", "residuals"]


@dataclass(frozen=True)
class FittedMode:
    """A mode of a fit; None for what is not known.

    Attributes:
        frequency_error_hz: ± at 95 % [Hz].
        damping_error: The same of the damping ratio.
        orders: At how many orders of the model it appears.
    """

    frequency_hz: float
    orders: int
    frequency_error_hz: float | None = None
    damping_ratio: float | None = None
    damping_error: float | None = None
    phase_collinearity: float | None = None
    mean_phase_rad: float | None = None
    one_shape: float | None = None


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Poles and shapes of a test, and how good they are.

    Attributes:
        modes: Frequencies, damping, shapes.
        frequency_errors: ``(k,)`` ± of the frequencies at 95 % [Hz]; nan where unknown.
        damping_errors: ``(k,)`` ± of the damping ratios at 95 %.
        source: Where ± comes from: noise that was given with the responses, or what the fit leaves of
            them; ``file`` where modes were taken from the file.
        collinearity: ``(k,)`` modal phase collinearity of the shapes.
        mean_phases: ``(k,)`` angle of the line in the complex plane that shapes lie along [rad].
        one_shape: ``(k,)`` share of a mode's residues that one shape explains.
        orders: ``(k,)`` at how many orders of the model it appears.
        steps: Poles of all orders, one list per band: the stabilisation diagram.
        responses: The responses that were fitted; None where modes were taken from the file.
        synthesised: ``(l, m, f)`` responses of the fitted model.
        assurance: ``(m, f)`` frequency response assurance criterion of each pair; nan where not
            measured.
        remarks: What the reader of the numbers must know.
    """

    modes: MeasuredModes
    frequency_errors: FloatArray
    damping_errors: FloatArray
    source: Source
    collinearity: FloatArray
    mean_phases: FloatArray
    one_shape: FloatArray
    orders: IntArray
    steps: tuple[tuple[OrderPoles, ...], ...] = ()
    responses: MeasuredResponses | None = None
    synthesised: ComplexArray | None = None
    assurance: FloatArray | None = None
    remarks: tuple[str, ...] = ()

    def list_modes(self) -> list[FittedMode]:
        """Return the modes in rows."""
        modes = self.modes
        columns = (
            *(self.frequency_errors, modes.damping, self.damping_errors, self.collinearity),
            *(self.mean_phases, self.one_shape),
        )
        rows = zip(modes.frequencies_hz, *columns, self.orders, strict=True)
        return [
            FittedMode(float(hz), int(orders), *map(find_known, numbers))
            for hz, *numbers, orders in rows
        ]


def read_modes(
    data: TestData,
    name: str,
    *,
    band: tuple[float, float] | None = None,
    order: int = ORDER,
    references: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> ModalFit:
    """Fit modes to the frequency responses of a test, or take those of a file that has none.

    Args:
        name: Of the file, for messages.
        band: Lowest and highest frequency that is used [Hz]; all lines by default.
        order: Highest order of the stabilisation diagram.
        references: Points or channels, such as ``3`` or ``3:+z``, that are used of the forces, or of the
            motions where these are fewer; all by default.
        progress: Receives what is done.

    Raises:
        MeasurementError: The test has neither, or no such reference, or too few lines.
    """
    try:
        if data.responses is not None:
            chosen = _choose_references(data.responses, references)
            return _fit_responses(chosen, band=band, order=order, progress=progress)
    except MeasurementError as error:
        raise MeasurementError(f"{name}:1: {error}") from error
    if data.modes is None:
        raise MeasurementError(
            f"{name}:1: holds no modes and no frequency responses; export them as UFF 55 or 58"
        )
    return pass_modes(data.modes)


def _choose_references(
    responses: MeasuredResponses, references: Sequence[str]
) -> MeasuredResponses:
    """Return the responses of some references."""
    if not references:
        return responses
    by_motion = len(responses.forces) > len(responses.motions)
    channels = responses.motions if by_motion else responses.forces
    names = [{channel.point, label_channel(channel)} for channel in channels]
    for name in references:
        if not any(name in labels for labels in names):
            known = ", ".join(map(label_channel, channels))
            raise MeasurementError(f"no reference {name}; choose of {known}")
    kept = [index for index, labels in enumerate(names) if labels.intersection(references)]
    return responses.pick(motions=kept) if by_motion else responses.pick(forces=kept)


def _fit_responses(
    responses: MeasuredResponses,
    *,
    band: tuple[float, float] | None = None,
    order: int = ORDER,
    progress: Callable[[str], None] = lambda _: None,
) -> ModalFit:
    """Fit poles and shapes to frequency responses.

    Where fewer motions than forces were measured (a hammer that goes from point to point), the
    shapes are those at the forces.

    Args:
        band: Lowest and highest frequency that is used [Hz]; all lines by default.
        order: Highest order of the stabilisation diagram.
        progress: Receives what is done.

    Raises:
        MeasurementError: Fewer lines than a fit needs, or responses without a common reference.
    """
    used = _choose_lines(responses, band)
    turned = len(used.forces) > len(used.motions)
    given = used.exchange() if turned else used
    if not np.isfinite(given.values[0]).all(axis=1).any():
        names = ", ".join(map(label_channel, given.forces))
        raise MeasurementError(
            f"no channel was measured together with all references ({names}); leave some out"
        )
    found = fit_poles(
        given.frequencies_hz,
        given.values,
        order=order,
        deviations=given.deviations,
        progress=progress,
    )
    kept = _resonances(found.model, given.frequencies_hz)
    model = dataclasses.replace(
        found.model,
        poles=found.model.poles[kept],
        participations=found.model.participations[:, kept],
        shapes=found.model.shapes[:, kept],
        shape_deviations=found.model.shape_deviations[:, kept],
    )
    pairs = _driving_points(given)
    agreement: FloatArray = np.full(len(kept), np.nan)
    scale_errors = agreement
    if pairs:
        found_shapes, agreement = scale_shapes(model, pairs)
        scale_errors = np.asarray(COVERAGE * scale_deviations(model, pairs), dtype=np.float64)
    else:
        found_shapes = unit_shapes(model.shapes)
    shapes = np.asarray(found_shapes, dtype=np.complex128)
    modes = MeasuredModes(
        np.abs(model.poles) / (2.0 * np.pi),
        damping_ratios(model.poles),
        given.motions,
        shapes,
        scaled=bool(pairs),
    )
    fitted = np.asarray(found.model.evaluate(given.frequencies_hz), dtype=np.complex128)
    synthesised = fitted.transpose(0, 2, 1) if turned else fitted
    frequency_errors, damping_errors = _pole_errors(found, kept)
    return ModalFit(
        modes,
        frequency_errors,
        damping_errors,
        source="residuals" if given.deviations is None else "noise",
        collinearity=phase_collinearity(shapes),
        mean_phases=mean_phases(shapes),
        one_shape=one_shape_shares(found.model, given.frequencies_hz, given.values)[kept],
        orders=np.array([len(found.clusters[number].orders) for number in kept]),
        steps=found.steps,
        responses=used,
        synthesised=synthesised,
        assurance=response_assurance(used.values, synthesised),
        remarks=tuple(_remarks(modes, given, agreement, scale_errors, turned=turned)),
    )


def pass_modes(modes: MeasuredModes) -> ModalFit:
    """Return modes that a file brought, as they are."""
    unknown = np.full(len(modes.frequencies_hz), np.nan)
    return ModalFit(
        modes,
        unknown,
        unknown,
        source="file",
        collinearity=phase_collinearity(modes.shapes),
        mean_phases=mean_phases(modes.shapes),
        one_shape=unknown,
        orders=np.zeros(len(unknown), dtype=np.int64),
    )


def _choose_lines(
    responses: MeasuredResponses, band: tuple[float, float] | None
) -> MeasuredResponses:
    """Return the lines within a band where all pairs that were measured have a value, and channels
    that were measured at all.
    """
    low, high = band or (0.0, np.inf)
    hz, measured = responses.frequencies_hz, np.isfinite(responses.values)
    pairs: NDArray[np.bool_] = np.any(measured, axis=0)
    lines = (hz > 0.0) & (hz >= low) & (hz <= high) & (measured | ~pairs).all(axis=(1, 2))
    if lines.sum() < LEAST_LINES:
        asked = "" if band is None else f" from {low:g} to {high:g} Hz"
        ends = f"from {hz[0]:g} to {hz[-1]:g} Hz" if len(hz) else "empty"
        raise MeasurementError(
            f"{int(lines.sum())} lines{asked}, and a fit needs {LEAST_LINES}; "
            f"the responses are {ends}: choose another band"
        )
    motions, forces = np.flatnonzero(pairs.any(axis=1)), np.flatnonzero(pairs.any(axis=0))
    return responses.pick(lines=np.flatnonzero(lines), motions=motions, forces=forces)


def _resonances(model: ModalModel, frequencies_hz: FloatArray) -> IntArray:
    """Return which modes lie within the lines and are damped as resonances are; the others stand for
    what is outside.
    """
    hz = np.abs(model.poles) / (2.0 * np.pi)
    inside = (hz >= frequencies_hz[0]) & (hz <= frequencies_hz[-1])
    return np.flatnonzero(inside & (damping_ratios(model.poles) < MOST_DAMPING))


def _driving_points(responses: MeasuredResponses) -> list[tuple[int, int, float]]:
    """Return motion, force and cosine of pairs at one point along one line."""
    cosines = [
        [same_line(motion, force, SAME_DIRECTION) for force in responses.forces]
        for motion in responses.motions
    ]
    signs = np.where(np.isfinite(responses.values[0]), cosines, 0.0)
    # force by force
    return [(int(m), int(f), float(signs[m, f])) for f, m in np.argwhere(signs.T)]


def _pole_errors(found: PoleFit, kept: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return ± of frequencies ``(k,)`` [Hz] and damping ratios ``(k,)`` at 95 %."""
    poles, covariances = found.model.poles[kept], found.covariances[kept]
    sizes = np.abs(poles)
    along = np.stack([poles.real, poles.imag], axis=1) / sizes[:, None]
    # of |p|, and of -Re p / |p|
    damping = (along * poles.real[:, None] / sizes[:, None] - np.array([1.0, 0.0])) / sizes[:, None]
    frequency = along / (2.0 * np.pi)
    errors = (
        COVERAGE * np.sqrt(np.einsum("ki,kij,kj->k", slope, covariances, slope))
        for slope in (frequency, damping)
    )
    frequency_errors, damping_errors = errors
    return frequency_errors, damping_errors


def _remarks(
    modes: MeasuredModes,
    responses: MeasuredResponses,
    agreement: FloatArray,
    scale_errors: FloatArray,
    *,
    turned: bool,
) -> Iterator[str]:
    """Say what a reader of the modes must know."""
    if turned:
        yield "fewer motions than forces: by reciprocity, shapes are those at the forces"
    if not modes.scaled:
        yield "no driving point: shapes have no scale, their largest motion is 1"
    for number, (share, error) in enumerate(zip(agreement, scale_errors, strict=True)):
        head = f"mode {number + 1} at {modes.frequencies_hz[number]:.4g} Hz"
        if share < AGREEING:
            yield f"{head}: driving points agree to {100.0 * share:.0f} %, its scale is doubtful"
        elif error > DOUBTFUL_SCALE:
            yield f"{head} hardly moves the driving points: its scale is known to ± {error:.0%}"
    spacing = float(np.median(np.diff(responses.frequencies_hz)))
    for number, hz in enumerate(modes.frequencies_hz):
        width = 2.0 * float(modes.damping[number]) * float(hz)
        if width < spacing:
            yield (
                f"mode {number + 1} at {hz:.4g} Hz is {width:.2g} Hz wide, lines are {spacing:.2g} Hz "
                "apart: its damping hangs on few lines"
            )
