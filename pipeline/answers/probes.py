"""Displacement and stress at probes as results, under static loads and over frequency: the types, and
how they read in ``summary.json`` and ``results.h5``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.estimates import (
    Estimate,
    list_left_out,
    scale_known,
    scale_shares,
    scale_total,
)
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.pipeline.storage.json_texts import check_finite
from headstock.scene.scene import LOAD
from headstock.solvers.control.drive_trains import COMMANDS
from headstock.solvers.second_order import Channel, ComplexArray, is_rotation
from headstock.solvers.stresses import STRESS_NAMES, largest_von_mises

MICRO, MEGA = 1e6, 1e-6  # from m to µm, from Pa to MPa
KILO = 1e3  # per N to per kN
ROUNDING = 1e-12


# of a probe of a frequency response: equivalent stresses are the largest over a cycle, and the
# stress at their peak is real and imaginary part
CURVES_KEYS = """
    component singular inputs[](input[] unit static_von_mises peak_von_mises peak_von_mises_error
    peak_von_mises_error_share.* peak_hz peak_stress.*[] displacement_unit peak_displacement[])"""


@dataclass(frozen=True, eq=False)
class ProbeResponse:
    """Response of a component to all static loads together at a probe, in machine axes.

    Attributes:
        displacement: ``(3,)`` [m].
        stress: ``(6,)`` xx yy zz xy xz yz [Pa].
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
    """

    component: str
    displacement: FloatArray
    stress: FloatArray
    singular: str = ""

    @property
    def von_mises(self) -> float:
        """Equivalent stress [Pa]."""
        return float(largest_von_mises(self.stress))

    @property
    def shown_displacement(self) -> FloatArray:
        """The displacement ``(3,)`` without rounding noise [m]."""
        return _clear(self.displacement, float(np.linalg.norm(self.displacement)))

    @property
    def shown_stress(self) -> FloatArray:
        """The stress ``(6,)`` without rounding noise [Pa]."""
        return _clear(self.stress, self.von_mises)


@dataclass(frozen=True, eq=False)
class ProbeAnswer(Answer):
    """Responses at all probes in one pose."""

    pose: str
    probes: dict[str, ProbeResponse]
    units: ClassVar[dict[str, str]] = {
        r"probes/.*/displacement(_error)?": "m",
        r"probes/.*/stress(_error)?": "Pa",
    }
    entry: ClassVar[str] = "probes"
    keys: ClassVar[str] = """probes.*.*(component displacement_um[] displacement_error_um[]
        stress_mpa.* stress_error_mpa.* von_mises_mpa von_mises_error_mpa singular error_left_out[])"""

    def list_numbers(self) -> Iterator[Number]:
        """Yield displacements, stresses and equivalent stresses."""
        for name, probe in self.probes.items():
            values = (*probe.displacement, *probe.stress, largest_von_mises(probe.stress))
            for key, value in zip(probe_keys(self.pose, name), values, strict=True):
                unit = "m" if key.kind == "probe_displacement" else "Pa"
                yield Number(key, float(value), unit, self.errors.get(key))

    def summarise(self) -> dict[str, Entry]:
        """Its probes as they stand in ``summary.json``.

        Raises:
            AccuracyError: A response is not a finite number.
        """
        return {
            name: _summarise_probe(
                name,
                probe,
                [self.error_of(key) for key in probe_keys(self.pose, name)],
            )
            for name, probe in self.probes.items()
        }

    def fill(self, file: "h5py.File") -> None:
        """Write displacements and stresses, NaN for errors that nobody knows."""
        for name, probe in self.probes.items():
            group = file.create_group(f"probes/{self.pose}/{name}")
            group["displacement"], group["stress"] = probe.displacement, probe.stress
            totals = [
                np.nan if (total := self.error_of(key).total) is None else total
                for key in probe_keys(self.pose, name)
            ]
            group["displacement_error"] = np.array(totals[:3])
            group["stress_error"] = np.array(totals[3:-1])


def probe_keys(pose: str, probe: str) -> tuple[Key, ...]:
    """Return the keys of displacement along x, y, z, of six stresses and of the equivalent stress."""
    at = {"pose": pose, "probe": probe}
    moved = (make_key("probe_displacement", direction=each, **at) for each in DIRECTIONS)
    names = (*STRESS_NAMES, "von_mises")
    return (*moved, *(make_key("probe_stress", component=each, **at) for each in names))


class ProbePeak(NamedTuple):
    """The largest equivalent stress over a cycle, and the one at rest [Pa per unit]; the place of its
    frequency.
    """

    place: int
    size: float
    error: Estimate
    static: float | None


@dataclass(frozen=True, eq=False)
class ProbeCurves:
    """Displacement and stress at a probe over frequency, machine axes: complex amplitudes per unit
    force or moment, or under a whole load of the scene.

    Attributes:
        inputs: ``k`` channels at which loads act.
        frequencies_hz: ``(n,)``.
        displacement: ``(n, 3, k)`` [m per unit]; NaN where there is no value.
        stress: ``(n, 6, k)`` xx yy zz xy xz yz [Pa per unit].
        displacement_error_share: Source of error to its size ``(n, 3, k)``; empty where none was
            sought, NaN where there is no bound.
        stress_error_share: The same ``(n, 6, k)``.
        von_mises_error_share: The same of the largest equivalent stress over a cycle ``(n, k)``.
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
    """

    name: str
    component: str
    inputs: tuple[Channel, ...]
    frequencies_hz: FloatArray
    displacement: ComplexArray
    stress: ComplexArray
    displacement_error_share: Mapping[str, FloatArray] = field(default_factory=dict)
    stress_error_share: Mapping[str, FloatArray] = field(default_factory=dict)
    von_mises_error_share: Mapping[str, FloatArray] = field(default_factory=dict)
    singular: str = ""

    @property
    def von_mises(self) -> FloatArray:
        """Largest equivalent stress over a cycle ``(n, k)`` [Pa per unit]."""
        return largest_von_mises(self.stress.swapaxes(1, 2))

    @property
    def von_mises_error(self) -> FloatArray | None:
        """Error by all sources together; None where none was sought."""
        parts = list(self.von_mises_error_share.values())
        return np.asarray(np.sum(parts, axis=0)) if parts else None

    def find_peak(self, column: int) -> "ProbePeak | None":
        """Return the largest equivalent stress under a load at an input; None where there is no value."""
        mises = self.von_mises[:, column]
        known = np.flatnonzero(np.isfinite(mises))
        if not len(known):
            return None
        top = int(known[np.argmax(mises[known])])
        at_rest = self.frequencies_hz[0] == 0.0 and np.isfinite(mises[0])
        shares = {
            source: None if np.isnan(size[top, column]) else float(size[top, column])
            for source, size in self.von_mises_error_share.items()
        }
        return ProbePeak(
            top, float(mises[top]), Estimate(shares), float(mises[0]) if at_rest else None
        )

    def summarise(self) -> Entry:
        """Return where the equivalent stress is largest, by input."""
        return {
            "component": self.component,
            "singular": self.singular,
            "inputs": [_summarise_peak(self, column) for column in range(len(self.inputs))],
        }

    def fill(self, group: h5py.Group) -> None:
        """Write the curves, NaN where there is no value or bound."""
        group.attrs["component"], group.attrs["singular"] = self.component, self.singular
        group["displacement"], group["stress"] = self.displacement, self.stress
        group["von_mises"] = self.von_mises
        for what, shares in (
            ("displacement", self.displacement_error_share),
            ("stress", self.stress_error_share),
            ("von_mises", self.von_mises_error_share),
        ):
            for source, size in shares.items():
                group[f"{what}_error_share/{source}"] = size


def probe_units(given: Channel) -> tuple[str, str, float]:
    """Units of stress and displacement at a probe by an input, and the factor from per SI unit of the
    load; a load of the scene is as large as it is there.
    """
    if input_unit(given) == "N":
        return "MPa/kN", "µm/kN", KILO
    return per_input("MPa", given), per_input("µm", given), 1.0


def input_unit(given: Channel) -> str:
    """Return the unit of an input; empty of a whole load of the scene."""
    if given[1] == LOAD:
        return ""
    if given[1] in COMMANDS:
        return "rad" if is_rotation(given) else "m"
    return "N m" if is_rotation(given) else "N"


def per_input(unit: str, given: Channel) -> str:
    """Return a unit per that of an input; under a whole load of the scene it stays."""
    per = input_unit(given)
    return f"{unit}/{f'({per})' if ' ' in per else per}" if per else unit


def _summarise_peak(curves: ProbeCurves, column: int) -> Entry:
    given, peak = curves.inputs[column], curves.find_peak(column)
    stress_unit, displacement_unit, per = probe_units(given)
    summary: Entry = {
        "input": list(given),
        "unit": stress_unit,
        "static_von_mises": None,
        "peak_von_mises": None,
        "peak_von_mises_error": None,
        "peak_von_mises_error_share": {},
        "peak_hz": None,
        "peak_stress": {},
        "displacement_unit": displacement_unit,
        "peak_displacement": [],
    }
    if peak is None:
        return summary
    top, factor = peak.place, per * MEGA
    shares = scale_shares(peak.error, factor)
    return summary | {
        "static_von_mises": scale_known(peak.static, factor),
        "peak_von_mises": factor * peak.size,
        "peak_von_mises_error": Estimate(shares).total,
        "peak_von_mises_error_share": shares,
        "peak_hz": float(curves.frequencies_hz[top]),
        "peak_stress": {
            name: [factor * float(value.real), factor * float(value.imag)]
            for name, value in zip(STRESS_NAMES, curves.stress[top, :, column], strict=True)
        },
        "peak_displacement": [
            per * MICRO * float(size) for size in np.abs(curves.displacement[top, :, column])
        ],
    }


def _summarise_probe(name: str, probe: ProbeResponse, errors: list[Estimate]) -> Entry:
    what = f"response at probe {name}"
    moved, stress = MICRO * probe.shown_displacement, MEGA * probe.shown_stress
    return {
        "component": probe.component,
        "displacement_um": check_finite(what, moved),
        "displacement_error_um": [scale_total(each, MICRO) for each in errors[:3]],
        "stress_mpa": dict(zip(STRESS_NAMES, check_finite(what, stress), strict=True)),
        "stress_error_mpa": dict(
            zip(STRESS_NAMES, (scale_total(each, MEGA) for each in errors[3:-1]), strict=True)
        ),
        "von_mises_mpa": probe.von_mises * MEGA,
        "von_mises_error_mpa": scale_total(errors[-1], MEGA),
        "singular": probe.singular,
        "error_left_out": list_left_out(errors[:-1]),
    }


def _clear(values: FloatArray, scale: float) -> FloatArray:
    """Zeros for what rounding leaves beside numbers of a scale."""
    return np.where(np.abs(values) < ROUNDING * scale, 0.0, values)
