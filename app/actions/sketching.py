"""``headstock show SCENE``: a machine drawn before anything is computed."""

import os
from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np

from headstock.app.pictures.numbered import Color, LabelledSurface, draw_numbered, show_numbered
from headstock.app.pictures.picture import Marks, Note
from headstock.app.pictures.scenes import TOOL_COLOR, TOOL_SHARE, join_skins_in_pose
from headstock.app.terminal.console import add_row, counted, make_console, make_table, print_table
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import GROUND
from headstock.geometry.machine.machine import Pose, position_units, show_position
from headstock.geometry.parts.components import Component, show_fixed
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.preview.rigid_view import SupportView, view_rigid
from headstock.pipeline.results.views import JointView, MachineView, PoseView
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_output
from headstock.scene.scene import Scene

RIGID, SPRING, FREE = (0.39, 0.45, 0.55), (0.85, 0.47, 0.02), (0.49, 0.23, 0.93)
MOUNT, WORK, SUPPORT = (0.10, 0.55, 0.27), (0.10, 0.35, 0.80), (0.20, 0.20, 0.20)
FREE_KINDS = ("revolute", "universal", "spherical", "prismatic")
# kinds that move or hold along an axis: the columns of their frame that it is
AXES = {
    "linear_guide": (0,),
    "ball_screw": (0,),
    "bearing": (0,),
    "mount": (2,),
    "revolute": (0,),
    "universal": (0, 2),
    "prismatic": (0,),
}
BALL_SHARE, ARROW_SHARE, CONE_SHARE = 0.007, 0.06, 0.03


def show_machine(
    scene: Scene, *, pose: str | None, picture: Path | None, window: bool, json_file: Path | None
) -> int:
    """List and draw components, joints, supports and points of a scene in a pose.

    Args:
        scene: The scene.
        pose: Its name; None for the first.
        picture: File to write; None for ``SCENE_machine.png``.
        window: Open a window in place of writing a picture.
        json_file: Write what is printed there, too.

    Raises:
        click.UsageError: There is no such pose, or no display for a window.
        DrawingError: pyvista is missing, or finds no OpenGL.
        HeadstockError: A part cannot be read or placed.
    """
    if pose is not None and pose not in scene.poses:
        raise click.UsageError(f"no pose {pose!r}; poses: {', '.join(scene.poses)}")
    if window and not os.environ.get("DISPLAY"):
        raise click.UsageError(
            "--window needs a display, and DISPLAY is not set (over ssh: ssh -X); "
            "without --window a picture is written"
        )
    chosen = scene.poses[pose or next(iter(scene.poses))]
    view, supports = view_rigid(scene, chosen)
    placed = view.poses[chosen.name]
    _print_tables(scene, chosen, view, supports)
    if json_file is not None:
        write_output(json_file, dump_summary(_list_machine(scene, placed, supports)).encode())
    if not view.skins:
        return 0
    surface = _label_machine(f"{scene.name}, pose {chosen.name}", view, placed, supports)
    if window:
        show_numbered(surface)
    else:
        write_picture(surface, picture or Path(f"{scene.path.stem}_machine.png"))
    return 0


def write_picture(surface: LabelledSurface, path: Path) -> None:
    """Draw a surface with labels from four sides to a PNG file.

    Raises:
        DrawingError: pyvista is missing, or finds no OpenGL.
        OutputError: The file cannot be written.
    """
    image, labelled = draw_numbered(surface)
    write_output(path, image)
    hidden = len(surface.labels) - len(labelled)
    remark = f" ({hidden} too small or hidden for a label)" if hidden else ""
    make_console().print(f"\npicture: {path}{remark}", markup=False)


def _label_machine(
    title: str, view: MachineView, placed: PoseView, supports: Mapping[str, SupportView]
) -> LabelledSurface:
    joined = join_skins_in_pose(view, placed)
    groups: dict[str, list[tuple[str, JointView]]] = {}
    for name, joint in placed.joints.items():
        groups.setdefault(_group(joint), []).append((name, joint))
    marks: list[Marks] = []
    notes: list[Note] = []
    legend: list[tuple[str, Color]] = []
    for group, members in groups.items():
        color = GROUPS[group]
        places = np.array([joint.frame.origin for _, joint in members])
        if group == "mount":
            into = np.array([-joint.frame.rotation[:, 2] for _, joint in members])
            marks.append(Marks(places, color, CONE_SHARE, True, "cone", into))
        else:
            marks.append(Marks(places, color, BALL_SHARE, True))
            marks += _axis_arrows([joint for _, joint in members], color)
        notes += [Note(name, joint.frame.origin, color) for name, joint in members]
        legend.append((f"{group}: {len(members)}", color))
    for name, support in supports.items():
        places = np.repeat(support.places, len(support.directions), axis=0)
        along = np.tile(support.directions, (len(support.places), 1))
        marks.append(Marks(places, SUPPORT, CONE_SHARE, True, "cone", along))
        notes += [Note(name, place, SUPPORT) for place in support.places]
    if supports:
        legend.append((f"support, a cone per fixed direction: {len(supports)}", SUPPORT))
    points = placed.points.items()
    tools = np.array([point.tool_place for _, point in points]).reshape(-1, 3)
    works = [point.work_place for _, point in points if point.work_place is not None]
    marks.append(Marks(tools, TOOL_COLOR, TOOL_SHARE, True))
    marks.append(Marks(np.array(works).reshape(-1, 3), WORK, TOOL_SHARE, True))
    # first, where there is most room
    notes = [Note(name, point.tool_place, TOOL_COLOR) for name, point in points] + notes
    if points:
        legend += [(f"tool of a point: {len(points)}", TOOL_COLOR)]
    if works:
        legend += [(f"work of a point: {len(works)}", WORK)]
    return LabelledSurface(
        joined.points,
        joined.triangles,
        joined.owners,
        dict(enumerate(view.skins, 1)),
        title,
        palette=joined.palette,
        marks=tuple(marks),
        notes=tuple(notes),
        legend=tuple(legend),
    )


GROUPS: dict[str, Color] = {
    "mount": MOUNT,
    "rigid or bolted joint": RIGID,
    "spring, guide, screw or bearing": SPRING,
    "free joint": FREE,
}


def _group(joint: JointView) -> str:
    if joint.kind == "mount":
        return "mount"
    if joint.kind in ("rigid", "bolted"):
        return "rigid or bolted joint"
    return "free joint" if joint.kind in FREE_KINDS else "spring, guide, screw or bearing"


def _axis_arrows(joints: list[JointView], color: Color) -> list[Marks]:
    """An arrow along each axis of joints."""
    arrows = [
        (joint.frame.origin, joint.frame.rotation[:, column])
        for joint in joints
        for column in AXES.get(joint.kind, ())
    ]
    if not arrows:
        return []
    tails, along = (np.array(part) for part in zip(*arrows, strict=True))
    return [Marks(tails, color, ARROW_SHARE, True, "arrow", along)]


def _print_tables(
    scene: Scene, pose: Pose, view: MachineView, supports: Mapping[str, SupportView]
) -> None:
    console, machine, placed = make_console(), scene.machine, view.poses[pose.name]
    table = make_table("component", "fidelity", "solid", ">size mm", ">at mm", "interfaces")
    for name, part in machine.components.items():
        size = np.ptp(view.skins[name].points, axis=0)
        cells = (_describe_fidelity(part), _describe_solid(part), _in_mm(size))
        at = _in_mm(placed.placements[name].origin)
        add_row(table, name, *cells, at, ", ".join(part.interfaces))
    print_table(console, f"{scene.name}: {counted(len(machine.components), 'component')}", table)
    if placed.joints:
        table = make_table("joint", "kind", "between", "and", ">at mm", ">axis")
        for name, joint in placed.joints.items():
            at, axis = _in_mm(joint.frame.origin), _describe_axis(joint)
            add_row(table, name, joint.kind, joint.first, joint.second, at, axis)
        units = position_units(machine)
        positions = [
            f"{axis} = {show_position(position, units[axis])}"
            for axis, position in pose.positions.items()
        ]
        print_table(console, f"Joints in pose {', '.join([pose.name, *positions])}", table)
    if supports:
        table = make_table("support", "component", "fixed", "at mm")
        for name, support in supports.items():
            fixed = " ".join(map(show_fixed, machine.supports[name].directions))
            at = "; ".join(_in_mm(place) for place in support.places)
            add_row(table, name, machine.supports[name].component, fixed, at)
        print_table(console, "Supports", table)
    if placed.points:
        table = make_table("point", "tool", "work", ">tool at mm")
        for name, point in placed.points.items():
            add_row(table, name, point.tool, point.work, _in_mm(point.tool_place))
        print_table(console, "Points", table)


def _list_machine(
    scene: Scene, placed: PoseView, supports: Mapping[str, SupportView]
) -> dict[str, object]:
    """What is shown, in SI units."""
    return {
        "components": {
            name: {
                "fidelity": _describe_fidelity(part),
                "solid": _describe_solid(part),
                "at_m": placed.placements[name].origin.tolist(),
                "interfaces": list(part.interfaces),
            }
            for name, part in scene.machine.components.items()
        },
        "joints": {
            name: {
                "kind": joint.kind,
                "between": [joint.first, joint.second],
                "at_m": joint.frame.origin.tolist(),
                "axes": [joint.frame.rotation[:, i].tolist() for i in AXES.get(joint.kind, ())],
            }
            for name, joint in placed.joints.items()
        },
        "supports": {
            name: {
                "component": scene.machine.supports[name].component,
                "fixed": [show_fixed(each) for each in scene.machine.supports[name].directions],
                "at_m": support.places.tolist(),
            }
            for name, support in supports.items()
        },
        "points": {
            name: {
                "tool": point.tool,
                "work": point.work,
                "tool_at_m": point.tool_place.tolist(),
                "work_at_m": GROUND if point.work_place is None else point.work_place.tolist(),
            }
            for name, point in placed.points.items()
        },
    }


def _describe_fidelity(component: Component) -> str:
    return "superelement" if isinstance(component.solid, SuperelementFile) else component.fidelity


def _describe_solid(component: Component) -> str:
    path = getattr(component.solid, "path", None)
    return path.name if isinstance(path, Path) else type(component.solid).__name__.lower()


def _describe_axis(joint: JointView) -> str:
    axes = [joint.frame.rotation[:, column] for column in AXES.get(joint.kind, ())]
    return "; ".join(" ".join(f"{round(float(x), 2) + 0.0:g}" for x in axis) for axis in axes)


def _in_mm(values: FloatArray) -> str:
    return " ".join(f"{round(1e3 * float(value), 1) + 0.0:.1f}" for value in values)
