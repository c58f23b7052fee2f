"""Rows of compliances, displacements, probes and budgets."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from headstock.app.tables.table import (
    Cell,
    Column,
    PlainTable,
    show_deviation,
)
from headstock.app.texts.bounded_values import bound_size
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.answers.static import UM_PER_KN, PointCompliance, StaticAnswer
from headstock.pipeline.numbers.estimates import known_part, scale_shares, scale_total
from headstock.pipeline.storage.json_texts import find_known
from headstock.reduction.motions.part_names import name_families


@dataclass(frozen=True)
class DeviationRow:
    """Displacement of a tool against the work: from what, and ``(6,)`` along and about the machine
    axes [m, rad], NaN where it is undetermined; how far it may be off, NaN for ``± ?``, empty where
    nobody says.
    """

    source: str
    motion: FloatArray
    errors: Sequence[float] = ()


def _moved_by(dof: int) -> Column[DeviationRow]:
    name = ("x", "y", "z", "A", "B", "C")[dof]
    unit = "um" if dof < 3 else "urad"

    def value(row: DeviationRow) -> Cell:
        return find_known(1e6 * row.motion[dof])

    def error(row: DeviationRow) -> float | None:
        moved = 1e6 * row.motion[dof]
        # a deviation that is written as zero has no digits that an error could end
        still = math.isnan(moved) or show_deviation(moved) == "0"
        return None if still or not row.errors else 1e6 * row.errors[dof]

    shown = f"{name} [{'µm' if dof < 3 else 'µrad'}]"
    return Column(
        value,
        f"{name} [{unit}]",
        f">{shown}",
        shown,
        show=show_deviation,
        missing="-",
        error=error,
    )


DEVIATION_COLUMNS: tuple[Column[DeviationRow], ...] = (
    Column(lambda row: row.source, "source", "from", "From"),
    *(_moved_by(dof) for dof in range(6)),
)


@dataclass(frozen=True)
class PointRow:
    """Compliance at a point in a pose, as it is shown [um/kN].

    Attributes:
        matrix: ``(3, 3)``, a column per force; None where a free motion leaves it undetermined.
        errors: Direction to ± of the compliance along it; None where it is not known.
        known: Direction to the part of ± that is known.
    """

    pose: str
    name: str
    point: PointCompliance
    matrix: list[list[float | None]]
    errors: dict[str, float | None]
    known: dict[str, float | None]


def list_point_rows(answers: Sequence[StaticAnswer]) -> list[PointRow]:
    """Return every point of every pose."""
    return [
        PointRow(
            answer.pose,
            name,
            point,
            [[find_known(value) for value in row] for row in point.compliance[:3, :3] * UM_PER_KN],
            {each: scale_total(error, UM_PER_KN) for each, error in errors.items()},
            {each: known_part(scale_shares(error, UM_PER_KN)) for each, error in errors.items()},
        )
        for answer in answers
        for name, point in answer.points.items()
        for errors in [answer.list_errors(name)]
    ]


def list_displacements(point: PointCompliance) -> list[DeviationRow]:
    """List how a point is moved by each static load, errors of guides among them, and by all."""
    if point.displacement is None:
        return []
    rows = [
        DeviationRow(load.replace("_", " "), moved) for load, moved in point.displacements.items()
    ]
    total = DeviationRow("all together", point.displacement)
    return [*rows, total] if len(rows) != 1 else rows


def longest_share(budget: Mapping[str, Mapping[str, float]]) -> float:
    """The largest share of a budget in any direction, whose bar fills a picture."""
    return (
        max(
            (share for shares in budget.values() for share in merge_families(shares).values()),
            default=0.0,
        )
        or 1.0
    )


def shared_budget(point: PointCompliance) -> dict[str, dict[str, float]]:
    """The budget of a point; empty where one part alone gives way, which says nothing."""
    return point.budget if any(len(shares) > 1 for shares in point.budget.values()) else {}


def sort_shares(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    """Shares, largest first; what symmetry makes equal goes by name, whatever the roundoff."""
    return sorted(shares.items(), key=lambda item: (-round(item[1], 6), item[0]))


def merge_families(shares: Mapping[str, float]) -> dict[str, float]:
    """Shares of parts whose names differ by a number, such as the carriages of a guide, together."""
    return {
        family: sum(shares[name] for name in members)
        for family, members in name_families(shares).items()
    }


def top_shares(shares: Mapping[str, float], count: int, least: float) -> list[tuple[str, float]]:
    """The largest shares, at most so many, of parts whose names differ by a number together.

    Args:
        count: How many there may be.
        least: Share below which one is not named.
    """
    return [item for item in sort_shares(merge_families(shares))[:count] if item[1] >= least]


def tabulate_compliance(name: str, row: PointRow) -> PlainTable:
    """Compliances at a point with their errors, directions by directions."""
    headings = (
        "force in",
        *(f"motion in {direction} [um/kN]" for direction in DIRECTIONS),
        "± along the force [um/kN]",
    )
    rows = (
        (
            d,
            *(moved[column] for moved in row.matrix),
            bound_size(row.matrix[column][column], row.errors.get(d)),
        )
        for column, d in enumerate(DIRECTIONS)
    )
    return PlainTable(name, headings, tuple(rows))


def tabulate_whole_compliance(name: str, point: PointCompliance) -> PlainTable:
    """All six motions under all six loads, in SI."""
    loads = [*(f"1 N in {d}" for d in DIRECTIONS), *(f"1 N m about {d}" for d in DIRECTIONS)]
    headings = (
        "load",
        *(f"motion in {d} [m]" for d in DIRECTIONS),
        *(f"rotation about {d} [rad]" for d in DIRECTIONS),
    )
    rows = zip(loads, point.compliance.T, strict=True)
    return PlainTable(
        name, headings, tuple((load, *map(find_known, column)) for load, column in rows)
    )


def tabulate_budget(name: str, budget: Mapping[str, dict[str, float]]) -> PlainTable:
    """Shares of every part in a compliance, by direction."""
    parts = [part for part, _ in sort_shares(next(iter(budget.values()), {}))]
    return PlainTable(
        name,
        ("part", *budget),
        tuple((part, *(budget[d].get(part) for d in budget)) for part in parts),
    )
