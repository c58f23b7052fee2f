"""The machine as the report's 3D view reads it: a JSON object whose numbers sit in one compressed block."""

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.skins import Skin
from headstock.pipeline.machine_views import MachineView, PoseView, ShiftArray, component_colors
from headstock.pipeline.mode_files import largest_shift

# displacements as 16-bit numbers up to here, above as 8-bit ones; what is more than the last limit is left to modes/
FINE_BYTES, MOST_BYTES = 900_000, 1_800_000
COMPRESSION = 6
Captions = Mapping[str, Sequence[tuple[str, str, str]]]


def encode_machine(view: MachineView, captions: Captions) -> str | None:
    """JSON text for the page, safe inside a script element; None when there is nothing to draw.

    Args:
        view: What there is to draw.
        captions: Pose to ``(shape id, short label, text)`` of its shapes, in the order in which they are offered; shape ids
            are ``mode:N`` and ``push:POINT DIRECTION``.
    """
    if not view.skins or not view.poses:
        return None
    offered, width = _fit(view, captions)
    places = [_place(skin, pose.placements[name]) for pose in view.poses.values() for name, skin in view.skins.items()]
    low, high = np.vstack(places).min(axis=0), np.vstack(places).max(axis=0)
    blocks: list[bytes] = []
    colors = component_colors(view)
    data = {
        "components": [_encode_skin(name, skin, colors[name], blocks) for name, skin in view.skins.items()],
        "poses": [_encode_pose(name, view, pose, offered[name], width, blocks) for name, pose in view.poses.items()],
        "bytes": width,
        "box": [[float(a), float(b)] for a, b in zip(low, high, strict=True)],
        "size": float(np.linalg.norm(high - low)) or 1.0,
    }
    data["blob"] = base64.b64encode(zlib.compress(b"".join(blocks), COMPRESSION)).decode()
    return script_json(data)


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


def _fit(view: MachineView, captions: Captions) -> tuple[dict[str, list[tuple[str, str, str]]], int]:
    """The shapes of each pose that fit into a page that can be mailed, and the bytes per number."""
    points = sum(len(skin.points) for skin in view.skins.values())
    offered = {}
    for name, pose in view.poses.items():
        known = pose_shapes(pose)
        offered[name] = [caption for caption in captions.get(name, ()) if caption[0] in known]
    count = sum(len(items) for items in offered.values())
    width = 2 if 6 * points * count <= FINE_BYTES else 1
    most = max(1, MOST_BYTES // max(1, 3 * width * points) // max(1, len(offered)))
    return {name: items[:most] for name, items in offered.items()}, width


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
    name: str, view: MachineView, pose: PoseView, captions: list[tuple[str, str, str]], width: int, blocks: list[bytes]
) -> dict[str, Any]:
    shapes = pose_shapes(pose)
    for shape, _, _ in captions:
        parts = [shapes[shape][component].astype(float) for component in view.skins]
        scale = (32767 if width == 2 else 127) / largest_shift(parts)
        blocks += [np.round(part * scale).astype("<i2" if width == 2 else "i1").tobytes() for part in parts]
    frames = [pose.placements[component] for component in view.skins]
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
        "shapes": [shape for shape, _, _ in captions],
        "captions": [{"id": shape, "lead": lead, "text": text} for shape, lead, text in captions],
    }


def _place(skin: Skin, frame: Frame) -> FloatArray:
    return np.asarray(skin.points @ frame.rotation.T + frame.origin)


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.7g}") for value in values]
