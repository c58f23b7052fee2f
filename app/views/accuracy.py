"""How near the accuracy that a scene asks for a run came; what rigid and segmented bodies leave out, compared
with finite elements, and rigid joints, compared with deformation shapes of their interfaces.
"""

from collections.abc import Iterator
from typing import NamedTuple

from headstock.app.tables.table import Column, Listing, show_percent
from headstock.app.texts.bounded_values import accuracy_words, model_words
from headstock.app.views.view import Section, TerminalPart, View
from headstock.pipeline.answers.accuracy import (
    AccuracyAnswer,
    BodyModel,
    InterfaceErrorsAnswer,
    JointShapes,
    ModelErrorsAnswer,
)
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.results.results import Results


class _Row[Model](NamedTuple):
    """A body or joint, the number that its model changes most, and by how much of it."""

    name: str
    model: Model
    number: str
    largest: float


type _Body = _Row[BodyModel]
type _Joint = _Row[JointShapes]

BODY_COLUMNS: tuple[Column[_Body], ...] = (
    Column(lambda row: row.name, "component", "body", "Body"),
    Column(lambda row: row.model.fidelity, "model", "model", "Model"),
    Column(lambda row: row.model.compared_with, "compared with", "compared with", "Compared with"),
    Column(
        lambda row: row.largest,
        "largest change",
        ">largest change",
        "Largest change",
        show=show_percent,
    ),
    Column(lambda row: row.number, "of number", "<of number", "of number"),
)
JOINT_COLUMNS: tuple[Column[_Joint], ...] = (
    Column(lambda row: row.name, "joint", "joint", "Joint"),
    Column(lambda row: row.model.between, "between", "between", "Between"),
    Column(lambda row: row.model.shapes, "shapes", ">shapes", "Shapes"),
    Column(lambda row: row.model.compared_with, "compared with", ">compared with", "Compared with"),
    Column(
        lambda row: row.largest,
        "largest ±",
        ">largest ±",
        "Largest ±",
        show=show_percent,
    ),
    Column(lambda row: row.number, "of number", "<of number", "of number"),
)
JOINTS = "Rigid joints compared with deformation shapes"


def _list_bodies(run: Results) -> Listing[_Body]:
    title = "Rigid and segmented bodies compared with elastic ones"
    found = run.find(ModelErrorsAnswer)[-1]
    rows = [_Row(name, body, *found.largest(name)) for name, body in found.bodies.items()]
    return Listing(title, BODY_COLUMNS, rows, "model_errors")


def _list_joints(run: Results) -> Listing[_Joint]:
    found = run.find(InterfaceErrorsAnswer)[-1]
    rows = [
        _Row(name, joint, "" if number is None else str(number), share)
        for name, joint in found.joints.items()
        for number, share in [found.largest(name)]
    ]
    return Listing(JOINTS, JOINT_COLUMNS, rows, "interface_errors")


def _list_body_parts(run: Results) -> Iterator[TerminalPart]:
    yield _list_bodies(run)
    yield f"  {model_words(run.find(ModelErrorsAnswer)[-1])}"
    yield ""


VIEW = View(
    terminal=lambda run: accuracy_words(run.find(AccuracyAnswer)[-1], run.find(PoseResponse)),
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
