"""The machine as the report's 3D view reads it: a JSON object whose numbers sit in one compressed
block.

A body that moves rigidly in a shape takes six numbers; only what deforms is written point by point.
"""

import base64
import dataclasses
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.app.drawings.markup import script_json
from headstock.geometry.frames import FloatArray, Frame, rigid_map
from headstock.geometry.parts.skins import Skin
from headstock.pipeline.results.mode_files import largest_shift
from headstock.pipeline.results.views import (
    MachineView,
    PoseView,
    ShiftArray,
    SurfaceGauges,
    component_colors,
)
from headstock.pipeline.storage.json_texts import JsonValue

# displacements as 16-bit numbers up to here, above as 8-bit ones; what is more than the last limit
# is left to modes/
FINE_BYTES, MOST_BYTES = 1_500_000, 1_800_000
# a body moves rigidly when it deforms by less than this share of the largest displacement: half a
# step of the 8-bit numbers
RIGID_SHARE = 0.004
# forces are shown as 1 kN
SHOWN_FORCE = 1000.0
# energy densities above those of all but this share of the surface points get the last colour: at
# re-entrant corners there is no largest one
PEAK_SHARE = 0.002
SMALLEST_SHARE = 0.002
COMPRESSION = 6  # 9 takes three times as long, for a hundredth less
Kind = Literal["force", "mode", "whole"]


@dataclass(frozen=True)
class Caption:
    """A shape that the page offers, and what it says of it.

    Attributes:
        shape: ``mode:N`` or ``push:POINT DIRECTION``.
        kind: Motion under a force, natural mode, or natural mode in which the machine moves as a
            whole.
        shares: Component and joint to its share of the strain energy.
    """

    shape: str
    lead: str = ""
    text: str = ""
    kind: Kind = "mode"
    frequency_hz: float = 0.0
    shares: Mapping[str, float] = field(default_factory=dict)


Captions = Mapping[str, Sequence[Caption]]


@dataclass(frozen=True)
class EncodedMachine:
    """The machine for the page, and what had to be left out of it.

    Attributes:
        text: JSON, safe inside a script element.
        left_out: How many of them the page does not hold.
        thinned: Bodies drawn with fewer triangles than the surface of their mesh or solid has: how
            many are drawn, of how many.
        kept_whole: Bodies drawn with very many triangles: how many, and why no fewer.
    """

    text: str
    left_out: int
    thinned: dict[str, tuple[int, int]]
    kept_whole: dict[str, tuple[int, str]]


@dataclass(frozen=True, eq=False)
class _Shape:
    """A displacement of the whole machine.

    Attributes:
        caption: What the page says of it.
        largest: Largest displacement, under 1 kN [m] or of the mode shape; ``parts`` are shares of
            it.
        parts: Per body ``(n, 3)``, or translation and rotation vector ``(6,)``.
        peak: Energy density that gets the last colour, in J/m^3 under 1 kN or as a share of the
            mode's energy per m^3; 0 where none is known.
        energies: Per body ``(n,)`` energy density over ``peak``, or None where it is not known.
    """

    caption: Caption
    largest: float
    parts: tuple[FloatArray, ...]
    peak: float
    energies: tuple[FloatArray | None, ...]

    def count_bytes(self, width: int) -> int:
        """Count what has to be written."""
        return sum(width * part.size for part in self.parts if part.ndim == 2) + sum(
            density.size for density in self.energies if density is not None
        )


def encode_machine(view: MachineView, captions: Captions) -> EncodedMachine | None:
    """Encode what the page needs to draw the machine; None when there is nothing to draw.

    Args:
        view: What there is to draw.
        captions: Pose to its shapes, in the order in which they are offered.
    """
    if not view.skins or not view.poses:
        return None
    # neighbours next to each other
    orders = {name: _order_along_curve(skin.points) for name, skin in view.skins.items()}
    drawn = {name: _order_skin(skin, orders[name]) for name, skin in view.skins.items()}
    shapes = {
        name: list(_find_shapes(view, pose, captions.get(name, ()), drawn, orders))
        for name, pose in view.poses.items()
    }
    offered, width = _fit(shapes)
    places = [
        _place(skin, pose.placements[name])
        for pose in view.poses.values()
        for name, skin in drawn.items()
    ]
    low, high = np.vstack(places).min(axis=0), np.vstack(places).max(axis=0)
    blocks: list[bytes] = []
    colors = component_colors(view)
    data: dict[str, JsonValue] = {
        "components": [
            _encode_skin(name, skin, colors[name], blocks) for name, skin in drawn.items()
        ],
        "poses": [
            _encode_pose(name, drawn, pose, offered[name], width, blocks)
            for name, pose in view.poses.items()
        ],
        "bytes": width,
        "box": [[float(a), float(b)] for a, b in zip(low, high, strict=True)],
        "size": float(np.linalg.norm(high - low)) or 1.0,
    }
    data["blob"] = base64.b64encode(zlib.compress(b"".join(blocks), COMPRESSION)).decode()
    count = sum(len(items) for items in shapes.values())
    return EncodedMachine(
        script_json(data),
        count - sum(len(items) for items in offered.values()),
        {
            name: (len(skin.triangles), skin.thinned_from)
            for name, skin in drawn.items()
            if skin.thinned_from is not None
        },
        {
            name: (len(skin.triangles), skin.kept_whole)
            for name, skin in drawn.items()
            if skin.kept_whole is not None
        },
    )


def _pose_shapes(pose: PoseView) -> dict[str, dict[str, ShiftArray]]:
    """Shape id to component to ``(n, 3)`` displacement."""
    shapes = {f"push:{name}": parts for name, parts in pose.pushes.items()}
    count = len(next(iter(pose.shifts.values()), ()))
    return shapes | {
        f"mode:{index}": {name: part[index] for name, part in pose.shifts.items()}
        for index in range(count)
    }


def _order_skin(skin: Skin, order: NDArray[np.int64]) -> Skin:
    """The surface with its points in an order, triangles and edges along it."""
    numbers = np.argsort(order)
    triangles = numbers[skin.triangles]
    edges = np.sort(numbers[skin.edges], axis=1)
    return dataclasses.replace(
        skin,
        points=skin.points[order],
        triangles=triangles[np.lexsort((triangles.max(axis=1), triangles.min(axis=1)))],
        edges=edges[np.lexsort((edges[:, 1], edges[:, 0]))],
        nodes=None,
        weights=None,
    )


def _order_along_curve(points: FloatArray) -> NDArray[np.int64]:
    """Points in the order of a curve that fills space, so that neighbours differ little: they
    compress well.

    Source: Morton (1966).
    """
    steps = np.round(
        (points - points.min(axis=0)) / max(float(np.ptp(points, axis=0).max()), 1e-12) * 1023.0
    ).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= (steps[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _find_shapes(
    view: MachineView,
    pose: PoseView,
    captions: Sequence[Caption],
    drawn: Mapping[str, Skin],
    orders: Mapping[str, NDArray[np.int64]],
) -> Iterator[_Shape]:
    known = _pose_shapes(pose)
    places = {name: _place(skin, pose.placements[name]) for name, skin in drawn.items()}
    gauges = {
        name: SurfaceGauges(_place(skin, pose.placements[name]), skin.triangles)
        for name, skin in view.skins.items()
        if name in view.materials
    }
    for caption in captions:
        if caption.shape not in known:
            continue
        force = SHOWN_FORCE if caption.kind == "force" else 1.0
        whole = {
            name: np.asarray(
                force * known[caption.shape][name].astype(np.float64), dtype=np.float64
            )
            for name in view.skins
        }
        largest = largest_shift(list(whole.values()))
        parts = {
            name: _find_rigid(
                places[name], np.asarray(part[orders[name]] / largest, dtype=np.float64)
            )
            for name, part in whole.items()
        }
        energy = 1.0
        if caption.kind != "force":  # share of the energy of a mode of unit modal mass
            energy = 0.5 * (2.0 * np.pi * caption.frequency_hz) ** 2
        density: dict[str, FloatArray] = {
            name: np.asarray(
                gauges[name].energy_density(whole[name], material)[orders[name]] / energy,
                dtype=np.float64,
            )
            for name, material in view.materials.items()
            if energy > 0.0
        }
        peak = (
            float(np.quantile(np.concatenate(list(density.values())), 1.0 - PEAK_SHARE))
            if density
            else 0.0
        )
        energies = tuple(
            np.minimum(density[name] / peak, 1.0) if name in density and peak > 0.0 else None
            for name in drawn
        )
        yield _Shape(caption, largest, tuple(parts.values()), peak, energies)


def _find_rigid(places: FloatArray, shift: FloatArray) -> FloatArray:
    """Translation at the origin and rotation vector ``(6,)`` where points move by nothing else,
    else their displacements.
    """
    moves = rigid_map(places, places.mean(axis=0))
    motion, *_ = np.linalg.lstsq(moves, shift.ravel(), rcond=1e-9)
    if np.abs(moves @ motion - shift.ravel()).max() > RIGID_SHARE:
        return shift
    return np.concatenate([motion[:3] - np.cross(motion[3:], places.mean(axis=0)), motion[3:]])


def _fit(shapes: Mapping[str, Sequence[_Shape]]) -> tuple[dict[str, list[_Shape]], int]:
    """The shapes of each pose that fit into a page that can be mailed, the first of every pose
    first, and the bytes per number.
    """
    width = (
        2
        if sum(shape.count_bytes(2) for items in shapes.values() for shape in items) <= FINE_BYTES
        else 1
    )
    offered: dict[str, list[_Shape]] = {name: [] for name in shapes}
    room = MOST_BYTES
    for turn in range(max((len(items) for items in shapes.values()), default=0)):
        for name, items in shapes.items():
            if turn < len(items):
                room -= items[turn].count_bytes(width)
                if room < 0:
                    return offered, width
                offered[name].append(items[turn])
    return offered, width


def _encode_skin(name: str, skin: Skin, color: str, blocks: list[bytes]) -> dict[str, JsonValue]:
    low = skin.points.min(axis=0)
    step = np.maximum(np.ptp(skin.points, axis=0), 1e-12) / 65535.0
    blocks.append(_pack_columns(np.round((skin.points - low) / step).astype(np.uint16)))
    blocks += [_pack_columns(corners.astype(np.uint32)) for corners in (skin.triangles, skin.edges)]
    return {
        "name": name,
        "color": color,
        "source": skin.source,
        "points": len(skin.points),
        "triangles": len(skin.triangles),
        "edges": len(skin.edges),
        "whole": skin.thinned_from or len(skin.triangles),
        "low": _rounded(low),
        "step": step.tolist(),
    }


def _pack_columns(values: NDArray[np.integer]) -> bytes:
    """Columns of whole numbers one after the other, as differences from the number before, which
    wrap round.

    All lowest bytes come before all next ones: the differences of neighbours are small, so that
    most bytes are alike.
    """
    columns = np.ascontiguousarray(values.T)
    unsigned = columns.view(f"u{columns.itemsize}")
    first = np.zeros((len(unsigned), 1), dtype=unsigned.dtype)
    steps = np.ascontiguousarray(np.diff(unsigned, axis=1, prepend=first)).astype(
        f"<u{columns.itemsize}"
    )
    return bytes(
        np.ascontiguousarray(steps.view(np.uint8).reshape(-1, columns.itemsize).T).tobytes()
    )


def _encode_pose(
    name: str,
    drawn: Mapping[str, Skin],
    pose: PoseView,
    offered: Sequence[_Shape],
    width: int,
    blocks: list[bytes],
) -> dict[str, JsonValue]:
    kind, scale = (np.int16, 32767) if width == 2 else (np.int8, 127)
    for shape in offered:
        blocks += [
            _pack_columns(np.round(part * scale).astype(kind))
            for part in shape.parts
            if part.ndim == 2
        ]
        # square roots, so that what holds a hundredth of the largest density is still distinguished
        blocks += [
            _pack_columns(np.round(255.0 * np.sqrt(density))[:, None].astype(np.uint8))
            for density in shape.energies
            if density is not None
        ]
    frames = [pose.placements[component] for component in drawn]
    return {
        "name": name,
        "frames": [
            [*_rounded(frame.origin), *_rounded(frame.rotation.ravel())] for frame in frames
        ],
        "joints": [
            {
                "name": joint,
                "kind": about.kind,
                "first": about.first,
                "second": about.second,
                "at": _rounded(about.frame.origin),
                "body": _body_of(about.first, drawn, _body_of(about.second, drawn)),
            }
            for joint, about in pose.joints.items()
        ],
        "points": [
            {
                "name": point,
                "tool": about.tool,
                "work": about.work,
                "at": _rounded(about.tool_place),
                "body": _body_of(about.tool, drawn, _body_of(about.work, drawn)),
                "back": None if about.work_place is None else _rounded(about.work_place),
                "back_body": _body_of(about.work, drawn),
            }
            for point, about in pose.points.items()
        ],
        "shapes": [_encode_shape(shape) for shape in offered],
    }


def _encode_shape(shape: _Shape) -> dict[str, JsonValue]:
    caption = shape.caption
    return {
        "id": caption.shape,
        "lead": caption.lead,
        "text": caption.text,
        "kind": caption.kind,
        "largest": float(f"{shape.largest:.5g}"),
        "peak": float(f"{shape.peak:.5g}"),
        "shares": {
            part: round(share, 4)
            for part, share in caption.shares.items()
            if share >= SMALLEST_SHARE
        },
        "rigid": [None if part.ndim == 2 else _rounded(part) for part in shape.parts],
        "resolved": [density is not None for density in shape.energies],
    }


def _body_of(end: str, drawn: Mapping[str, Skin], other: int | None = None) -> int | None:
    """Number of the component that an end ``COMPONENT.INTERFACE`` belongs to; another one for
    ground.
    """
    return next((number for number, name in enumerate(drawn) if end.startswith(f"{name}.")), other)


def _place(skin: Skin, frame: Frame) -> FloatArray:
    return np.asarray(skin.points @ frame.rotation.T + frame.origin)


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.7g}") for value in values]
