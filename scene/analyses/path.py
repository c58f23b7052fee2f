"""A straight move of axes or of the tool of a mechanism: how fast, and how far the tool leaves its line."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from headstock.geometry.errors import PoseError
from headstock.geometry.machine.carriages import find_overhangs
from headstock.geometry.machine.machine import MachinePath, Pose, place_components, show_position
from headstock.geometry.mechanisms.exechon import TOOL_POINT
from headstock.scene.building.axes import find_measure_fault, find_position_fault
from headstock.scene.building.cutting import (
    CUTTING_FORCE,
    build_cut,
    check_cutter,
    find_lead_fault,
    part_side,
    tooth_period,
)
from headstock.scene.building.draft import (
    Draft,
    SceneAnalysis,
)
from headstock.scene.building.drives import (
    DRIVE_CONTROL,
    FRICTION,
    build_drives,
    check_sampling,
    driven_axis,
)
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.reading.units import ANGULAR_SPEED, LENGTH, SPEED, Dimension, Quantity
from headstock.scene.scene import Request, Scene
from headstock.scene.schema import types
from headstock.scene.schema.axes import PoseTable
from headstock.scene.schema.cutting import MillTable
from headstock.scene.schema.effects import GUIDE_ERRORS
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.milling.forces import MillingCut, Side
from headstock.solvers.motion.deviation import LowPass
from headstock.solvers.motion.set_points import Ramp, SetPoint, find_move_fault
from headstock.solvers.second_order import Channel

KEY: KeyPath = ("analyses", "path")
CUT: KeyPath = (*KEY, "cut")
# times the inverse of the time constant: beyond it a ramp has less than 2 % of its spectrum, 1/(pi f T)
RAMP_BAND = 16.0
RAMP_SAMPLES = 10.0  # on a ramp, that a remedy asks for
TOOTH_HARMONICS = 10  # of the passing of teeth
Channels = Annotated[list[types.ChannelName], Field(min_length=1, max_length=30)]
Feeds = Annotated[list[types.PathFeed], Field(min_length=1, max_length=20)]


@dataclass(frozen=True)
class PathCut:
    """Milling along a path.

    Attributes:
        cut: Tool, material and engagement.
        at: Point where the tool is.
        up: Direction from the tool's tip to its holder, machine frame.
        part: On which side of the travel the part lies, seen from above.
    """

    cut: MillingCut
    at: str
    up: tuple[float, float, float]
    part: Side = "right"


@dataclass(frozen=True)
class PathRequest(Request):
    """A move of axes, straight in their positions, once per feed.

    Attributes:
        moves: One per feed, in the order of the scene.
        outputs: Where the deviation is wanted.
        low_pass: What the deviation is filtered by; None for nothing.
        residual_time: How long after a ramp its residual vibration is looked at, and recorded after the end [s].
        band_hz: How high it looks [Hz].
        cut: What is milled on the way; None for a move in air.
        follows_pose: The machine's matrices change along the way; else those of its middle hold.
    """

    analysis: ClassVar[str] = "path"

    path: MachinePath
    moves: tuple[SetPoint, ...]
    outputs: tuple[Channel, ...]
    sampling_hz: float
    low_pass: LowPass | None
    residual_time: float
    band_hz: float
    cut: PathCut | None = None
    follows_pose: bool = True
    estimate: bool = True

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        feeds = " and ".join(move.name.partition(" ")[0] for move in self.moves)
        unit = self.moves[0].name.partition(" ")[2]
        length = show_position(self.path.length, self.path.unit)
        cut = "" if self.cut is None else f", cutting forces in {self.cut.cut.coefficients.name}"
        return f"{', '.join(self.path.axes)} moves {length} at {feeds} {unit}, sampled at {self.sampling_hz:g} Hz{cut}"


class _PathCutTable(types.StrictTable):
    """Milling along a path; used with the effect `cutting_force`."""

    mill: MillTable
    """the milling tool"""
    spindle: types.PositiveAngularSpeed
    """speed of the spindle"""
    axial_depth: types.PositiveLength
    """depth of cut along the tool"""
    radial_depth: types.PositiveLength
    """depth of cut across the tool, at most its diameter"""
    sense: Literal["down", "up"] = "down"
    """`down` (climb): teeth leave at the finished face; `up` (conventional): they enter there"""
    part_side: Literal["right", "left"] | None = None
    """side of the travel on which the part lies; default: where a clockwise tool mills in this sense"""
    material: types.Text
    """workpiece material: of `[cutting.NAME]`, or of the [catalogue](cutting_coefficients.md)"""
    at: types.Text | None = None
    """point where the tool is; default: the first one"""
    up: types.Direction = (0.0, 0.0, 1.0)
    """direction from the tool's tip to its holder"""


class PathTable(types.RequestTable):
    """How far a point leaves the straight line while axes accelerate to a feed and stop again."""

    loads_probes = "by itself"

    start: Annotated[PoseTable, Field(alias="from", min_length=1)]
    """start position of the axes: `{ X = "-40 mm" }`"""
    to: Annotated[PoseTable, Field(min_length=1)]
    """end position; every axis, linear or rotary, has a constant share of the way"""
    pose: types.Text | None = None
    """pose that gives the position of all other axes; default: zero"""
    feeds: Feeds
    """feed rates; the path is computed once for each; of the linear travel where a linear axis moves, else an angular speed such as `"3600
    deg/min"`"""
    time_constant: types.PositiveTime
    """feed divided by acceleration; for exponential ramps the time constant of the lag"""
    ramp: Literal["linear", "s_curve", "exponential"] = "linear"
    """`linear`: constant acceleration; `s_curve`: its jerk limited too; `exponential`: a first-order lag"""
    jerk_time: types.PositiveTime | None = None
    """acceleration divided by jerk; required by an S-curve, and at most `time_constant`"""
    outputs: Channels | None = None
    """where the deviation is computed: `[["tcp", "z"]]`; default: all points in x, y and z"""
    sampling: types.PositiveFrequency = 2500.0
    """samples per second, more than twice `lowpass`"""
    lowpass: types.PositiveFrequency | None = None
    """cut-off frequency of a fourth-order Butterworth low-pass filter applied to the deviation; default: none"""
    filter: Literal["zero_phase", "causal"] = "zero_phase"
    """`zero_phase`: forwards and backwards, without delay; `causal`: once, as a measuring instrument does"""
    residual_time: types.PositiveTime = 0.3
    """time after a ramp over which residual vibration is evaluated, also recorded after the end"""
    cut: _PathCutTable | None = None
    """milling along the path; used with the effect `cutting_force`"""
    pose_model: Literal["pose_dependent", "frozen"] | None = None
    """`pose_dependent`: the machine's matrices change along the path; `frozen`: those at mid-path are used throughout; default:
    `pose_dependent`, but `frozen` for axes under control"""
    estimate: types.Flag = True
    """± of its numbers, for which machines of components make the moves once more per mesh and for modes left out"""

    def stops(self) -> Iterator[tuple[KeyPath, str, Quantity]]:
        """Yield every position of both ends: its key, its axis, its value."""
        for end, positions in (("from", self.start), ("to", self.to)):
            yield from (((*KEY, end, axis), axis, value) for axis, value in positions.items())

    @property
    def effects(self) -> frozenset[str]:
        """Axes rub, and a mill cuts."""
        return frozenset({FRICTION, CUTTING_FORCE})

    def _faults(self) -> Iterator[str]:
        if self.ramp == "s_curve" and self.jerk_time is None:
            yield 'an S-curve needs the time in which the acceleration is reached; write jerk_time = "30 ms"'
        if self.ramp != "s_curve" and self.jerk_time is not None:
            yield 'only an S-curve has a jerk_time; remove it, or write ramp = "s_curve"'
        if self.jerk_time is not None and self.jerk_time > self.time_constant:
            yield (
                f"jerk_time is {1e3 * self.jerk_time:g} ms and longer than the time_constant of {1e3 * self.time_constant:g} ms;"
                " shorten it"
            )
        if self.lowpass is not None and self.sampling <= 2.0 * self.lowpass:
            yield (
                f"a low-pass at {self.lowpass:g} Hz needs more than {2.0 * self.lowpass:g} samples a second, and sampling is"
                f' {self.sampling:g} Hz; write for example sampling = "{5.0 * self.lowpass:g} Hz"'
            )


def build_path(scene: SceneTable, table: PathTable) -> MachinePath:
    """Both ends: axes that the path does not name stand where its pose has them."""
    rest = {axis: value.value for axis, value in scene.poses.get(table.pose or "", {}).items()}
    first = rest | {axis: value.value for axis, value in table.start.items()}
    return MachinePath(
        Pose("from", first),
        Pose("to", first | {axis: value.value for axis, value in table.to.items()}),
        frozenset(axis for axis, entry in scene.axes.items() if entry.kind == "rotary"),
    )


def _build(table: PathTable, draft: Draft) -> PathRequest:
    """Build the request: the deviation of all points unless the table names outputs."""
    scene = draft.table
    line = build_path(scene, table)
    ramp = Ramp(table.ramp, table.time_constant, table.jerk_time or 0.0)
    return table.fill(
        PathRequest,
        path=line,
        moves=tuple(SetPoint(line.length, feed.value, ramp, line.unit) for feed in table.feeds),
        outputs=draft.build_channels(table.outputs or [(name, "") for name in scene.points]),
        sampling_hz=table.sampling,
        low_pass=None if table.lowpass is None else LowPass(table.lowpass, table.filter),
        band_hz=_find_band(scene, table),
        cut=_build_cut(scene, table),
        follows_pose=_follows_pose(scene, table),
    )


def _build_cut(scene: SceneTable, table: PathTable) -> PathCut | None:
    """Build what is milled along the path, where the effect ``cutting_force`` is on."""
    if table.cut is None or CUTTING_FORCE not in scene.active:
        return None
    cut, at = table.cut, table.cut.at or next(iter(scene.points))
    return PathCut(build_cut(scene, cut, _feeds_per_tooth(table, cut)), at, cut.up, part_side(cut))


def _feeds_per_tooth(table: PathTable, cut: _PathCutTable) -> list[float]:
    """Return the feed per tooth [m] of each feed; none where one is no speed."""
    if any(feed.dimension != SPEED for feed in table.feeds):
        return []
    return [feed.value * tooth_period(cut) for feed in table.feeds]


def _check(table: PathTable, draft: Draft) -> None:
    """Report what is wrong with a path, apart from rails."""
    scene = draft.table
    for index, (name, direction) in enumerate(table.outputs or ()):
        draft.check_channel((*KEY, "outputs", index), name, direction)
    if table.pose is not None:
        draft.check_name((*KEY, "pose"), table.pose, "poses")
    for key, axis, _ in table.stops():
        draft.check_name(key, axis, "axes", "axis")
    before = len(draft.findings.problems)
    if scene.mechanism is not None:
        _check_tool_path(table, draft.findings)
    for key, axis, value in table.stops():
        if axis in scene.axes and (fault := find_position_fault(axis, value, scene)):
            draft.add(key, fault)
    if table.outputs is None and not scene.points:
        draft.add(
            KEY,
            'there is no point whose deviation is wanted; write [points], or outputs = [["tcp", "z"]]',
        )
    if len(draft.findings.problems) == before:
        _check_moves(scene, table, draft.findings)
    if (cut := table.cut) is not None:
        check_cutter(CUT, cut, _feeds_per_tooth(table, cut), draft)


def _check_tool_path(table: PathTable, findings: Findings) -> None:
    """Report what a path of the tool of a mechanism cannot have."""
    for key, axis, value in table.stops():
        if axis not in TOOL_POINT:
            findings.add(
                key, "a path of a mechanism leads its tool along X, Y and Z; set other axes by pose"
            )
        elif fault := find_measure_fault(axis, value, LENGTH):
            findings.add(key, fault)


def _check_complete(table: PathTable, draft: Draft) -> None:
    """Report a cut without a tool, and axes under control that no drive moves."""
    scene = draft.table
    _check_cut(table, draft)
    if DRIVE_CONTROL not in scene.active:
        return
    if table.lowpass is not None:
        check_sampling(draft, table.lowpass, "path", "lowpass")
    driven = {driven_axis(name, table) for name, table in scene.drives.items()}
    for axis, end in table.to.items():
        start = table.start.get(axis)
        if (
            axis in scene.axes
            and scene.axes[axis].kind == "linear"
            and axis not in driven
            and (start is None or start.value != end.value)
        ):
            draft.findings.add_for(
                "path",
                ("analyses", "path", "to", axis),
                f"axis {axis} moves under control, but no drive moves it; write [drives.{axis}]",
            )


def _check_cut(table: PathTable, draft: Draft) -> None:
    """Report a cut without a tool, and the effect that needs a cut."""
    scene, cut = draft.table, table.cut
    cuts = CUTTING_FORCE in scene.active
    elsewhere = scene.mechanism is not None or "contouring" in scene.analyses.requested
    if cuts and cut is None and not elsewhere:
        draft.add(
            ("effects", CUTTING_FORCE),
            "nothing is milled; write [analyses.path.cut] with mill, spindle, depths and material",
        )
    if cut is None:
        return
    if cut.at is not None:
        draft.findings.check_name((*CUT, "at"), cut.at, scene.points, "point", "points")
    elif not scene.points:
        draft.add(CUT, "there is no point for the tool; write [points]")


def _check_scene(request: PathRequest, scene: Scene, findings: Findings) -> None:
    """Report where the tool of a mechanism cannot get, every carriage that hangs over the end of its
    rail on the way, and a mill that is led along its axis.

    Axes have constant shares of the way, so its ends tell.
    """
    _check_lead(request, scene, findings)
    for end, share in (("from", 0.0), ("to", 0.5), ("to", 1.0)) if scene.mechanism else ():
        try:
            place_components(scene.machine, request.path.pose_at(share * request.path.length))
        except PoseError as error:
            findings.add((*KEY, end), str(error))
            return
    for end, pose in (("from", request.path.start), ("to", request.path.end)):
        for fault in find_overhangs(scene.machine, pose).values():
            findings.add((*KEY, end), fault)


def _check_lead(request: PathRequest, scene: Scene, findings: Findings) -> None:
    """Report a straight path that leads its mill along the tool's own axis."""
    if request.cut is None:
        return
    start, end = request.path.start.positions, request.path.end.positions
    moved = {name: end.get(name, 0.0) - start.get(name, 0.0) for name in request.path.axes}
    machine = scene.machine
    if scene.mechanism is not None:
        travel = np.array([moved.get(name, 0.0) for name in "XYZ"])
    elif any(axis.kind == "rotary" for axis in machine.axes.values()):
        return  # they turn the directions of others; the run tells
    else:
        point = machine.points[request.cut.at]
        travel = sum(
            (
                ((point.tool.component in axis.moves) - (point.work.component in axis.moves))
                * moved[name]
                * axis.direction
                for name, axis in machine.axes.items()
                if name in moved
            ),
            np.zeros(3),
        )
    if np.linalg.norm(travel) > 0.0 and (
        fault := find_lead_fault(np.array(request.cut.up), travel)
    ):
        findings.add(
            ("analyses", "path", "cut", "up"),
            f"points along the path, {fault}; write another up, or another path",
        )


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
    highest = 0.5 * table.sampling
    if scene.mechanism is None:
        return highest
    cut = _build_cut(scene, table)
    teeth = 0.0 if cut is None else cut.cut.mill.teeth * cut.cut.spindle / (2.0 * math.pi)
    passed = max(feed.value for feed in table.feeds) / min(_list_waves(scene), default=math.inf)
    return min(highest, max(RAMP_BAND / table.time_constant, TOOTH_HARMONICS * teeth, passed))


def _list_waves(scene: SceneTable) -> list[float]:
    """Lengths of the waves of errors and of motor torques of a mechanism, along its legs, which are at
    most as fast as its tool [m].
    """
    # with the effect torque_ripple
    lengths = [
        drive.lead / wave.per_turn
        for drive in build_drives(scene).values()
        for wave in drive.ripple
    ]
    if scene.mechanism is None or GUIDE_ERRORS not in scene.active:
        return lengths
    legs = scene.mechanism.errors
    profiles = [] if legs is None else [*legs.profiles().values()]
    for joint in scene.joints.values():
        if joint.errors is not None:
            profiles += joint.errors.profiles().values()
            if joint.errors.ball_passing is not None:
                lengths.append(joint.errors.ball_passing.period)
    for profile in profiles:
        lengths += [wave.period.value for wave in profile.waves or ()]
        if profile.points is not None:
            places = [position.value for position in profile.points.at]
            lengths += [later - earlier for earlier, later in itertools.pairwise(places)]
    return lengths


def _follows_pose(scene: SceneTable, table: PathTable) -> bool:
    """A loop of linear axes under control is closed in the pose of the middle, unless something else
    is written.
    """
    if table.pose_model is None:
        return (
            scene.mechanism is not None
            or bool(build_path(scene, table).turning)
            or not build_drives(scene)
        )
    return table.pose_model == "pose_dependent"


ANALYSIS = SceneAnalysis(
    PathTable,
    PathRequest,
    "a straight line travelled by axes, see [path analysis](path_analysis.md)",
    build=_build,
    check=_check,
    check_complete=_check_complete,
    check_scene=_check_scene,
)
