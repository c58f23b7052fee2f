"""Reduced bodies of files as parts of a scene: what is wrong with a file, and what names an interface
that it does not have, is a problem of the scene, with its line and key.
"""

from collections.abc import Iterator
from pathlib import Path

from headstock.geometry.errors import HeadstockError
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.exchange.files import read_body
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import FILE_ROUNDING, check_superelement
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.reading.findings import KeyPath, Problem, SceneError, suggest_names
from headstock.scene.scene import Scene

CHEAP_BYTES = 2_000_000  # of a file that is read before a run: some 500 dofs


def read_part(scene: Scene, component: Component, solid: SuperelementFile) -> Superelement:
    """Read the reduced body of a component, checked like one of our own.

    Raises:
        SceneError: A file is damaged or of no such body, or something is attached to an interface that
            it does not have.
    """
    try:
        superelement = read_body(solid)
        check_superelement(superelement, rounding=FILE_ROUNDING)
    except HeadstockError as error:
        points = solid.points
        key = "points" if points is not None and points.name in str(error) else "superelement"
        described = scene.findings.describe(
            ("components", component.name, "solid", key), str(error)
        )
        raise SceneError([described]) from error
    names = [*superelement.interface_maps, *superelement.rails]
    problems = [
        _describe_unknown(scene, key, end, names)
        for key, end in _list_ends(scene)
        if end.component == component.name and end.interface not in names
    ]
    if problems:
        raise SceneError(problems)
    return superelement


def find_part_problems(scene: Scene) -> list[Problem]:
    """Find what is wrong with the small files of reduced bodies and with what is attached to them."""
    problems: list[Problem] = []
    for component in scene.machine.components.values():
        solid = component.solid
        if not isinstance(solid, SuperelementFile) or _is_large(solid.path):
            continue
        try:
            read_part(scene, component, solid)
        except SceneError as error:
            problems += error.problems
    return problems


def _is_large(path: Path) -> bool:
    try:
        return path.stat().st_size > CHEAP_BYTES
    except OSError:
        return False  # reading it says why


def _list_ends(scene: Scene) -> Iterator[tuple[KeyPath, JointEnd]]:
    """Yield what joints, points and responses are attached to, with its key."""
    machine = scene.machine
    for joint in machine.joints.values():
        for number, end in enumerate(joint.ends):
            yield ("joints", joint.name, "between", number), end
    for point in machine.points.values():
        yield ("points", point.name, "tool"), point.tool
        yield ("points", point.name, "work"), point.work
    if FrfRequest not in scene.analyses:
        return
    request = scene.analyses[FrfRequest]
    for side, channels in (("inputs", request.inputs), ("outputs", request.outputs)):
        for name in dict.fromkeys(name for name, _ in channels if name not in machine.sensors):
            component, dot, interface = name.partition(".")
            if dot and component in machine.components:
                yield ("analyses", "frf", side), JointEnd(component, interface)


def _describe_unknown(scene: Scene, key: KeyPath, end: JointEnd, names: list[str]) -> Problem:
    hint = suggest_names(end.interface, names, what=f"interfaces of {end.component}")
    message = f"component {end.component!r} has no interface {str(end.interface)[:80]!r}; {hint}"
    return scene.findings.describe(key, message)
