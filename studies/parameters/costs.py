"""Cost and error of the runs of a study, compared with one of its points, the reference run."""

import dataclasses
import itertools
import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass

from headstock.pipeline.answers.answer import Entry
from headstock.scene.reading.watch_paths import MEASURED_NAMES, Watched
from headstock.scene.studies import REFERENCE_RUN, StudyFamily, list_varied, show_setting
from headstock.studies.parameters.tables import StudyRow, StudyTable, is_number, median_seconds

ACCURACY = "accuracy"
BESIDE_SOLVING = ("mesh", "write")


@dataclass(frozen=True, eq=False)
class CostPoint:
    """One way to compute a scene.

    Attributes:
        name: Family and varied keys in a few words; keys that are the same all over the family left
            out.
        error: Largest relative error of a watched number from the reference run of the study.
        seconds: Wall-clock time, median and spread of the repeats [s].
        cpu_seconds: Processor time of all threads and child processes, likewise [s].
        solve_seconds: Processor time of assembly and solutions: all stages but meshing and writing,
            of the last round and the last repeat [s].
        memory_mb: Peak resident memory [MB]; where nobody could look and a process cannot forget
            its peak, no more than this.
        memory_known: It is this point's own.
        dofs: Degrees of freedom before reduction.
        best: Nothing computed is both cheaper in processor time and closer.
        automatic: Its settings were chosen for an accuracy.
        other_model: Its error is none but a spread of the model.
        accuracy: What became of the accuracy that was asked for; None where settings are given.
    """

    row: StudyRow
    name: str
    error: float
    worst: str
    seconds: tuple[float, float]
    cpu_seconds: tuple[float, float]
    solve_seconds: float
    memory_mb: float
    dofs: int
    memory_known: bool = True
    best: bool = False
    automatic: bool = False
    other_model: bool = False
    accuracy: Entry | None = None

    @property
    def competes(self) -> bool:
        """It is one of those among which the cheapest is sought."""
        return not self.automatic and not self.other_model


def weigh_costs(table: StudyTable) -> list[CostPoint]:
    """Errors and costs of every finished point of a study with a reference run, that one left out.

    Empty when the reference run failed.
    """
    is_reference = [row.record.family == REFERENCE_RUN for row in table.rows]
    references = itertools.compress(table.rows, is_reference)
    reference = next((row for row in references if row.record.status == "done"), None)
    if reference is None:
        return []
    exact = {
        column: value
        for column, value in reference.values.items()
        if is_number(value) and column not in MEASURED_NAMES
    }
    families = {family.name: family for family in table.study.families}
    others = itertools.compress(table.rows, map(operator.not_, is_reference))
    weighed = (_weigh(row, exact, families[row.record.family]) for row in others)
    points = list(filter(None, weighed))
    front = set(map(id, pareto_front([point for point in points if point.competes], "cpu")))
    return [dataclasses.replace(point, best=id(point) in front) for point in points]


def pareto_front(points: Sequence[CostPoint], cost: str) -> list[CostPoint]:
    """Points that none is cheaper and closer than, rising in ``cpu``, ``memory``, ``dofs``."""
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
    """The point of least processor time whose true error is within a bound, automatic ones and
    other models left out.
    """
    good = [point for point in points if point.error <= error and point.competes]
    return min(good, key=lambda point: point.cpu_seconds[0]) if good else None


def _weigh(row: StudyRow, exact: dict[str, float], family: StudyFamily) -> CostPoint | None:
    record = row.record
    wall, spent = median_seconds(record), median_seconds(record, "cpu_seconds")
    if record.status != "done" or record.summary is None or wall is None or spent is None:
        return None
    errors = {column: _relative(row.values.get(column), value) for column, value in exact.items()}
    if not errors:
        return None
    worst = max(errors, key=lambda column: errors[column])
    totals = record.summary["totals"]
    keys = {*family.settings, *record.varied}
    return CostPoint(
        row=row,
        name=_name_point(row, family),
        error=errors[worst],
        worst=worst,
        seconds=wall,
        cpu_seconds=spent,
        solve_seconds=sum(
            stage.get("cpu_seconds", 0.0)
            for stage in record.summary["stages"]
            if stage["stage"] not in BESIDE_SOLVING
        ),
        memory_mb=max(record.peak_mb, default=float(totals["peak_rss_mb"])),
        dofs=int(totals["full_dofs"]),
        memory_known=bool(record.peak_mb),
        automatic=any(key == ACCURACY or key.startswith(f"{ACCURACY}.") for key in keys),
        other_model=family.other_model,
        accuracy=record.summary.get("accuracy"),
    )


def _name_point(row: StudyRow, family: StudyFamily) -> str:
    varied = row.record.varied
    telling = {
        key: value
        for key, value in varied.items()
        if len({show_setting(other) for other in family.vary[key]}) > 1
    }
    return ", ".join(
        [*([family.name.replace("_", " ")] if family.name else []), *list_varied(telling or varied)]
    )


def _relative(value: Watched, exact: float) -> float:
    """Relative error; inf for a number that a run has not found."""
    return abs(value / exact - 1.0) if is_number(value) and exact else math.inf
