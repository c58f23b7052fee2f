"""Measured modes beside computed ones: pairs by shape, what is missing on either side, what is doubtful."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.results.short_forms import Displayed, ShortForm
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.storage.json_texts import find_known
from headstock.scene.test_data.records import MeasuredModes, TestChannel
from headstock.solvers.pairing.mode_pairing import (
    SAME_MODE,
    Field,
    ModePair,
    ModeSet,
    pair_modes,
)
from headstock.solvers.pairing.shape_agreement import agree_by_channel
from headstock.studies.correlation.modal_fit import ModalFit
from headstock.studies.correlation.responses import ComparedResponses

CERTAIN = 0.8  # MAC below which a pair is doubtful
MOST_LEFT_OUT = 3  # points that hide pairs
LEAST_GAIN = 1.0  # of the sum of MACs, for a point to be left out of the pairing
RIVAL = 0.1  # a further shape whose MAC is less than this below that of the pair rivals it
WITHIN = 0.05


@dataclass(frozen=True)
class CorrelatedMode:
    """A measured mode, a computed one, or both where they are a pair; None where there is no number.

    Attributes:
        measured: Index of the measured mode; None where it was not measured.
        computed: Index of the computed mode; None where the model has none.
        mac: Of the two shapes, or of the spaces of two clusters; of what is no pair the largest.
        deviation: Computed over measured frequency less one; None but for a pair.
        doubts: What speaks against the pair, in plain words.
        label: Name of the measured mode.
        measured_error_hz: ± of the measured frequency at 95 % [Hz].
        number: Of the computed mode, from 1, rigid-body modes first.
        name: Of the computed mode, by its energies; None where the model has none.
        computed_error_hz: ± of the computed frequency [Hz]; None where a source has no bound.
        computed_known_hz: The part of it that is known [Hz].
    """

    measured: int | None
    computed: int | None
    mac: float
    deviation: float | None = None
    doubts: tuple[str, ...] = ()
    cross_orthogonality: float | None = None
    label: str | None = None
    measured_hz: float | None = None
    measured_error_hz: float | None = None
    measured_damping: float | None = None
    phase_collinearity: float | None = None
    number: int | None = None
    name: str | None = None
    computed_hz: float | None = None
    computed_error_hz: float | None = None
    computed_known_hz: float | None = None
    computed_damping: float | None = None

    @property
    def title(self) -> str:
        """The measured frequency, or the computed one with its name."""
        if self.measured_hz is not None:
            return f"{self.measured_hz:.4g} Hz"
        return f"{self.computed_hz:.4g} Hz ({self.name})"

    @property
    def remark(self) -> str:
        """Return what is to be said of the pair, or of the mode that has no partner."""
        if self.name is None:
            return "missing in the model"
        return "not measured" if self.measured is None else "; ".join(self.doubts)


@dataclass(frozen=True)
class ComparedChannel:
    """A channel of a test.

    Attributes:
        comac: Coordinate MAC of the paired shapes; None where nothing moves there.
        ecomac: Their mean difference, which shows wrong signs and directions.
        distance_m: From the surface that carries its point; None where a sensor of the scene does.
    """

    channel: TestChannel
    comac: float | None
    ecomac: float | None
    distance_m: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Correlation(Displayed):
    """A measured machine beside its model in one pose.

    Attributes:
        variant: Variant of the scene; None for as written.
        fit: Measured modes with shapes at the channels that are compared, and their ±.
        computed: Modes of the model, with shapes ``(n_all, m)`` of its superelement dofs.
        shapes: ``(c, m)`` of the computed modes at the channels.
        range_hz: Frequencies between which the test looked.
        within: Relative deviation up to which a frequency is met.
        pairs: Measured and computed modes, paired by shape.
        left_out: Points that hid pairs: these were found without them.
        mac: ``(k, m)`` of single shapes.
        orthogonality: ``(k, m)`` cross-orthogonality with the mass of the reduced model; None where
            the channels do not suffice.
        responses: Measured and computed frequency responses; None without.
        distances: Point to its distance from the surface that carries it [m].
        sensors: Measured point to its sensor in the model.
        rotation: ``(3, 3)`` from the axes of the test to those of the machine.
        names: Of the measured modes, from a test before the machine was modified; empty ones of new
            modes, and none without such a test.
        since_base: Modes whose order has changed since that test.
        faulty: Sensor and direction of channels that look wrong.
        faults: The same in plain words, and how.
        remarks: What was assumed.
        fit_files: Files for a fit, by name: targets, with the sensors that the scene lacks.
        view: Measured and computed shapes side by side, one for each of ``modes``.
    """

    scene: str
    test: str
    variant: str | None
    fit: ModalFit
    computed: PoseModes
    shapes: Field
    range_hz: tuple[float, float]
    within: float
    pairs: tuple[ModePair, ...]
    mac: FloatArray
    left_out: tuple[str, ...] = ()
    orthogonality: FloatArray | None = None
    responses: ComparedResponses | None = None
    distances: dict[str, float] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    names: tuple[str, ...] = ()
    since_base: tuple[str, ...] = ()
    faulty: frozenset[tuple[str, str]] = frozenset()
    faults: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    fit_files: dict[str, str] = field(default_factory=dict)
    view: MachineView | None = None

    @property
    def measured(self) -> MeasuredModes:
        """Measured modes."""
        return self.fit.modes

    @property
    def mode_names(self) -> tuple[str, ...]:
        """Name of each measured mode; empty where it has none."""
        return self.names or ("",) * len(self.measured.frequencies_hz)

    @property
    def pose(self) -> str:
        """Pose of the model."""
        return self.computed.pose.name

    @property
    def channels(self) -> tuple[TestChannel, ...]:
        """Points and directions in which shapes are compared."""
        return self.measured.channels

    @cached_property
    def modes(self) -> tuple[CorrelatedMode, ...]:
        """Pairs and measured modes that the model lacks by measured frequency, then computed modes in
        the range that were not measured.
        """
        by_measured = {pair.first: pair for pair in self.pairs}
        rows = [
            self._describe(index, by_measured.get(index))
            for index in range(len(self.measured.frequencies_hz))
        ]
        paired = {pair.second for pair in self.pairs}
        low, high = self.range_hz
        for index, hz in enumerate(self.computed.frequencies_hz):
            elastic = index >= self.computed.rigid_count
            if elastic and index not in paired and low <= hz <= high:
                mac = float(self.mac[:, index].max(initial=0.0))
                rows.append(CorrelatedMode(None, index, mac, **self._describe_computed(index)))
        return tuple(rows)

    def _describe(self, index: int, pair: ModePair | None) -> CorrelatedMode:
        """Return a measured mode with its partner."""
        hz, modes = float(self.measured.frequencies_hz[index]), self.measured
        row = CorrelatedMode(
            index,
            None,
            float(self.mac[index].max(initial=0.0)),
            label=self.mode_names[index] or None,
            measured_hz=hz,
            measured_error_hz=find_known(self.fit.frequency_errors[index]),
            measured_damping=find_known(modes.damping[index]),
            phase_collinearity=find_known(self.fit.collinearity[index]),
        )
        if pair is None:
            return row
        table, second = self.orthogonality, pair.second
        return dataclasses.replace(
            row,
            computed=second,
            mac=float(self.mac[index, second]) if self.left_out else pair.correlation,
            deviation=float(self.computed.frequencies_hz[second]) / hz - 1.0,
            doubts=tuple(self._doubt(pair)),
            cross_orthogonality=None if table is None else float(table[index, second]),
            **self._describe_computed(second),
        )

    def _describe_computed(self, index: int) -> dict[str, Any]:
        """Return the fields of a computed mode."""
        modes = self.computed
        error = modes.list_errors()[index]
        return {
            "number": modes.below + index + 1,
            "name": modes.mode_names[index],
            "computed_hz": float(modes.frequencies_hz[index]),
            "computed_error_hz": error.total,
            "computed_known_hz": error.known,
            "computed_damping": modes.damping_ratio[index],
        }

    def list_channels(self) -> list[ComparedChannel]:
        """Return the channels with the agreement of the paired shapes in each."""
        first, second = ([getattr(p, side) for p in self.pairs] for side in ("first", "second"))
        agreement = agree_by_channel(self.measured.shapes[:, first], self.shapes[:, second])
        return [
            ComparedChannel(
                channel, find_known(comac), find_known(ecomac), self.distances.get(channel.point)
            )
            for channel, comac, ecomac in zip(self.channels, *agreement, strict=True)
        ]

    @property
    def verdict(self) -> tuple[str, ...]:
        """Sentences that a reader wants first."""
        paired = [row for row in self.modes if row.deviation is not None]
        lists = {
            "missing in the model": [row for row in self.modes if row.computed is None],
            "computed, but not measured": [row for row in self.modes if row.measured is None],
            "doubtful pairs": [row for row in paired if row.doubts],
        }
        return (
            self._count_met(paired),
            *(
                f"{what}: {', '.join(row.title for row in rows)}"
                for what, rows in lists.items()
                if rows
            ),
            *_name_exchanges(paired),
            *(f"paired without point {point}, which hides the pairs" for point in self.left_out),
            *self.since_base,
            *self.faults,
        )

    def _count_met(self, paired: Sequence[CorrelatedMode]) -> str:
        """Say how many measured modes are met, and which one least."""
        sizes = [abs(row.deviation or 0.0) for row in paired]
        met, count = sum(size <= self.within for size in sizes), len(self.measured.frequencies_hz)
        text = f"{met} of {count} measured modes are met within {100 * self.within:g} %"
        if not paired:
            return text
        worst = paired[int(np.argmax(sizes))]
        return f"{text}; largest deviation {100 * (worst.deviation or 0.0):+.1f} % ({worst.title})"

    def _doubt(self, pair: ModePair) -> Iterator[str]:
        """Yield what speaks against a pair."""
        first, second = pair.first, pair.second
        row, alone = self.mac[first], float(self.mac[first, second])
        if self.left_out:  # what single shapes look like says little then
            if pair.correlation < CERTAIN:
                yield f"MAC {pair.correlation:.2f} without {', '.join(self.left_out)}"
            return
        if pair.correlation < CERTAIN:
            yield f"MAC {pair.correlation:.2f}"
        if pair.correlation > alone + RIVAL:
            yield f"close modes, compared as a space (MAC {alone:.2f} alone)"
            return
        for index in np.flatnonzero(row > max(alone - RIVAL, SAME_MODE)):
            if index != second:
                number = self.computed.below + int(index) + 1
                yield f"looks like computed mode {number} as well (MAC {row[index]:.2f})"

    def _short_form(self) -> ShortForm:
        facts = [
            ("test", self.test),
            ("pose", self.pose),
            *(("verdict", sentence) for sentence in self.verdict),
        ]
        rows = [
            [
                "-" if row.measured_hz is None else f"{row.measured_hz:.5g}",
                "-" if row.computed_hz is None else f"{row.computed_hz:.5g}",
                "-" if row.deviation is None else f"{100 * row.deviation:+.1f} %",
                f"{row.mac:.2f}",
            ]
            for row in self.modes
        ]
        head = ["measured [Hz]", "computed [Hz]", "deviation", "MAC"]
        return ShortForm(f"Correlation of {self.scene} with {self.test}", facts, head, rows)


def _name_exchanges(paired: Sequence[CorrelatedMode]) -> Iterator[str]:
    """Yield neighbours that the model has in the other order: pairing by frequency would hide it."""
    for one, other in itertools.pairwise(paired):
        if (one.computed or 0) > (other.computed or 0):
            yield f"the model has the modes at {one.title} and {other.title} in the other order"


def pair_shapes(
    measured: MeasuredModes, computed: PoseModes, shapes: Field
) -> tuple[ModePair, ...]:
    """Return the measured and computed modes that are the same.

    Args:
        shapes: ``(c, m)`` computed, at the channels of the measured ones.
    """
    model = ModeSet(computed.frequencies_hz, shapes, computed.rigid_count)
    return pair_modes(ModeSet(measured.frequencies_hz, measured.shapes), model)


def pair_by_most(
    measured: MeasuredModes, computed: PoseModes, shapes: Field
) -> tuple[tuple[ModePair, ...], tuple[str, ...]]:
    """Return the same by the points that agree: a few that hide pairs are left out one by one, and
    named.
    """
    pairs, left_out = pair_shapes(measured, computed, shapes), tuple[str, ...]()
    points = np.array([channel.point for channel in measured.channels])
    while len(left_out) < MOST_LEFT_OUT and _sum_up(pairs) < CERTAIN * len(measured.frequencies_hz):
        tried = {}
        for point in dict.fromkeys(points.tolist()):
            kept = ~np.isin(points, [*left_out, point])
            known = dataclasses.replace(measured, shapes=measured.shapes[kept])
            tried[point] = pair_shapes(known, computed, shapes[kept]) if kept.any() else ()
        best = max(tried, key=lambda point: _sum_up(tried[point]))
        if _sum_up(tried[best]) < _sum_up(pairs) + LEAST_GAIN:
            break
        pairs, left_out = tried[best], (*left_out, best)
    return pairs, left_out


def _sum_up(pairs: Sequence[ModePair]) -> float:
    return sum(pair.correlation for pair in pairs)
