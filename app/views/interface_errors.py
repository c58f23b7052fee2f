"""What rigid joints leave out, compared with deformation shapes of their interfaces."""

from headstock.app.tables.components import JOINT_COLUMNS
from headstock.app.views.view import FinishedRun, Listing, Section, View
from headstock.pipeline.answers.interfaces import JointShapesSummary

TITLE = "Rigid joints compared with deformation shapes"


def _list_joints(run: FinishedRun) -> Listing[tuple[str, JointShapesSummary]]:
    rows = run.summary["interface_errors"]["joints"].items()
    return Listing(TITLE, JOINT_COLUMNS, rows, "interface_errors")


VIEW = View(
    tables=lambda run: [_list_joints(run).tabulate()],
    terminal=lambda run: [_list_joints(run)],
    section=lambda run: Section("joint", TITLE, tables=[_list_joints(run)], part_of="components"),
)
