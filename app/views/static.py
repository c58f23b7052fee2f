"""Static compliance at points: matrices, budgets and displacements under static loads; displacement and stress at
points of components under them.
"""

from collections.abc import Iterator

from markupsafe import Markup

from headstock.app.drawings.figures import draw_budget
from headstock.app.drawings.markup import typeset, write_data
from headstock.app.tables.probes import (
    PROBE_COLUMNS,
    PROBE_MOTION_COLUMNS,
    PROBE_STRESS_COLUMNS,
    ProbeRow,
    list_probes,
)
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    PointRow,
    list_displacements,
    list_point_rows,
    longest_share,
    shared_budget,
    tabulate_budget,
    tabulate_compliance,
    tabulate_whole_compliance,
)
from headstock.app.tables.table import Listing, PlainTable, list_text_columns, tabulate
from headstock.app.texts.bounded_values import show_bound, show_compliances
from headstock.app.views.view import Section, Shares, TerminalPart, View
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.probes import ProbeAnswer
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results


def _list_tables(run: Results) -> Iterator[PlainTable]:
    for row in list_point_rows(run.find(StaticAnswer)):
        stem = f"{file_stem(row.pose)}_{file_stem(row.name)}"
        yield tabulate_compliance(f"compliance_{stem}", row)
        yield tabulate_whole_compliance(f"compliance_6x6_{stem}", row.point)
        yield tabulate_budget(f"budget_{stem}", row.point.budget)
        if moved := list_displacements(row.point):
            yield tabulate(f"displacement_{stem}", DEVIATION_COLUMNS, moved)


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    several = len(run.static) > 1
    for row in list_point_rows(run.find(StaticAnswer)):
        place = f"{row.name} in pose {row.pose}" if several else row.name
        yield _list_compliances(place, row)
        for direction, shares in shared_budget(row.point).items():
            yield Shares(direction, shares)
        if row.point.text:
            yield f"\n{row.point.text}"
        yield ""
        if moved := list_displacements(row.point):
            title = f"Displacement of {place} under the static loads"
            yield Listing(title, DEVIATION_COLUMNS, moved)


def _list_compliances(place: str, point: PointRow) -> Listing[tuple[str, ...]]:
    known = any(error is not None for error in (*point.errors.values(), *point.known.values()))
    # row i of the matrix is the motion in i: a column per force is shown as a row, so that it reads
    # from cause to effect
    rows = [
        (
            direction,
            *show_compliances(point.matrix, column, point.errors),
            show_bound(
                point.matrix[column][column],
                point.errors.get(direction),
                point.known.get(direction),
            ),
        )
        for column, direction in enumerate(DIRECTIONS)
    ]
    headings = ("force", *(f">moves {direction}" for direction in DIRECTIONS))
    columns = list_text_columns(*headings, *([">± along the force"] if known else []))
    return Listing(f"Static compliance at {place} [µm/kN]", columns, rows)


def _write_section(run: Results) -> Section:
    names = {
        "points": list_point_rows(run.find(StaticAnswer)),
        "columns": DEVIATION_COLUMNS,
        "list_displacements": list_displacements,
        "shared_budget": shared_budget,
        "draw_budget": draw_budget,
        "moved": _write_moved,
        "longest": longest_share,
    }
    return Section("stiffness", "Static stiffness", template="views/static.html", names=names)


def _write_moved(point: PointRow, row: int, column: int) -> Markup:
    """Write an entry of the compliance matrix of a point, rounded with its errors."""
    value = point.matrix[row][column]
    text = show_compliances(point.matrix, column, point.errors)[row]
    return (
        Markup('<span class="missing">{}</span>').format(text)
        if value is None
        else write_data(value, typeset(text))
    )


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)


def _list_probes(run: Results) -> Iterator[Listing[ProbeRow]]:
    for answer in run.find(ProbeAnswer):
        title = f"Under the static loads in pose {answer.pose}"
        yield Listing(title, PROBE_COLUMNS, list_probes(answer), f"probes_{file_stem(answer.pose)}")


PROBES_VIEW = View(
    tables=lambda run: (listing.tabulate() for listing in _list_probes(run)),
    terminal=_list_probes,
    section=lambda run: Section(
        "probes",
        "Probes",
        template="views/probes.html",
        names={
            "answers": run.find(ProbeAnswer),
            "list_probes": list_probes,
            "motions": PROBE_MOTION_COLUMNS,
            "stresses": PROBE_STRESS_COLUMNS,
        },
    ),
)
