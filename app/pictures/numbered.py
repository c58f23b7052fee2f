"""Pictures of parts with a label on everything that is seen, from four sides: pyvista draws, and
matplotlib sets the text.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, find_objects

from headstock.app.pictures.libraries import Figure, FigureCanvasAgg, hsv_to_rgb, withStroke
from headstock.app.pictures.picture import Marks, Note, Picture, frame_picture
from headstock.app.pictures.pictures import draw_pictures, open_window
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import IntArray, sharp_edges

# towards the viewer; between them they see every side twice
CAMERAS = {
    "+x −y +z": (1.0, -0.8, 0.7),
    "−x +y +z": (-1.0, 0.8, 0.7),
    "+x +y −z": (0.8, 1.0, -0.7),
    "−x −y −z": (-0.8, -1.0, -0.7),
}
OWNERS = "owners "
INK = (0.06, 0.09, 0.16)
PIXELS = (900, 720)
WINDOW = (1400, 900)
DPI = 100
GOLDEN = 0.618034
CLEARANCE = 7.0  # pixels around a label's middle that must belong to what it names
SEEN = 1.5  # pixels; smaller areas get no label
TEXT_SHADE = 0.65
NOTE_REACHES = (1.0, 1.7)
LEADER = "#475467"
PLATE = {"boxstyle": "round,pad=0.15", "facecolor": (1.0, 1.0, 1.0, 0.85), "linewidth": 0.0}
LETTER, LINE = 7.0, 17.0  # pixels of text
LEGEND_STEP = 17  # pixels
HEAD, MOST_INSIDE = 40, 8  # pixels above the pictures; lines of a legend that stands in them
LEADERS = [
    (22 * np.cos(angle), -22 * np.sin(angle))
    for angle in np.radians([45, 135, 315, 225, 0, 180, 90, 270])
]


Color = tuple[float, float, float]


class DrawingError(HeadstockError):
    """Nothing could be drawn; says why."""


@dataclass(frozen=True, eq=False)
class LabelledSurface:
    """Triangles that belong to something with a label.

    Attributes:
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` outward.
        owners: ``(m,)`` numbers from 1; those without a label have only a colour.
        palette: ``(owners + 1, 3)`` red, green, blue of each owner from 1, 0..1; None for soft
            colours of their own.
        notes: Texts besides the labels.
        legend: What marks mean, each in its colour.
    """

    points: FloatArray
    triangles: IntArray
    owners: IntArray
    labels: Mapping[int, str]
    title: str
    palette: FloatArray | None = None
    marks: tuple[Marks, ...] = ()
    notes: tuple[Note, ...] = ()
    legend: tuple[tuple[str, Color], ...] = ()


@dataclass(frozen=True)
class _Spot:
    """A visible area's innermost pixel, and how many pixels lie between it and the border."""

    place: tuple[float, float]
    room: float


@dataclass(frozen=True)
class _Label:
    """A text in a picture: what it names, where, and half its width and height in pixels; a note
    belongs to owner 0.
    """

    owner: int
    text: str
    place: tuple[float, float]
    text_at: tuple[float, float]
    half: tuple[float, float]
    color: Color = INK


def draw_numbered(surface: LabelledSurface) -> tuple[bytes, set[int]]:
    """A PNG of a surface from four sides, and the owners that got a label in at least one of them.

    Raises:
        DrawingError: pyvista is missing, or finds no OpenGL.
    """
    pictures = _list_pictures(surface)
    drawing = draw_pictures(pictures)
    if drawing.remark is not None:
        raise DrawingError(drawing.remark)
    width, height = PIXELS
    # a long legend stands above the pictures
    lines = len(surface.legend)
    total = 2 * height + HEAD + (LEGEND_STEP * lines if lines > MOST_INSIDE else 0)
    figure = Figure(figsize=(2 * width / DPI, total / DPI), dpi=DPI)
    canvas: Any = FigureCanvasAgg(figure)
    figure.text(0.5, 1.0 - 14 / total, surface.title, ha="center", va="center", fontsize=13)
    labelled: set[int] = set()
    share = 2 * height / total
    for index, name in enumerate(CAMERAS):
        axes = figure.add_axes(
            (0.5 * (index % 2), share * (0.5 - 0.5 * (index // 2)), 0.5, share / 2)
        )
        axes.set_axis_off()
        axes.imshow(_open_image(drawing.images[name]), interpolation="none", aspect="auto")
        axes.text(12, height - 12, f"seen from {name}", fontsize=9, color="#555555")
        owners = _read_owners(drawing.images[OWNERS + name])
        frame = frame_picture(next(picture for picture in pictures if picture.name == name))
        places = [frame.project(note.place[None], PIXELS)[0] for note in surface.notes]
        spots = {
            owner: spot for owner, spot in _find_spots(owners).items() if owner in surface.labels
        }
        labels = _place_labels(spots, surface.labels)
        for label in labels + _place_notes(surface.notes, places, labels):
            if label.text_at != label.place:
                axes.plot(
                    *zip(label.place, label.text_at, strict=True), color=LEADER, linewidth=0.6
                )
            text = axes.text(
                *label.text_at, label.text, fontsize=8, ha="center", va="center", color=label.color
            )
            if label.owner:
                text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
            else:
                text.set_bbox(PLATE)  # coloured letters are hard to read on coloured bodies
            labelled.add(label.owner)
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
    for number, (entry, color) in enumerate(surface.legend):
        line = 1.0 - LEGEND_STEP * (number + 1) / total
        for place, words, shade in ((0.98, entry, INK), (0.992, "\N{BLACK SQUARE}", color)):
            figure.text(place, line, words, fontsize=10, color=shade, ha="right", va="center")
    labelled.discard(0)
    buffer = io.BytesIO()
    canvas.print_png(buffer)
    return buffer.getvalue(), labelled


def show_numbered(surface: LabelledSurface) -> None:
    """Show a surface with its labels and notes in a window until the user closes it.

    Raises:
        DrawingError: pyvista is missing, or cannot open a window.
    """
    middles = {
        owner: surface.points[surface.triangles[surface.owners == owner]].reshape(-1, 3)
        for owner in surface.labels
    }
    labels = [
        Note(surface.labels[owner], 0.5 * (corners.min(axis=0) + corners.max(axis=0)), INK)
        for owner, corners in middles.items()
        if len(corners)
    ]
    looks = _list_pictures(surface)[0]
    notes = (*labels, *surface.notes)
    problem = open_window([replace(looks, name=surface.title, size=WINDOW, notes=notes)])
    if problem is not None:
        raise DrawingError(f"no window: {problem}")


def _list_pictures(surface: LabelledSurface) -> list[Picture]:
    """From each side the surface as it looks, and its owners as colours."""
    # corners of their own for every owner, so that each has its colour up to its border
    pairs = np.column_stack([surface.triangles.ravel(), np.repeat(surface.owners, 3)])
    corners, flat = np.unique(pairs, axis=0, return_inverse=True)
    points, owners, triangles = surface.points[corners[:, 0]], corners[:, 1], flat.reshape(-1, 3)
    numbers = np.arange(int(surface.owners.max()) + 1)
    soft = [(GOLDEN * numbers) % 1.0, np.full(len(numbers), 0.28), np.full(len(numbers), 0.98)]
    palette = hsv_to_rgb(np.column_stack(soft)) if surface.palette is None else surface.palette
    codes = np.column_stack([owners >> 16, owners >> 8 & 255, owners & 255]) / 255.0
    find_edges = _find_borders if surface.palette is None else sharp_edges
    edges = find_edges(points, triangles)
    found = []
    for name, camera in CAMERAS.items():
        looks = Picture(
            name,
            points,
            triangles,
            edges,
            palette[owners],
            PIXELS,
            marks=surface.marks,
            camera=np.array(camera),
        )
        found += [looks, replace(looks, name=OWNERS + name, colors=codes, marks=(), flat=True)]
    return found


def _find_borders(points: FloatArray, triangles: IntArray) -> IntArray:
    """Edges ``(k, 2)`` that belong to one triangle: owners share no points."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    found, counts = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(found[counts == 1])


def _open_image(png: bytes) -> Image.Image:
    return Image.open(io.BytesIO(png))


def _read_owners(png: bytes) -> IntArray:
    """Owner ``(height, width)`` of each pixel, 0 for none."""
    red, green, blue, opacity = np.moveaxis(np.asarray(_open_image(png), dtype=np.int64), 2, 0)
    return np.where(opacity > 0, (red << 16) + (green << 8) + blue, 0)


def _find_spots(owners: IntArray) -> dict[int, _Spot]:
    """Where each visible owner is farthest from the border of its area."""
    spots: dict[int, _Spot] = {}
    for owner, area in enumerate(find_objects(owners), 1):
        if area is None:
            continue
        room = distance_transform_edt(np.pad(owners[area] == owner, 1))
        y, x = np.unravel_index(int(np.argmax(room)), room.shape)
        spots[owner] = _Spot(
            (float(area[1].start + x - 1), float(area[0].start + y - 1)), float(room[y, x])
        )
    return spots


def _place_labels(spots: Mapping[int, _Spot], texts: Mapping[int, str]) -> list[_Label]:
    """Labels inside what they name where there is room, else beside it on a leader, else none."""
    labels: list[_Label] = []
    for owner, spot in sorted(spots.items(), key=lambda item: -item[1].room):
        half = (LETTER * len(texts[owner]) / 2 + 2, LINE / 2)
        offsets = [(0.0, 0.0)] if spot.room >= CLEARANCE else LEADERS if spot.room >= SEEN else []
        for x, y in offsets:
            label = _Label(
                owner, texts[owner], spot.place, (spot.place[0] + x, spot.place[1] + y), half
            )
            if not any(_overlap(label, other) for other in labels):
                labels.append(label)
                break
    return labels


def _place_notes(
    notes: Sequence[Note], places: Sequence[FloatArray], labels: Sequence[_Label]
) -> list[_Label]:
    """Texts beside what they name, on a leader, where they cover no other text; else none."""
    found: list[_Label] = []
    width, height = PIXELS
    for note, place in zip(notes, places, strict=True):
        half = (LETTER * len(note.text) / 2 + 2, LINE / 2)
        red, green, blue = (TEXT_SHADE * part for part in note.color)
        dark = (red, green, blue)
        for reach in NOTE_REACHES:
            for x, y in LEADERS:
                at = (float(place[0] + reach * x), float(place[1] + reach * y))
                label = _Label(0, note.text, (float(place[0]), float(place[1])), at, half, dark)
                inside = (
                    half[0] <= at[0] <= width - half[0] and half[1] <= at[1] <= height - half[1]
                )
                if inside and not any(_overlap(label, other) for other in (*labels, *found)):
                    found.append(label)
                    break
            else:
                continue
            break
    return found


def _overlap(first: _Label, second: _Label) -> bool:
    return all(
        abs(first.text_at[i] - second.text_at[i]) < first.half[i] + second.half[i] for i in range(2)
    )
