"""Pictures of joint kinds and patch kinds with their axes, for docs/joints.md and docs/patches.md:
``./headstock exec python3 docs/site/pictures.py``.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from headstock.app.pictures.picture import Marks, Picture, frame_picture
from headstock.app.pictures.pictures import draw_pictures
from headstock.geometry.frames import FloatArray, frame_axes, rotation_about
from headstock.geometry.parts.skins import Skin, join_skins, solid_skin
from headstock.geometry.parts.solids import Box, Solid, Tube
from headstock.scene.building.joints import KINDS

IMAGES = Path(__file__).resolve().parent.parent / "images"
SIZE = (640, 440)
DPI = 100
FIRST, SECOND = (0.62, 0.72, 0.85), (0.93, 0.78, 0.55)
PATCH = (0.85, 0.30, 0.25)
AXIS_COLORS = ((0.72, 0.05, 0.05), (0.05, 0.50, 0.15), (0.10, 0.25, 0.80))
LENGTH = 0.11  # of the arrows [m]
LABEL = 1.65  # of their length, where the text is
# behind the text: on a body coloured letters are hard to read
PLATE = {"boxstyle": "round,pad=0.2", "facecolor": (1.0, 1.0, 1.0, 0.88), "linewidth": 0.0}


@dataclass(frozen=True, eq=False)
class Body:
    """A solid, where its origin is [m], its colour, and its rotation about z [deg]."""

    solid: Solid
    at: tuple[float, float, float]
    color: tuple[float, float, float]
    along: str = "z"
    angle: float = 0.0


def box(x: float, y: float, z: float) -> Box:
    """A box of these sizes [mm]."""
    return Box((1e-3 * x, 1e-3 * y, 1e-3 * z))


def tube(outer: float, inner: float, length: float) -> Tube:
    """A tube of these sizes [mm]."""
    return Tube(1e-3 * outer, 1e-3 * inner, 1e-3 * length)


BED = Body(box(260, 180, 50), (0.0, 0.0, -0.06), FIRST)
TABLE = Body(box(140, 140, 60), (0.0, 0.0, 0.0), SECOND)
SHAFT = Body(tube(44, 1, 205), (-0.12, 0.0, 0.05), SECOND, along="x")
HOUSING = Body(box(50, 130, 130), (0.0, 0.0, -0.015), FIRST)
NUT = Body(box(70, 90, 90), (0.0, 0.0, 0.005), FIRST)
LINK = Body(box(160, 44, 44), (0.10, 0.0, 0.028), SECOND)
ARM = Body(box(160, 44, 44), (-0.10, 0.0, 0.028), FIRST)
COLUMN = Body(box(90, 90, 170), (0.0, 0.0, 0.0), SECOND)
FEET = Body(box(240, 160, 80), (0.0, 0.0, 0.0), SECOND)
# bodies, where the joint acts [m], the directions that the scene gives
JOINTS: dict[str, tuple[tuple[Body, ...], tuple[float, float, float]]] = {
    "rigid": ((BED, COLUMN), (0.0, 0.0, 0.0)),
    "bolted": ((BED, COLUMN), (0.0, 0.0, 0.0)),
    "spring": ((BED, TABLE), (0.0, 0.0, 0.0)),
    "linear_guide": ((BED, TABLE), (0.0, 0.0, 0.0)),
    "ball_screw": ((NUT, SHAFT), (0.0, 0.0, 0.05)),
    "bearing": ((HOUSING, SHAFT), (0.0, 0.0, 0.05)),
    "mount": ((FEET,), (0.0, 0.0, 0.0)),
    "revolute": ((HOUSING, SHAFT), (0.0, 0.0, 0.05)),
    "universal": ((ARM, LINK), (0.0, 0.0, 0.05)),
    "spherical": ((ARM, LINK), (0.0, 0.0, 0.05)),
    "prismatic": ((NUT, SHAFT), (0.0, 0.0, 0.05)),
}
BLOCK = Body(box(240, 160, 60), (0.0, 0.0, -0.06), FIRST)
ROUND = Body(tube(140, 0, 120), (0.0, 0.0, -0.12), FIRST)
# areas on the upper face as thin bodies, and what is written at the axes of the component
PATCHES: dict[str, tuple[tuple[Body, ...], tuple[str, str, str]]] = {
    "face": (
        (Body(box(240, 160, 1), (0.0, 0.0, 0.0), PATCH),),
        ("x", "y", 'z\nface = "z+"'),
    ),
    "rect": (
        (Body(box(110, 60, 1), (-0.03, 0.02, 0.0), PATCH),),
        ("x: size[0], center[0]", "y: size[1],\ncenter[1]", "z"),
    ),
    "disk": (
        (Body(tube(90, 0, 1), (0.04, 0.0, 0.0), PATCH),),
        ("x: center[0]", "y: center[1]", "z"),
    ),
    "strip": (
        (Body(box(240, 40, 1), (0.0, 0.03, 0.0), PATCH),),
        ('x: along = "x"', "y: width,\ncenter", "z"),
    ),
    "turned": (
        (Body(box(110, 60, 1), (-0.03, 0.02, 0.0), PATCH, angle=30.0),),
        ("x: size[0] turned\nby angle", "y", "z"),
    ),
    "ring": (
        (Body(tube(90, 40, 1), (0.04, 0.0, 0.0), PATCH),),
        ("x: center[0]", "y: center[1]", "z"),
    ),
    "outline": (
        (
            Body(box(150, 40, 1), (-0.025, -0.04, 0.0), PATCH),
            Body(box(40, 60, 1), (-0.08, 0.01, 0.0), PATCH),
        ),
        ("x", "y", "z\nsix corners"),
    ),
    "band": (
        (Body(tube(141, 139, 40), (0.0, 0.0, -0.07), PATCH),),
        ("x", "y", "z: width,\ncenter[2]"),
    ),
    "patches": (
        tuple(
            Body(tube(36, 0, 1), (x, y, 0.0), PATCH) for x in (-0.09, 0.09) for y in (-0.05, 0.05)
        ),
        ("x", "y", "z\nfour disks, one interface"),
    ),
    "rail": (
        (
            Body(box(240, 20, 1), (0.0, -0.05, 0.0), PATCH),
            Body(box(60, 44, 22), (0.05, -0.05, 0.001), SECOND),
        ),
        ('x: rail along "x"', "y", "z\na carriage at any x"),
    ),
}
DOFS = ("x", "y", "z", "rx", "ry", "rz")


def main() -> None:
    """Draw all of them."""
    pictures: dict[str, tuple[Picture, FloatArray, tuple[str, ...]]] = {
        f"joint_{kind}": draw_joint(kind) for kind in KINDS
    }
    middle = np.zeros(3)  # of the face: where the axes of a box are
    for kind, (areas, texts) in PATCHES.items():
        body = ROUND if kind == "band" else BLOCK
        picture = _make_picture(kind, (body, *areas), middle, np.eye(3))
        pictures[f"patch_{kind}"] = picture, LABEL * LENGTH * np.eye(3), texts
    for name, (drawn, places, words) in pictures.items():
        drawing = draw_pictures([drawn])
        if drawing.remark is not None:
            raise SystemExit(drawing.remark)
        label_axes(drawn, drawing.images[drawn.name], places, words, IMAGES / f"{name}.png")


def draw_joint(kind: str) -> tuple[Picture, FloatArray, tuple[str, ...]]:
    """Two bodies and the frame of the joint between them.

    Returns:
        The picture, tips ``(3, 3)`` of the axes [m], and what is written there.
    """
    bodies, place = JOINTS[kind]
    rule = KINDS[kind]
    upright = rule.axis_is == "z"
    axis = np.array([0.0, 0.0, 1.0] if upright else [1.0, 0.0, 0.0])
    normal = np.array([1.0, 0.0, 0.0] if upright else [0.0, 0.0, 1.0])
    rotation = np.eye(3) if upright else frame_axes(axis, normal)
    origin = np.array(place)
    tips = origin + LABEL * LENGTH * rotation.T
    return (
        _make_picture(kind, bodies, origin, rotation),
        tips,
        tuple(_describe_axis(kind, column) for column in range(3)),
    )


def _describe_axis(kind: str, column: int) -> str:
    """What acts along and about an axis of the joint's frame."""
    rule = KINDS[kind]
    found = []
    for dof in (column, column + 3):
        keys = [key for key, dofs in rule.keys.items() if dof in dofs]
        name = DOFS[dof]
        if dof in rule.fixed:
            found.append(f"{name} fixed")
        elif keys and keys[0] != name:
            found.append(f"{name} {keys[0]}")
        else:
            found.append(f"{name} free" if rule.fixed or not keys else f"{name} spring")
    return "\n".join(found)


def _make_picture(
    name: str, bodies: Sequence[Body], origin: FloatArray, rotation: FloatArray
) -> Picture:
    skins = [_place_skin(body) for body in bodies]
    joined = join_skins(skins)
    # corners of a box around the labels, which no triangle uses, keep them inside the picture
    around = origin + 1.75 * LENGTH * np.vstack([rotation.T, -np.eye(3)])
    points = np.vstack([joined.points, around])
    colors = [
        np.tile(body.color, (len(skin.points), 1)) for body, skin in zip(bodies, skins, strict=True)
    ]
    share = LENGTH / float(np.linalg.norm(np.ptp(points, axis=0)))
    arrows = [
        Marks(origin[None], color, share, True, "arrow", rotation[:, [column]].T)
        for column, color in enumerate(AXIS_COLORS)
    ]
    ball = Marks(origin[None], (0.1, 0.1, 0.1), 0.07 * share, True)
    return Picture(
        name,
        points,
        joined.triangles,
        joined.edges,
        np.vstack([*colors, np.ones((len(around), 3))]),
        SIZE,
        marks=(*arrows, ball),
    )


def _place_skin(body: Body) -> Skin:
    skin = solid_skin(body.solid)
    if skin is None:
        raise ValueError("a solid that is read from a file has no surface of its own")
    points = skin.points
    if body.along == "x":
        points = points[:, [2, 0, 1]]
    points = points @ rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(body.angle)).T
    return Skin(points + np.array(body.at), skin.triangles, skin.edges, skin.source)


def label_axes(
    picture: Picture, image: bytes, places: FloatArray, texts: Sequence[str], path: Path
) -> None:
    """Write the texts at their places into a picture, and the picture into a file.

    Args:
        picture: As it was drawn.
        image: The PNG.
        places: ``(n, 3)`` [m].
        texts: One per place.
        path: Of the file.
    """
    width, height = SIZE
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.imshow(Image.open(io.BytesIO(image)), interpolation="none", aspect="auto")
    spots = frame_picture(picture).project(places, SIZE)
    for number, (text, color) in enumerate(zip(texts, AXIS_COLORS, strict=False)):
        x, y = float(spots[number, 0]), float(spots[number, 1])
        axes.text(x, y, text, fontsize=15, color=color, ha="center", va="center", bbox=PLATE)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    canvas.print_png(path)


if __name__ == "__main__":
    main()
