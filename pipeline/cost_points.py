"""What a run costs and how far it is off: the points of a study that holds its runs against one of them."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from headstock.pipeline.study_points import TRUTH
from headstock.pipeline.study_tables import StudyRow, StudyTable, is_number, median_seconds
from headstock.pipeline.watch_paths import MEASURED_NAMES

ACCURACY = "accuracy"
SAME_PEAK = 0.002  # two runs in a row whose peaks differ by less have one between them


@dataclass(frozen=True, eq=False)
class CostPoint:
    """One way to compute a scene.

    Attributes:
        row: Of the study.
        error: Largest relative error of a watched number against the study's truth.
        worst: Which one.
        seconds: Wall-clock time, median and spread of the repeats [s].
        cpu_seconds: Processor time of all threads and child processes, likewise [s].
        memory_mb: Peak resident memory [MB]; where a process cannot forget its peak, no more than this.
        memory_known: The peak rose with this point, or fell, so that it is its own.
        dofs: Degrees of freedom before reduction.
        best: Nothing computed is both cheaper in processor time and closer.
        automatic: Its settings were chosen for an accuracy.
    """

    row: StudyRow
    error: float
    worst: str
    seconds: tuple[float, float]
    cpu_seconds: tuple[float, float]
    memory_mb: float
    dofs: int
    memory_known: bool = True
    best: bool = False
    automatic: bool = False


def weigh_costs(table: StudyTable) -> list[CostPoint]:
    """Errors and costs of every finished point of a study with a truth, the truth itself left out.

    Empty when the truth failed.
    """
    truths = [row for row in table.rows if row.record.family == TRUTH and row.record.status == "done"]
    if not truths:
        return []
    exact = {column: value for column, value in truths[0].values.items() if is_number(value) and column not in MEASURED_NAMES}
    points = []
    before = 0.0
    for row in table.rows:
        point = _weigh(row, exact, table)
        if point is not None:
            known = abs(point.memory_mb - before) > SAME_PEAK * before
            before = point.memory_mb
            points += [dataclasses.replace(point, memory_known=known)] if row.record.family != TRUTH else []
    return [_mark(point, points) for point in points]


def pareto_front(points: Sequence[CostPoint], cost: str) -> list[CostPoint]:
    """Points that none is both cheaper and closer than, by rising cost: ``cpu``, ``memory`` or ``dofs``."""
    front: list[CostPoint] = []
    shown = [point for point in points if cost != "memory" or point.memory_known]
    for point in sorted(shown, key=lambda point: (read_cost(point, cost), point.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


def read_cost(point: CostPoint, cost: str) -> float:
    """Processor time [s], memory [MB] or degrees of freedom of a point."""
    return {"cpu": point.cpu_seconds[0], "memory": point.memory_mb, "dofs": float(point.dofs)}[cost]


def cheapest_within(points: Sequence[CostPoint], error: float) -> CostPoint | None:
    """The point of least processor time whose true error is within a bound, automatic ones left out."""
    good = [point for point in points if point.error <= error and not point.automatic]
    return min(good, key=lambda point: point.cpu_seconds[0]) if good else None


def _weigh(row: StudyRow, exact: dict[str, Any], table: StudyTable) -> CostPoint | None:
    wall, spent = median_seconds(row.record), median_seconds(row.record, "cpu_seconds")
    if row.record.status != "done" or wall is None or spent is None:
        return None
    errors = {column: _relative(row.values.get(column), value) for column, value in exact.items()}
    if not errors:
        return None
    worst = max(errors, key=lambda column: errors[column])
    totals = row.record.summary["totals"]
    family = next(family for family in table.study.families if family.name == row.record.family)
    keys = {*family.settings, *row.record.varied}
    automatic = any(key == ACCURACY or key.startswith(f"{ACCURACY}.") for key in keys)
    return CostPoint(
        row, errors[worst], worst, wall, spent, float(totals["peak_rss_mb"]), int(totals["full_dofs"]), automatic=automatic
    )


def _relative(value: Any, exact: float) -> float:
    """Relative error; inf for a number that a run has not found."""
    return abs(value / exact - 1.0) if is_number(value) and exact else math.inf


def _mark(point: CostPoint, points: Sequence[CostPoint]) -> CostPoint:
    front = pareto_front([other for other in points if not other.automatic], "cpu")
    best = any(other is point for other in front)
    return dataclasses.replace(point, best=best)
