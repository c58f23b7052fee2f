"""What every mesh file is turned into: cells of one kind in gmsh's node order, without unused
points.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import FACETS, NODE_COUNTS
from headstock.meshing.errors import MeshError, PartFileError
from headstock.meshing.files.raw_mesh import RawMesh, Section
from headstock.meshing.files.solid_cells import (
    SolidCells,
    cut_facets,
    cut_to_tets,
    fill_middles,
    gather_cells,
)
from headstock.meshing.files.topology_checks import (
    check_one_solid,
    drop_repeated_cells,
    list_cell_faces,
    turn_cells,
)
from headstock.meshing.process.job import MeshData, pack_data, parse_job
from headstock.meshing.process.worker import Arrays

WHOLE_FILE = "*"
# facets that a chosen part shares with the rest of its file
CUT_SET = "cut"
NAMED = 6


def read_file(reader: Callable[..., RawMesh], text: bytes) -> Arrays:
    """Read the mesh file of a job with a reader that may raise anything.

    Args:
        reader: Takes the path of the file, then those of the files that it may read besides.

    Returns:
        Points in the file's unit, cells of one kind in gmsh's node order, and named surface and
        node sets.

    Raises:
        PartFileError: The file cannot be read, or holds no usable mesh.
        MeshError: The file is missing.
    """
    solid = parse_job(text.decode()).solid
    if not isinstance(solid, MeshFile):
        raise MeshError(f"a {type(solid).__name__} is no mesh file")
    path = solid.path
    if not path.is_file():
        raise MeshError(f"there is no file {path}")
    try:
        return pack_data(_assemble_mesh(path, reader(path, *solid.beside), solid.solid))
    except MeshError as error:
        message = str(error)
        raise PartFileError(
            message if path.name in message else f"{path.name}: {message}"
        ) from error
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # foreign readers raise anything, gmsh the bare class
        raise PartFileError(
            f"{path.name} cannot be read: {type(error).__name__}: {error}; it is damaged or of another kind: export it again"
        ) from error


def _assemble_mesh(path: Path, raw: RawMesh, solid: str | None = None) -> MeshData:
    """Make one solid of what a file holds.

    Args:
        solid: Name of the set of cells to take; None for all of one material, ``*`` for all of whatever
            material.

    Raises:
        MeshError: The cells are no solid, or of several materials.
    """
    _check_numbers(path, raw)
    numbers = np.concatenate([block.numbers for block in raw.solids])
    chosen = _choose_solid(path, raw, solid)
    remarks = [*raw.notes, *_note_left_out(path, raw)]
    if solid is None:
        remarks += _check_materials(path, raw)
    gathered = gather_cells(path, raw.points, raw.solids)
    every = [cells for cells in (one.within(chosen) for one in gathered) if len(cells.index)]
    every, notes = drop_repeated_cells(path, every, numbers, _material_numbers(raw))
    remarks += notes
    every, notes = turn_cells(raw.points, every)
    remarks += notes
    names = [name for name in raw.groups if solid is None or name != solid]
    check_one_solid(path, raw.points, every, numbers, names)
    points, cells, kind, notes = _make_one_kind(path, raw.points, every, numbers)
    remarks += notes
    facets = _assemble_facets(raw, kind, cut=bool(notes))
    if not chosen.all():
        rest = [cells for cells in (one.within(~chosen) for one in gathered) if len(cells.index)]
        facets |= _find_cut(every, rest, kind, cut=bool(notes))
    nodes = {
        name: np.unique(np.concatenate(members)).astype(np.int64)
        for name, members in raw.node_sets.items()
        if name not in facets
    }
    data = MeshData(points, cells, kind, facets, nodes, remarks=remarks)
    return _drop_unused_points(data, whole=bool(chosen.all()))


def _check_numbers(path: Path, raw: RawMesh) -> None:
    """Refuse files without cells, and numbers that are none."""
    if not raw.cell_count:
        only = _counted(raw.left_out)
        raise MeshError(
            f"{path.name} holds no solid cells{f', only {only}' if only else ''}; write a mesh of tets, hexes, "
            "wedges or pyramids"
        )
    if not np.isfinite(raw.points).all():
        raise MeshError(f"{path.name}: coordinates that are not finite numbers")
    named = {**raw.facets, **raw.node_sets}
    for what, blocks in {"cells": [block.nodes for block in raw.solids], **named}.items():
        for nodes in blocks:
            if nodes.size and not -1 <= nodes.min() <= nodes.max() < len(raw.points):
                raise MeshError(
                    f"{path.name}: {what} use nodes that are not among the {len(raw.points)} of the file; "
                    "it is damaged, export it again"
                )


def _counted(kinds: dict[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in kinds.items())


def _note_left_out(path: Path, raw: RawMesh) -> list[str]:
    if not raw.left_out:
        return []
    return [
        f"{path.name}: left out what is no solid cell, with its stiffness and mass: {_counted(raw.left_out)}; "
        f"taken are {raw.cell_count} solid cells"
    ]


def _choose_solid(path: Path, raw: RawMesh, solid: str | None) -> NDArray[np.bool_]:
    """Return which cells of the file to take, ``(n_cells,)``."""
    if solid is None or solid == WHOLE_FILE:
        return np.ones(raw.cell_count, dtype=bool)
    names = {name.upper(): name for name in reversed(raw.groups)}
    name = solid if solid in raw.groups else names.get(solid.upper())
    if name is None:
        shown = ", ".join(list(raw.groups)[: 4 * NAMED]) or "none"
        raise MeshError(
            f"{path.name} has no set of solid cells called {solid!r}; available: {shown}"
        )
    chosen = np.zeros(raw.cell_count, dtype=bool)
    chosen[np.concatenate(raw.groups[name])] = True
    return chosen


def _material_numbers(raw: RawMesh) -> IntArray:
    """Return the number of the material of each cell, -1 where the file names none."""
    keys = {
        key: number for number, key in enumerate(dict.fromkeys(one.key for one in raw.sections))
    }
    materials = np.full(raw.cell_count, -1, dtype=np.int64)
    for one in raw.sections:
        if one.key is not None:
            materials[one.cells] = keys[one.key]
    return materials


def _check_materials(path: Path, raw: RawMesh) -> list[str]:
    """Refuse several materials; remark on sets of cells that may be of several."""
    with_material = [one for one in raw.sections if one.key is not None]
    remedy = (
        'a component has one material: write solid = { mesh = "...", solid = "NAME" } for a component of each, or '
        f'solid = "{WHOLE_FILE}" to take them all as one'
    )
    if len({one.key for one in with_material}) > 1:
        raise MeshError(
            f"{path.name} holds cells of {len({one.key for one in with_material})} materials: {_list_sections(with_material)}; {remedy}"
        )
    untold = [one for one in raw.sections if one.key is None]
    parts = [one for one in untold if len(np.unique(one.cells)) < raw.cell_count]
    if not parts:
        return []
    return [
        f"{path.name} does not say whether its sets of cells are of one material, and they are taken as one: "
        f"{_list_sections(parts)}; {remedy} without this line"
    ]


def _list_sections(sections: Sequence[Section]) -> str:
    shown = [
        f"{one.name} ({', '.join(word for word in (one.material, f'{len(one.cells)} cells') if word)})"
        for one in sections[:NAMED]
    ]
    return ", ".join(shown) + (", ..." if len(sections) > NAMED else "")


def _make_one_kind(
    path: Path, points: FloatArray, every: Sequence[SolidCells], numbers: IntArray
) -> tuple[FloatArray, IntArray, CellKind, list[str]]:
    """Return the points, cells of one kind and what was done to make them one."""
    families = [cells.family for cells in every]
    cells = every[0]
    collapsed = any((np.diff(np.sort(one.corners, axis=1), axis=1) == 0).any() for one in every)
    if len(every) == 1 and not collapsed:
        if cells.family == "hex" and (cells.nodes >= 0).all():
            fill_middles(path, points, every, numbers)
            return points, cells.nodes, "hex27", []
        if not (cells.middles >= 0).any() and cells.family in ("tet", "hex"):
            return points, cells.corners, "tet4" if cells.family == "tet" else "hex8", []
    points, filled = fill_middles(path, points, every, numbers)
    if not collapsed and families == ["tet"]:
        return points, filled[0].nodes, "tet10", []
    if not collapsed and families == ["hex"]:
        return points, filled[0].nodes[:, : NODE_COUNTS["hex20"]], "hex20", []
    points, tets, _ = cut_to_tets(points, filled)
    counts = _counted({_name_family(one): len(one.index) for one in every})
    note = f"{counts} cut into {len(tets)} second-order tets of the same shape"
    return points, tets, "tet10", [note]


def _name_family(cells: SolidCells) -> str:
    plural = "es" if cells.family == "hex" else "s"
    return cells.family + plural * (len(cells.index) > 1)


def _assemble_facets(raw: RawMesh, kind: CellKind, *, cut: bool) -> dict[str, IntArray]:
    """Return the corners of the facets of each named surface set, of the number that faces of the
    cells have.
    """
    wanted = len(FACETS["tet" if kind.startswith("tet") else "hex"][0])
    facets = {}
    for name, blocks in raw.facets.items():
        facets_of = [
            cut_facets(block) if cut and block.shape[1] == 4 else block for block in blocks
        ]
        fitting = [block for block in facets_of if block.shape[1] == wanted] or facets_of[:1]
        facets[name] = np.concatenate(fitting).astype(np.int64)
    return facets


def _find_cut(
    every: Sequence[SolidCells], rest: Sequence[SolidCells], kind: CellKind, *, cut: bool
) -> dict[str, IntArray]:
    """Find facets between cells of a part and other cells of the file, as a named set."""
    wanted = len(FACETS["tet" if kind.startswith("tet") else "hex"][0])
    rims = []
    for faces in (list_cell_faces(every), list_cell_faces(rest)):
        order, starts, lengths = faces.runs()
        rims.append(np.hstack([faces.nodes, faces.keys])[order[starts[lengths == 1]]])
    both = np.concatenate(rims)
    _, first, counts = np.unique(both[:, 4:], axis=0, return_index=True, return_counts=True)
    shared = both[np.sort(first[counts == 2]), :4]
    quads = shared[:, 3] >= 0
    blocks = [shared[~quads, :3], shared[quads]]
    if cut:
        blocks[1] = cut_facets(blocks[1])
    fitting = [block for block in blocks if block.shape[1] == wanted and len(block)]
    return {CUT_SET: np.concatenate(fitting)} if fitting else {}


def _drop_unused_points(data: MeshData, *, whole: bool) -> MeshData:
    """Return the mesh without points that no cell has; what is ``whole`` keeps facets with such
    points, of which patches say that they are none.
    """
    used = np.unique(data.cells)
    row_of = np.full(len(data.points), -1, dtype=np.int64)
    row_of[used] = np.arange(len(used))
    nodes = {name: row_of[members[members >= 0]] for name, members in data.node_sets.items()}
    facets = {
        name: np.where(rows < 0, -1, row_of[rows])[(row_of[rows] >= 0).all(axis=1) | whole]
        for name, rows in data.facets.items()
    }
    return MeshData(
        data.points[used],
        row_of[data.cells],
        data.kind,
        {name: rows for name, rows in facets.items() if len(rows)},
        {name: members[members >= 0] for name, members in nodes.items() if (members >= 0).any()},
        remarks=data.remarks,
    )
