"""Shapes for other programs: modes and static ones in a ``.vtu`` per pose and a ``.pvd`` over them
for ParaView, an animated ``.glb`` per mode (glTF 2.0).
"""

import json
import math
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import Frame
from headstock.geometry.parts.skins import Skin
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.results.grids import (
    POSES_FILE,
    AnyArray,
    encode_collection,
    encode_grid,
    merge_grids,
    mode_numbers,
    surface_grid,
)
from headstock.pipeline.results.views import MachineView, PoseView, component_colors
from headstock.pipeline.storage.json_texts import JsonValue
from headstock.pipeline.storage.outputs import replace_outputs

MODES_FOLDER, VOLUME_FOLDER = "modes", "volume"
# the largest displacement is shown as this share of the machine's size
SHOWN_SHARE = 0.06
PERIOD_SECONDS = 2.0
KEYFRAMES = 25
GLTF_FLOAT, GLTF_UINT = 5126, 5125
GLTF_VERTICES, GLTF_INDICES = 34962, 34963
Z_UP_TO_Y_UP = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]


def write_mode_files(folder: Path, modal: Iterable[PoseModes], view: MachineView) -> list[str]:
    """Write ``modes/POSE.vtu``, ``modes/poses.pvd`` over them and ``modes/POSE_NN.glb`` into a folder
    of results, and remove those of an earlier run.

    Args:
        modal: Modes of each pose.
        view: Surfaces, and how they move in each pose.

    Returns:
        Remarks for the user.

    Raises:
        OutputError: A file cannot be written.
    """
    contents: dict[str, bytes] = {}
    by_pose = {modes.pose.name: modes for modes in modal if len(modes.frequencies_hz)}
    for name, pose in view.poses.items():
        modes, stem = by_pose.get(name) if pose.shifts else None, file_stem(name)
        if pose.pushes or modes is not None:
            numbers = (
                {} if modes is None else mode_numbers(modes.frequencies_hz, modes.damping_ratio)
            )
            below = 0 if modes is None else modes.below
            bodies = [
                surface_grid(view, name, component, numbers, below) for component in view.skins
            ]
            contents[f"{stem}.vtu"] = encode_grid(merge_grids(bodies))
        if modes is not None:
            count = len(modes.frequencies_hz)
            contents |= {
                f"{stem}_{below + index + 1:02d}.glb": _encode_glb(view, pose, modes, index)
                for index in range(count)
            }
    return replace_outputs(folder, MODES_FOLDER, with_collection(contents))


def with_collection(contents: dict[str, bytes]) -> dict[str, bytes]:
    """Files by name, and one over those of the poses among them."""
    poses = [name for name in contents if name.endswith(".vtu")]
    return contents | ({POSES_FILE: encode_collection(poses)} if poses else {})


def file_stem(name: str) -> str:
    """A name from a scene as the stem of a file: letters, digits, dash and underscore."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:80] or "_"


def machine_size(view: MachineView, pose: PoseView) -> float:
    """Diagonal of the box around the machine in a pose [m]."""
    places = [
        skin.points @ pose.placements[name].rotation.T + pose.placements[name].origin
        for name, skin in view.skins.items()
    ]
    return float(np.linalg.norm(np.ptp(np.vstack(places), axis=0))) if places else 1.0


def largest_shift(shifts: Sequence[AnyArray]) -> float:
    """Largest displacement of any point; one where nothing moves."""
    return (
        max((float(np.linalg.norm(part, axis=-1).max(initial=0.0)) for part in shifts), default=0.0)
        or 1.0
    )


def _encode_glb(view: MachineView, pose: PoseView, modes: PoseModes, index: int) -> bytes:
    """One mode as an animated model: each body a mesh with its displacement as morph target, its
    weight swinging as a sine.

    Args:
        view: Surface of each component in its own frame [m].
        pose: Placements and mode shapes in the pose.

    Source: glTF 2.0 specification (Khronos, 2021), binary container.
    """
    swing = (
        SHOWN_SHARE
        * machine_size(view, pose)
        / largest_shift([pose.shifts[name][index] for name in view.skins])
    )
    buffer = _Buffer()
    times = buffer.add(np.linspace(0.0, PERIOD_SECONDS, KEYFRAMES, dtype=np.float32), bounds=True)
    weights = buffer.add(np.sin(np.linspace(0.0, 2.0 * np.pi, KEYFRAMES)).astype(np.float32))
    meshes, materials, nodes = [], [], []
    for number, ((name, skin), color) in enumerate(
        zip(view.skins.items(), component_colors(view).values(), strict=True)
    ):
        mesh = _glb_mesh(
            buffer, skin, pose.placements[name], pose.shifts[name][index] * swing, material=number
        )
        meshes.append(mesh | {"name": name})
        materials.append(_glb_material(name, color))
        nodes.append({"name": name, "mesh": number})
    channels = [
        {"sampler": 0, "target": {"node": number, "path": "weights"}}
        for number in range(len(nodes))
    ]
    label = f"{modes.frequencies_hz[index]:.3f} Hz: {modes.mode_names[index]}"
    root = {"name": "machine", "rotation": Z_UP_TO_Y_UP, "children": list(range(len(nodes)))}
    content = {
        "asset": {"version": "2.0", "generator": "headstock"},
        "scene": 0,
        "scenes": [{"name": label, "nodes": [len(nodes)]}],
        "nodes": [*nodes, root],
        "meshes": meshes,
        "materials": materials,
        "animations": [
            {"name": label, "samplers": [{"input": times, "output": weights}], "channels": channels}
        ],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.content)}],
    }
    text = json.dumps(content, ensure_ascii=False, allow_nan=False).encode()
    chunks = b"".join(
        _glb_chunks([(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", bytes(buffer.content))])
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


class _Buffer:
    """The binary part of a glTF file with the list of what is in it."""

    def __init__(self) -> None:
        self.content = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, JsonValue]] = []

    def add(self, array: AnyArray, *, target: int | None = None, bounds: bool = False) -> int:
        """Append an array and return the number of its accessor.

        Args:
            array: ``(n,)`` or ``(n, 3)``, single precision or unsigned integers.
            target: Use of the view: ``ARRAY_BUFFER`` or ``ELEMENT_ARRAY_BUFFER`` of glTF; None for
                animation data.
            bounds: State the least and largest value, as glTF wants of positions and times.
        """
        data = array.tobytes()
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": len(data)}
        self.views.append(view if target is None else view | {"target": target})
        self.content += data + b"\0" * (-len(data) % 4)
        accessor: dict[str, JsonValue] = {
            "bufferView": len(self.views) - 1,
            "componentType": GLTF_UINT if array.dtype.kind == "u" else GLTF_FLOAT,
            "count": len(array),
            "type": "VEC3" if array.ndim == 2 else "SCALAR",
        }
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _glb_mesh(
    buffer: _Buffer, skin: Skin, frame: Frame, shift: AnyArray, *, material: int
) -> dict[str, JsonValue]:
    points = (skin.points @ frame.rotation.T + frame.origin).astype(np.float32)
    place = buffer.add(points, target=GLTF_VERTICES, bounds=True)
    move = buffer.add(shift.astype(np.float32), target=GLTF_VERTICES, bounds=True)
    faces = buffer.add(skin.triangles.astype(np.uint32).ravel(), target=GLTF_INDICES)
    primitive: JsonValue = {
        "attributes": {"POSITION": place},
        "indices": faces,
        "targets": [{"POSITION": move}],
        "material": material,
    }
    return {"primitives": [primitive], "weights": [0.0]}


def _glb_material(name: str, color: str) -> dict[str, JsonValue]:
    # glTF colours are linear, ours are sRGB
    linear = [(int(color[i : i + 2], 16) / 255.0) ** 2.2 for i in (1, 3, 5)]
    surface: JsonValue = {
        "baseColorFactor": [*linear, 1.0],
        "metallicFactor": 0.1,
        "roughnessFactor": 0.6,
    }
    return {"name": name, "doubleSided": True, "pbrMetallicRoughness": surface}


def _glb_chunks(chunks: Sequence[tuple[bytes, bytes]]) -> Iterator[bytes]:
    for kind, data in chunks:
        yield struct.pack("<I4s", len(data), kind) + data
