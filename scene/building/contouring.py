"""A contour: built from its table, and what may be wrong with it, its effects and its reach."""

import math
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.carriages import find_overhangs
from headstock.geometry.machine.machine import Pose, find_limit_fault
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.meshing.process.strangers import CORNERS, RECORD, FileKind
from headstock.scene.building.cutting import build_cut, part_side
from headstock.scene.building.draft import Draft, check_name
from headstock.scene.building.drives import FRICTION
from headstock.scene.building.lobes import build_tool_mode
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.forces import ForceFileError
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.tool_positions import read_corners, read_positions
from headstock.scene.requests import ContouringRequest
from headstock.scene.scene import Scene
from headstock.scene.schema.effects import CONTOUR_EFFECTS
from headstock.scene.schema.mechanism import ContouringTable
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.tool_path import (
    AVERAGES,
    SHORTEST_FACE,
    PolylineContour,
    SquareContour,
    plan_contour,
)

KEY: KeyPath = ("analyses", "contouring")
FORCE_SUFFIXES = (".csv",)
PASSINGS = 2.0  # modes are kept up to so many times the frequency at which teeth pass
LOOKS = 200  # places along a contour at which axes are compared with their limits
UP = (0.0, 0.0, 1.0)  # along the tool
SLOWEST = 1e-10  # feed per tooth [m]
ONE_HEIGHT = 1e-9  # of corners [m]


def build_contouring(
    scene: SceneTable, folder: Path, damping: PoseDamping
) -> ContouringRequest | None:
    """The contour a scene asks for.

    Args:
        scene: With its tables.
        folder: Of the scene, for the file of measured forces.
        damping: Of the whole machine.

    Raises:
        ValueError: A file is missing or out of bounds, or the corners of a line are no contour.
        ForceFileError: The file of corners cannot be used.
    """
    table = scene.analyses.contouring
    if table is None:
        return None
    return ContouringRequest(
        contour=_build_contour(table, folder),
        cut=build_cut(scene, table),
        model=table.model,
        steps_per_turn=table.steps_per_turn,
        damping=damping,
        material=table.material,
        forces=_find_file(folder, table.forces),
        traces=_find_file(folder, table.traces),
        traces_knots=table.traces_knots,
        tool_modes=tuple(build_tool_mode(mode, UP) for mode in table.tool_modes),
        cutting=bool(scene.effects.get("cutting_force", False)),
        regeneration=bool(scene.effects.get("regeneration", False)),
        point=_tool_point(scene, table),
        modes_to_hz=table.modes_to or PASSINGS * table.spindle / (2.0 * math.pi) * table.mill.teeth,
        follows_pose=table.pose_model == "pose_dependent",
        cut_off=table.cut_off,
        estimate=table.estimate,
    )


def _find_file(folder: Path, name: str | None, kind: FileKind = RECORD) -> Path | None:
    return None if name is None else resolve_file(folder, name, FORCE_SUFFIXES, kind)


def _build_contour(table: ContouringTable, folder: Path) -> SquareContour | PolylineContour:
    """The way of the tool: around a block, or along a line.

    Raises:
        ValueError: Corners are not at one height, or the file is missing or out of bounds.
        ForceFileError: The file of corners cannot be used.
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


def _check_way(table: ContouringTable, folder: Path, findings: Findings) -> None:
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
    except (ValueError, ForceFileError) as error:
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


def _explain_effect(name: str, *, on_path: bool) -> str:
    """What to say of an effect that does not act."""
    if name == "coriolis":
        return (
            "needs no switch here: linear axes do not turn what they carry, and what a guide that tilts does to a body that slides along it"
            " is part of every way that follows its poses; remove it"
        )
    if name == "cutting_force":
        return "acts in [analyses.contouring] and along [analyses.path], and this scene has neither; remove it"
    if not on_path:
        return "acts in [analyses.contouring] only, and this scene has none; remove it"
    return (
        "acts along contours, where teeth meet the waves of those before them; give the line of this path as polyline in [analyses.contouring],"
        " or its corners in a CSV file as polyline_file, or remove the effect"
    )


def check_contouring(draft: Draft, findings: Findings) -> None:
    """Report what is wrong with a contour, apart from places that it cannot reach."""
    scene, table = draft.table, draft.table.analyses.contouring
    acting = {"cutting_force"} if scene.analyses.path is not None else set()
    acting |= {"cutting_force", "regeneration"} if table is not None else set()
    if scene.mechanism is not None:
        # its variants may name effects for contours that they leave out
        acting = {*CONTOUR_EFFECTS} - ({"regeneration"} if scene.analyses.path else set()) | acting
    for name in (set(CONTOUR_EFFECTS) - acting) & {
        name for name, value in scene.effects.items() if value
    }:
        findings.add(
            ("effects", name), _explain_effect(name, on_path=scene.analyses.path is not None)
        )
    if table is None:
        return
    _check_regeneration(scene, table, findings)
    if not scene.is_lumped:
        _check_coupled(scene, table, draft, findings)
    cutting = bool(scene.effects.get("cutting_force"))
    if (table.material is not None and table.forces is not None) or (
        cutting and table.material is None and table.forces is None
    ):
        findings.add(KEY, 'needs either the material that is cut, or forces = "measured.csv"')
    _check_way(table, draft.folder, findings)
    for name, written in (("forces", table.forces), ("traces", table.traces)):
        try:
            _find_file(draft.folder, written)
        except ValueError as error:
            findings.add((*KEY, name), str(error))


def check_contour_reach(scene: Scene, findings: Findings) -> None:
    """Report where linear axes cannot follow a contour; a mechanism tells when it closes its
    loops.
    """
    request = scene.analyses.get(ContouringRequest) or scene.on_request.get(ContouringRequest)
    if request is None:
        return
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
        for place in (float(places[:, number].min()), float(places[:, number].max())):
            if fault := find_limit_fault(name, place, low=low, high=high, unit="m"):
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
        request: Of the contour.
        names: Of the axes or legs.
        end: When the path ends [s].
        findings: Receives what is wrong.
    """
    if request.traces is None:
        return None
    try:
        record = read_positions(request.traces, names)
    except ForceFileError as error:
        findings.add((*KEY, "traces"), str(error))
        return None
    if record.times[0] > 0.0 or record.times[-1] < end:
        findings.add(
            (*KEY, "traces"),
            f"holds {record.times[0]:g} to {record.times[-1]:g} s, and the path takes 0 to {end:.6g} s; its time starts with the path",
        )
    return record.positions


def _tool_point(scene: SceneTable, table: ContouringTable) -> str | None:
    """The point of the tool: as written, else the scene's first."""
    return table.point or next(iter(scene.points), None)


def _check_coupled(
    scene: SceneTable, table: ContouringTable, draft: Draft, findings: Findings
) -> None:
    if table.point is not None:
        check_name((*KEY, "point"), table.point, "points", draft, findings)
    elif not scene.points:
        findings.add(
            KEY,
            'no point says where the tool is; write [points] tcp = { tool = "spindle.tip", work = "table.top" }',
        )
    if table.model != "linear" and not scene.effects.get(FRICTION):
        findings.add(
            (*KEY, "model"),
            "of a machine of components follows its friction alone, at the speeds of the motors, and nothing rubs here;"
            ' write [effects] friction = true with drive_control, or model = "linear"',
        )


def _check_regeneration(scene: SceneTable, table: ContouringTable, findings: Findings) -> None:
    key = ("effects", "regeneration")
    if not scene.effects.get("regeneration"):
        return
    if not scene.effects.get("cutting_force"):
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
