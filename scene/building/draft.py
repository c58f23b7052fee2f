"""A scene while it is checked: tables that passed the schema, the names and files they refer to,
and checks of names and channels.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.joints import GROUND, JointEnd
from headstock.geometry.mechanisms.tool_mechanism import TOOL_AXES
from headstock.geometry.parts.solids import Solid
from headstock.scene.expansion.overrides import split_variant
from headstock.scene.reading.csv_files import AxisPath
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.reading.names import NAMES
from headstock.scene.reading.positions import KeyPath
from headstock.scene.scene import Request, Scene
from headstock.scene.schema.scene import SceneTable, load_record
from headstock.scene.schema.types import RequestTable
from headstock.scene.studies import Sweep
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class Draft:
    """What the checks of a scene look at.

    Names are those that are written, so that a broken entry does not make everything that refers to
    it look wrong too.

    Attributes:
        table: Entries that passed the schema.
        raw: The scene in full, after its variant and overrides.
        written: The same as it is written, in short where it is: what overrides reach.
        folder: Of the scene file, for the files it refers to.
        sections: Section name to entry names.
        interfaces: Component name to interface names; None where only a file knows them.
        solids: By component, as far as they can be built.
        paths: Way of each sweep that names a file, where it could be read.
    """

    table: SceneTable
    raw: TomlTable
    written: TomlTable
    folder: Path
    sections: Mapping[str, frozenset[str]]
    interfaces: Mapping[str, frozenset[str] | None]
    solids: Mapping[str, Solid]
    paths: Mapping[str, AxisPath]

    @property
    def poses(self) -> tuple[str, ...]:
        """Names of the poses; a scene that names none has one, ``reference``."""
        return tuple(self.table.poses) or ("reference",)


@dataclass(frozen=True, eq=False)
class SceneAnalysis[T: RequestTable, R: Request]:
    """An analysis as scenes know it: each module of ``scene/analyses`` has one, ``ANALYSIS``.

    Attributes:
        table: Schema of ``[analyses.NAME]``.
        request: What is built from the table.
        meaning: Of the analysis, for the scene reference.
        build: Builds the request of a scene that has passed every check.
        check: Reports what is wrong with the table, whatever else is.
        check_complete: Reports what is wrong once every entry of the scene passed the schema.
        check_scene: Reports what is wrong with the machine in its poses.
        check_sweep: Raises SceneError where the poses of a sweep do not suffice.
    """

    table: type[T]
    request: type[R]
    meaning: str
    build: Callable[[T, Draft], R]
    check: Callable[[T, Draft, Findings], None]
    check_complete: Callable[[T, Draft, Findings], None] | None = None
    check_scene: Callable[[R, Scene, Findings], None] | None = None
    check_sweep: Callable[[Scene, Sweep], None] | None = None


@functools.cache
def list_records() -> tuple[SceneAnalysis[Any, Any], ...]:
    """Return every analysis, in the order of their names."""
    return tuple(load_record(name) for name in NAMES)


def collect_sections(raw: TomlTable) -> dict[str, frozenset[str]]:
    """Names of the entries of each section of a parsed scene, valid or not."""
    sections = {key: frozenset(value) for key, value in raw.items() if isinstance(value, dict)}
    if "mechanism" in raw:
        sections["axes"] = sections.get("axes", frozenset()) | set(TOOL_AXES)
    return sections


def collect_interfaces(raw: TomlTable) -> dict[str, frozenset[str] | None]:
    """Interface names of each component of a parsed scene, valid or not; None where only a file
    knows them.
    """
    interfaces: dict[str, frozenset[str] | None] = {}
    components = raw.get("components")
    for name, entry in components.items() if isinstance(components, dict) else ():
        table = entry if isinstance(entry, dict) else {}
        solid, written = table.get("solid"), table.get("interfaces", {})
        from_file = isinstance(solid, dict) and "superelement" in solid
        interfaces[name] = (
            None if from_file or not isinstance(written, dict) else frozenset(written)
        )
    return interfaces


def check_name(
    key: KeyPath, name: str, section: str, draft: Draft, findings: Findings, what: str = ""
) -> None:
    """Report a name that is no entry of its section.

    Args:
        section: Of the scene: ``joints``, say.
        what: Word for an entry; that of the section without its last letter when empty.
    """
    known = draft.sections.get(section, frozenset())
    if name in known:
        return
    what = what or section.removesuffix("s")
    findings.add(key, f"unknown {what} {name[:80]!r}; {suggest_names(name, known, what=section)}")


def check_end(key: KeyPath, end: JointEnd, draft: Draft, findings: Findings) -> None:
    """Report an end that means neither ground nor an interface of a component."""
    if end.component is None:
        return
    if end.component not in draft.interfaces:
        known = [*draft.interfaces, GROUND]
        text = f"unknown component {end.component[:80]!r}; {suggest_names(end.component, known, what='components')}"
        findings.add(key, text)
        return
    known_interfaces = draft.interfaces[end.component]
    if known_interfaces is not None and end.interface not in known_interfaces:
        what = f"interfaces of {end.component}"
        hint = (
            suggest_names(end.interface, known_interfaces, what=what)
            if known_interfaces
            else f"{end.component} has none"
        )
        example = f'; describe it: [components.{end.component}.interfaces] {end.interface} = {{ face = "z+" }}'
        findings.add(
            key,
            f"component {end.component!r} has no interface {str(end.interface)[:80]!r}; {hint}{example}",
        )


def check_channel(key: KeyPath, name: str, draft: Draft, findings: Findings) -> None:
    """Report a channel that is at neither a point nor ``component.interface``."""
    component, dot, interface = name.partition(".")
    if dot:
        check_end(key, JointEnd(component, interface), draft, findings)
    else:
        check_name(key, name, "points", draft, findings)


def check_pose_names(
    key: KeyPath, poses: Iterable[str] | None, draft: Draft, findings: Findings
) -> None:
    """Report names that are no poses; a scene without poses has one that is called ``reference``.

    Args:
        key: Where they are written.
        poses: What is written; None for nothing.
    """
    for index, pose in enumerate(poses or ()):
        if pose != "reference" or draft.sections.get("poses"):
            check_name((*key, index), pose, "poses", draft, findings)


def check_variant(
    key: KeyPath, choice: str | None, draft: Draft, findings: Findings, *, more: str = ""
) -> None:
    """Report each of the variants joined in a choice that the scene does not offer.

    Args:
        choice: Names joined by ``+``; empty for none.
        more: What else could be written there.
    """
    known = draft.table.variants
    for variant in split_variant(choice) if choice else ():
        if variant not in known:
            hint = suggest_names(variant, known, what="variants")
            findings.add(key, f"unknown variant {variant[:80]!r}; {hint}{more}")


def is_known_end(end: JointEnd, scene: SceneTable) -> bool:
    """Whether an end means ground or an interface of a component that passed the schema."""
    if end.component is None:
        return True
    component = scene.components.get(end.component)
    return component is not None and (
        component.solid.superelement is not None or end.interface in component.interfaces
    )


def build_channels(channels: Sequence[tuple[str, str]]) -> tuple[Channel, ...]:
    """Every channel once, with its direction."""
    found = [(name, dof) for name, given in channels for dof in ([given] if given else DIRECTIONS)]
    return tuple(dict.fromkeys(found))


def check_probe_output(
    key: KeyPath, name: str, direction: str, draft: Draft, findings: Findings
) -> None:
    """Report a probe as an output that is a point as well, or has a direction."""
    if name in draft.table.points:
        findings.add(key, f"{name} is a point and a probe; rename one of them")
    elif direction:
        findings.add(
            key, f'a probe shows displacement and stress in all directions; write "{name}" alone'
        )
