"""A machine before anything is computed: tables of its components, joints, supports and points."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from headstock.app.pictures.machine_sketch import AXIS_COLUMNS
from headstock.app.terminal.console import add_row, counted, make_console, make_table, print_table
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import GROUND
from headstock.geometry.machine.machine import Pose, position_units, show_position
from headstock.geometry.parts.components import Component, show_fixed
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.preview.doubts import JointGap
from headstock.pipeline.preview.rigid_view import SupportView
from headstock.pipeline.results.views import JointView, MachineView, PoseView
from headstock.scene.scene import Scene


def print_machine(
    scene: Scene,
    pose: Pose,
    view: MachineView,
    supports: Mapping[str, SupportView],
    gaps: Mapping[str, JointGap],
) -> None:
    """Components of a scene, and its joints, supports and points in a pose.

    Args:
        view: What of the machine is drawn.
        supports: By name, where they are in the pose.
        gaps: How far the ends of joints lie apart, where that is known.
    """
    console, machine, placed = make_console(), scene.machine, view.poses[pose.name]
    table = make_table("component", "fidelity", "solid", ">size mm", ">at mm", "interfaces")
    for name, part in machine.components.items():
        size = np.ptp(view.skins[name].points, axis=0)
        cells = (_describe_fidelity(part), _describe_solid(part), _in_mm(size))
        at = _in_mm(placed.placements[name].origin)
        add_row(table, name, *cells, at, ", ".join(part.interfaces))
    print_table(console, f"{scene.name}: {counted(len(machine.components), 'component')}", table)
    if placed.joints:
        table = make_table("joint", "kind", "between", "and", ">apart mm", ">at mm", ">axis")
        for name, joint in placed.joints.items():
            apart = f"{1e3 * gaps[name].areas:.1f}" if name in gaps else ""
            at, axis = _in_mm(joint.frame.origin), _describe_axis(joint)
            add_row(table, name, joint.kind, joint.first, joint.second, apart, at, axis)
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
    if placed.sensors:
        table = make_table("sensor", "component", "measures", ">mass g", ">at mm")
        for name, one in placed.sensors.items():
            sensor = machine.sensors[name]
            mass = f"{1e3 * sensor.mass:.4g}" if sensor.mass else ""
            measured = " ".join(one.measured) or "nothing: a point mass"
            add_row(table, name, sensor.component, measured, mass, _in_mm(one.place))
        print_table(console, "Sensors and point masses", table)


def list_machine(
    scene: Scene,
    placed: PoseView,
    supports: Mapping[str, SupportView],
    gaps: Mapping[str, JointGap],
) -> dict[str, object]:
    """List what is shown, in SI units."""
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
                "apart_m": gaps[name].areas if name in gaps else None,
                "at_m": joint.frame.origin.tolist(),
                "axes": [
                    joint.frame.rotation[:, i].tolist() for i in AXIS_COLUMNS.get(joint.kind, ())
                ],
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
        "sensors": {
            name: {
                "component": scene.machine.sensors[name].component,
                "measures": {
                    dof: one.directions[row].tolist() for row, dof in enumerate(one.measured)
                },
                "mass_kg": scene.machine.sensors[name].mass,
                "at_m": one.place.tolist(),
            }
            for name, one in placed.sensors.items()
        },
    }


def _describe_fidelity(component: Component) -> str:
    return "superelement" if isinstance(component.solid, SuperelementFile) else component.fidelity


def _describe_solid(component: Component) -> str:
    path = getattr(component.solid, "path", None)
    return path.name if isinstance(path, Path) else type(component.solid).__name__.lower()


def _describe_axis(joint: JointView) -> str:
    axes = [joint.frame.rotation[:, column] for column in AXIS_COLUMNS.get(joint.kind, ())]
    return "; ".join(" ".join(f"{round(float(x), 2) + 0.0:g}" for x in axis) for axis in axes)


def _in_mm(values: FloatArray) -> str:
    return " ".join(f"{round(1e3 * float(value), 1) + 0.0:.1f}" for value in values)
