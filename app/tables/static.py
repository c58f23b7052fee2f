"""Rows of compliances, displacements, probes and budgets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from headstock.app.tables.table import Cell, Column, PlainTable, show_deviation
from headstock.app.texts.bounded_values import bound_size
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.static import PointSummary
from headstock.pipeline.results.summary import RunSummary
from headstock.reduction.motions.body_motions import name_families


@dataclass(frozen=True)
class DeviationRow:
    """Displacement of a tool against the work: from what, and ``(6,)`` along and about the machine
    axes [m, rad]; how far it may be off, NaN for ``± ?``, empty where nobody says.
    """

    source: str
    motion: Sequence[float | None]
    errors: Sequence[float] = ()


def _moved_by(dof: int) -> Column[DeviationRow]:
    name = ("x", "y", "z", "A", "B", "C")[dof]
    unit = "um" if dof < 3 else "urad"

    def value(row: DeviationRow) -> Cell:
        moved = row.motion[dof]
        return None if moved is None else 1e6 * moved

    def error(row: DeviationRow) -> float | None:
        moved = row.motion[dof]
        # a deviation that is written as zero has no digits that an error could end
        still = moved is None or show_deviation(1e6 * moved) == "0"
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


def list_displacements(point: PointSummary) -> list[DeviationRow]:
    """List how a point is moved by each static load, errors of guides among them, and by all."""
    if "displacement" not in point:
        return []
    rows = [
        DeviationRow(load.replace("_", " "), moved)
        for load, moved in point.get("displacements", {}).items()
    ]
    total = DeviationRow("all together", point["displacement"])
    return [*rows, total] if len(rows) != 1 else rows


def static_by_pose(summary: RunSummary) -> dict[str, dict[str, PointSummary]]:
    """Pose to point to compliance; a summary of one pose names it nowhere but in its stages."""
    if "static_poses" in summary:
        return summary["static_poses"]
    if not summary["static"]:
        return {}
    poses = [row["pose"] or "reference" for row in summary["stages"] if row["stage"] == "static"]
    return {(poses or ["reference"])[0]: summary["static"]}


def longest_share(budget: Mapping[str, Mapping[str, float]]) -> float:
    """The largest share of a budget in any direction, whose bar fills a picture."""
    return (
        max((share for shares in budget.values() for share in shares.values()), default=0.0) or 1.0
    )


def shared_budget(point: PointSummary) -> dict[str, dict[str, float]]:
    """The budget of a point; empty where one part alone gives way, which says nothing."""
    budget = point["budget"]
    return budget if any(len(shares) > 1 for shares in budget.values()) else {}


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
    """The largest shares, at most so many.

    Args:
        count: How many there may be.
        least: Share below which one is not named.
    """
    return [item for item in sort_shares(shares)[:count] if item[1] >= least]


def tabulate_compliance(name: str, point: PointSummary) -> PlainTable:
    """Compliances at a point with their errors, directions by directions."""
    matrix = point["compliance_um_per_kN"]
    errors = point.get("error_um_per_kN", {})
    headings = (
        "force in",
        *(f"motion in {direction} [um/kN]" for direction in DIRECTIONS),
        "± along the force [um/kN]",
    )
    rows = (
        (
            d,
            *(matrix[row][column] for row in range(3)),
            bound_size(matrix[column][column], errors.get(d)),
        )
        for column, d in enumerate(DIRECTIONS)
    )
    return PlainTable(name, headings, tuple(rows))


def tabulate_whole_compliance(name: str, point: PointSummary) -> PlainTable:
    """All six motions under all six loads, in SI."""
    loads = [*(f"1 N in {d}" for d in DIRECTIONS), *(f"1 N m about {d}" for d in DIRECTIONS)]
    headings = (
        "load",
        *(f"motion in {d} [m]" for d in DIRECTIONS),
        *(f"rotation about {d} [rad]" for d in DIRECTIONS),
    )
    columns = zip(*point["compliance_6x6"], strict=True)
    return PlainTable(
        name, headings, tuple((load, *column) for load, column in zip(loads, columns, strict=True))
    )


def tabulate_budget(name: str, budget: Mapping[str, dict[str, float]]) -> PlainTable:
    """Shares of every part in a compliance, by direction."""
    parts = [part for part, _ in sort_shares(next(iter(budget.values()), {}))]
    return PlainTable(
        name,
        ("part", *budget),
        tuple((part, *(budget[d].get(part) for d in budget)) for part in parts),
    )
