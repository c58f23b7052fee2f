"""What rigid and segmented bodies leave out, compared with finite elements."""

from collections.abc import Iterator

from headstock.app.tables.components import MODEL_COLUMNS
from headstock.app.texts.bounded_values import model_words
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View
from headstock.pipeline.answers.accuracy import BodyModelSummary


def _list_bodies(run: FinishedRun) -> Listing[tuple[str, BodyModelSummary]]:
    title = "Rigid and segmented bodies compared with elastic ones"
    rows = run.summary["model_errors"]["bodies"].items()
    return Listing(title, MODEL_COLUMNS, rows, "model_errors")


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
