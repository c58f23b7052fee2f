"""How near the accuracy that a scene asks for a run came; what rigid and segmented bodies leave out, compared
with finite elements, and rigid joints, compared with deformation shapes of their interfaces.
"""

from collections.abc import Iterator

from headstock.app.tables.table import Column, Listing, show_percent
from headstock.app.texts.bounded_values import accuracy_words, model_words
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.pipeline.answers.accuracy import BodyModelSummary, JointShapesSummary

type _Body = tuple[str, BodyModelSummary]
type _Joint = tuple[str, JointShapesSummary]

BODY_COLUMNS: tuple[Column[_Body], ...] = (
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
JOINT_COLUMNS: tuple[Column[_Joint], ...] = (
    Column(lambda row: row[0], "joint", "joint", "Joint"),
    Column(lambda row: row[1]["between"], "between", "between", "Between"),
    Column(lambda row: row[1]["shapes"], "shapes", ">shapes", "Shapes"),
    Column(lambda row: row[1]["compared_with"], "compared with", ">compared with", "Compared with"),
    Column(
        lambda row: row[1]["largest"],
        "largest change",
        ">may be off",
        "May be off",
        show=show_percent,
    ),
    Column(lambda row: row[1]["number"], "of", "<of", "of"),
)
JOINTS = "Rigid joints compared with deformation shapes"


def _list_bodies(run: FinishedRun) -> Listing[_Body]:
    title = "Rigid and segmented bodies compared with elastic ones"
    rows = run.summary["model_errors"]["bodies"].items()
    return Listing(title, BODY_COLUMNS, rows, "model_errors")


def _list_joints(run: FinishedRun) -> Listing[_Joint]:
    rows = run.summary["interface_errors"]["joints"].items()
    return Listing(JOINTS, JOINT_COLUMNS, rows, "interface_errors")


def _list_body_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    yield _list_bodies(run)
    yield f"  {model_words(run.summary['model_errors'])}"
    yield ""


VIEW = View(
    terminal=lambda run: accuracy_words(run.summary["accuracy"], run.summary.get("frf")),
)
MODEL_ERRORS_VIEW = View(
    tables=lambda run: [_list_bodies(run).tabulate()],
    terminal=_list_body_parts,
    section=lambda run: Section(
        "model", "Compared with finite elements", tables=[_list_bodies(run)], part_of="components"
    ),
)
INTERFACE_ERRORS_VIEW = View(
    tables=lambda run: [_list_joints(run).tabulate()],
    terminal=lambda run: [_list_joints(run)],
    section=lambda run: Section("joint", JOINTS, tables=[_list_joints(run)], part_of="components"),
)
