"""A contour: a block milled around from outside, or a line that the tool's centre follows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.carriages import find_overhangs
from headstock.geometry.machine.machine import Pose, find_limit_fault
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.meshing.process.strangers import CORNERS, RECORD, FileKind
from headstock.scene.building.cutting import (
    CUTTING_FORCE,
    build_cut,
    build_tool_mode,
    check_cutter,
    part_side,
    tooth_period,
)
from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.building.drives import FRICTION
from headstock.scene.reading.csv_files import MOST_CORNERS, CsvError, read_corners, read_history
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.scene import Request, Scene
from headstock.scene.schema import types
from headstock.scene.schema.cutting import MillTable, ToolModeTable
from headstock.scene.schema.effects import read_modal_damping, read_rayleigh_damping
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.tool_dynamics import ToolMode
from headstock.solvers.milling.tool_path import (
    AVERAGES,
    SHORTEST_FACE,
    PolylineContour,
    SquareContour,
    describe_contour,
    plan_contour,
)

KEY: KeyPath = ("analyses", "contouring")
FORCE_SUFFIXES = (".csv",)
PASSINGS = 2.0  # modes are kept up to so many times the frequency at which teeth pass
LOOKS = 200  # places along a contour at which axes are compared with their limits
UP = (0.0, 0.0, 1.0)  # along the tool
SLOWEST = 1e-10  # feed per tooth [m]
ONE_HEIGHT = 1e-9  # of corners [m]


@dataclass(frozen=True)
class ContouringRequest(Request):
    """A contour.

    Attributes:
        cut: Tool, material and engagement.
        model: ``linear`` along the path, or the full equations.
        material: Name of the work material; None with measured forces.
        forces: File of measured forces; None for computed ones.
        cutting: Whether the tool cuts; otherwise it goes its way in air.
        regeneration: Whether a tooth meets the wave the one before it left.
        point: Where the tool is, of a machine of components; a lumped mechanism has its own.
        modes_to_hz: Modes kept of a machine of components; what is above follows at once.
        follows_pose: The machine's matrices change along the way; else those of its first straight
            cut hold.
        traces: File of measured positions of axes or legs; None for the computed path.
        traces_knots: Distance of the knots of the spline through them [s].
        tool_modes: Lumped modes of spindle and tool, from the machine to the tip.
        cut_off: Wavelength between roughness and waviness of milled faces [m].
    """

    analysis: ClassVar[str] = "contouring"

    contour: SquareContour | PolylineContour
    cut: MillingCut
    model: Literal["linear", "nonlinear"]
    steps_per_turn: int
    damping: PoseDamping = field(default_factory=PoseDamping)
    material: str | None = None
    forces: Path | None = None
    cutting: bool = True
    regeneration: bool = False
    point: str | None = None
    modes_to_hz: float = math.inf
    follows_pose: bool = True
    traces: Path | None = None
    traces_knots: float = 0.01
    tool_modes: tuple[ToolMode, ...] = ()
    cut_off: float = 0.8e-3
    estimate: bool = True

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        source = (
            f"forces of {self.forces.name}"
            if self.forces is not None
            else f"cutting forces in {self.material}"
        )
        if not self.cutting:
            source = "no cutting force: not named in [effects]"
        elif self.regeneration:
            source += ", chips as thick as the last teeth left them"
        if self.traces is not None:
            source += f", drives as in {self.traces.name}"
        if self.tool_modes:
            source += f", {len(self.tool_modes)} mode(s) of spindle and tool"
        return f"tool gap {describe_contour(self.contour)}, {self.model}, {source}"


class _ContouringTable(types.RequestTable):
    """A square block milled around from outside, or a line that the tool's centre follows."""

    loads_probes = "by itself"

    model_config = types.one_of("side", "polyline", "polyline_file")

    side: types.PositiveLength | None = None
    """side of the finished block, gone around clockwise seen from above if it lies on the right of the travel"""
    at: types.Position | None = None
    """centre of the block and height of the tool point, in the machine frame of a mechanism; of axes the position of the tool relative to
    its work, counted from where it is with all axes at zero; required with `side`"""
    polyline: (
        Annotated[list[types.Position], Field(min_length=2, max_length=MOST_CORNERS)] | None
    ) = None
    """in place of a block: corners that the tool's centre follows, at one height, in the places of `at`"""
    polyline_file: types.Text | None = None
    """the same from a CSV file with the columns `x,y,z` in m, and `feed` to each corner in m/s if it differs"""
    corner_radius: types.NotNegativeLength = 0.0
    """radius of arcs around the corners of a polyline; sharp ones are rounded by the averages"""
    feed: types.PositiveSpeed
    """feed rate of the tool's centre along the path"""
    spindle: types.PositiveAngularSpeed
    """speed of the spindle"""
    mill: MillTable
    """the milling tool"""
    axial_depth: types.PositiveLength
    """depth of cut along the tool"""
    radial_depth: types.PositiveLength
    """depth of cut across the tool, at most its diameter"""
    sense: Literal["down", "up"] = "down"
    """`down` (climb): teeth leave at the finished face; `up` (conventional): they enter there"""
    part_side: Literal["right", "left"] | None = None
    """side of the travel on which the part lies; default: where a clockwise tool mills in this sense"""
    material: types.Text | None = None
    """workpiece material, in place of measured `forces`: of `[cutting.NAME]`, or of the [catalogue](cutting_coefficients.md)"""
    forces: types.Text | None = None
    """measured forces in place of computed ones: CSV with the columns `time,fx,fy,fz` in s and N, on the tool, machine frame; each time
    step takes their mean over it"""
    traces: types.Text | None = None
    """measured positions that the drives follow in place of the computed path: CSV with the columns `time` in s and in m `q1,q2,q3` of the
    legs of a mechanism or the names of the axes; its time starts with the path"""
    traces_knots: types.PositiveTime = 0.01
    """spacing of the knots of the spline through measured positions; noise between them is left out"""
    lead: types.NotNegativeLength = 0.02
    """length of the straight path before and after the block"""
    averaging: types.PositiveTime = 0.01
    """length of each of three moving averages that limit the jerk"""
    model: Literal["linear", "nonlinear"] = "linear"
    """`linear`: small motions about the path, with friction at the speeds of the set points; `nonlinear`: friction at the speeds of the
    motors, and of a lumped mechanism the full equations"""
    steps_per_turn: Annotated[types.WholeNumber, types.Between(24, 2000)] = 96
    """time steps per turn of the spindle"""
    point: types.Text | None = None
    """where the tool is, against the work; default: the scene's first point"""
    modes_to: types.PositiveFrequency | None = None
    """modes of a machine of components kept in time; those above follow quasi-statically; default: twice the frequency at which teeth pass"""
    pose_model: Literal["pose_dependent", "frozen"] = "pose_dependent"
    """`pose_dependent`: matrices of a machine of components change along the way; `frozen`: those of the middle of face 1"""
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    """lumped modes of spindle and tool as those of `[analyses.lobes]`, across the z axis unless they have a direction"""
    cut_off: types.PositiveLength = 0.8e-3
    """wavelength between roughness and waviness of the milled faces (Gaussian filter of ISO 16610-21)"""
    estimate: types.Flag = True
    """± of its numbers, for which machines of components go the contour once or twice more"""

    @property
    def effects(self) -> frozenset[str]:
        """Axes rub, and teeth cut what those before them left."""
        return frozenset({FRICTION, CUTTING_FORCE, "regeneration"})

    def _faults(self) -> Iterator[str]:
        written = self.given(("side", "polyline", "polyline_file"))
        if len(written) != 1:
            yield f"gives {' and '.join(written) or 'no way for the tool'}; write either a block, side and at, or polyline, or polyline_file"
        if (self.side is None) != (self.at is None):
            yield (
                "has at, the centre of a block, without side"
                if self.side is None
                else "has side without at, the centre of the block and the height of the tool point"
            )


def _build(table: _ContouringTable, draft: Draft) -> ContouringRequest:
    """Build the request.

    Raises:
        ValueError: A file is missing or out of bounds, or the corners of a line are no contour.
        CsvError: The file of corners cannot be used.
    """
    scene = draft.table
    damping = scene.effects.get("damping", False)
    return table.fill(
        ContouringRequest,
        contour=_build_contour(table, draft.folder),
        cut=build_cut(scene, table, [table.feed * tooth_period(table)]),
        damping=PoseDamping(read_modal_damping(damping), read_rayleigh_damping(damping)),
        forces=_find_file(draft.folder, table.forces),
        traces=_find_file(draft.folder, table.traces),
        tool_modes=tuple(build_tool_mode(mode, UP) for mode in table.tool_modes),
        cutting="cutting_force" in scene.active,
        regeneration="regeneration" in scene.active,
        point=table.point or next(iter(scene.points), None),
        modes_to_hz=table.modes_to or PASSINGS * table.spindle / (2.0 * math.pi) * table.mill.teeth,
        follows_pose=table.pose_model == "pose_dependent",
    )


def _find_file(folder: Path, name: str | None, kind: FileKind = RECORD) -> Path | None:
    return None if name is None else resolve_file(folder, name, FORCE_SUFFIXES, kind)


def _build_contour(table: _ContouringTable, folder: Path) -> SquareContour | PolylineContour:
    """The way of the tool: around a block, or along a line.

    Raises:
        ValueError: Corners are not at one height, or the file is missing or out of bounds.
        CsvError: The file of corners cannot be used.
    """
    offset, part = 0.5 * table.mill.diameter, part_side(table)
    if table.side is not None and table.at is not None:
        return SquareContour(
            side=table.side,
            center=(table.at[0], table.at[1]),
            height=table.at[2],
            offset=offset,
            lead=table.lead,
            feed=table.feed,
            window=table.averaging,
            part=part,
        )
    path, feeds = _find_file(folder, table.polyline_file, CORNERS), None
    if path is None:
        corners = np.array(table.polyline, dtype=float)
    else:
        corners, feeds = read_corners(path)
    heights = corners[:, 2]
    if np.ptp(heights) > ONE_HEIGHT:
        raise ValueError(
            f"the corners lie between {1e3 * heights.min():g} and {1e3 * heights.max():g} mm; a contour lies at one height"
        )
    rates = np.full(len(corners), table.feed) if feeds is None else feeds
    return PolylineContour(
        points=tuple((float(x), float(y)) for x, y, _ in corners),
        feeds=tuple(float(rate) for rate in rates[1:]),
        radius=table.corner_radius,
        height=float(heights[0]),
        offset=offset,
        lead=table.lead,
        window=table.averaging,
        part=part,
    )


def _check_way(table: _ContouringTable, folder: Path, findings: Findings) -> None:
    """Report a contour that cannot be laid out."""
    key = "side" if table.side is not None else "polyline"
    key = key if table.polyline_file is None else "polyline_file"
    if table.side is not None and table.corner_radius:
        findings.add(
            (*KEY, "corner_radius"),
            "is of a polyline; around the corners of a block the radius is that of the tool",
        )
    try:
        plan = plan_contour(_build_contour(table, folder))
    except (ValueError, CsvError) as error:
        findings.add((*KEY, key), str(error))
        return
    if not plan.cuts:
        findings.add(
            (*KEY, key),
            f"has no straight cut of {1e3 * SHORTEST_FACE:g} mm beside the leads; a face is at least so long",
        )
        return
    radius, passing = 0.5 * table.mill.diameter, table.spindle * table.mill.teeth / (2.0 * math.pi)
    fastest, slowest = (choose(cut.feed for cut in plan.cuts) for choose in (max, min))
    if fastest > radius * passing:
        findings.add(
            (*KEY, "feed" if table.feed == fastest else key),
            f"leads the tool {1e3 * fastest / passing:.3g} mm further per tooth, and its radius is {1e3 * radius:g} mm: it would cut nothing in"
            f' between; write at most "{60.0 * radius * passing:.3g} m/min", or a faster spindle',
        )
    elif slowest < SLOWEST * passing:
        findings.add(
            (*KEY, "feed" if table.feed == slowest else key),
            f"leads the tool {1e9 * slowest / passing:.2g} nm further per tooth, less than an atom; write a faster feed, or a slower spindle",
        )
    longest = max(cut.length / cut.feed for cut in plan.cuts)
    if AVERAGES * table.averaging > longest:
        findings.add(
            (*KEY, "averaging"),
            f"rounds corners for {AVERAGES * table.averaging:.3g} s, and the tool takes {longest:.3g} s along the longest face, so that no"
            f' straight part is left; write at most "{1e3 * longest / AVERAGES:.2g} ms"',
        )


def _check(table: _ContouringTable, draft: Draft) -> None:
    """Report what is wrong with a contour, apart from places that it cannot reach."""
    scene = draft.table
    _check_regeneration(scene, table, draft.findings)
    if not scene.is_lumped:
        _check_coupled(scene, table, draft)
    cutting = "cutting_force" in scene.active
    if (table.material is not None and table.forces is not None) or (
        cutting and table.material is None and table.forces is None
    ):
        draft.add(KEY, 'needs either the material that is cut, or forces = "measured.csv"')
    _check_way(table, draft.folder, draft.findings)
    for name, written in (("forces", table.forces), ("traces", table.traces)):
        try:
            _find_file(draft.folder, written)
        except ValueError as error:
            draft.add((*KEY, name), str(error))
    check_cutter(KEY, table, [table.feed * tooth_period(table)], draft)


def _check_scene(request: ContouringRequest, scene: Scene, findings: Findings) -> None:
    """Report where linear axes cannot follow a contour; a mechanism tells when it closes its
    loops.
    """
    plan = plan_contour(request.contour)
    path = plan.path
    if scene.mechanism is not None:
        _check_traces(request, LENGTHS, path.span[1], findings)
        return
    machine, point = scene.machine, scene.machine.points[request.point or ""]
    try:
        travel = find_tool_travel(machine, point)
        places = travel.axis_positions(
            path.at(np.array([*np.linspace(*path.span, LOOKS), *plan.bends])).position
        )
    except ValueError as error:
        key = "at" if isinstance(request.contour, SquareContour) else "polyline"
        findings.add((*KEY, key), f"cannot be followed: {error}")
        return
    measured = _check_traces(request, travel.axes, path.span[1], findings)
    places = places if measured is None else measured
    for number, name in enumerate(travel.axes):
        low, high = machine.axes[name].limits
        for position in (float(places[:, number].min()), float(places[:, number].max())):
            if fault := find_limit_fault(name, position, low=low, high=high, unit="m"):
                findings.add(
                    KEY, f"the contour leads axis {name} too far: {fault}; move or shrink it"
                )
    if findings.concern("analyses"):
        return
    for row in (*places.argmin(axis=0), *places.argmax(axis=0)):
        pose = Pose("on the contour", dict(zip(travel.axes, places[row].tolist(), strict=True)))
        for fault in find_overhangs(machine, pose).values():
            findings.add(KEY, fault)


def _check_traces(
    request: ContouringRequest, names: tuple[str, ...], end: float, findings: Findings
) -> FloatArray | None:
    """Positions ``(n, k)`` that were measured on a contour, if any; what is wrong is reported.

    Args:
        end: When the path ends [s].
        findings: Receives what is wrong.
    """
    if request.traces is None:
        return None
    try:
        times, positions = read_history(request.traces, names)
    except CsvError as error:
        findings.add((*KEY, "traces"), str(error))
        return None
    if times[0] > 0.0 or times[-1] < end:
        findings.add(
            (*KEY, "traces"),
            f"holds {times[0]:g} to {times[-1]:g} s, and the path takes 0 to {end:.6g} s; its time starts with the path",
        )
    return positions


def _check_coupled(scene: SceneTable, table: _ContouringTable, draft: Draft) -> None:
    if table.point is not None:
        draft.check_name((*KEY, "point"), table.point, "points")
    elif not scene.points:
        draft.add(
            KEY,
            'no point says where the tool is; write [points] tcp = { tool = "spindle.tip", work = "table.top" }',
        )
    if table.model != "linear" and FRICTION not in scene.active:
        draft.add(
            (*KEY, "model"),
            "of a machine of components follows its friction alone, at the speeds of the motors, and nothing rubs here;"
            ' write [effects] friction = true with drive_control, or model = "linear"',
        )


def _check_regeneration(scene: SceneTable, table: _ContouringTable, findings: Findings) -> None:
    key = ("effects", "regeneration")
    if "regeneration" not in scene.active:
        return
    if "cutting_force" not in scene.active:
        findings.add(
            key, "acts through cutting forces; write [effects] cutting_force = true as well"
        )
    elif table.material is None:
        findings.add(
            key,
            "needs computed forces: measured ones contain it already; remove this, or write the material instead of forces",
        )
    elif table.steps_per_turn % table.mill.teeth:
        findings.add(
            ("analyses", "contouring", "steps_per_turn"),
            f"with regeneration must be a multiple of the {table.mill.teeth} teeth; write for example {24 * table.mill.teeth}",
        )


ANALYSIS = SceneAnalysis(
    _ContouringTable,
    ContouringRequest,
    "a block milled, see [contouring](contouring.md)",
    build=_build,
    check=_check,
    check_scene=_check_scene,
)
