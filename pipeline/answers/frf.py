"""Frequency responses as results: the type, and how it reads in ``summary.json`` and
``results.h5``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.answers.probes import CURVES_KEYS, ProbeCurves, per_input
from headstock.pipeline.answers.static import N_PER_UM, UM_PER_KN
from headstock.pipeline.numbers.estimates import Estimate, scale_known, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, Series, make_key
from headstock.solvers.linear.frequency_response import convert_receptance
from headstock.solvers.pairing.response_peaks import ResponseLevel, ResponsePeak
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    Motion,
    is_rotation,
    name_channel,
)

Spacing = Literal["linear", "log"]
type Height = ResponsePeak | ResponseLevel


# keys in SI are those of rotations and moments; lines are sizes of the receptance at even steps of
# the range, whatever the machine: they compare runs
DRIVE_POINT_KEYS = """
    dof[] most_negative_real_hz most_negative_real_error_share.* minimum_dynamic_stiffness_hz
    minimum_dynamic_stiffness_mode truncation_share lines_hz[] lines_um_per_kN[] lines_SI[]
    static_um_per_kN most_negative_real_um_per_kN most_negative_real_error_um_per_kN
    chatter_limit_N_per_um minimum_dynamic_stiffness_N_per_um static_SI most_negative_real_SI
    most_negative_real_error_SI chatter_limit_SI minimum_dynamic_stiffness_SI"""


@dataclass(frozen=True, eq=False)
class DrivePointFigures:
    """What the response at one drive point to a load there says about cutting.

    Attributes:
        static: Compliance at 0 Hz [m/N or rad/(N m)]; None for a free body.
        most_negative_real: Most negative real part; None where there is none, or the response is unbounded.
        most_negative_real_hz: Its frequency [Hz].
        chatter_limit: ``-1 / (2 Re)`` [N/m]: width of cut without chatter times the cutting
            stiffness per width.
        minimum_dynamic_stiffness: Smallest dynamic stiffness; None where the response is unbounded.
        minimum_dynamic_stiffness_hz: Its frequency [Hz].
        minimum_dynamic_stiffness_mode: Name of the natural mode nearest to it.
        truncation_share: Share of the static compliance that the modes up to the highest frequency
            miss: what a sum over them without static correction would lack.
        lines_hz: Even steps of the range, whatever the machine [Hz].
        lines: Size of the receptance there [m/N or rad/(N m)]; None where there is no value.
    """

    channel: Channel
    static: float | None
    most_negative_real: float | None = None
    most_negative_real_hz: float | None = None
    chatter_limit: float | None = None
    minimum_dynamic_stiffness: float | None = None
    minimum_dynamic_stiffness_hz: float | None = None
    minimum_dynamic_stiffness_mode: str = ""
    truncation_share: float | None = None
    lines_hz: tuple[float, ...] = ()
    lines: tuple[float | None, ...] = ()


class LineError(NamedTuple):
    """Error of lines of a response by one source, over the largest entry of the same line."""

    median_share: float
    largest_share: float
    largest_share_hz: float


class LineErrors(NamedTuple):
    """How far up there is a bound [Hz], and errors of lines by source; None where nothing is known."""

    bounded_to_hz: float
    sources: dict[str, LineError | None]


@dataclass(frozen=True, eq=False)
class ResponseCurves:
    """What is tabled and drawn of a frequency response.

    Attributes:
        inputs: Where loads act.
        outputs: Where motion is computed.
        frequencies_hz: ``(n,)``.
        receptance: ``(n, n_outputs, n_inputs)`` [m/N, ...]; NaN where there is no value.
        motion: What is tabled and drawn.
        error_share: Source of error to how far the receptance may be off by it ``(n, n_outputs,
            n_inputs)`` [m/N, ...]; NaN where there is no bound, empty where none was sought.
        probes: Displacement and stress inside components.
    """

    pose: str
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    frequencies_hz: FloatArray
    receptance: ComplexArray
    motion: Motion = "receptance"
    spacing: Spacing = "linear"
    error_share: Mapping[str, FloatArray] = field(default_factory=dict)
    probes: tuple[ProbeCurves, ...] = ()

    @property
    def error(self) -> FloatArray | None:
        """Error of the receptance by all sources together; None where none was sought."""
        if self.error_share:
            return np.asarray(np.sum(list(self.error_share.values()), axis=0))
        return None

    @property
    def line_errors(self) -> LineErrors | None:
        """Errors of lines by source; None where none was sought."""
        if self.error is None:
            return None
        seen = np.isfinite(self.receptance).all(axis=(1, 2))
        bounded = seen & np.isfinite(self.error).all(axis=(1, 2))
        lines = self.frequencies_hz[bounded]
        sources: dict[str, LineError | None] = {}
        for source, error in self.error_share.items():
            # where another source has no bound anywhere, this one still says what it knows
            known = bounded if bounded.any() else seen & np.isfinite(error).all(axis=(1, 2))
            if not known.any():
                sources[source] = None
                continue
            shares = error[known].max(axis=(1, 2)) / np.abs(self.receptance[known]).max(axis=(1, 2))
            worst = float(self.frequencies_hz[known][int(np.argmax(shares))])
            sources[source] = LineError(float(np.median(shares)), float(shares.max()), worst)
        return LineErrors(float(lines[-1]) if len(lines) else 0.0, sources)

    @property
    def value_errors(self) -> FloatArray | None:
        """The error in terms of what is tabled and drawn."""
        return None if self.error is None else self._convert(self.error)

    @property
    def value_error_share(self) -> dict[str, FloatArray]:
        """Its part by source."""
        return {source: self._convert(error) for source, error in self.error_share.items()}

    @property
    def values(self) -> ComplexArray:
        """Receptance, mobility or accelerance ``(n, n_outputs, n_inputs)``."""
        return convert_receptance(self.receptance, self.frequencies_hz, self.motion)

    def _convert(self, error: FloatArray) -> FloatArray:
        return np.asarray(
            np.abs(convert_receptance(error + 0j, self.frequencies_hz, self.motion)), dtype=float
        )


@dataclass(frozen=True, eq=False)
class PoseResponse(Answer):
    """Frequency response in one pose.

    Attributes:
        curves: What is tabled and drawn.
        method: ``modal``, ``dampers``, ``poles`` or ``direct``.
        free_body: Entries without a value at 0 Hz, as ``output / input``.
        singular_hz: Frequencies on the pole of an undamped mode.
        figures: Of every drive point, which is input and output.
        error_left_out: What is not in the errors, in plain words.
        peaks: That count, of every entry.
        levels: Below all resonances, of every entry.
    """

    curves: ResponseCurves
    method: str
    damped: bool
    free_body: tuple[str, ...]
    singular_hz: tuple[float, ...]
    figures: tuple[DrivePointFigures, ...]
    error_left_out: tuple[str, ...] = ()
    peaks: tuple[ResponsePeak, ...] = ()
    levels: tuple[ResponseLevel, ...] = ()
    units: ClassVar[dict[str, str]] = {
        r"frf/.*/(inputs|outputs)": "",
        r"frf/.*/frequencies_hz": "Hz",
        r"frf/.*/probes/.*/displacement(_error_share/.*)?": "m per N, N m or whole load, by directions and inputs",
        r"frf/.*/probes/.*/(stress|von_mises)(_error_share/.*)?": "Pa per N, N m or whole load",
        r"frf/.*/(receptance|error|error_share/.*)": "SI: m or rad per N, N m or whole load, by outputs and inputs",
    }
    entry: ClassVar[str] = "frf"
    keys: ClassVar[str] = f"""frf.*(inputs[][] outputs[][] from_hz to_hz points motion method damped
        free_body[] singular_hz[] error.*.** error_left_out[] drive_points[]({DRIVE_POINT_KEYS})
        peaks[](kind output[] input[] hz mode size_um_per_kN error_um_per_kN size_SI error_SI error_share.*)
        probes.*({CURVES_KEYS}))"""

    @property
    def place(self) -> str:
        """Its pose or point."""
        return self.curves.pose

    @property
    def heights(self) -> tuple[Height, ...]:
        """Peaks, then levels."""
        return (*self.peaks, *self.levels)

    def key(self, height: Height) -> Key:
        """Return the key of a peak or level."""
        output, given = self.curves.outputs[height.output], self.curves.inputs[height.given]
        at = {"output": " ".join(output), "input": " ".join(given)}
        if isinstance(height, ResponseLevel):
            return make_key("level", pose=self.curves.pose, **at)
        return make_key("peak", pose=self.curves.pose, mode=height.mode + 1, **at)

    def figure_key(self, channel: Channel) -> Key:
        """Return the key of the most negative real part at a drive point."""
        return make_key("negative_real", pose=self.curves.pose, output=" ".join(channel))

    def list_heights(self) -> Iterator[Number]:
        """Yield peaks and levels."""
        curves = self.curves
        for height in self.heights:
            unit = _response_unit(curves.outputs[height.output], curves.inputs[height.given])
            key = self.key(height)
            yield Number(key, height.height, unit, self.errors.get(key))

    def list_numbers(self) -> Iterator[Number]:
        """Yield peaks, levels and what drive points say about cutting, then stress peaks at probes."""
        yield from self.list_heights()
        pose = self.curves.pose
        for figures in self.figures:
            soft = _response_unit(figures.channel, figures.channel)
            stiff = "N/m" if soft == "m/N" else "N m/rad"
            if figures.most_negative_real is not None:
                key = self.figure_key(figures.channel)
                yield Number(key, figures.most_negative_real, soft, self.errors.get(key))
            if figures.minimum_dynamic_stiffness is not None:
                key = make_key("dynamic_stiffness", pose=pose, output=" ".join(figures.channel))
                yield Number(key, figures.minimum_dynamic_stiffness, stiff)
        for probe in self.curves.probes:
            for column, given in enumerate(probe.inputs):
                if (peak := probe.find_peak(column)) is not None:
                    at = {"pose": pose, "probe": probe.name, "input": " ".join(given)}
                    key = make_key("peak_frequency_stress", **at)
                    yield Number(key, peak.size, per_input("Pa", given), peak.error)

    def list_series(self) -> Iterator[Series]:
        """Yield the receptance of every entry over frequency."""
        curves = self.curves
        axes = {"frequency [Hz]": curves.frequencies_hz}
        for row, output in enumerate(curves.outputs):
            for column, given in enumerate(curves.inputs):
                yield Series(
                    f"receptance(pose={curves.pose},output={' '.join(output)},input={' '.join(given)})",
                    axes,
                    curves.receptance[:, row, column],
                    _response_unit(output, given),
                    {source: size[:, row, column] for source, size in curves.error_share.items()},
                )

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``; the curves are in ``results.h5`` and ``tables/``."""
        curves, errors = self.curves, self.curves.line_errors
        summary: Entry = {
            "inputs": [list(channel) for channel in curves.inputs],
            "outputs": [list(channel) for channel in curves.outputs],
            "from_hz": float(curves.frequencies_hz[0]),
            "to_hz": float(curves.frequencies_hz[-1]),
            "points": len(curves.frequencies_hz),
            "motion": curves.motion,
            "method": self.method,
            "damped": self.damped,
            "free_body": list(self.free_body),
            "singular_hz": list(self.singular_hz),
            "error": None if errors is None else _summarise_errors(errors),
            "error_left_out": list(self.error_left_out),
            "drive_points": [
                _summarise_drive_point(figures, self.error_of(self.figure_key(figures.channel)))
                for figures in self.figures
            ],
            "peaks": [self._summarise_height(height) for height in self.heights],
        }
        if curves.probes:
            summary["probes"] = {probe.name: probe.summarise() for probe in curves.probes}
        return summary

    def _summarise_height(self, height: Height) -> Entry:
        output, given = self.curves.outputs[height.output], self.curves.inputs[height.given]
        linear = output[1] in "xyz" and given[1] in "xyz"
        scale = UM_PER_KN if linear else 1.0
        own = self.error_of(self.key(height))
        size, error = scale * height.height, scale_total(own, scale)
        summary: Entry = {
            "kind": "level" if isinstance(height, ResponseLevel) else "peak",
            "output": list(output),
            "input": list(given),
            "hz": height.hz,
            "mode": 0 if isinstance(height, ResponseLevel) else height.mode + 1,
            "error_share": scale_shares(own, scale),
        }
        if linear:
            return summary | {"size_um_per_kN": size, "error_um_per_kN": error}
        return summary | {"size_SI": size, "error_SI": error}

    def fill(self, file: "h5py.File") -> None:
        """Write the curves."""
        _fill_curves(file.create_group(f"frf/{self.curves.pose}"), self.curves)


def _fill_curves(group: h5py.Group, curves: ResponseCurves) -> None:
    """Write the curves of a pose: receptance in SI, NaN where there is no value."""
    group["frequencies_hz"] = curves.frequencies_hz
    group["receptance"] = curves.receptance
    if curves.error is not None:
        group["error"] = curves.error
        for source, share in curves.error_share.items():
            group[f"error_share/{source}"] = share
    group.attrs["motion"], group.attrs["spacing"] = curves.motion, curves.spacing
    for name, channels in (("inputs", curves.inputs), ("outputs", curves.outputs)):
        group[name] = np.char.encode(
            np.array([name_channel(channel) for channel in channels]), "utf-8"
        )
    for probe in curves.probes:
        probe.fill(group.create_group(f"probes/{probe.name}"))


def _response_unit(output: Channel, given: Channel) -> str:
    """Return the unit of a receptance."""
    return per_input("rad" if is_rotation(output) else "m", given)


def _summarise_drive_point(figures: DrivePointFigures, off: Estimate) -> Entry:
    linear = figures.channel[1] in "xyz"
    soft, stiff = (UM_PER_KN, N_PER_UM) if linear else (1.0, 1.0)
    summary: Entry = {
        "dof": list(figures.channel),
        "most_negative_real_hz": figures.most_negative_real_hz,
        "most_negative_real_error_share": scale_shares(off, soft),
        "minimum_dynamic_stiffness_hz": figures.minimum_dynamic_stiffness_hz,
        "minimum_dynamic_stiffness_mode": figures.minimum_dynamic_stiffness_mode,
        "truncation_share": figures.truncation_share,
        "lines_hz": list(figures.lines_hz),
    }
    lines = [scale_known(value, soft) for value in figures.lines]
    static, worst = scale_known(figures.static, soft), scale_known(figures.most_negative_real, soft)
    chatter = scale_known(figures.chatter_limit, stiff)
    least = scale_known(figures.minimum_dynamic_stiffness, stiff)
    if linear:
        return summary | {
            "lines_um_per_kN": lines,
            "static_um_per_kN": static,
            "most_negative_real_um_per_kN": worst,
            "most_negative_real_error_um_per_kN": scale_total(off, soft),
            "chatter_limit_N_per_um": chatter,
            "minimum_dynamic_stiffness_N_per_um": least,
        }
    return summary | {
        "lines_SI": lines,
        "static_SI": static,
        "most_negative_real_SI": worst,
        "most_negative_real_error_SI": scale_total(off, soft),
        "chatter_limit_SI": chatter,
        "minimum_dynamic_stiffness_SI": least,
    }


def _summarise_errors(errors: LineErrors) -> Entry:
    shares = {name: one and one._asdict() for name, one in errors.sources.items()}
    return {"bounded_to_hz": errors.bounded_to_hz, **shares}
