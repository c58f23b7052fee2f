"""The machine as the report's 3D view reads it: a JSON object whose numbers sit in one compressed block.

A body that moves rigidly in a shape takes six numbers; only what deforms is written point by point.
"""

import base64
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray, Frame, rigid_map
from headstock.geometry.skin_decimation import decimate_skin
from headstock.geometry.skins import Skin
from headstock.pipeline.machine_views import MachineView, PoseView, ShiftArray, component_colors
from headstock.pipeline.mode_files import largest_shift

# triangles of all bodies together; what has more is drawn more coarsely
MOST_TRIANGLES = 48_000
# displacements as 16-bit numbers up to here, above as 8-bit ones; what is more than the last limit is left to modes/
FINE_BYTES, MOST_BYTES = 900_000, 1_800_000
# a body moves rigidly when it deforms by less than this share of the largest displacement: half a step of the 8-bit numbers
RIGID_SHARE = 0.004
COMPRESSION = 6
Captions = Mapping[str, Sequence[tuple[str, str, str]]]


@dataclass(frozen=True)
class EncodedMachine:
    """The machine for the page, and what had to be left out of it.

    Attributes:
        text: JSON, safe inside a script element.
        left_out: How many of them the page does not hold.
        thinned: Bodies drawn with fewer triangles than the surface of their mesh or solid has: how many are drawn, of how many.
    """

    text: str
    left_out: int
    thinned: dict[str, tuple[int, int]]


@dataclass(frozen=True, eq=False)
class _Shape:
    """A displacement of the whole machine, largest one: per body ``(n, 3)``, or translation and rotation vector ``(6,)``."""

    caption: tuple[str, str, str]
    parts: tuple[FloatArray, ...]

    @property
    def numbers(self) -> int:
        """How many have to be written."""
        return sum(part.size for part in self.parts if part.ndim == 2)


def encode_machine(view: MachineView, captions: Captions) -> EncodedMachine | None:
    """What the page needs to draw the machine; None when there is nothing to draw.

    Args:
        view: What there is to draw.
        captions: Pose to ``(shape id, short label, text)`` of its shapes, in the order in which they are offered; shape ids
            are ``mode:N`` and ``push:POINT DIRECTION``.
    """
    if not view.skins or not view.poses:
        return None
    drawn, kept = _thin_out(view)
    shapes = {name: list(_find_shapes(view, pose, captions.get(name, ()), drawn, kept)) for name, pose in view.poses.items()}
    offered, width = _fit(shapes)
    places = [_place(skin, pose.placements[name]) for pose in view.poses.values() for name, skin in drawn.items()]
    low, high = np.vstack(places).min(axis=0), np.vstack(places).max(axis=0)
    blocks: list[bytes] = []
    colors = component_colors(view)
    data = {
        "components": [_encode_skin(name, skin, colors[name], blocks) for name, skin in drawn.items()],
        "poses": [_encode_pose(name, drawn, pose, offered[name], width, blocks) for name, pose in view.poses.items()],
        "bytes": width,
        "box": [[float(a), float(b)] for a, b in zip(low, high, strict=True)],
        "size": float(np.linalg.norm(high - low)) or 1.0,
    }
    data["blob"] = base64.b64encode(zlib.compress(b"".join(blocks), COMPRESSION)).decode()
    count = sum(len(items) for items in shapes.values())
    thinned = {name: (len(skin.triangles), skin.thinned_from) for name, skin in drawn.items() if skin.thinned_from is not None}
    return EncodedMachine(script_json(data), count - sum(len(items) for items in offered.values()), thinned)


def script_json(content: Any) -> str:
    """JSON that no browser takes for the end of the script element it stands in, nor for a line break in a script."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def pose_shapes(pose: PoseView) -> dict[str, dict[str, ShiftArray]]:
    """Shape id to component to ``(n, 3)`` displacement."""
    shapes = {f"push:{name}": parts for name, parts in pose.pushes.items()}
    count = len(next(iter(pose.shifts.values()), ()))
    return shapes | {f"mode:{index}": {name: part[index] for name, part in pose.shifts.items()} for index in range(count)}


def _thin_out(view: MachineView) -> tuple[dict[str, Skin], dict[str, NDArray[np.int64]]]:
    """Surfaces small enough for a page that can be mailed, and which points of each were kept."""
    share = min(1.0, MOST_TRIANGLES / max(1, sum(len(skin.triangles) for skin in view.skins.values())))
    found = {name: decimate_skin(skin, largest=max(12, int(share * len(skin.triangles)))) for name, skin in view.skins.items()}
    return {name: skin for name, (skin, _) in found.items()}, {name: kept for name, (_, kept) in found.items()}


def _find_shapes(
    view: MachineView,
    pose: PoseView,
    captions: Sequence[tuple[str, str, str]],
    drawn: Mapping[str, Skin],
    kept: Mapping[str, NDArray[np.int64]],
) -> Iterator[_Shape]:
    known = pose_shapes(pose)
    for caption in captions:
        if caption[0] in known:
            parts = {name: known[caption[0]][name].astype(float) for name in view.skins}
            scale = 1.0 / largest_shift(list(parts.values()))
            places = {name: _place(skin, pose.placements[name]) for name, skin in drawn.items()}
            yield _Shape(caption, tuple(_find_rigid(places[name], scale * part[kept[name]]) for name, part in parts.items()))


def _find_rigid(places: FloatArray, shift: FloatArray) -> FloatArray:
    """Translation at the origin and rotation vector ``(6,)`` where points move by nothing else, else their displacements."""
    moves = rigid_map(places, places.mean(axis=0))
    motion, *_ = np.linalg.lstsq(moves, shift.ravel(), rcond=1e-9)
    if np.abs(moves @ motion - shift.ravel()).max() > RIGID_SHARE:
        return shift
    return np.concatenate([motion[:3] - np.cross(motion[3:], places.mean(axis=0)), motion[3:]])


def _fit(shapes: Mapping[str, Sequence[_Shape]]) -> tuple[dict[str, list[_Shape]], int]:
    """The shapes of each pose that fit into a page that can be mailed, the first of every pose first, and the bytes per number."""
    numbers = sum(shape.numbers for items in shapes.values() for shape in items)
    width = 2 if 2 * numbers <= FINE_BYTES else 1
    offered: dict[str, list[_Shape]] = {name: [] for name in shapes}
    room = MOST_BYTES
    for turn in range(max((len(items) for items in shapes.values()), default=0)):
        for name, items in shapes.items():
            if turn < len(items):
                room -= width * items[turn].numbers
                if room < 0:
                    return offered, width
                offered[name].append(items[turn])
    return offered, width


def _encode_skin(name: str, skin: Skin, color: str, blocks: list[bytes]) -> dict[str, Any]:
    low = skin.points.min(axis=0)
    step = np.maximum(np.ptp(skin.points, axis=0), 1e-12) / 65535.0
    wide = len(skin.points) > 65535
    index = np.dtype("<u4") if wide else np.dtype("<u2")
    blocks.append(np.round((skin.points - low) / step).astype("<u2").tobytes())
    blocks += [skin.triangles.astype(index).tobytes(), skin.edges.astype(index).tobytes()]
    return {
        "name": name,
        "color": color,
        "source": skin.source,
        "points": len(skin.points),
        "triangles": len(skin.triangles),
        "edges": len(skin.edges),
        "wide": wide,
        "low": _rounded(low),
        "step": step.tolist(),
    }


def _encode_pose(
    name: str, drawn: Mapping[str, Skin], pose: PoseView, offered: Sequence[_Shape], width: int, blocks: list[bytes]
) -> dict[str, Any]:
    kind, scale = ("<i2", 32767) if width == 2 else ("i1", 127)
    blocks += [np.round(part * scale).astype(kind).tobytes() for shape in offered for part in shape.parts if part.ndim == 2]
    frames = [pose.placements[component] for component in drawn]
    return {
        "name": name,
        "frames": [[*_rounded(frame.origin), *_rounded(frame.rotation.ravel())] for frame in frames],
        "joints": [
            {"name": joint, "kind": about.kind, "first": about.first, "second": about.second, "at": _rounded(about.frame.origin)}
            for joint, about in pose.joints.items()
        ],
        "points": [
            {"name": point, "tool": about.tool, "work": about.work, "at": _rounded(about.tool_place)}
            for point, about in pose.points.items()
        ],
        "shapes": [
            {
                "id": shape.caption[0],
                "lead": shape.caption[1],
                "text": shape.caption[2],
                "rigid": [None if part.ndim == 2 else _rounded(part) for part in shape.parts],
            }
            for shape in offered
        ],
    }


def _place(skin: Skin, frame: Frame) -> FloatArray:
    return np.asarray(skin.points @ frame.rotation.T + frame.origin)


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.7g}") for value in values]
