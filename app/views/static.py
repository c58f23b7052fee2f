"""Static compliance at points: matrices, budgets and displacements under static loads; displacement and stress at
points of components under them.
"""

from collections.abc import Iterator

from markupsafe import Markup

from headstock.app.drawings.figures import draw_budget
from headstock.app.drawings.markup import typeset, write_data
from headstock.app.tables.probes import PROBE_COLUMNS, PROBE_MOTION_COLUMNS, PROBE_STRESS_COLUMNS
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    list_displacements,
    longest_share,
    shared_budget,
    static_by_pose,
    tabulate_budget,
    tabulate_compliance,
    tabulate_whole_compliance,
)
from headstock.app.tables.table import Listing, PlainTable, list_text_columns, tabulate
from headstock.app.texts.bounded_values import show_bound, show_compliances
from headstock.app.views.view import FinishedRun, Section, Shares, TerminalPart, View
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.probes import ProbeSummary
from headstock.pipeline.answers.static import PointSummary
from headstock.pipeline.numbers.estimates import known_part
from headstock.pipeline.results.mode_files import file_stem


def _list_points(run: FinishedRun) -> list[tuple[str, str, PointSummary]]:
    """Return pose, name and compliance of every point."""
    return [
        (pose, name, point)
        for pose, points in static_by_pose(run.summary).items()
        for name, point in points.items()
    ]


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, name, point in _list_points(run):
        stem = f"{file_stem(pose)}_{file_stem(name)}"
        yield tabulate_compliance(f"compliance_{stem}", point)
        yield tabulate_whole_compliance(f"compliance_6x6_{stem}", point)
        yield tabulate_budget(f"budget_{stem}", point["budget"])
        if rows := list_displacements(point):
            yield tabulate(f"displacement_{stem}", DEVIATION_COLUMNS, rows)


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    several = "static_poses" in run.summary
    for pose, name, point in _list_points(run):
        place = f"{name} in pose {pose}" if several else name
        yield _list_compliances(place, point)
        for direction, shares in shared_budget(point).items():
            yield Shares(direction, shares)
        if point["text"]:
            yield f"\n{point['text']}"
        yield ""
        if rows := list_displacements(point):
            title = f"Displacement of {place} under the static loads"
            yield Listing(title, DEVIATION_COLUMNS, rows)


def _list_compliances(place: str, point: PointSummary) -> Listing[tuple[str, ...]]:
    errors = point.get("error_um_per_kN", {})
    parts = {name: known_part(share) for name, share in point.get("error_share", {}).items()}
    known = any(error is not None for error in (*errors.values(), *parts.values()))
    matrix = point["compliance_um_per_kN"]
    # row i of the matrix is the motion in i: a column per force is shown as a row, so that it reads
    # from cause to effect
    rows = [
        (
            direction,
            *show_compliances(matrix, column, errors),
            show_bound(matrix[column][column], errors.get(direction), parts.get(direction)),
        )
        for column, direction in enumerate(DIRECTIONS)
    ]
    headings = ("force", *(f">moves {direction}" for direction in DIRECTIONS))
    columns = list_text_columns(*headings, *([">± along the force"] if known else []))
    return Listing(f"Static compliance at {place} [µm/kN]", columns, rows)


def _write_section(run: FinishedRun) -> Section:
    pose, name, _ = _list_points(run)[0]
    names = {
        "static": static_by_pose(run.summary),
        "first": (pose, name),
        "columns": {"deviations": DEVIATION_COLUMNS},
        "list_displacements": list_displacements,
        "shared_budget": shared_budget,
        "draw_budget": draw_budget,
        "moved": _write_moved,
        "longest": longest_share,
    }
    return Section("stiffness", "Static stiffness", template="views/static.html", names=names)


def _write_moved(point: PointSummary, row: int, column: int) -> Markup:
    """Write an entry of the compliance matrix of a point, rounded with its errors."""
    matrix = point["compliance_um_per_kN"]
    value, text = (
        matrix[row][column],
        show_compliances(matrix, column, point["error_um_per_kN"])[row],
    )
    return (
        Markup('<span class="missing">{}</span>').format(text)
        if value is None
        else write_data(value, typeset(text))
    )


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)


def _list_probes(run: FinishedRun) -> Iterator[Listing[tuple[str, ProbeSummary]]]:
    for pose, probes in run.summary["probes"].items():
        title = f"Under the static loads in pose {pose}"
        yield Listing(title, PROBE_COLUMNS, probes.items(), f"probes_{file_stem(pose)}")


PROBES_VIEW = View(
    tables=lambda run: (listing.tabulate() for listing in _list_probes(run)),
    terminal=_list_probes,
    section=Section(
        "probes",
        "Probes",
        template="views/probes.html",
        names={
            "columns": {
                "probe_motions": PROBE_MOTION_COLUMNS,
                "probe_stresses": PROBE_STRESS_COLUMNS,
            }
        },
    ),
)
