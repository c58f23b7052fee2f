"""Variants of a machine side by side: which modes are the same, and how far apart they are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.results.short_forms import Displayed, ShortForm, list_few
from headstock.pipeline.stages.run_state import PoseModel
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, machine_field
from headstock.solvers.pairing.mode_pairing import SAME_MODE, ModeSet, correlate_modes, pair_modes
from headstock.studies.responses import EntrySummary, compare_entries, overlay_responses
from headstock.studies.variants import VariantSolution


@dataclass(frozen=True)
class _ModeCell:
    """A mode of one variant in its row.

    Attributes:
        index: Number of the mode in its variant, from 0.
        frequency_hz: [Hz].
        deviation: Relative deviation from the row's first variant; None there and for rigid-body
            modes.
        correlation: MAC with the shape in the row's first variant; None there.
    """

    index: int
    frequency_hz: float
    deviation: float | None = None
    correlation: float | None = None


@dataclass(frozen=True)
class ModeRow:
    """One mode throughout the variants.

    Attributes:
        name: What it is called in the variant in which it was found first: the reference, if it is
            there.
        cells: Variant to cell, that of the origin first; variants without this mode are not in it.
    """

    name: str
    origin: str
    cells: dict[str, _ModeCell] = field(default_factory=dict)

    @property
    def frequency_hz(self) -> float:
        """Frequency in the variant in which it was found first [Hz]."""
        return self.cells[self.origin].frequency_hz


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Displayed):
    """Variants side by side.

    Attributes:
        pose: Pose they were solved in.
        reference: Variant the others are compared with.
        solutions: By variant name, in the order asked for.
        mac_threshold: Correlation from which two modes are the same.
        correlations: Variant to the MAC ``(wanted modes of the reference, all modes of the
            variant)`` of single shapes; none of the reference.
        lines: Variant to its frequency response on lines that all have in common; none without
            one, and none of a variant with other inputs or outputs than the reference.
        entries: Variant to the numbers of each entry of its response, as ``compare.json`` has them.
        not_computed: Variant to why there is no such model, in plain words.
        columns: All variants, solved or not, in the order asked for.
        not_compared: What is not compared, and why, in plain words.
    """

    scene: str
    pose: str
    reference: str
    solutions: dict[str, VariantSolution]
    rows: tuple[ModeRow, ...]
    mac_threshold: float
    correlations: dict[str, FloatArray]
    lines: dict[str, ResponseCurves]
    entries: dict[str, list[EntrySummary]]
    not_computed: dict[str, str]
    columns: tuple[str, ...]
    not_compared: tuple[str, ...] = ()

    @property
    def numbers(self) -> dict[str, Numbers]:
        """Variant to every number that was asked for, with its ±, by name."""
        return {name: solution.numbers for name, solution in self.solutions.items()}

    def _short_form(self) -> ShortForm:
        facts = [
            ("pose", self.pose),
            ("variants", list_few(self.columns)),
            ("reference", self.reference),
            ("rows", f"{len(self.rows)} modes"),
        ]
        rows = [
            [
                row.name,
                *(
                    f"{row.cells[name].frequency_hz:.5g}" if name in row.cells else "-"
                    for name in self.columns
                ),
            ]
            for row in self.rows
        ]
        head = ["mode", *(f"{name} [Hz]" for name in self.columns)]
        return ShortForm(f"Comparison of variants of {self.scene}", facts, head, rows)


@dataclass(eq=False)
class _Family:
    """Rows that begin in one place, and the shapes they begin with."""

    rows: list[ModeRow]
    modes: ModeSet


def compare_variants(
    solutions: Sequence[VariantSolution],
    *,
    scene: str,
    reference: str | None = None,
    cannot: Mapping[str, str] | None = None,
    columns: Sequence[str] = (),
) -> Comparison:
    """Pair the modes of all variants with those of a reference, and the rest with each other.

    Motions are compared at places that stand for the mass of each body, the same in all variants
    whatever their fidelity.

    Args:
        solutions: At least one, all in the same pose.
        reference: Variant to hold the others against; by default the first of those with most
            elastic, then segmented components.
        cannot: Variant to why there is no such model.
        columns: All variants in the order to show them in; by default the solutions.
    """
    by_name = {solution.choice.name: solution for solution in solutions}
    richest = sorted(by_name, key=lambda name: _richness(by_name[name]), reverse=True)
    best = reference or richest[0]
    order = [best, *(name for name in richest if name != best)]
    places = {
        name: choose_places(part)
        for name, part in by_name[best].machine.parts.superelements.items()
    }
    sets = {name: _mode_set(solution, places) for name, solution in by_name.items()}
    rows = _gather_rows(by_name, sets, order)
    lines = overlay_responses(by_name, best)
    first = sets[best].field[:, : by_name[best].wanted]
    return Comparison(
        scene,
        by_name[best].pose,
        best,
        by_name,
        rows,
        SAME_MODE,
        correlations={
            name: correlate_modes(first, modes.field)
            for name, modes in sets.items()
            if name != best and first.size and modes.field.size
        },
        lines=lines,
        entries={
            name: compare_entries(solution, lines, best)
            for name, solution in by_name.items()
            if solution.response is not None
        },
        not_computed=dict(cannot or {}),
        columns=tuple(columns) or tuple(by_name),
    )


def _gather_rows(
    solutions: Mapping[str, VariantSolution], sets: Mapping[str, ModeSet], order: Sequence[str]
) -> tuple[ModeRow, ...]:
    """Return the modes that some variant is asked for, rising: those of the first one with their
    partners, then those that it lacks.
    """
    families: list[_Family] = []
    for name in order:
        left = sets[name]
        numbers = list(range(len(left.frequencies_hz)))
        for family in families:
            left, numbers = _enter_cells(family, name, left, numbers, SAME_MODE)
        rows = [
            ModeRow(solutions[name].named.names[i], name, {name: _ModeCell(i, float(hz))})
            for i, hz in zip(numbers, left.frequencies_hz, strict=True)
        ]
        families.append(_Family(rows, left))
    wanted = [
        row
        for family in families
        for row in family.rows
        if any(cell.index < solutions[name].wanted for name, cell in row.cells.items())
    ]
    return tuple(sorted(wanted, key=lambda row: row.frequency_hz))


def _richness(solution: VariantSolution) -> tuple[int, int]:
    """Number of components with deformations of their own, and of segmented ones."""
    kinds = [facts.fidelity for facts in solution.components.values()]
    return sum(map(kinds.count, ("elastic", "superelement", "polynomial"))), kinds.count(
        "segmented"
    )


def _mode_set(solution: VariantSolution, places: Mapping[str, BodyPlaces]) -> ModeSet:
    if solution.modal is None:
        return ModeSet(np.zeros(0), np.zeros((0, 0)))
    machine = solution.machine
    shapes = (
        _lumped_field(machine, places, solution.modal.shapes)
        if machine.coupled is None
        else machine_field(machine.coupled, places, solution.modal.shapes)
    )
    return ModeSet(
        solution.modal.frequencies_hz, shapes, min(solution.modal.rigid_count, shapes.shape[1])
    )


def _lumped_field(
    machine: PoseModel, places: Mapping[str, BodyPlaces], shapes: FloatArray
) -> FloatArray:
    """As ``machine_field`` of a lumped mechanism, whose bodies are rigid."""
    motions, parts = machine.expand(shapes), machine.parts.superelements
    parts_moved: list[FloatArray] = [np.zeros((0, shapes.shape[1]))]
    for name, chosen in places.items():
        rotation, center = machine.placements[name].rotation, parts[name].center_of_mass
        moved = rigid_map(chosen.points @ rotation.T, rotation @ center)
        motion = moved @ motions[machine.offsets[name]]
        parts_moved.append(np.repeat(np.sqrt(chosen.masses), 3)[:, None] * motion)
    return np.vstack(parts_moved)


def _enter_cells(
    family: _Family, name: str, modes: ModeSet, numbers: list[int], mac_threshold: float
) -> tuple[ModeSet, list[int]]:
    """Enter a variant's modes into the rows they belong to; the modes that are left, with their
    numbers in the variant.
    """
    pairs = pair_modes(family.modes, modes, mac_threshold=mac_threshold)
    for pair in pairs:
        row, hz = family.rows[pair.first], float(modes.frequencies_hz[pair.second])
        rigid = pair.second < modes.rigid_count or pair.first < family.modes.rigid_count
        deviation = None if rigid else hz / row.frequency_hz - 1.0
        row.cells[name] = _ModeCell(numbers[pair.second], hz, deviation, pair.correlation)
    used = {pair.second for pair in pairs}
    kept = [i for i in range(len(numbers)) if i not in used]
    rigid_left = sum(i < modes.rigid_count for i in kept)
    shapes: FloatArray = modes.field[:, kept]
    return ModeSet(modes.frequencies_hz[kept], shapes, rigid_left), [numbers[i] for i in kept]
