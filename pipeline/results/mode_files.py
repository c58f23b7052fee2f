"""Shapes for other programs: modes and static ones in a ``.vtu`` per pose for ParaView, an animated
``.glb`` per mode (glTF 2.0).
"""

import base64
import json
import math
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import Frame
from headstock.geometry.parts.skins import Skin
from headstock.pipeline.results.modal import ModesSummary
from headstock.pipeline.results.views import MachineView, PoseView, component_colors
from headstock.pipeline.storage.json_texts import JsonValue
from headstock.pipeline.storage.outputs import replace_outputs

MODES_FOLDER = "modes"
# the largest displacement is shown as this share of the machine's size
SHOWN_SHARE = 0.06
PERIOD_SECONDS = 2.0
KEYFRAMES = 25
VTK_TRIANGLE = 5
GLTF_FLOAT, GLTF_UINT = 5126, 5125
GLTF_VERTICES, GLTF_INDICES = 34962, 34963
Z_UP_TO_Y_UP = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
AnyArray = NDArray[Any]


def write_mode_files(folder: Path, modal: Sequence[ModesSummary], view: MachineView) -> list[str]:
    """Write ``modes/POSE.vtu`` and ``modes/POSE_NN.glb`` into a folder of results, and remove those
    of an earlier run.

    Args:
        folder: Folder of results.
        modal: Modes of each pose, as in ``summary.json``.
        view: Surfaces, and how they move in each pose.

    Returns:
        Remarks for the user.

    Raises:
        OutputError: A file cannot be written.
    """
    contents: dict[str, bytes] = {}
    by_pose = {modes["pose_name"]: modes for modes in modal if modes["frequencies_hz"]}
    for name, pose in view.poses.items():
        modes, stem = by_pose.get(name) if pose.shifts else None, file_stem(name)
        if pose.pushes or modes is not None:
            contents[f"{stem}.vtu"] = encode_vtu(view, pose, modes)
        if modes is not None:
            count = len(modes["frequencies_hz"])
            contents |= {
                f"{stem}_{index + 1:02d}.glb": encode_glb(view, pose, modes, index)
                for index in range(count)
            }
    return replace_outputs(folder, MODES_FOLDER, contents)


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


def encode_vtu(view: MachineView, pose: PoseView, modes: ModesSummary | None) -> bytes:
    """Surface of the machine in a pose [m] with its displacements.

    Point data: ``component`` numbers the bodies, ``mode_01`` and so on are mode shapes
    [m/sqrt(kg)], ``static_POINT_x`` displacements under a unit force at a point [m/N]. Field data:
    ``frequencies_hz`` and, for a damped machine, ``damping_ratio`` of every mode, NaN where there
    is none. The names are the same whatever the results, so that a ParaView state fits the next
    run.

    Args:
        view: Surface of each component in its own frame [m].
        pose: Placements and displacements in the pose.
        modes: Natural modes of the pose; None where no modal analysis was run.
    """
    points, triangles, numbers = [], [], []
    start = 0
    for number, (name, skin) in enumerate(view.skins.items()):
        frame = pose.placements[name]
        points.append(skin.points @ frame.rotation.T + frame.origin)
        triangles.append(skin.triangles + start)
        numbers.append(np.full(len(skin.points), number, dtype=np.int32))
        start += len(skin.points)
    fields: dict[str, AnyArray] = {"component": np.concatenate(numbers)}
    for index in range(0 if modes is None else len(modes["frequencies_hz"])):
        fields[mode_array(index)] = np.vstack(
            [pose.shifts[name][index] for name in view.skins]
        ).astype(np.float32)
    for push, shifts in pose.pushes.items():
        fields[push_array(push)] = np.vstack([shifts[name] for name in view.skins]).astype(
            np.float32
        )
    block = CellBlock(VTK_TRIANGLE, np.vstack(triangles))
    numbers_of_modes = (
        {} if modes is None else mode_numbers(modes["frequencies_hz"], modes["damping_ratio"])
    )
    return encode_grid(Grid(np.vstack(points), (block,), fields, {}, numbers_of_modes))


@dataclass(frozen=True, eq=False)
class CellBlock:
    """Cells of one kind: VTK's number of it, and ``(n, nodes)`` points of each in VTK's order."""

    kind: int
    cells: AnyArray


@dataclass(frozen=True, eq=False)
class Grid:
    """An unstructured grid: points ``(n, 3)``, cells, and arrays by name over points, over cells
    and of the whole.
    """

    points: AnyArray
    blocks: tuple[CellBlock, ...]
    point_data: dict[str, AnyArray]
    cell_data: dict[str, AnyArray]
    field_data: dict[str, AnyArray]


def mode_array(index: int) -> str:
    """Name of the array of a mode, whatever its frequency."""
    return f"mode_{index + 1:02d}"


def push_array(push: str) -> str:
    """Name of the array of the response to a unit force, ``POINT DIRECTION``."""
    return f"static_{push.replace(' ', '_')}"


def mode_numbers(
    frequencies_hz: Sequence[float], damping_ratio: Sequence[float | None]
) -> dict[str, AnyArray]:
    """Frequencies [Hz] and damping ratios of the modes of a pose as arrays; no ratios where nothing
    is damped.
    """
    found = {"frequencies_hz": np.array(frequencies_hz, dtype=np.float64)}
    if any(ratio is not None for ratio in damping_ratio):
        found["damping_ratio"] = np.array(
            [math.nan if ratio is None else ratio for ratio in damping_ratio]
        )
    return found if len(frequencies_hz) else {}


def encode_grid(grid: Grid) -> bytes:
    """A grid as ``.vtu``.

    It is written here since libraries that could take a second and more to import, longer than a
    small run takes.

    Source: VTK file formats, XML unstructured grids with base64 data behind a 64-bit length.
    """
    sizes = np.concatenate(
        [np.full(len(block.cells), block.cells.shape[1], dtype=np.int64) for block in grid.blocks]
    )
    kinds = np.concatenate(
        [np.full(len(block.cells), block.kind, dtype=np.uint8) for block in grid.blocks]
    )
    cells = [
        _data_array(
            "connectivity",
            np.concatenate([block.cells.ravel() for block in grid.blocks]).astype(np.int64),
        ),
        _data_array("offsets", np.cumsum(sizes)),
        _data_array("types", kinds),
    ]
    about, over_points, over_cells = (
        "".join(starmap(encode, data.items()))
        for encode, data in (
            (_field_array, grid.field_data),
            (_data_array, grid.point_data),
            (_data_array, grid.cell_data),
        )
    )
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
            f"<UnstructuredGrid><FieldData>{about}</FieldData>",
            f'<Piece NumberOfPoints="{len(grid.points)}" NumberOfCells="{len(kinds)}">',
            f"<Points>{_data_array('points', grid.points)}</Points>",
            f"<Cells>{''.join(cells)}</Cells>",
            f"<PointData>{over_points}</PointData>",
            f"<CellData>{over_cells}</CellData>",
            "</Piece></UnstructuredGrid></VTKFile>\n",
        ]
    ).encode()


def encode_glb(view: MachineView, pose: PoseView, modes: ModesSummary, index: int) -> bytes:
    """One mode as an animated model: each body a mesh with its displacement as morph target, its
    weight swinging as a sine.

    Args:
        view: Surface of each component in its own frame [m].
        pose: Placements and mode shapes in the pose.
        modes: Natural modes of the pose.
        index: Which mode, from zero.

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
    label = f"{modes['frequencies_hz'][index]:.3f} Hz: {modes['mode_names'][index]}"
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
    return _glb_container(
        json.dumps(content, ensure_ascii=False, allow_nan=False).encode(), bytes(buffer.content)
    )


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


def _glb_container(text: bytes, binary: bytes) -> bytes:
    chunks = b"".join(_glb_chunks([(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", binary)]))
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _glb_chunks(chunks: Sequence[tuple[bytes, bytes]]) -> Iterator[bytes]:
    for kind, data in chunks:
        yield struct.pack("<I4s", len(data), kind) + data


def _field_array(name: str, values: AnyArray) -> str:
    # a field has no length of its own: without it readers expect one value
    return _data_array(name, values).replace(
        " format=", f' NumberOfTuples="{len(values)}" format=', 1
    )


def _data_array(name: str, array: AnyArray) -> str:
    kinds = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
    data = np.ascontiguousarray(array).tobytes()
    text = base64.b64encode(struct.pack("<Q", len(data)) + data).decode()
    width = f' NumberOfComponents="{array.shape[1]}"' if array.ndim == 2 else ""
    return f'<DataArray type="{kinds[array.dtype.str[1:]]}" Name={quoteattr(name)}{width} format="binary">{text}</DataArray>'
