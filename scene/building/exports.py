"""What a run writes for other programs: checked against the rest of the scene, and built."""

import itertools
from collections import Counter
from collections.abc import Collection, Iterator

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.joints import Axis, Joint
from headstock.geometry.machine.machine import Machine
from headstock.scene.building.draft import Draft
from headstock.scene.exports import Export
from headstock.scene.reading.findings import Findings, KeyPath, SceneError
from headstock.scene.scene import Scene
from headstock.scene.schema.scene import SceneTable

ALONG = 1e-9  # of a length: directions that differ by less are one


def check_exports(draft: Draft) -> None:
    """Report exports of components, poses and axes that there are not, and two into one file."""
    exports, known = build_exports(draft.table), dict[str, Export]()
    for name, wanted in exports.items():
        faults = list(wanted.find_faults())
        for at, fault in faults:
            draft.add(("exports", name, at) if at else ("exports", name), fault)
        if not any(at == "format" for at, _ in faults):
            known[name] = wanted
    files = Counter(str(wanted.name_file(name)) for name, wanted in known.items())
    for name, wanted in known.items():
        key, table = ("exports", name), draft.table.exports[name]
        if table.component is not None:
            draft.check_name((*key, "component"), table.component, "components")
        draft.check_pose((*key, "pose"), table.pose)
        for number, axis in enumerate(table.travel or ()):
            draft.check_name((*key, "travel", number), axis, "axes")
        file = str(wanted.name_file(name))
        if files[file] > 1:
            draft.add(
                (*key, "file"), f"{file} is written by another export, too; name another file"
            )


def build_exports(table: SceneTable) -> dict[str, Export]:
    """Return what a run writes for other programs, by name."""
    return {name: export.fill(Export) for name, export in table.exports.items()}


def check_spaces(scene: Scene, findings: Findings) -> None:
    """Report state spaces that the machine of a scene cannot have."""
    for name, wanted in scene.exports.items():
        for key, fault in _find_space_faults(scene, wanted, ("exports", name)):
            findings.add(key, fault)


def require_space(scene: Scene, wanted: Export) -> None:
    """Refuse a state space that the machine of a scene cannot have.

    Raises:
        SceneError: It cannot; with the line of what stands in the way.
    """
    problems = [
        scene.findings.describe(key, fault) for key, fault in _find_space_faults(scene, wanted, ())
    ]
    if problems:
        raise SceneError(problems)


def _find_space_faults(scene: Scene, wanted: Export, at: KeyPath) -> Iterator[tuple[KeyPath, str]]:
    """Yield what keeps a machine from an export as a state space: the key at fault, and what to write.

    Args:
        at: Key of the export; empty for one that is no part of the scene.
    """
    machine, axes, still = scene.machine, scene.machine.axes, _list_still(scene.machine)
    if wanted.kind.of != "space":
        return
    if scene.is_lumped:
        text = "a state space is of a machine of coupled components, not of a lumped mechanism"
        yield ("mechanism", "model"), f'{text}; write model = "components", or leave out the export'
    if not machine.points and "frf" not in scene.analyses.names:
        text = "there is no point whose motion could be an output"
        yield at, f"{text}; write [points], or [analyses.frf] with inputs"
    loaded = [one.loaded_places for one in scene.analyses.requests if one.analysis == "frf"]
    for number, name in enumerate(itertools.chain(*loaded)):
        if name in machine.displacements:
            text = (
                "is a displacement, whose rate and acceleration act as well: an input of responses"
            )
            yield ("analyses", "frf", "inputs", number), f"{text}; leave it out of a state space"
    if wanted.motors != "locked" and not scene.drives:
        text = f"no drive has a motor that is {wanted.motors}"
        key = ("effects", "drive_control")
        yield key, f"{text}; describe one in [drives.NAME] and write drive_control = true"
    for what, stands in (
        ("the mechanism", machine.mechanism is not None and not scene.is_lumped),
        ("gravity_stiffening", machine.gravity_stiffening),
    ):
        if wanted.travel and stands:
            text = f"{what} changes more than the rows of joints along the travel"
            yield (*at, "travel"), f"{text}; leave out travel, and export single poses"
    for number, name in enumerate(wanted.travel):
        if name not in axes:
            text = f"there is no axis {name!r}; axes: {', '.join(axes) or 'none'}"
            yield (*at, "travel", number), text
            continue
        if not np.isfinite(axes[name].limits).all():
            text = "has no limits, between which it could travel; write `limits`"
            yield ("axes", name), text
        for joint in machine.joints.values():
            if _fixes_other_motions(joint, axes[name], still):
                text = f"fixes other motions rigidly wherever {name} stands, and a state space along its travel"
                yield (
                    ("joints", joint.name),
                    f"{text} has no common basis; give what is rigid there a stiffness, or leave {name} out of travel",
                )


def _list_still(machine: Machine) -> set[str | None]:
    """Return ground as None, and the components that cannot move at all."""
    still = {None, *(support.component for support in machine.supports.values())}
    size = 0
    while size < len(still):
        size = len(still)
        for joint in machine.joints.values():
            ends = {end.component for end in joint.ends}
            if len(joint.fixed) == len(DOF_NAMES) and ends & still:
                still |= {
                    name for name in ends if name and machine.components[name].fidelity == "rigid"
                }
    return still


def _fixes_other_motions(joint: Joint, axis: Axis, still: Collection[str | None]) -> bool:
    """Return whether what a joint fixes, in the axes of its bodies, changes as an axis moves.

    Fixed translations at a point that slides by ``d`` change by turns about ``d x a``; an axis that
    turns mixes directions. Only bodies that cannot move, and their turns, leave it the same.
    """
    moved = [end.component in axis.moves for end in joint.ends]
    if not joint.fixed or all(moved) or not any(moved):
        return False
    first, second = (end.component for end in joint.ends)
    carrier, other = (second, first) if first is None else (first, second)
    if joint.length is not None or other in still:
        return joint.length is not None
    translations, turns = (
        joint.rotation[:, [dof - start for dof in joint.fixed if start <= dof < start + 3]]
        for start in (0, 3)
    )
    kept = [part if carrier in still else np.zeros((3, 0)) for part in (translations, turns)]
    if axis.kind == "linear":
        return _leaves(axis.direction, translations, kept[1])
    slid = (axis.center if joint.point is None else joint.point) - axis.center
    return (
        _leaves(axis.direction, translations, kept[0])
        or _leaves(axis.direction, turns, kept[1])
        or _leaves(np.cross(axis.direction, slid).astype(float), translations, kept[1])
    )


def _leaves(direction: FloatArray, turned: FloatArray, space: FloatArray) -> bool:
    """Return whether the cross product of a direction with any of others ``(3, k)`` leaves the span of
    directions ``(3, m)``.
    """
    products = np.cross(direction, turned.T).T
    inside = space @ np.linalg.pinv(space, rcond=ALONG)
    return bool(np.abs(products - inside @ products).max(initial=0.0) > ALONG)
