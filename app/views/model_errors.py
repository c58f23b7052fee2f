"""What rigid and segmented bodies leave out, compared with finite elements."""

from collections.abc import Iterator

from headstock.app.tables.table import Column, show_percent
from headstock.app.texts.bounded_values import model_words
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View
from headstock.pipeline.answers.accuracy import BodyModelSummary

COLUMNS: tuple[Column[tuple[str, BodyModelSummary]], ...] = (
    Column(lambda row: row[0], "component", "body", "Body"),
    Column(lambda row: row[1]["fidelity"], "model", "model", "Model"),
    Column(lambda row: row[1]["compared_with"], "compared with", "compared with", "Compared with"),
    Column(
        lambda row: row[1]["largest"],
        "largest change",
        ">changes",
        "Largest change",
        show=show_percent,
    ),
    Column(lambda row: row[1]["number"], "of", "<of", "of"),
)


def _list_bodies(run: FinishedRun) -> Listing[tuple[str, BodyModelSummary]]:
    title = "Rigid and segmented bodies compared with elastic ones"
    rows = run.summary["model_errors"]["bodies"].items()
    return Listing(title, COLUMNS, rows, "model_errors")


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    yield _list_bodies(run)
    yield f"  {model_words(run.summary['model_errors'])}"
    yield ""


def _write_section(run: FinishedRun) -> Section:
    title = "Compared with finite elements"
    return Section("model", title, tables=[_list_bodies(run)], part_of="components")


VIEW = View(
    tables=lambda run: [_list_bodies(run).tabulate()],
    terminal=_list_parts,
    section=_write_section,
)
