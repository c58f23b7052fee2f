"""What rigid joints leave out, compared with deformation shapes of their interfaces."""

from headstock.app.tables.table import Column, show_percent
from headstock.app.views.view import FinishedRun, Listing, Section, View
from headstock.pipeline.answers.interfaces import JointShapesSummary

TITLE = "Rigid joints compared with deformation shapes"


COLUMNS: tuple[Column[tuple[str, JointShapesSummary]], ...] = (
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


def _list_joints(run: FinishedRun) -> Listing[tuple[str, JointShapesSummary]]:
    rows = run.summary["interface_errors"]["joints"].items()
    return Listing(TITLE, COLUMNS, rows, "interface_errors")


VIEW = View(
    tables=lambda run: [_list_joints(run).tabulate()],
    terminal=lambda run: [_list_joints(run)],
    section=lambda run: Section("joint", TITLE, tables=[_list_joints(run)], part_of="components"),
)
