"""Variants as models of one machine, in rows and words: where compliance comes from, responses,
costs, what a simpler model is good for and what it cannot answer.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from headstock.app.tables.comparison import describe_store, list_points
from headstock.app.tables.static import sort_shares
from headstock.app.texts.bounded_values import show_bound, show_bounded, show_digits
from headstock.app.texts.curves import name_entry, response_unit
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.numbers.kinds import KINDS
from headstock.pipeline.numbers.numbers import parse_key
from headstock.reduction.motions.part_names import name_families
from headstock.solvers.second_order import Channel
from headstock.studies.comparison_summary import (
    ComparisonSummary,
    JudgedModeSummary,
    OtherSummary,
    RowSummary,
    VariantSummary,
    VerdictSummary,
)
from headstock.studies.kind_changes import ROUNDING
from headstock.studies.responses import EntrySummary

CANNOT = "cannot"
MISSING = "–"
NAMED_SHARE = 0.1  # of a compliance: less is not worth a row
PEAKS_SHOWN = 3
MODES_NAMED = 3
MOST_SHOWN = 3  # numbers of a row
DEFORMING = (
    "bend",
    "twist",
    "stretch",
    "deform",
    "breathe",
    "ovalize",
)  # verbs of the names of modes


@dataclass(frozen=True)
class _ModelCell:
    """What a model says in a row: a value, and smaller below it what belongs to it."""

    text: str
    small: str = ""


@dataclass(frozen=True)
class ModelRow:
    """An answer of every model that has it.

    Attributes:
        cells: Variant to what it says; those that say nothing are not in it.
    """

    head: str
    cells: dict[str, _ModelCell] = field(default_factory=dict)


@dataclass(frozen=True)
class _ModelSection:
    """Rows under a heading."""

    title: str
    rows: tuple[ModelRow, ...]


def show_change(value: float | None, first: float | None) -> str:
    """``-12.1 %``; nothing without a first value, or of the first itself."""
    if value is None or not first or value == first:
        return ""
    return _signed(value / first - 1.0)


def _signed(change: float) -> str:
    shown = f"{100.0 * change:+.1f} %"
    return "0.0 %" if shown in ("+0.0 %", "-0.0 %") else shown


def share_rows(summary: ComparisonSummary, point: str, direction: str) -> list[ModelRow]:
    """List the parts that the compliance at a point in a direction comes from, largest first; joints and
    components whose names differ by a number only are one part.

    Args:
        direction: ``x``, ``y`` or ``z``.
    """
    budgets = {
        name: variant["static"][point]["budget"][direction]
        for name, variant in summary["variants"].items()
        if point in variant["static"]
    }
    families = name_families({part for budget in budgets.values() for part in budget})
    totals = {
        family: {
            name: sum(budget.get(member, 0.0) for member in members)
            for name, budget in budgets.items()
            if budget
        }
        for family, members in families.items()
    }
    most = {part: max(shares.values(), default=0.0) for part, shares in totals.items()}
    return [
        ModelRow(
            f"  {part}",
            {name: _ModelCell(f"{100.0 * share:.0f} %") for name, share in totals[part].items()},
        )
        for part, size in sort_shares(most)
        if size >= NAMED_SHARE
    ]


def response_sections(
    summary: ComparisonSummary, *, drive_points: bool = False
) -> list[_ModelSection]:
    """A section per entry of the frequency responses that is more than a trace of symmetry lost.

    Args:
        drive_points: Only entries of a load and the motion at the same place, where there are any.
    """
    entries: dict[tuple[Channel, Channel], dict[str, EntrySummary]] = {}
    for name, variant in summary["variants"].items():
        for entry in variant["frf"]:
            output, given = ((each[0], each[1]) for each in (entry["output"], entry["input"]))
            entries.setdefault((output, given), {})[name] = entry
    direct = drive_points and any(output == given for output, given in entries)
    return [
        _response_section(channels[0], channels[1], found, summary["reference"])
        for channels, found in entries.items()
        if not all(entry["negligible"] for entry in found.values())
        and (not direct or channels[0] == channels[1])
    ]


def _show_largest(
    entry: EntrySummary, own: EntrySummary | None, factor: float
) -> _ModelCell | None:
    size, hz = entry["peak"], entry["peak_hz"]
    if size is None or hz is None:
        return None
    change = show_change(size, own["peak"] if own else None)
    return _ModelCell(
        f"{show_digits(factor * size, 4)}",
        "\n".join(filter(None, (f"at {show_digits(hz, 4)} Hz", change))),
    )


def _show_real(entry: EntrySummary, own: EntrySummary | None, factor: float) -> _ModelCell | None:
    value, hz, error = (
        entry["most_negative_real"],
        entry["most_negative_real_hz"],
        entry["most_negative_real_error"],
    )
    if value is None or hz is None:
        return None
    size = None if error is None else factor * error
    change = show_change(value, own["most_negative_real"] if own else None)
    return _ModelCell(
        f"{show_bounded(factor * value, size)} {show_bound(factor * value, size)}",
        "\n".join(filter(None, (f"at {show_digits(hz, 4)} Hz", change))),
    )


def _show_peaks(entry: EntrySummary, _: EntrySummary | None, factor: float) -> _ModelCell | None:
    highest = sorted(entry["peaks"], key=lambda peak: -peak["size"])[:PEAKS_SHOWN]
    texts = [
        f"{show_digits(peak['frequency_hz'], 4)} Hz: {show_digits(factor * peak['size'], 3)}"
        for peak in highest
    ]
    return _ModelCell("\n".join(texts)) if texts else None


def _show_difference(
    entry: EntrySummary, _: EntrySummary | None, factor: float
) -> _ModelCell | None:
    far = entry["difference"]
    if far is None:
        return None
    share = f"{100.0 * far['share_of_peak']:.0f} % of its peak"
    return _ModelCell(
        show_digits(factor * far["size"], 3), f"at {show_digits(far['at_hz'], 4)} Hz\n{share}"
    )


def _show_agreement(entry: EntrySummary, _: EntrySummary | None, __: float) -> _ModelCell | None:
    far = entry["difference"]
    if far is None:
        return None
    to = far["agrees_to_hz"]
    return _ModelCell("nowhere" if to is None else f"{show_digits(to, 3)} Hz")


# heads with the reference, and what makes a cell from an entry, that of the reference and a factor of
# units
RESPONSE_ROWS: tuple[
    tuple[str, Callable[[EntrySummary, EntrySummary | None, float], _ModelCell | None]], ...
] = (
    ("largest dynamic compliance", _show_largest),
    ("most negative real part", _show_real),
    ("largest peaks", _show_peaks),
    ("largest difference from {}", _show_difference),
    ("within 10 % of {} up to", _show_agreement),
)


def _response_section(
    output: Channel, given: Channel, found: Mapping[str, EntrySummary], reference: str
) -> _ModelSection:
    unit, factor = response_unit("receptance", output, given)
    own, rows = found.get(reference), []
    for head, show in RESPONSE_ROWS:
        cells = {
            name: _ModelCell(CANNOT) if entry["reason"] else show(entry, own, factor)
            for name, entry in found.items()
        }
        shown = {name: cell for name, cell in cells.items() if cell is not None}
        if shown:
            rows.append(ModelRow(head.format(reference), shown))
    return _ModelSection(f"Response {name_entry(output, given)} [{unit}]", tuple(rows))


def other_sections(summary: ComparisonSummary) -> list[_ModelSection]:
    """A section per kind of numbers of analyses other than modes, compliances and responses; components
    of a vector share a row.
    """
    sections: dict[tuple[str, str], dict[str, dict[str, list[OtherSummary]]]] = {}
    for name, variant in summary["variants"].items():
        for label, numbers in variant["others"].items():
            for entry, number in numbers.items():
                rows = sections.setdefault((label, number["unit"]), {})
                columns = rows.setdefault(parse_key(entry).vector.describe_place(), {})
                columns.setdefault(name, []).append(number)
    order = [kind.label for kind in KINDS.values()]
    return [
        _ModelSection(
            f"{label[0].upper()}{label[1:]} [{unit}]",
            tuple(
                ModelRow(
                    head,
                    {
                        name: _other_cell(numbers, columns.get(summary["reference"], []))
                        for name, numbers in columns.items()
                    },
                )
                for head, columns in rows.items()
            ),
        )
        for (label, unit), rows in sorted(
            sections.items(), key=lambda section: order.index(section[0][0])
        )
    ]


def _other_cell(numbers: Sequence[OtherSummary], reference: Sequence[OtherSummary]) -> _ModelCell:
    """Numbers of a row, of many the least and the largest; and by how much the largest differs from
    that of the reference.
    """
    sizes = [number["value"] for number in numbers if number["value"] is not None]
    if not sizes:
        return _ModelCell(MISSING)
    first = max(
        (number["value"] for number in reference if number["value"] is not None),
        key=abs,
        default=None,
    )
    change = show_change(max(sizes, key=abs), first)
    if len(numbers) > MOST_SHOWN:
        return _ModelCell(f"{show_digits(min(sizes), 4)} .. {show_digits(max(sizes), 4)}", change)
    least = ROUNDING * max(map(abs, sizes))
    shown = [
        MISSING
        if number["value"] is None
        else show_digits(0.0 if abs(number["value"]) < least else number["value"], 4)
        for number in numbers
    ]
    return _ModelCell(", ".join(shown), change)


def cost_rows(summary: ComparisonSummary) -> list[ModelRow]:
    """List what each model costs."""

    def row(head: str, make: Callable[[VariantSummary], _ModelCell]) -> ModelRow:
        return ModelRow(head, {name: make(each) for name, each in summary["variants"].items()})

    def seconds(variant: VariantSummary) -> _ModelCell:
        effort = variant["effort"]
        return _ModelCell(f"{effort['seconds']['total']:.2f}", describe_store(effort))

    return [
        row("dofs of the components", lambda each: _ModelCell(_spaced(each["full_dofs"]))),
        row("dofs solved for", lambda each: _ModelCell(_spaced(each["coupled_dofs"]))),
        row("seconds from scene to results", seconds),
        row(
            "processor seconds",
            lambda each: _ModelCell(f"{each['effort']['cpu_seconds']['total']:.2f}"),
        ),
        row("peak memory [MB]", lambda each: _ModelCell(f"{each['effort']['peak_rss_mb']:.0f}")),
    ]


def _spaced(count: int) -> str:
    return f"{count:,}".replace(",", " ")


def nearest_mac(
    summary: ComparisonSummary, row: RowSummary, variant: VariantSummary
) -> float | None:
    """Largest MAC of a mode of the reference with any mode of a model that has not got it; None
    where that was not computed.
    """
    own = row["variants"][summary["reference"]]
    if own is None or own["number"] > len(variant["mac"]):
        return None
    return max(variant["mac"][own["number"] - 1], default=None)


def cannot_words(summary: ComparisonSummary) -> list[str]:
    """Results that a model cannot give, and the reason; once for models that share it."""
    owners: dict[str, list[str]] = {}
    for name, why in summary["not_computed"].items():
        owners.setdefault(why, []).append(name)
    for name, variant in summary["variants"].items():
        for why in dict.fromkeys(entry["reason"] for entry in variant["frf"] if entry["reason"]):
            owners.setdefault(f"response: {why}", []).append(name)
    return [f"{', '.join(names)}: cannot: {why}" for why, names in owners.items()]


def verdict_words(summary: ComparisonSummary) -> list[str]:
    """One line per simpler model: where it agrees, where it differs, and what it costs."""
    return [
        f"{name}: {_describe_verdict(summary, name, verdict)}"
        for name, verdict in summary["verdicts"].items()
    ]


def _describe_verdict(summary: ComparisonSummary, name: str, verdict: VerdictSummary) -> str:
    agreeing, lost = _sort_compliances(summary, name, verdict)
    if verdict["agreeing"]:
        agreeing.append(
            f"{_name_numbers(verdict['agreeing'])} within {_percent(verdict['agreeing_within'] or 0.0)}"
        )
    reached, nowhere = _reach_of_responses(summary["variants"][name]["frf"])
    agreeing += reached
    lost += _name_modes(
        verdict["deviating"],
        lambda mode: (
            f"f{mode['number']} {100.0 * (mode['deviation'] or 0.0):+.0f} % ({_bends(mode)})"
        ),
    )
    lost += nowhere
    parts = [f"agrees for {_join(agreeing)}" if agreeing else "agrees for no result within 10 %"]
    if lost:
        parts.append(f"differs by more: {_join(lost)}")
    if verdict["missing"]:
        missed = _name_modes(
            verdict["missing"],
            lambda mode: f"f{mode['number']} ({_bends(mode)}, MAC {mode['mac']:.2f} at best)",
        )
        parts.append(f"lacks {_join(missed)}")
    own, best = (summary["variants"][each]["effort"] for each in (name, summary["reference"]))
    times = [
        f"{effort['seconds']['total']:.2g} s"
        + (f" ({describe_store(effort)})" if effort["elastic_components"] else "")
        for effort in (own, best)
    ]
    return f"{'; '.join(parts)}; {times[0]} compared with {times[1]}"


def _reach_of_responses(entries: Sequence[EntrySummary]) -> tuple[list[str], list[str]]:
    """Up to where the responses at drive points agree, or all where there is none; and those
    that are off from the first line on.
    """
    known = [(entry, entry["difference"]) for entry in entries if not entry["negligible"]]
    direct = [item for item in known if item[0]["output"] == item[0]["input"]] or known
    agreeing, lost = [], []
    for entry, far in direct:
        if far is not None:
            to, place = far["agrees_to_hz"], " ".join(entry["output"])
            if to is None:
                lost.append(place)
            else:
                agreeing.append(f"{place} up to {show_digits(to, 3)} Hz")
    return (
        [f"response within 10 % at {_join(agreeing)}"] if agreeing else [],
        [f"response at {_join(lost)} from the lowest frequency on"] if lost else [],
    )


def _sort_compliances(
    summary: ComparisonSummary, name: str, verdict: VerdictSummary
) -> tuple[list[str], list[str]]:
    """Compliances that agree, in one item, and those that are not, each with its cause."""
    found, points = verdict["compliance"], list_points(summary)
    several = len(points) > 1
    agreeing, lost = {}, []
    for place, change in found.items():
        point, direction = place.rsplit(" ", 1)
        if abs(change) <= verdict["agreement"]:
            agreeing[place] = change
            continue
        part = _cause(summary, name, point, direction)
        at = f" at {point}" if several else ""
        lost.append(f"d{direction}/F{direction}{at} {100.0 * change:+.0f} % ({part})")
    if not agreeing:
        return [], lost
    most = _percent(max(map(abs, agreeing.values())))
    if len(agreeing) == len(found):
        return [f"compliance within {most}"], lost
    shown = [place if several else place.rsplit(" ", 1)[1] for place in agreeing]
    return [f"compliance in {', '.join(shown)} within {most}"], lost


def _cause(summary: ComparisonSummary, name: str, point: str, direction: str) -> str:
    """The part whose contribution to a compliance differs most from that in the reference."""
    place, parts = DIRECTIONS.index(direction), []
    for variant in (summary["variants"][name], summary["variants"][summary["reference"]]):
        found = variant["static"][point]
        size = found["compliance_um_per_kN"][place][place] or 0.0
        parts.append({part: size * share for part, share in found["budget"][direction].items()})
    own, best = parts
    families = name_families(own.keys() | best.keys())
    return max(
        families,
        key=lambda family: abs(
            sum(best.get(part, 0.0) - own.get(part, 0.0) for part in families[family])
        ),
    )


def _name_modes(
    modes: Sequence[JudgedModeSummary], name: Callable[[JudgedModeSummary], str]
) -> list[str]:
    named = [name(mode) for mode in modes[:MODES_NAMED]]
    more = len(modes) - len(named)
    return [*named, f"{more} more mode{'s' if more > 1 else ''}"] if more else named


def _bends(mode: JudgedModeSummary) -> str:
    """Frequency and name of a mode, and the component that deforms where the name does not say."""
    shown, part = f"{show_digits(mode['frequency_hz'], 3)} Hz, {mode['name']}", mode["part"]
    stem = part.rstrip("0123456789.,")
    reported = any(
        any(word.startswith(stem) for word in clause.split())
        and any(f" {verb}" in clause for verb in DEFORMING)
        for clause in mode["name"].split(", ")
    )
    if reported or mode["part_share"] < NAMED_SHARE:
        return shown
    return f"{shown}, {100.0 * mode['part_share']:.0f} % of its strain energy in {part}"


def _name_numbers(numbers: Sequence[int]) -> str:
    """``f1..f4, f6``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][-1] + 1:
            spans[-1].append(number)
        else:
            spans.append([number])
    return ", ".join(
        f"f{span[0]}" if len(span) == 1 else f"f{span[0]}..f{span[-1]}" for span in spans
    )


def _percent(size: float) -> str:
    return f"{100.0 * size:.2g} %"


def _join(items: Sequence[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
