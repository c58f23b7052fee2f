"""Pictures of parts with a label on everything that is seen, from four sides: a small rasteriser
and matplotlib's text.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, find_objects

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import IntArray

# towards the viewer; between them they see every side twice
CAMERAS = {
    "+x −y +z": (1.0, -0.8, 0.7),
    "−x +y +z": (-1.0, 0.8, 0.7),
    "+x +y −z": (0.8, 1.0, -0.7),
    "−x −y −z": (-0.8, -1.0, -0.7),
}
PIXELS = (900, 720)
SAMPLES = 2  # per pixel and direction
MARGIN = 24
DPI = 100
LIGHT = np.array([0.3, 0.5, 0.8]) / np.linalg.norm([0.3, 0.5, 0.8])
GOLDEN = 0.618034
CLEARANCE = 7.0  # pixels around a label's middle that must belong to what it names
SEEN = 1.5  # pixels; smaller areas get no label
LETTER, LINE = 7.0, 12.0  # pixels of text
LEADERS = [
    (22 * np.cos(angle), -22 * np.sin(angle))
    for angle in np.radians([45, 135, 315, 225, 0, 180, 90, 270])
]
FRAGMENTS = 2_000_000  # worked on at once


@dataclass(frozen=True, eq=False)
class LabelledSurface:
    """Triangles that belong to something with a label.

    Attributes:
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` outward.
        owners: ``(m,)`` numbers from 1.
        labels: Text of each owner.
        title: Heading of the picture.
    """

    points: FloatArray
    triangles: IntArray
    owners: IntArray
    labels: Mapping[int, str]
    title: str


@dataclass(frozen=True)
class Spot:
    """A visible area's innermost pixel, and how many pixels lie between it and the border."""

    place: tuple[float, float]
    room: float


@dataclass(frozen=True)
class Label:
    """A text in a picture: what it names, where, and half its width and height in pixels."""

    owner: int
    text: str
    place: tuple[float, float]
    text_at: tuple[float, float]
    half: tuple[float, float]


def draw_numbered(surface: LabelledSurface) -> tuple[bytes, set[int]]:
    """A PNG of a surface from four sides, and the owners that got a label in at least one of
    them.
    """
    width, height = PIXELS
    figure = Figure(figsize=(2 * width / DPI, (2 * height + 40) / DPI), dpi=DPI)
    canvas: Any = FigureCanvasAgg(figure)
    figure.text(
        0.5, 1.0 - 14 / (2 * height + 40), surface.title, ha="center", va="center", fontsize=13
    )
    labelled: set[int] = set()
    share = 2 * height / (2 * height + 40)
    for index, (name, camera) in enumerate(CAMERAS.items()):
        axes = figure.add_axes(
            (0.5 * (index % 2), share * (0.5 - 0.5 * (index // 2)), 0.5, share / 2)
        )
        axes.set_axis_off()
        image, seen = _render(surface, np.array(camera))
        axes.imshow(image, interpolation="none", aspect="auto")
        axes.text(12, height - 12, f"seen from {name}", fontsize=9, color="#555555")
        for label in _place_labels(seen, surface.labels):
            if label.text_at != label.place:
                axes.plot(
                    *zip(label.place, label.text_at, strict=True), color="#475467", linewidth=0.6
                )
            text = axes.text(
                *label.text_at, label.text, fontsize=8, ha="center", va="center", color="#101828"
            )
            text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
            labelled.add(label.owner)
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
    buffer = io.BytesIO()
    canvas.print_png(buffer)
    return buffer.getvalue(), labelled


def _render(
    surface: LabelledSurface, camera: FloatArray
) -> tuple[NDArray[np.float64], dict[int, Spot]]:
    """Image ``(height, width, 3)`` and where each visible owner is best labelled."""
    axes = _camera_axes(camera / np.linalg.norm(camera))
    seen = surface.points @ axes.T
    size = np.array(PIXELS) * SAMPLES
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    scale = float(((size - 2 * MARGIN * SAMPLES) / np.maximum(high - low, 1e-300)).min())
    flat = (seen[:, :2] - (low + high) / 2) * scale * [1.0, -1.0] + size / 2
    winner = _find_nearest(
        np.column_stack([flat, seen[:, 2]]), surface.triangles, int(size[0]), int(size[1])
    )
    owners = np.concatenate([surface.owners, [0]])[winner]
    corners = seen[surface.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    shade = np.concatenate([0.62 + 0.38 * np.clip(normals @ LIGHT, 0.0, 1.0), [1.0]])[winner]
    numbers = np.arange(int(surface.owners.max()) + 1)
    palette = hsv_to_rgb(
        np.column_stack(
            [(GOLDEN * numbers) % 1.0, np.full(len(numbers), 0.28), np.full(len(numbers), 0.98)]
        )
    )
    palette[0] = 1.0
    image = palette[owners] * shade[..., None]
    border = np.zeros(owners.shape, dtype=bool)
    border[:, 1:] |= owners[:, 1:] != owners[:, :-1]
    border[1:] |= owners[1:] != owners[:-1]
    image[border] = 0.25
    fine = image.reshape(PIXELS[1], SAMPLES, PIXELS[0], SAMPLES, 3).mean(axis=(1, 3))
    return fine, _find_spots(owners[::SAMPLES, ::SAMPLES])


def _camera_axes(camera: FloatArray) -> FloatArray:
    right = np.cross([0.0, 0.0, 1.0], camera)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(camera, right), camera])


def _find_nearest(flat: FloatArray, triangles: IntArray, width: int, height: int) -> IntArray:
    """Index ``(height, width)`` of the nearest triangle at each pixel, -1 for none; points are
    ``(n, 3)`` pixels and depth.
    """
    depth = np.full(width * height, -np.inf)
    winner = np.full(width * height, -1, dtype=np.int64)
    for chosen, side in _size_classes(flat, triangles):
        corners = flat[triangles[chosen]]
        starts = np.floor(corners[:, :, :2].min(axis=1)).astype(np.int64)
        grid = np.stack(
            np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1
        ).reshape(-1, 2)
        pixels = starts[:, None, :] + grid
        a, b, c = (corners[:, i, None, :2] for i in range(3))
        spots = pixels + 0.5
        whole = _cross(b - a, c - a)
        whole = np.where(whole == 0.0, np.inf, whole)
        u, v = _cross(c - b, spots - b) / whole, _cross(a - c, spots - c) / whole
        w = 1.0 - u - v
        inside = (
            (u >= 0)
            & (v >= 0)
            & (w >= 0)
            & np.isfinite(whole)
            & (pixels >= 0).all(axis=2)
            & (pixels < [width, height]).all(axis=2)
        )
        heights = (
            u * corners[:, 0, None, 2] + v * corners[:, 1, None, 2] + w * corners[:, 2, None, 2]
        )[inside]
        places = (pixels[..., 1] * width + pixels[..., 0])[inside]
        names = np.broadcast_to(chosen[:, None], inside.shape)[inside]
        closer = np.flatnonzero(heights > depth[places])
        closer = closer[np.argsort(heights[closer], kind="stable")]  # the last one written stays
        depth[places[closer]], winner[places[closer]] = heights[closer], names[closer]
    return winner.reshape(height, width)


def _size_classes(flat: FloatArray, triangles: IntArray) -> Iterator[tuple[IntArray, int]]:
    """Triangles that face the camera, in portions of about one size, with the side of the square of
    pixels that holds each.
    """
    corners = flat[triangles][:, :, :2]
    spread = (np.floor(corners.max(axis=1)) - np.floor(corners.min(axis=1))).max(axis=1) + 1
    classes = np.ceil(4.0 * np.log2(np.maximum(spread, 2.0)) - 1e-9).astype(np.int64)
    # rows of pixels run downwards
    front = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) < 0.0
    for step in np.unique(classes[front]):
        members, side = np.flatnonzero(front & (classes == step)), int(np.ceil(2.0 ** (step / 4.0)))
        portion = max(1, FRAGMENTS // side**2)
        for start in range(0, len(members), portion):
            yield members[start : start + portion], side


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _find_spots(owners: IntArray) -> dict[int, Spot]:
    """Where each visible owner is farthest from the border of its area."""
    spots: dict[int, Spot] = {}
    for owner, area in enumerate(find_objects(owners), 1):
        if area is None:
            continue
        room = distance_transform_edt(np.pad(owners[area] == owner, 1))
        y, x = np.unravel_index(int(np.argmax(room)), room.shape)
        spots[owner] = Spot(
            (float(area[1].start + x - 1), float(area[0].start + y - 1)), float(room[y, x])
        )
    return spots


def _place_labels(spots: Mapping[int, Spot], texts: Mapping[int, str]) -> list[Label]:
    """Labels inside what they name where there is room, else beside it on a leader, else none."""
    labels: list[Label] = []
    for owner, spot in sorted(spots.items(), key=lambda item: -item[1].room):
        half = (LETTER * len(texts[owner]) / 2 + 2, LINE / 2)
        offsets = [(0.0, 0.0)] if spot.room >= CLEARANCE else LEADERS if spot.room >= SEEN else []
        for x, y in offsets:
            label = Label(
                owner, texts[owner], spot.place, (spot.place[0] + x, spot.place[1] + y), half
            )
            if not any(_overlap(label, other) for other in labels):
                labels.append(label)
                break
    return labels


def _overlap(first: Label, second: Label) -> bool:
    return all(
        abs(first.text_at[i] - second.text_at[i]) < first.half[i] + second.half[i] for i in range(2)
    )
