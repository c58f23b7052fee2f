"""What a run writes for other programs: checked against the rest of the scene, and built."""

from collections import Counter

from headstock.scene.building.draft import Draft
from headstock.scene.exports import Export
from headstock.scene.schema.scene import SceneTable


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
