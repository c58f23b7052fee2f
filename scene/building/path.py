"""The path of a path analysis, and checks of it: axes, limits, feeds and carriages on their rails."""

from headstock.geometry.machine.carriages import find_overhangs
from headstock.geometry.machine.machine import MachinePath, Pose
from headstock.scene.building.machine import find_position_fault
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.scene import Scene, list_analyses
from headstock.scene.schema.path import PathTable
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.paths.set_points import Ramp, SetPoint, find_move_fault

KEY: KeyPath = ("analyses", "path")


def build_path(scene: SceneTable, table: PathTable) -> MachinePath:
    """Both ends: axes that the path does not name stand where its pose has them."""
    rest = {axis: value.value for axis, value in scene.poses.get(table.pose or "", {}).items()}
    first = rest | {axis: value.value for axis, value in table.start.items()}
    return MachinePath(Pose("from", first), Pose("to", first | {axis: value.value for axis, value in table.to.items()}))


def check_path(scene: SceneTable, findings: Findings) -> None:
    """Report what is wrong with a path, apart from rails."""
    table = scene.analyses.path
    if table is None:
        return
    known = len(findings.problems)
    if scene.mechanism is not None:
        findings.add(KEY, "a path moves the axes of the scene, and a mechanism has none; remove one of them")
        return
    for end, stops in (("from", table.start), ("to", table.to)):
        for axis, value in stops.items():
            if axis not in scene.axes:
                continue  # reported with the other names
            fault = find_position_fault(axis, value, scene)
            if scene.axes[axis].kind != "linear":
                fault = "a path moves linear axes only; name another axis, and give this one its place by pose"
            if fault:
                findings.add((*KEY, end, axis), fault)
    if table.pose_changes == "followed" and scene.drives and scene.effects.get("drive_control", False) is not False:
        text = 'drives under control are closed in the pose of the middle; write "frozen", or leave the effect drive_control away'
        findings.add((*KEY, "pose_changes"), text)
    if table.outputs is None and not scene.points:
        findings.add(KEY, 'there is no point whose deviation is wanted; write [points], or outputs = [["tcp", "z"]]')
    if len(findings.problems) == known:
        _check_moves(scene, table, findings)


def check_path_carriages(scene: Scene, findings: Findings) -> None:
    """Report every carriage that hangs over the end of its rail on the way; the way is straight, so its ends tell."""
    request = list_analyses(scene).get("path")
    if request is None:
        return
    for end, pose in (("from", request.path.start), ("to", request.path.end)):
        for fault in find_overhangs(scene.machine, pose).values():
            findings.add((*KEY, end), fault)


def _check_moves(scene: SceneTable, table: PathTable, findings: Findings) -> None:
    line = build_path(scene, table)
    if not line.axes:
        findings.add((*KEY, "to"), "the path ends where it begins; write another position of an axis")
        return
    for index, feed in enumerate(table.feeds):
        move = SetPoint(line.length, feed, Ramp(table.ramp, table.time_constant, table.jerk_time or 0.0))
        if fault := find_move_fault(move):
            findings.add((*KEY, "feeds", index), fault)
