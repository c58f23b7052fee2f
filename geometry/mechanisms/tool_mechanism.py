"""A closed-loop mechanism that carries components and is posed by its tool."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, compose_frames, rotation_about
from headstock.geometry.mechanisms.exechon import MountedExechon, solve_tool_pose
from headstock.geometry.mechanisms.kinematics import place_markers

# the axes of a tool pose: place of the tool point, and turns of the tool about the machine's x and
# y
TOOL_AXES = ("X", "Y", "Z", "A", "B")
TOOL_POINT, TOOL_TURNS = TOOL_AXES[:3], TOOL_AXES[3:]


@dataclass(frozen=True, eq=False)
class ToolMechanism:
    """A mounted mechanism, its tool and what it carries.

    Attributes:
        mounted: Dimensions, place and limits.
        tool: ``(3,)`` direction of the tool in the machine frame where a pose does not turn it.
        carries: Component to the marker of the mechanism it is fixed to; its placement is relative
            to
            that marker.
    """

    mounted: MountedExechon
    tool: FloatArray
    carries: Mapping[str, str]


def tool_pose(
    mechanism: ToolMechanism, positions: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the tool point ``(3,)`` [m] and direction ``(3,)`` of a pose, machine frame; A and B
    turn the tool about x, then about y.
    """
    point = np.array([positions.get(axis, 0.0) for axis in TOOL_POINT])
    direction = mechanism.tool
    for axis, about in zip(TOOL_TURNS, ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), strict=True):
        direction = rotation_about(np.array(about), positions.get(axis, 0.0)) @ direction
    return point, direction


def solve_pose(mechanism: ToolMechanism, positions: Mapping[str, float]) -> FloatArray:
    """Return the coordinates ``(n,)`` of the mechanism in a pose.

    Raises:
        PoseError: The pose is out of reach, singular or beyond a joint's limits.
    """
    point, direction = tool_pose(mechanism, positions)
    return solve_tool_pose(mechanism.mounted, point, direction)


def place_carriers(mechanism: ToolMechanism, positions: Mapping[str, float]) -> dict[str, Frame]:
    """Return the frame of the marker under every carried component in the machine frame, in a pose.

    Raises:
        PoseError: The pose is out of reach, singular or beyond a joint's limits.
    """
    mounted = mechanism.mounted.mechanism
    placed = place_markers(mounted, solve_pose(mechanism, positions))
    places = {name: mounted.markers.index(marker) for name, marker in mechanism.carries.items()}
    return {
        name: compose_frames(
            mechanism.mounted.mounting, Frame(placed.positions[place], placed.rotations[place])
        )
        for name, place in places.items()
    }
