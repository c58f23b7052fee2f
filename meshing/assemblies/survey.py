"""What an assembly file holds: its solids, the parts they are copies of, and the tree of products."""

import dataclasses
import itertools
import json
import math
import re
import unicodedata
from collections import Counter, defaultdict
from collections.abc import Container, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.assemblies.equal_solids import Motion, SolidPoints, group_equal
from headstock.geometry.assemblies.parts import Assembly, Part, PlacedSolid, TreeNode
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import Vector
from headstock.meshing.errors import MeshError, PartFileError
from headstock.meshing.length_units import STEP_UNIT, read_length_unit
from headstock.meshing.process.isolation import WorkerLimits
from headstock.meshing.process.strangers import FileKind, require_size, run_apart
from headstock.meshing.process.worker import Arrays

ASSEMBLY = FileKind("an assembly", 500_000_000, "export a part of it, or simpler parts")
MEASURE = "headstock.meshing.assemblies.solids:measure_solids"
TRY = "headstock.meshing.assemblies.solids:try_surfaces"
MEMORY_BYTES = 8 << 30
SECONDS, SECONDS_PER_MB = 20.0, 4.0  # real files take up to 1.5 s per MB
WALL_FACTOR = 4.0
TRIAL_SECONDS = 20.0  # of processor time, for the surfaces of all parts
LONGEST_NAME = 24
# names that gmsh and its kernel give to what has none
TAKEN_NAMES = {"ground"}
LETTERS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ø": "o", "ß": "ss", "æ": "ae"})
SAME_ROTATION = 1e-4  # of the elements of matrices
NAMELESS = re.compile(r"Open CASCADE STEP translator [\d. ]*|Shapes|")

type Groups = list[list[tuple[int, Motion]]]


def survey_assembly(
    path: Path, *, unit: str | None = None, trial_seconds: float = TRIAL_SECONDS
) -> Assembly:
    """List the solids and parts of a STEP file, and try whether the parts' surfaces can be meshed.

    Args:
        unit: Length unit in words, in place of that the file names.
        trial_seconds: Processor time for the trial [s]; 0 for none.

    Raises:
        MeshError: The file is missing, is no STEP file, is damaged or too large, holds no solid, or a
            product in it contains itself.
    """
    status = require_size(path, ASSEMBLY, PartFileError)
    data = run_apart([MEASURE], path, limits=limit_reading(status.st_size), error=PartFileError)
    rows = _match_rows(data)
    points = _read_points(data, rows)
    groups = group_equal(points)
    remarks = _list_remarks(data, rows, groups, points)
    parts = [
        Part(name, tuple(motion.placement(index + 1) for index, motion in group))
        for name, group in zip(_name_parts(data, rows, groups), groups, strict=True)
    ]
    if trial_seconds > 0.0:
        parts, untried = _try_parts(path, parts, status.st_size, trial_seconds)
        remarks += untried
    return Assembly(
        path,
        unit or read_length_unit(path),
        _place_solids(data, rows),
        tuple(parts),
        _build_tree(data, rows, path.stem),
        tuple(remarks),
    )


def limit_reading(size: int, more: float = 0.0) -> WorkerLimits:
    """Return the limits of reading a STEP file with gmsh.

    Args:
        size: Of the file [bytes].
        more: Processor time for what is done with it [s].
    """
    seconds = SECONDS + SECONDS_PER_MB * size / 1e6 + more
    return WorkerLimits(MEMORY_BYTES, math.ceil(seconds), WALL_FACTOR * seconds)


def _match_rows(data: Arrays) -> list[int]:
    """Return the row of the tree that each solid belongs to, -1 where none does: by gmsh's labels, or
    in order where these are written otherwise and there are as many of both.
    """
    paths: list[str] = []
    rows: dict[str, list[int]] = defaultdict(list)
    below = set(data["parents"].tolist())
    for row, parent in enumerate(data["parents"].tolist()):
        names = (
            [data["labels"][row]] if parent < 0 else [data["labels"][row], data["products"][row]]
        )
        paths.append("/".join([*([paths[parent]] if parent >= 0 else []), *map(str, names)]))
        rows[paths[row]].append(row)
    if all(NAMELESS.fullmatch(str(product)) for product in data["products"]):
        return [-1] * len(data["paths"])
    matched = [_longest_start(str(path).removeprefix("Shapes/"), rows) for path in data["paths"]]
    ends = [row for row in range(len(paths)) if row not in below]
    if None in matched and len(ends) == len(matched):
        return ends
    counts, taken, result = Counter(matched), Counter[str | None](), []
    for start in matched:
        # several occurrences of one name take their solids in turn
        equal = [-1] if start is None else rows[start]
        result.append(equal[taken[start] * len(equal) // counts[start]])
        taken[start] += 1
    return result


def _longest_start(path: str, known: Container[str]) -> str | None:
    while path not in known:
        path, slash, _ = path.rpartition("/")
        if not slash:
            return None
    return path


def _place_solids(data: Arrays, rows: Sequence[int]) -> tuple[PlacedSolid, ...]:
    solids = []
    for i, row in enumerate(rows):
        names, above = [], row
        while above >= 0:
            names.append(str(data["labels"][above]))
            above = int(data["parents"][above])
        colour = _vector(data["colours"][i])
        solids.append(
            PlacedSolid(
                number=i + 1,
                names=tuple(reversed(names)),
                product=str(data["products"][row]) if row >= 0 else "",
                volume=float(data["volumes"][i]) * STEP_UNIT**3,
                area=float(data["areas"][i]) * STEP_UNIT**2,
                center=_vector(data["centers"][i] * STEP_UNIT),
                low=_vector(data["boxes"][i, :3] * STEP_UNIT),
                high=_vector(data["boxes"][i, 3:] * STEP_UNIT),
                colour=None if math.isnan(colour[0]) else colour,
            )
        )
    return tuple(solids)


def _read_points(data: Arrays, rows: Sequence[int]) -> list[SolidPoints]:
    ends = np.cumsum(data["counts"])
    points = []
    for i, row in enumerate(rows):
        mine = slice(ends[i] - data["counts"][i], ends[i])
        dimensions = data["dimensions"][mine]
        points.append(
            SolidPoints(
                float(data["volumes"][i]) * STEP_UNIT**3,
                data["centers"][i] * STEP_UNIT,
                data["points"][mine] * STEP_UNIT,
                dimensions,
                data["sizes"][mine] * STEP_UNIT ** np.maximum(dimensions, 1),
                *(() if row < 0 else (int(data["definitions"][row]), data["rotations"][row])),
            )
        )
    return points


def _list_remarks(
    data: Arrays, rows: Sequence[int], groups: Groups, points: Sequence[SolidPoints]
) -> list[str]:
    """Return remarks where the tree disagrees with the shapes, which count."""
    remarks = []
    if broken := int(data["broken"]):
        remarks.append(f"{broken} occurrences in its tree refer to no product and are left out")
    if max(rows) >= 0 and -1 in rows:
        remarks.append(f"{rows.count(-1)} of {len(rows)} solids belong to no product of its tree")
    names = [f'"{data["products"][row]}"' if row >= 0 else "solids of no product" for row in rows]
    shapes: dict[tuple[str, int], set[int]] = defaultdict(set)
    for number, group in enumerate(groups):
        first = points[group[0][0]]
        equal = dict.fromkeys(names[i] for i, _ in group)
        if len(equal) > 1:
            remarks.append(f"{', '.join(equal)} have one shape and become one part")
        for i, motion in group:
            shapes[names[i], rows[:i].count(rows[i])].add(number)
            turned = points[i].rotation @ first.rotation.T - motion.rotation
            if points[i].product == first.product and np.abs(turned).max() > SAME_ROTATION:
                remarks.append(f"its tree rotates solid {i + 1} otherwise than its shape does")
    remarks += [
        f"{name} is one product, but has {len(numbers)} shapes: as many parts"
        for (name, _), numbers in shapes.items()
        if len(numbers) > 1 and name.startswith('"')
    ]
    return remarks


def _name_parts(data: Arrays, rows: Sequence[int], groups: Groups) -> list[str]:
    """Return a name for each part: of its product or occurrence, else ``part_N``."""
    names: list[str] = []
    for number, group in enumerate(groups, 1):
        row = rows[group[0][0]]
        options = [str(data[key][row]) for key in ("products", "labels")] if row >= 0 else []
        cleaned = [_clean_name(option) for option in options if not NAMELESS.fullmatch(option)]
        name = first = next(filter(None, cleaned), f"part_{number}")
        count = 1
        while name in names or name in TAKEN_NAMES:
            count += 1
            name = f"{first}_{count}"
        names.append(name)
    return names


def _clean_name(text: str) -> str:
    plain = (
        unicodedata.normalize("NFKD", text.translate(LETTERS)).encode("ascii", "ignore").decode()
    )
    name = re.sub(r"\W+", "_", plain).strip("_")[:LONGEST_NAME].rstrip("_")
    return f"part_{name}" if name[:1].isdigit() else name


def _try_parts(
    path: Path, parts: Sequence[Part], size: int, seconds: float
) -> tuple[list[Part], list[str]]:
    """Return the parts with what the trial found against them, and a remark where it ended early."""
    job = {"solids": [part.placements[0].solid for part in parts], "seconds": seconds}
    try:
        faults = run_apart(
            [TRY],
            path,
            limits=limit_reading(size, 2.0 * seconds),
            error=MeshError,
            content=json.dumps(job).encode(),
        )["faults"].tolist()
        ended = f"the trial of surfaces ended after {seconds:g} s"
    except MeshError as error:
        faults, ended = [], str(error)
    tried = [
        dataclasses.replace(part, fault=fault or None)
        for part, fault in itertools.zip_longest(parts, faults)
    ]
    untried = len(parts) - len(faults)
    return tried, [
        f"{ended}: of {untried} parts it is seen in a run whether they can be meshed"
    ] if untried else []


def _build_tree(data: Arrays, rows: Sequence[int], file: str) -> TreeNode:
    """Return the tree of those occurrences that have solids."""
    children: dict[int, list[TreeNode]] = defaultdict(list)
    solids: dict[int, list[int]] = defaultdict(list)
    for number, row in enumerate(rows, 1):
        solids[row].append(number)
    for row in reversed(range(len(data["parents"]))):
        numbers, below = tuple(solids[row]), tuple(reversed(children[row]))
        if numbers or below:
            label, product = str(data["labels"][row]), str(data["products"][row])
            node = TreeNode(label, product, numbers, below)
            children[int(data["parents"][row])].append(node)
    roots = tuple(reversed(children[-1]))
    if len(roots) == 1 and not solids[-1]:
        return roots[0]
    return TreeNode(file, "", tuple(solids[-1]), roots)


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
