"""Names that exist in a scene, and checks that every reference means one of them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from headstock.geometry.machine.joints import GROUND, JointEnd
from headstock.geometry.mechanisms.tool_mechanism import TOOL_AXES
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.watch_paths import parse_watch
from headstock.scene.schema.connections import JointTable
from headstock.scene.schema.overrides import AS_WRITTEN, path_exists, split_variant
from headstock.scene.schema.scene import AnalysesTable, SceneTable
from headstock.scene.schema.studies import FamilyTable, StudyTable
from headstock.scene.studies import VARIANT


@dataclass(frozen=True)
class SceneNames:
    """Names by section as written, so that a broken entry does not make everything that refers to it look wrong too.

    Attributes:
        sections: Section name to entry names.
        interfaces: Component name to interface names; None where only a file knows them.
    """

    sections: Mapping[str, frozenset[str]]
    interfaces: Mapping[str, frozenset[str] | None]


def collect_names(raw: Mapping[str, Any]) -> SceneNames:
    """Names of a parsed scene, valid or not."""
    sections = {key: frozenset(value) for key, value in raw.items() if isinstance(value, dict)}
    if "mechanism" in raw:
        sections["axes"] = sections.get("axes", frozenset()) | set(TOOL_AXES)
    interfaces: dict[str, frozenset[str] | None] = {}
    components = raw.get("components")
    for name, entry in components.items() if isinstance(components, dict) else ():
        table = entry if isinstance(entry, dict) else {}
        solid, written = table.get("solid"), table.get("interfaces", {})
        from_file = isinstance(solid, dict) and "superelement" in solid
        interfaces[name] = None if from_file or not isinstance(written, dict) else frozenset(written)
    return SceneNames(sections, interfaces)


def check_references(scene: SceneTable, raw: Mapping[str, Any], findings: Findings) -> None:
    """Report every name in the scene that means nothing."""
    names = collect_names(raw)
    _check_components(scene, names, findings)
    _check_joints(scene, names, findings)
    _check_axes(scene, names, findings)
    _check_areas(scene, names, findings)
    _check_requests(scene, names, raw, findings)


def _check_name(key: KeyPath, name: str, section: str, names: SceneNames, findings: Findings, what: str = "") -> bool:
    known = names.sections.get(section, frozenset())
    if name in known:
        return True
    what = what or section.removesuffix("s")
    findings.add(key, f"unknown {what} {name[:80]!r}; {suggest_names(name, known, what=section)}")
    return False


def _check_end(key: KeyPath, end: JointEnd, names: SceneNames, findings: Findings) -> None:
    if end.component is None:
        return
    if end.component not in names.interfaces:
        known = [*names.interfaces, GROUND]
        text = f"unknown component {end.component[:80]!r}; {suggest_names(end.component, known, what='components')}"
        findings.add(key, text)
        return
    known_interfaces = names.interfaces[end.component]
    if known_interfaces is not None and end.interface not in known_interfaces:
        what = f"interfaces of {end.component}"
        hint = suggest_names(end.interface, known_interfaces, what=what) if known_interfaces else f"{end.component} has none"
        example = f'; describe it: [components.{end.component}.interfaces] {end.interface} = {{ face = "z+" }}'
        findings.add(key, f"component {end.component!r} has no interface {str(end.interface)[:80]!r}; {hint}{example}")


def _check_components(scene: SceneTable, names: SceneNames, findings: Findings) -> None:
    for name, component in scene.components.items():
        key: KeyPath = ("components", name)
        if component.material is not None:
            _check_name((*key, "material"), component.material, "materials", names, findings)
        elif component.solid.superelement is None:
            known = suggest_names("", names.sections.get("materials", ()), what="materials")
            findings.add((*key, "material"), f"'material' is missing; {known}")
        if name == GROUND:
            findings.add(key, 'a component cannot be called "ground": that is what it stands on; choose another name')


def _check_joints(scene: SceneTable, names: SceneNames, findings: Findings) -> None:
    for name, joint in scene.joints.items():
        key: KeyPath = ("joints", name, "between")
        for index, end in enumerate(joint.between):
            _check_end((*key, index), end, names, findings)
        for part in ("far", "reach") if joint.screw is not None else ():
            if (named := getattr(joint.screw, part)) is not None:
                _check_end(("joints", name, "screw", part), named, names, findings)
        first, second = joint.between
        if first.component == second.component:
            what = f"component {first.component!r}" if first.component else "ground"
            findings.add(key, f"joint {name!r} has both ends on {what}: a self joint does nothing; name two different components")
        if name in names.sections.get("components", ()):
            findings.add(("joints", name), f"a component is called {name!r} too; results name both, so choose another name")


def _check_axes(scene: SceneTable, names: SceneNames, findings: Findings) -> None:
    for name, axis in scene.axes.items():
        key: KeyPath = ("axes", name)
        for index, joint in enumerate(axis.joint_names()):
            _check_name((*key, "joints", index) if axis.joints else (*key, "joint"), joint, "joints", names, findings)
        for index, component in enumerate(axis.moves or ()):
            _check_name((*key, "moves", index), component, "components", names, findings)


def _check_areas(scene: SceneTable, names: SceneNames, findings: Findings) -> None:
    for section, entries in (("supports", scene.supports), ("loads", scene.loads)):
        for name, entry in entries.items():
            if entry.at is not None:
                component, _, interface = entry.at.partition(".")
                _check_end((section, name, "at"), JointEnd(component, interface), names, findings)
            elif entry.face is not None:
                _check_name((section, name, "face"), entry.face.partition(".")[0], "components", names, findings)
    for name, load in scene.loads.items():
        if load.component is not None:
            _check_name(("loads", name, "component"), load.component, "components", names, findings)
    for name, probe in scene.probes.items():
        _check_name(("probes", name, "component"), probe.component, "components", names, findings)
    for name, point in scene.points.items():
        _check_end(("points", name, "tool"), point.tool, names, findings)
        _check_end(("points", name, "work"), point.work, names, findings)
        if point.tool == point.work:
            findings.add(("points", name), "tool and work are the same, so nothing moves between them; name two places")


def _check_requests(scene: SceneTable, names: SceneNames, raw: Mapping[str, Any], findings: Findings) -> None:
    for name, pose in scene.poses.items():
        for axis in pose:
            _check_name(("poses", name, axis), axis, "axes", names, findings, "axis")
    for name, sweep in scene.sweeps.items():
        for axis in sweep.axes or ():
            _check_name(("sweeps", name, "axes", axis), axis, "axes", names, findings, "axis")
        for place, axis, _ in sweep.quantities() if sweep.axes is None else ():
            _check_name(("sweeps", name, *place), axis, "axes", names, findings, "axis")
    for name, study in scene.studies.items():
        _check_study(name, study, scene, raw, findings)
    static, modal = scene.analyses.static, scene.analyses.modal
    for index, point in enumerate(static.at or () if static else ()):
        _check_name(("analyses", "static", "at", index), point, "points", names, findings)
    frf = scene.analyses.frf
    for key, ports in (("inputs", frf.inputs), ("outputs", frf.outputs)) if frf else ():
        for index, (name, _) in enumerate(ports or ()):
            _check_port(("analyses", "frf", key, index), name, names, findings)
    _check_poses("frf", frf.poses if frf else None, names, findings)
    _check_poses("static", static.poses if static else None, names, findings)
    control = scene.analyses.control
    _check_poses("control", control.poses if control else None, names, findings)
    _check_poses("modal", modal.poses if modal else None, names, findings)
    _check_path(scene, names, findings)
    _check_compare(scene, names, findings)


def _check_path(scene: SceneTable, names: SceneNames, findings: Findings) -> None:
    path = scene.analyses.path
    if path is None:
        return
    for index, (name, _) in enumerate(path.outputs or ()):
        _check_port(("analyses", "path", "outputs", index), name, names, findings)
    for end, stops in (("from", path.start), ("to", path.to)):
        for axis in stops:
            _check_name(("analyses", "path", end, axis), axis, "axes", names, findings, "axis")
    if path.pose is not None:
        _check_name(("analyses", "path", "pose"), path.pose, "poses", names, findings)


def _check_compare(scene: SceneTable, names: SceneNames, findings: Findings) -> None:
    for index, choice in enumerate(scene.compare.variants or ()):
        for variant in (part for part in split_variant(choice) if choice != AS_WRITTEN and part not in scene.variants):
            hint = suggest_names(variant, scene.variants, what="variants")
            findings.add(
                ("compare", "variants", index), f"unknown variant {variant[:80]!r}; {hint}; {AS_WRITTEN!r} is the scene itself"
            )
    if scene.compare.pose is not None and (scene.compare.pose != "reference" or names.sections.get("poses")):
        _check_name(("compare", "pose"), scene.compare.pose, "poses", names, findings)


def _check_study(name: str, study: StudyTable, scene: SceneTable, raw: Mapping[str, Any], findings: Findings) -> None:
    key: KeyPath = ("studies", name)
    named = [((*key, "families", family), table) for family, table in study.families.items()]
    parts: list[tuple[KeyPath, StudyTable | FamilyTable]] = [(key, study), *named]
    for place, table in parts:
        varied = table.vary or {}
        truth = (table.truth or {}) if isinstance(table, StudyTable) else {}
        for section, paths in (("vary", varied), ("set", table.set), ("truth", truth)):
            for path in paths:
                if not (section in {"vary", "truth"} and path == VARIANT) and (reason := path_exists(raw, path)):
                    findings.add((*place, section, path), reason)
        choices = [*varied.get(VARIANT, ()), *([truth[VARIANT]] if VARIANT in truth else [])]
        chosen = [part for choice in choices if choice for part in split_variant(str(choice))]
        for variant in (part for part in chosen if part not in scene.variants):
            hint = suggest_names(variant, scene.variants, what="variants")
            findings.add((*place, "vary", VARIANT), f'unknown variant {variant[:80]!r}; {hint}; "" is the scene as it stands')
        for analysis in table.analyses or ():
            asked = [kind for kind in AnalysesTable.model_fields if getattr(scene.analyses, kind) is not None]
            if analysis not in asked:
                findings.add((*place, "analyses"), f"the scene has no [analyses.{analysis}]; it has: {', '.join(asked) or 'none'}")
    for index, watch in enumerate(study.watch or ()):
        _check_watch((*key, "watch", index), watch, scene, findings)


def _check_watch(key: KeyPath, watch: str, scene: SceneTable, findings: Findings) -> None:
    root, *rest = parse_watch(watch).steps
    sections: dict[object, Mapping[str, object]] = {"static": scene.points, "components": scene.components}
    known = sections.get(root)
    if known is not None and rest and rest[0] not in known:
        findings.add(key, f"{watch}: {suggest_names(rest[0], known, what='points' if root == 'static' else 'components')}")


def _check_port(key: KeyPath, name: str, names: SceneNames, findings: Findings) -> None:
    component, dot, interface = name.partition(".")
    if dot:
        _check_end(key, JointEnd(component, interface), names, findings)
    else:
        _check_name(key, name, "points", names, findings)


def _check_poses(analysis: str, poses: Iterable[str] | None, names: SceneNames, findings: Findings) -> None:
    for index, pose in enumerate(poses or ()):
        if pose != "reference" or names.sections.get("poses"):
            _check_name(("analyses", analysis, "poses", index), pose, "poses", names, findings)


def is_known_end(end: JointEnd, scene: SceneTable) -> bool:
    """Whether an end means ground or an interface of a component that passed the schema."""
    if end.component is None:
        return True
    component = scene.components.get(end.component)
    return component is not None and (component.solid.superelement is not None or end.interface in component.interfaces)


def sound_joints(scene: SceneTable) -> dict[str, JointTable]:
    """Joints whose two ends are known and differ."""
    return {
        name: joint
        for name, joint in scene.joints.items()
        if all(is_known_end(end, scene) for end in joint.between) and joint.between[0].component != joint.between[1].component
    }
