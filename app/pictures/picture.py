"""What one picture shows: coloured triangles, edges and marks in the machine frame, and where the
camera stands; and how it gets to the process that draws.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import IO, Any, Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import IntArray

# towards the viewer: from the front, the right and above
CAMERA = np.array([1.25, -1.0, 0.75]) / np.linalg.norm([1.25, -1.0, 0.75])
MARGIN = 1.06


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
    axes = _camera_axes(picture.camera)
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = 0.5 * (high - low)
    width, height = picture.size
    half_height = MARGIN * max(half[1], half[0] * height / width, 1e-9)
    reach = float(np.linalg.norm(np.ptp(points, axis=0)))
    return PictureFrame(axes, axes.T @ (0.5 * (low + high)), half_height, reach)


def _camera_axes(towards: FloatArray) -> FloatArray:
    """Rows ``(3, 3)``: to the right, up and towards the viewer, in the machine frame."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def write_pictures(file: IO[bytes], pictures: Sequence[Picture]) -> None:
    """Write pictures to a file: text whose arrays stand beside it."""
    arrays: list[np.ndarray[Any, np.dtype[Any]]] = []

    def put_aside(array: np.ndarray[Any, np.dtype[Any]]) -> dict[str, int]:
        arrays.append(array)
        return {"array": len(arrays) - 1}

    text = json.dumps([asdict(picture) for picture in pictures], default=put_aside)
    np.savez(file, *arrays, text=np.array(text))


def read_pictures(file: IO[bytes]) -> list[Picture]:
    """The inverse of ``write_pictures``."""
    with np.load(file, allow_pickle=False) as record:
        found = json.loads(
            str(record["text"]),
            object_hook=lambda entry: (
                record[f"arr_{entry['array']}"] if entry.keys() == {"array"} else entry
            ),
        )
    for entry in found:
        entry["size"] = tuple(entry["size"])
        entry["marks"] = tuple(Marks(**marks) for marks in entry["marks"])
        entry["notes"] = tuple(Note(**note) for note in entry["notes"])
    return [Picture(**entry) for entry in found]
