"""The path of a path analysis, built from its table, and what may be wrong with it: axes, limits,
feeds and carriages.
"""

import itertools
import math

from headstock.geometry.errors import PoseError
from headstock.geometry.machine.carriages import find_overhangs
from headstock.geometry.machine.machine import MachinePath, Pose, place_components
from headstock.geometry.mechanisms.tool_mechanism import TOOL_POINT
from headstock.scene.building.analyses import build_channels
from headstock.scene.building.axes import find_position_fault
from headstock.scene.building.draft import Draft, check_channel, check_name
from headstock.scene.building.drives import build_drives, build_path_cut
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import ANGULAR_SPEED, LENGTH, SPEED, Dimension
from headstock.scene.requests import PathRequest
from headstock.scene.scene import Scene
from headstock.scene.schema.effects import GUIDE_ERRORS
from headstock.scene.schema.path import PathTable
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.paths.response import LowPass
from headstock.solvers.paths.set_points import Ramp, SetPoint, find_move_fault

KEY: KeyPath = ("analyses", "path")
# times the inverse of the time constant: beyond it a ramp has less than 2 % of its spectrum, 1/(pi f T)
RAMP_BAND = 16.0
RAMP_SAMPLES = 10.0  # on a ramp, that a remedy asks for
TOOTH_HARMONICS = 10  # of the passing of teeth


def build_path(scene: SceneTable, table: PathTable) -> MachinePath:
    """Both ends: axes that the path does not name stand where its pose has them."""
    rest = {axis: value.value for axis, value in scene.poses.get(table.pose or "", {}).items()}
    first = rest | {axis: value.value for axis, value in table.start.items()}
    return MachinePath(
        Pose("from", first),
        Pose("to", first | {axis: value.value for axis, value in table.to.items()}),
        frozenset(axis for axis, own in scene.axes.items() if own.kind == "rotary"),
    )


def build_path_request(scene: SceneTable) -> PathRequest | None:
    """The path analysis a scene asks for."""
    path = scene.analyses.path
    if path is None:
        return None
    line = build_path(scene, path)
    ramp = Ramp(path.ramp, path.time_constant, path.jerk_time or 0.0)
    return PathRequest(
        path=line,
        moves=tuple(SetPoint(line.length, feed.value, ramp, line.unit) for feed in path.feeds),
        outputs=build_channels(path.outputs or [(name, "") for name in scene.points]),
        sampling_hz=path.sampling,
        low_pass=None if path.lowpass is None else LowPass(path.lowpass, path.filter),
        residual_time=path.residual_time,
        band_hz=_find_band(scene, path),
        cut=build_path_cut(scene),
        follows_pose=_follows_pose(scene, path),
        estimate=path.estimate,
    )


def check_path(draft: Draft, findings: Findings) -> None:
    """Report what is wrong with a path, apart from rails."""
    scene, table = draft.table, draft.table.analyses.path
    if table is None:
        return
    for index, (name, _) in enumerate(table.outputs or ()):
        check_channel((*KEY, "outputs", index), name, draft, findings)
    if table.pose is not None:
        check_name((*KEY, "pose"), table.pose, "poses", draft, findings)
    for end, stops in (("from", table.start), ("to", table.to)):
        for axis in stops:
            check_name((*KEY, end, axis), axis, "axes", draft, findings, "axis")
    known = len(findings.problems)
    if scene.mechanism is not None:
        _check_tool_path(scene, table, findings)
    for end, stops in (("from", table.start), ("to", table.to)):
        for axis, value in stops.items():
            if axis not in scene.axes:
                continue
            if fault := find_position_fault(axis, value, scene):
                findings.add((*KEY, end, axis), fault)
    if table.outputs is None and not scene.points:
        findings.add(
            KEY,
            'there is no point whose deviation is wanted; write [points], or outputs = [["tcp", "z"]]',
        )
    if len(findings.problems) == known:
        _check_moves(scene, table, findings)


def _check_tool_path(scene: SceneTable, table: PathTable, findings: Findings) -> None:
    """Report what a path of the tool of a mechanism cannot have."""
    for end, stops in (("from", table.start), ("to", table.to)):
        for axis, value in stops.items():
            if axis not in TOOL_POINT:
                findings.add(
                    (*KEY, end, axis),
                    "a path of a mechanism leads its tool along X, Y and Z; set other axes by pose",
                )
            elif value.dimension != LENGTH:
                findings.add(
                    (*KEY, end, axis),
                    f'{axis} is measured as {LENGTH.name}; write for example "{LENGTH.example}"',
                )


def check_path_carriages(scene: Scene, findings: Findings) -> None:
    """Report where the tool of a mechanism cannot get, and every carriage that hangs over the end of
    its rail on the way; axes have constant shares of it, so its ends tell.
    """
    request = scene.analyses.get(PathRequest) or scene.on_request.get(PathRequest)
    if request is None:
        return
    for end, share in (("from", 0.0), ("to", 0.5), ("to", 1.0)) if scene.mechanism else ():
        try:
            place_components(scene.machine, request.path.pose_at(share * request.path.length))
        except PoseError as error:
            findings.add((*KEY, end), str(error))
            return
    for end, pose in (("from", request.path.start), ("to", request.path.end)):
        for fault in find_overhangs(scene.machine, pose).values():
            findings.add((*KEY, end), fault)


def _check_moves(scene: SceneTable, table: PathTable, findings: Findings) -> None:
    line = build_path(scene, table)
    if not line.axes:
        findings.add(
            (*KEY, "to"), "the path ends where it begins; write another position of an axis"
        )
        return
    ramp = Ramp(table.ramp, table.time_constant, table.jerk_time or 0.0)
    if ramp.duration * table.sampling < 1.0:
        findings.add(
            (*KEY, "sampling"),
            f"is {table.sampling:g} Hz, and a ramp takes {1e3 * ramp.duration:g} ms: no sample falls on it; write at least"
            f' "{math.ceil(RAMP_SAMPLES / ramp.duration):g} Hz", or a longer time_constant',
        )
        return
    wanted = SPEED if line.unit == "m" else ANGULAR_SPEED
    for index, feed in enumerate(table.feeds):
        key = (*KEY, "feeds", index)
        if feed.dimension != wanted:
            findings.add(key, _name_feed(line, feed.dimension))
        elif fault := find_move_fault(SetPoint(line.length, feed.value, ramp, line.unit)):
            findings.add(key, fault)


def _name_feed(line: MachinePath, given: Dimension) -> str:
    """What is wrong with a feed of another kind than its path."""
    if line.unit == "m":
        linear = ", ".join(axis for axis in line.axes if axis not in line.turning)
        return f'is a {given.name}, and the feed is that of the linear travel where {linear} moves; write for example "{SPEED.example}"'
    return f'is a {given.name}, and {", ".join(line.turning)} turns alone; write an angular speed, for example "3600 deg/min"'


def _find_band(scene: SceneTable, table: PathTable) -> float:
    """How high a path looks [Hz]: to its low-pass, or as far as samples tell frequencies apart. A
    mechanism, whose steps in time follow its highest mode, only as far as ramps, teeth, and waves of
    errors and of torques excite it.
    """
    if table.lowpass is not None:
        return table.lowpass
    told = 0.5 * table.sampling
    if scene.mechanism is None:
        return told
    cut = build_path_cut(scene)
    teeth = 0.0 if cut is None else cut.cut.mill.teeth * cut.cut.spindle / (2.0 * math.pi)
    passed = max(feed.value for feed in table.feeds) / min(_list_waves(scene), default=math.inf)
    return min(told, max(RAMP_BAND / table.time_constant, TOOTH_HARMONICS * teeth, passed))


def _list_waves(scene: SceneTable) -> list[float]:
    """Lengths of the waves of errors and of motor torques of a mechanism, along its legs, which are at
    most as fast as its tool [m].
    """
    # with the effect torque_ripple
    found = [
        drive.lead / wave.per_turn
        for drive in build_drives(scene).values()
        for wave in drive.ripple
    ]
    if scene.mechanism is None or scene.effects.get(GUIDE_ERRORS, False) is False:
        return found
    legs = scene.mechanism.errors
    profiles = [] if legs is None else [*legs.profiles().values()]
    for joint in scene.joints.values():
        if joint.errors is not None:
            profiles += joint.errors.profiles().values()
            if joint.errors.ball_passing is not None:
                found.append(joint.errors.ball_passing.period)
    for profile in profiles:
        found += [wave.period.value for wave in profile.waves or ()]
        if profile.points is not None:
            places = [place.value for place in profile.points.at]
            found += [later - earlier for earlier, later in itertools.pairwise(places)]
    return found


def _follows_pose(scene: SceneTable, table: PathTable) -> bool:
    """A loop of linear axes under control is closed in the pose of the middle, unless something else
    is written.
    """
    return (
        scene.mechanism is not None
        or bool(build_path(scene, table).turning)
        or not build_drives(scene)
        if table.pose_model is None
        else table.pose_model == "pose_dependent"
    )
