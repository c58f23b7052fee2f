"""What one picture shows: coloured triangles and edges in the machine frame, and where the camera
stands.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import IntArray
from headstock.pipeline.results.mode_files import SHOWN_SHARE, largest_shift, machine_size
from headstock.pipeline.results.views import MachineView, PoseView, component_colors

# towards the viewer: from the front, the right and above
CAMERA = np.array([1.25, -1.0, 0.75]) / np.linalg.norm([1.25, -1.0, 0.75])
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


MARGIN = 1.06
JOINT_COLOR, TOOL_COLOR = (0.85, 0.47, 0.02), (0.80, 0.10, 0.20)
# radius of a mark against the size of the machine
JOINT_SHARE, TOOL_SHARE = 0.006, 0.010


@dataclass(frozen=True, eq=False)
class Marks:
    """Balls, arrows or cones of one colour.

    Attributes:
        places: ``(n, 3)`` in the machine frame [m]: middles of balls, tails of arrows, tips of
            cones.
        color: Red, green, blue, 0..1.
        share: Radius of a ball, length of an arrow or a cone, relative to the size of what the
            picture shows.
        in_front: Whether no body hides them.
        shape: What they look like.
        directions: ``(n, 3)`` unit vectors along arrows and into cones; None for balls.
    """

    places: FloatArray
    color: tuple[float, float, float]
    share: float
    in_front: bool = False
    shape: Literal["ball", "arrow", "cone"] = "ball"
    directions: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Note:
    """A text at a point ``(3,)`` of the machine frame [m], in a colour."""

    text: str
    place: FloatArray
    color: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture to be drawn.

    Attributes:
        name: Stem of its file.
        points: ``(n, 3)`` in the machine frame [m].
        triangles: ``(m, 3)``.
        edges: ``(k, 2)``.
        colors: ``(n, 3)`` red, green, blue of the points, 0..1.
        size: Width and height in pixels.
        ghost: ``(n, 3)`` where the points are at rest; None when they are.
        marks: Of joints and named points.
        notes: Texts of a window; those of a file are set where there is room.
        camera: ``(3,)`` towards the viewer.
        flat: Colours exactly as given: no light, no edges, nothing smoothed.
    """

    name: str
    points: FloatArray
    triangles: IntArray
    edges: IntArray
    colors: FloatArray
    size: tuple[int, int]
    ghost: FloatArray | None = None
    marks: tuple[Marks, ...] = ()
    notes: tuple[Note, ...] = ()
    camera: FloatArray = field(default_factory=lambda: CAMERA)
    flat: bool = False


@dataclass(frozen=True, eq=False)
class PictureList:
    """Pictures as they are handed to the process that draws."""

    pictures: tuple[Picture, ...]


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """What part of space a picture shows, seen along parallel rays.

    Attributes:
        axes: Rows ``(3, 3)``: to the right, up and towards the viewer, in the machine frame.
        middle: ``(3,)`` point in the middle of the picture [m].
        half_height: From there to the upper rim [m].
        reach: Diagonal of what is shown [m].
    """

    axes: FloatArray
    middle: FloatArray
    half_height: float
    reach: float

    def project(self, points: FloatArray, size: tuple[int, int]) -> FloatArray:
        """Pixels ``(n, 2)``, to the right and down, of points ``(n, 3)`` in a picture of a size."""
        seen = (points - self.middle) @ self.axes[:2].T * (0.5 * size[1] / self.half_height)
        return np.asarray(seen * [1.0, -1.0] + 0.5 * np.array(size))

    @property
    def towards(self) -> FloatArray:
        """Unit vector ``(3,)`` towards the viewer."""
        return np.asarray(self.axes[2])


def frame_picture(picture: Picture) -> PictureFrame:
    """The frame that shows all points of a picture, at rest too, with a margin."""
    points = picture.points if picture.ghost is None else np.vstack([picture.points, picture.ghost])
    axes = camera_axes(picture.camera)
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = 0.5 * (high - low)
    width, height = picture.size
    half_height = MARGIN * max(half[1], half[0] * height / width, 1e-9)
    reach = float(np.linalg.norm(np.ptp(points, axis=0)))
    return PictureFrame(axes, axes.T @ (0.5 * (low + high)), half_height, reach)


def rest_picture(name: str, view: MachineView, pose: PoseView, size: tuple[int, int]) -> Picture:
    """The machine at rest, coloured by component, with its joints and points.

    Args:
        name: Stem of its file.
        view: Surface of each component.
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


def mode_picture(
    name: str, view: MachineView, pose: PoseView, index: int, size: tuple[int, int]
) -> Picture:
    """A natural mode at its turning point, coloured by displacement, with the undeformed machine as
    edges.

    Args:
        name: Stem of its file.
        view: Surface of each component.
        pose: Placements and mode shapes in the pose.
        index: Which mode, from zero.
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


def camera_axes(towards: FloatArray) -> FloatArray:
    """Rows ``(3, 3)``: to the right, up and towards the viewer, in the machine frame."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


@dataclass(frozen=True, eq=False)
class JoinedSkins:
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


def join_skins_in_pose(view: MachineView, pose: PoseView) -> JoinedSkins:
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
    return JoinedSkins(
        np.vstack(points),
        np.vstack(triangles),
        np.vstack(edges),
        np.repeat(np.arange(1, len(counts) + 1), counts),
        np.array(palette),
    )
