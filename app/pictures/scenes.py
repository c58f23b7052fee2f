"""What pictures show of a machine: it at rest and in its modes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from headstock.app.pictures.picture import Marks, Picture
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import IntArray
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.results.mode_files import (
    SHOWN_SHARE,
    file_stem,
    largest_shift,
    machine_size,
)
from headstock.pipeline.results.views import MachineView, PoseView, component_colors

# small to large displacement, the same stops as in the viewer
RAMP = (
    np.array(
        [
            [49, 69, 155],
            [62, 143, 196],
            [127, 205, 187],
            [254, 224, 139],
            [244, 109, 67],
            [197, 27, 61],
        ]
    )
    / 255.0
)


JOINT_COLOR, TOOL_COLOR = (0.85, 0.47, 0.02), (0.80, 0.10, 0.20)
MACHINE_SIZE, MODE_SIZE = (1500, 960), (720, 480)
MODES_DRAWN = 40
# radius of a mark against the size of the machine
JOINT_SHARE, TOOL_SHARE = 0.006, 0.010


def list_machine_pictures(view: MachineView) -> list[Picture]:
    """The machine at rest in each pose."""
    return [
        _rest_picture(f"machine_{file_stem(name)}", view, pose, MACHINE_SIZE)
        for name, pose in view.poses.items()
    ]


def list_mode_pictures(modal: Iterable[PoseModes], view: MachineView) -> list[Picture]:
    """The modes of each pose."""
    return [
        _mode_picture(
            f"mode_{file_stem(modes.pose.name)}_{modes.below + index + 1:02d}",
            view,
            view.poses[modes.pose.name],
            index,
            MODE_SIZE,
        )
        for modes in modal
        if view.poses[modes.pose.name].shifts
        for index in range(min(len(modes.frequencies_hz), MODES_DRAWN))
    ]


def _rest_picture(name: str, view: MachineView, pose: PoseView, size: tuple[int, int]) -> Picture:
    """The machine at rest, coloured by component, with its joints and points.

    Args:
        pose: Placements, joints and points in the pose.
        size: Width and height in pixels.
    """
    joined = join_skins_in_pose(view, pose)
    counts = [len(skin.points) for skin in view.skins.values()]
    colors = np.repeat(joined.palette[1:], counts, axis=0)
    joints = np.array([joint.frame.origin for joint in pose.joints.values()]).reshape(-1, 3)
    tools = np.array([point.tool_place for point in pose.points.values()]).reshape(-1, 3)
    marks = (
        Marks(joints, JOINT_COLOR, JOINT_SHARE),
        Marks(tools, TOOL_COLOR, TOOL_SHARE, in_front=True),
    )
    return Picture(name, joined.points, joined.triangles, joined.edges, colors, size, marks=marks)


def _mode_picture(
    name: str, view: MachineView, pose: PoseView, index: int, size: tuple[int, int]
) -> Picture:
    """A natural mode at its turning point, coloured by displacement, with the undeformed machine as
    edges.

    Args:
        pose: Placements and mode shapes in the pose.
        size: Width and height in pixels.
    """
    joined = join_skins_in_pose(view, pose)
    shift = np.vstack([pose.shifts[part][index] for part in view.skins]).astype(float)
    largest = largest_shift([shift])
    share = np.linalg.norm(shift, axis=1) / largest
    colors = np.column_stack(
        [
            np.interp(share, np.linspace(0.0, 1.0, len(RAMP)), RAMP[:, channel])
            for channel in range(3)
        ]
    )
    moved = joined.points + shift * (SHOWN_SHARE * machine_size(view, pose) / largest)
    return Picture(name, moved, joined.triangles, joined.edges, colors, size, ghost=joined.points)


@dataclass(frozen=True, eq=False)
class _JoinedSkins:
    """All skins of a machine in a pose as one surface.

    Attributes:
        points: ``(n, 3)`` in the machine frame [m].
        triangles: ``(m, 3)``.
        edges: ``(e, 2)``.
        owners: ``(m,)`` number of the component of each triangle, from 1.
        palette: ``(components + 1, 3)`` red, green, blue of each, 0..1; white for none.
    """

    points: FloatArray
    triangles: IntArray
    edges: IntArray
    owners: IntArray
    palette: FloatArray


def join_skins_in_pose(view: MachineView, pose: PoseView) -> _JoinedSkins:
    """Every component's skin where it stands in a pose."""
    points: list[FloatArray] = [np.zeros((0, 3))]
    triangles: list[IntArray] = [np.zeros((0, 3), dtype=np.int64)]
    edges: list[IntArray] = [np.zeros((0, 2), dtype=np.int64)]
    start = 0
    for name, skin in view.skins.items():
        frame = pose.placements[name]
        points.append(skin.points @ frame.rotation.T + frame.origin)
        triangles.append(skin.triangles + start)
        edges.append(skin.edges + start)
        start += len(skin.points)
    counts = [len(skin.triangles) for skin in view.skins.values()]
    colors = ["#ffffff", *component_colors(view).values()]
    palette = [[int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)] for color in colors]
    return _JoinedSkins(
        np.vstack(points),
        np.vstack(triangles),
        np.vstack(edges),
        np.repeat(np.arange(1, len(counts) + 1), counts),
        np.array(palette),
    )
