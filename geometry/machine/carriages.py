"""Where rails begin and end and where carriages stand on them in a pose, as far as solids determine
it without a mesh.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose, place_components, show_position
from headstock.geometry.parts.components import Interface, Patch
from headstock.geometry.parts.mass_properties import interface_moment
from headstock.geometry.parts.patches import (
    FACE_DIRECTIONS,
    OVERHANG_TOLERANCE,
    PlanarSolid,
    Span,
    band_span,
    imprint_window,
    in_plane_axes,
    named_planar_face,
    patch_rects,
)
from headstock.geometry.parts.solids import Solid, Tube

DEGREE = 3  # of the splines along a rail
TRAVEL_STEP = 1e-4  # to which remedies round limits of axes [m]
LEAST_INTERVALS = 1.5  # intervals of control points per carriage length below which its motion depends on single control points


def rail_span(solid: Solid, interface: Interface) -> Span | None:
    """Return the lowest and highest place of a rail along its axis, component frame [m]; None where
    only a mesh knows.

    Raises:
        ValueError: The interface is no rail.
    """
    pieces = rail_pieces(solid, interface)
    if pieces is None:
        return None
    return min(low for low, _ in pieces), max(high for _, high in pieces)


def rail_pieces(solid: Solid, interface: Interface) -> tuple[Span, ...] | None:
    """Return the lowest and highest place of each patch of a rail along its axis, component frame
    [m]; None where only a mesh knows.

    Raises:
        ValueError: The interface is no rail.
    """
    if interface.rail is None:
        raise ValueError(f"interface {interface.name!r} is no rail")
    axis = "xyz".index(interface.rail.along)
    spans = [_patch_span(solid, patch, axis) for patch in interface.patches]
    closed_form = tuple(span for span in spans if span is not None)
    return closed_form if len(closed_form) == len(spans) else None


def _patch_span(solid: Solid, patch: Patch, axis: int) -> Span | None:
    if isinstance(solid, Tube) and patch.face in ("outer", "inner"):
        return band_span(patch, 0.0, solid.length) if axis == 2 else None
    normal = FACE_DIRECTIONS.get(patch.face, (-1, 0.0))[0]
    if normal == axis:
        return None
    if normal < 0:
        return None
    face = named_planar_face(solid, patch.face) if isinstance(solid, PlanarSolid) else None
    rects = None if face is None else patch_rects(face, patch)
    if not rects and patch.shape == "rect":
        rects = [imprint_window(normal, patch)]
    if not rects:
        return None
    first = 2 * in_plane_axes(normal).index(axis)
    return min(rect[first] for rect in rects), max(rect[first + 1] for rect in rects)


@dataclass(frozen=True)
class Carriage:
    """A carriage on its rail.

    Attributes:
        place: Its middle along the rail's axis in the frame of the rail's component [m].
        length: Its length [m].
        span: Where the rail begins and ends [m].
    """

    joint: str
    rail: JointEnd
    place: float
    length: float
    span: Span

    @property
    def overhang(self) -> float:
        """Return how far it hangs over the nearer end [m]; below zero by as much as it may still
        move.
        """
        return max(
            self.span[0] - (self.place - 0.5 * self.length),
            self.place + 0.5 * self.length - self.span[1],
        )

    @property
    def hangs_over(self) -> bool:
        """Return whether it hangs over an end by more than rounding."""
        return self.overhang > OVERHANG_TOLERANCE * (self.span[1] - self.span[0])


def _rail_end(machine: Machine, joint: Joint) -> JointEnd | None:
    """Return the end of a joint that is a rail; None where there is none, or its component is not
    described by the machine.
    """
    for end in joint.ends:
        component = machine.components.get(end.component or "")
        interface = (
            None
            if component is None or end.interface is None
            else component.interfaces.get(end.interface)
        )
        if interface is not None and interface.rail is not None:
            return end
    return None


def place_carriages(machine: Machine, pose: Pose) -> tuple[Carriage, ...]:
    """Return every carriage whose place is known without a mesh.

    Raises:
        ValueError: The pose names an unknown axis or leaves its limits.
    """
    ends = {name: _rail_end(machine, joint) for name, joint in machine.joints.items()}
    riding = [(machine.joints[name], rail) for name, rail in ends.items() if rail is not None]
    # poses of a mechanism name no axes
    placements = place_components(machine, pose) if riding else {}
    carriages = []
    for joint, rail in riding:
        if joint.length is None:
            continue
        component = machine.components[str(rail.component)]
        interface = component.interfaces[str(rail.interface)]
        span = rail_span(component.solid, interface)
        point = _joint_point(machine, joint, rail, placements)
        if span is not None and point is not None and interface.rail is not None:
            frame = placements[component.name]
            position = (frame.rotation.T @ (point - frame.origin))[
                "xyz".index(interface.rail.along)
            ]
            carriages.append(Carriage(joint.name, rail, float(position), joint.length, span))
    return tuple(carriages)


def find_overhangs(machine: Machine, pose: Pose) -> dict[str, str]:
    """Find which carriages hang over an end of their rail in a pose: joint to why it cannot stand
    there and what to do.

    Raises:
        ValueError: The pose names an unknown axis or leaves its limits.
        PoseError: The mechanism cannot take the pose.
    """
    carriages = place_carriages(machine, pose)
    return {
        carriage.joint: _describe_overhang(carriage)
        for carriage in carriages
        if carriage.hangs_over
    }


def find_travel_faults(machine: Machine) -> list[str]:
    """Find the axes whose limits let a carriage hang over an end of its rail, every other axis at
    zero: where, by how much, and what to do.

    Raises:
        PoseError: The mechanism cannot take a pose.
    """
    faults = []
    for name, axis in machine.axes.items():
        limits, hanging = list(axis.limits), []
        for end, limit in enumerate(axis.limits):
            pose = Pose(name, {name: limit})
            riding = place_carriages(machine, pose) if math.isfinite(limit) else ()
            over = [one for one in riding if one.joint in axis.joints and one.hangs_over]
            if over:
                worst = max(over, key=lambda carriage: carriage.overhang)
                inward = (1.0, -1.0)[end]
                # away from the rail's end, so that rounding leaves nothing over it
                steps = (inward * limit + worst.overhang) / TRAVEL_STEP - OVERHANG_TOLERANCE
                limits[end] = inward * TRAVEL_STEP * math.ceil(steps)
                hanging.append(
                    f"at {show_position(limit)} the carriage of joint {worst.joint} hangs "
                    f"{show_position(worst.overhang)} over the end of rail {worst.rail}"
                )
        if hanging:
            low, high = (f'"{show_position(limit)}"' for limit in limits)
            shorter = f"write limits = [{low}, {high}], or " if limits[0] < limits[1] else ""
            faults.append(f"axis {name}: {', '.join(hanging)}; {shorter}make the rail longer")
    return faults


def _describe_overhang(carriage: Carriage) -> str:
    low, high = carriage.span
    half = 0.5 * carriage.length
    return (
        f"the carriage of joint {carriage.joint} ({show_position(carriage.length)} long) hangs {show_position(carriage.overhang)} over "
        f"the end of rail {carriage.rail}: its middle stands at {show_position(carriage.place)}, the rail runs from {show_position(low)} "
        f"to {show_position(high)}; keep its middle between {show_position(low + half)} and {show_position(high - half)}, or make the "
        "rail longer"
    )


def _joint_point(
    machine: Machine, joint: Joint, rail: JointEnd, placements: Mapping[str, Frame]
) -> FloatArray | None:
    """Return the joint point in the machine frame, carried along by the end that is not the
    rail.
    """
    other = joint.ends[0] if joint.ends[1] is rail else joint.ends[1]
    if other.component is None:
        return joint.point
    component = machine.components.get(other.component)
    if component is None:
        return None
    now = placements[other.component]
    if joint.point is not None:
        home = component.placement
        return now.origin + now.rotation @ (home.rotation.T @ (joint.point - home.origin))
    interface = component.interfaces.get(other.interface or "")
    if interface is None or not isinstance(component.solid, PlanarSolid | Tube):
        return None
    moment = interface_moment(component.solid, interface)
    return None if moment is None else np.asarray(now.origin + now.rotation @ moment[1])


def count_control_points(span: float, length: float, intervals: float) -> int:
    """Return the number of control points of a rail for which a carriage covers so many intervals;
    at least what a cubic spline needs.

    Args:
        span: Length of the rail [m].
        length: Of the carriage [m].
        intervals: Between control points, per length of the carriage.
    """
    return max(math.ceil(intervals * span / length * (1.0 - OVERHANG_TOLERANCE)), 1) + DEGREE
