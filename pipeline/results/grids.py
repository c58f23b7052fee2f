"""Meshes with named arrays, as ParaView reads them: what the arrays are called, ``.vtu`` files, and
``.pvd`` files that collect the poses.

A name says motion, quantity and unit, ``mode 01 shape [m/sqrt(kg)]``, and nothing that changes from
run to run, so that a ParaView state fits the next one.
"""

import base64
import html
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.probes import per_input
from headstock.pipeline.results.views import MachineView
from headstock.scene.scene import LOAD
from headstock.solvers.second_order import Channel, name_channel

AnyArray = NDArray[Any]
Quantity = Literal["shape", "strain energy density", "stress", "von Mises stress"]
Part = Literal["", " Re", " Im"]  # of complex amplitudes
# units of a mode, whose modal mass is one, and of a response to a unit force
UNITS: dict[Quantity, tuple[str, str]] = {
    "shape": ("m/sqrt(kg)", "m/N"),
    "strain energy density": ("J/(kg m^3)", "J/(m^3 N^2)"),
    "stress": ("Pa/sqrt(kg)", "Pa/N"),
    "von Mises stress": ("Pa/sqrt(kg)", "Pa/N"),
}
# units of a response per unit of a force and of a moment, and under a whole load of the scene
COMPONENT, VOLUME = "component", "volume [m^3]"
FREQUENCIES, DAMPING = "frequencies [Hz]", "damping ratios [1]"
POSES_FILE = "poses.pvd"
VTK_TRIANGLE = 5
# loaded only where somebody asks for a mesh: it needs pyvista
MESH_MODULE = "headstock.pipeline.results.meshes"


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


def mode_array(index: int, quantity: Quantity = "shape") -> str:
    """Name of an array of a mode, whatever its frequency."""
    return f"mode {index + 1:02d} {quantity} [{UNITS[quantity][0]}]"


def push_array(push: str, quantity: Quantity = "shape") -> str:
    """Name of an array of the response to a unit force, ``POINT DIRECTION``."""
    return f"static {push} {quantity} [{UNITS[quantity][1]}]"


def harmonic_array(given: Channel, hz: float, quantity: Quantity, part: Part = "") -> str:
    """Name of an array of the response to a harmonic input; of stresses and displacements the part
    in phase with it and the one a quarter of a cycle before it.
    """
    unit = per_input("m" if quantity == "shape" else "Pa", given)
    name = given[0] if given[1] == LOAD else name_channel(given)
    return f"frf {name} at {hz:g} Hz {quantity}{part} [{unit}]"


def mode_numbers(
    frequencies_hz: FloatArray, damping_ratio: Sequence[float | None]
) -> dict[str, AnyArray]:
    """Frequencies [Hz] and damping ratios of the modes of a pose as arrays, NaN where there is no
    ratio; no ratios where nothing is damped.
    """
    found = {FREQUENCIES: frequencies_hz}
    if any(ratio is not None for ratio in damping_ratio):
        found[DAMPING] = np.array([math.nan if ratio is None else ratio for ratio in damping_ratio])
    return found if len(frequencies_hz) else {}


def surface_grid(
    view: MachineView, pose: str, component: str, numbers: Mapping[str, AnyArray], below: int = 0
) -> Grid:
    """Surface of a component in a pose [m] with its displacements.

    Args:
        view: Surface of each component in its own frame [m], and how it moves in each pose.
        numbers: Of the modes of the pose, as ``mode_numbers`` makes them; empty without modes.
        below: How many modes lie below the first of them.
    """
    seen, skin = view.poses[pose], view.skins[component]
    frame = seen.placements[component]
    shifts = {
        mode_array(below + index): seen.shifts[component][index]
        for index in range(len(numbers.get(FREQUENCIES, ())))
    } | {push_array(push): parts[component] for push, parts in seen.pushes.items()}
    body = np.full(len(skin.points), list(view.skins).index(component), dtype=np.int32)
    return Grid(
        skin.points @ frame.rotation.T + frame.origin,
        (CellBlock(VTK_TRIANGLE, skin.triangles),),
        {COMPONENT: body} | {name: shift.astype(np.float32) for name, shift in shifts.items()},
        {},
        dict(numbers),
    )


def merge_grids(grids: Sequence[Grid]) -> Grid:
    """Grids with the same arrays as one; field data of the first."""
    starts = np.cumsum([0, *(len(grid.points) for grid in grids)])
    first = grids[0]
    return Grid(
        np.vstack([grid.points for grid in grids]),
        tuple(
            CellBlock(block.kind, block.cells + start)
            for grid, start in zip(grids, starts, strict=False)
            for block in grid.blocks
        ),
        {name: np.concatenate([g.point_data[name] for g in grids]) for name in first.point_data},
        {name: np.concatenate([g.cell_data[name] for g in grids]) for name in first.cell_data},
        first.field_data,
    )


def pose_numbers(modal: Sequence[PoseModes], pose: str) -> dict[str, AnyArray]:
    """Numbers of the modes of a pose; empty where it has none."""
    found = next((modes for modes in modal if modes.pose.name == pose), None)
    return {} if found is None else mode_numbers(found.frequencies_hz, found.damping_ratio)


def encode_collection(files: Sequence[str]) -> bytes:
    """Files next to it as steps of time 0, 1 and so on: ParaView's slider goes through them."""
    sets = [
        f'<DataSet timestep="{step}" part="0" file="{html.escape(name)}"/>'
        for step, name in enumerate(files)
    ]
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
            "<Collection>",
            *sets,
            "</Collection>",
            "</VTKFile>\n",
        ]
    ).encode()


def encode_grid(grid: Grid) -> bytes:
    """A grid as ``.vtu``.

    It is written here: importing VTK's writer takes 0.16 to 0.24 s and meshio's 0.15 to 0.20 s of
    the second that a repeated run takes, and meshio's leaves out field data.

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
    return f'<DataArray type="{kinds[array.dtype.str[1:]]}" Name="{html.escape(name)}"{width} format="binary">{text}</DataArray>'
