"""What two folders of outputs hold, as numbers and texts with places, and where they differ.

``read_tree`` turns every file into leaves: arrays of numbers, and texts. ``differences`` compares
two such trees: numbers within 1e-10 of the largest one of their array (two digits of its type where
that is coarser), texts word by word. Seconds, memory, dates, versions, digests and what else
differs between two runs of the same code is listed once, at the top.
"""

import base64
import csv
import html
import io
import json
import math
import re
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import h5py
import matplotlib.image
import numpy as np
import scipy.io

TOLERANCE = 1e-10
# keys of JSON and HDF5, heads of CSV columns, parts of texts and of reports that time, memory,
# place or version decide
MASKED_KEYS = (
    *(
        "seconds",
        "*cpu_seconds",
        "import_seconds",
        "solve_seconds",
        "seconds_with",
        "seconds_without",
        "time_noise",
        "peak_rss_mb",
        "peak_mb",
    ),
    *(
        "cpu seconds",
        "cpu spread",
        "solving cpu seconds",
        "spread",
        "MB",
        "best",
    ),  # of cost studies
    *("date", "host", "commit", "version", "versions", "provenance", "sha256", "key"),
)
MASKED_COLUMNS = re.compile(
    r"seconds|\bCPU\b|memory|\[MB\]|^(?:(?:load|components|couple|modes|static|frf|total) \[s\]|(?:cpu )?spread|MB|best)$",
    re.IGNORECASE,
)
MASKED_SECTIONS = ("cost", "origin")  # of reports, by id
MASKED_TEXTS = (
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d[\d:.]*(?:Z|[+-]\d\d:?\d\d)?"), "DATE"),
    (re.compile(r"(?<![\w.])(?=\d*[a-f])[0-9a-f]{12,64}(?![\w.+])"), "DIGEST"),
    (re.compile(r"^(?:<[^>]*>)*(?:seconds from scene|processor seconds|peak memory).*"), "SECONDS"),
    (
        re.compile(r"\b(scene|components|coupling|modes|compliances|responses) \d+\.\d\d(?=,|$)"),
        r"\1 COST",
    ),
    (re.compile(r"\b(headstock|Headstock) \d+\.\d+\.\d+\S*"), r"\1 VERSION"),
    (
        re.compile(
            r"(?<![\w.])\d[\d\u202f ]*(?:\.\d+)?[\s\u202f](?:(?:µs|ms|s|min|h)|[kMG]B)(?![\w/])"
        ),
        "COST",
    ),
    (re.compile(r"─+"), "─"),
    (re.compile(r"\s+"), " "),
)
# numbers that may be rounding errors only, and the scale of what they are errors of: shares of a
# whole, Hz, and m/N
SCALES = (
    *(
        (f"*/{name}/*", 1.0)
        for name in (
            "residual",
            "budget",
            "error_share",
            "energy_share",
            "kinetic_share",
            "error_hz",
        )
    ),
    ("*/pushes/*", 1e-9),
)
# what is rounded to fewer digits where it is written; results.h5 has them all
TOLERANCES = (
    *(("*.html: data *", 1e-6), ("*.glb:/accessors/*", 1e-6)),
    # two of 255 steps of a colour: the renderer does not repeat itself to the last one
    *(("*: pixels", 0.01), ("*: picture *", 0.01)),
)
MASKED_LINES = re.compile(r"about COST expected|COST so far")  # of stages that take long

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w])")
LONG_BASE64 = re.compile(r"data:(image/png|text/csv)[^,]{0,40};base64,([A-Za-z0-9+/=]+)")

Numbers = np.ndarray[Any, np.dtype[Any]]
Leaf = Numbers | str


@dataclass(frozen=True)
class Difference:
    """One place where two trees differ.

    Attributes:
        place: File, and the place in it.
        base: What the first tree holds.
        now: What the second one holds.
        share: Largest difference over the scale of the array; infinite for texts and for what is
            missing.
    """

    place: str
    base: str
    now: str
    share: float


def read_tree(folder: Path, names: dict[str, str] | None = None) -> dict[str, Leaf]:
    """Every number and text below a folder, by place.

    Args:
        folder: What to read.
        names: Paths that are written differently in each tree, and what stands for them.
    """
    leaves: dict[str, Leaf] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            place = _masked(str(path.relative_to(folder)))[0]
            reader = READERS.get(path.suffix, _read_any)
            leaves[place] = f"a file {path.suffix}"
            try:
                leaves.update(
                    {f"{place}{inner}": leaf for inner, leaf in reader(path, names or {})}
                )
            except Exception as error:
                raise ValueError(f"{path}: {error}") from error
    return leaves


def differences(base: dict[str, Leaf], now: dict[str, Leaf]) -> list[Difference]:
    """Where two trees differ, the worst first."""
    found = []
    for place in sorted(base.keys() | now.keys()):
        if place not in now:
            found.append(Difference(place, _short(base[place]), "missing", math.inf))
        elif place not in base:
            found.append(Difference(place, "missing", _short(now[place]), math.inf))
        else:
            difference = compare_leaves(place, base[place], now[place])
            found += [] if difference is None else [difference]
    return sorted(found, key=lambda difference: -difference.share)


def compare_leaves(place: str, base: Leaf, now: Leaf) -> Difference | None:
    """The difference of two leaves at one place, None where they agree."""
    if isinstance(base, str) or isinstance(now, str):
        if isinstance(base, str) and isinstance(now, str):
            return _compare_texts(place, base, now)
        return Difference(place, _short(base), _short(now), math.inf)
    if base.shape != now.shape:
        return Difference(place, f"shape {base.shape}", f"shape {now.shape}", math.inf)
    share = _share(place, base, now)
    if share <= _tolerance(place, base, now):
        return None
    where = np.unravel_index(int(np.argmax(_distance(base, now))), base.shape)
    index = "".join(f"[{place}]" for place in where) if base.size > 1 else ""
    return Difference(place + index, repr(base[where].item()), repr(now[where].item()), share)


def _tolerance(place: str, *arrays: Numbers) -> float:
    digits = [2 * float(np.finfo(array.dtype).eps) for array in arrays if array.dtype.kind in "fc"]
    return max(
        [
            TOLERANCE,
            *digits,
            *(share for pattern, share in TOLERANCES if fnmatchcase(place, pattern)),
        ]
    )


def _share(place: str, base: Numbers, now: Numbers) -> float:
    """Largest difference of two arrays of one shape over the largest finite size in the first."""
    if base.size == 0:
        return 0.0
    largest = float(np.max(_distance(base, now)))
    sizes = np.abs(base[np.isfinite(base)]) if base.dtype.kind in "fciu" else np.ones(1)
    floor = max((scale for pattern, scale in SCALES if fnmatchcase(place, pattern)), default=0.0)
    scale = max(float(np.max(sizes, initial=0.0)), floor)
    if largest == 0:
        return 0.0
    return largest / scale if scale > 0 else math.inf


def _distance(base: Numbers, now: Numbers) -> Numbers:
    """Size of each difference, infinite where one is no finite number and the other is not the
    same.
    """
    if base.dtype.kind not in "fc" and now.dtype.kind not in "fc":
        return np.abs(base.astype(np.int64) - now.astype(np.int64)).astype(float)
    with np.errstate(invalid="ignore"):
        distance = np.abs(base.astype(complex) - now.astype(complex))
    same = (base == now) | (np.isnan(base) & np.isnan(now))
    return np.where(same, 0.0, np.where(np.isfinite(distance), distance, math.inf))


def _compare_texts(place: str, base: str, now: str) -> Difference | None:
    """Line by line: words equal, numbers with many digits as numbers, on the scale of the line."""
    first, second = _masked(base), _masked(now)
    if first == second:
        return None
    for number, (old, new) in enumerate(zip(first, second, strict=False), start=1):
        if old != new and not _same_line(place, old, new):
            column = next(
                (i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b),
                min(len(old), len(new)),
            )
            start = max(0, column - 30)
            return Difference(
                f"{place} line {number}", old[start : start + 90], new[start : start + 90], math.inf
            )
    if len(first) != len(second):
        longer = first if len(first) > len(second) else second
        extra = longer[min(len(first), len(second))][:90]
        return Difference(
            place, f"{len(first)} lines", f"{len(second)} lines, beginning with: {extra}", math.inf
        )
    return None


def _same_line(place: str, old: str, new: str) -> bool:
    if NUMBER.split(old) != NUMBER.split(new):
        return False
    base, now = (np.array([float(text) for text in NUMBER.findall(line)]) for line in (old, new))
    return base.shape == now.shape and _share(place, base, now) <= TOLERANCE


def _masked(text: str) -> list[str]:
    lines = []
    for line in text.splitlines():
        masked = line.strip()
        for pattern, name in MASKED_TEXTS:
            masked = pattern.sub(name, masked)
        if masked.strip() and not MASKED_LINES.search(masked):
            lines.append(masked.strip())
    return lines


def _short(leaf: Leaf) -> str:
    return leaf[:60] if isinstance(leaf, str) else f"array {leaf.shape}"


def _is_masked(key: str) -> bool:
    return any(fnmatchcase(key, pattern) for pattern in MASKED_KEYS)


# --- readers: one per kind of file
# ---------------------------------------------------------------------------------------------

Names = dict[str, str]
Leaves = Iterator[tuple[str, Leaf]]


def _with_names(text: str, names: Names) -> str:
    for path, name in names.items():
        text = text.replace(path, name)
    return text


def _read_text(path: Path, names: Names) -> Leaves:
    yield ":", _with_names(path.read_text(errors="replace"), names)


def _read_any(path: Path, names: Names) -> Leaves:
    content = path.read_bytes()
    if b"\0" in content:
        yield ": bytes", np.frombuffer(content, dtype=np.uint8)
    else:
        yield from _read_text(path, names)


def _read_json(path: Path, names: Names) -> Leaves:
    yield from _json_leaves(json.loads(_with_names(path.read_text(), names)), "/")


def _read_json_lines(path: Path, names: Names) -> Leaves:
    for number, line in enumerate(_with_names(path.read_text(), names).splitlines(), start=1):
        yield from _json_leaves(json.loads(line), f": line {number}/")


def _json_leaves(value: object, place: str) -> Leaves:
    """Nested lists of numbers are one array; every other value stands alone."""
    numbers = _flat_numbers(value)
    if numbers is not None:
        yield place, np.array(numbers, dtype=float)
        if isinstance(value, list) and list in map(type, value):
            yield f"{place} shape", _outline(value)
    elif isinstance(value, dict):
        for key, inner in value.items():
            if not _is_masked(key):
                yield from _json_leaves(inner, f"{place}{key}/")
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _json_leaves(inner, f"{place}{index}/")
    else:
        yield place, json.dumps(value, ensure_ascii=False)


def _flat_numbers(value: object) -> list[float] | None:
    """The numbers of a nested list, null as nan; None where it holds something else or no number at
    all.
    """
    if isinstance(value, bool | str | dict) or value is None or value == []:
        return None
    if not isinstance(value, list):
        return [float(str(value))]
    parts = [
        [math.nan] if inner is None else [] if inner == [] else _flat_numbers(inner)
        for inner in value
    ]
    if any(part is None for part in parts) or all(inner is None for inner in value):
        return None
    return [number for part in parts for number in part or []]


def _outline(value: object) -> str:
    """Lengths of nested lists as a text."""
    if not isinstance(value, list):
        return "1"
    return f"{len(value)}" + (
        "(" + " ".join(_outline(inner) for inner in value) + ")" if list in map(type, value) else ""
    )


def _read_csv(path: Path, names: Names) -> Leaves:
    yield from _csv_leaves(_with_names(path.read_text(), names))


def _csv_leaves(text: str) -> Leaves:
    """A column that holds numbers only is one array, empty cells as nan; any other column is one
    text per cell.
    """
    rows = list(csv.reader(io.StringIO(text)))
    if not rows:
        return
    yield " head", ",".join(rows[0])
    width = max(map(len, rows))
    for index in range(width):
        head = rows[0][index] if index < len(rows[0]) else str(index)
        if MASKED_COLUMNS.search(head):
            continue
        cells = [row[index] if index < len(row) else "" for row in rows[1:]]
        try:
            yield (
                f" column {index} {head}",
                np.array([float(cell) if cell else math.nan for cell in cells]),
            )
        except ValueError:
            yield f" column {index} {head}", "\n".join(cell or "-" for cell in cells)


def _read_html(path: Path, names: Names) -> Leaves:
    """Tables in files, pictures and data of the page as what they are, the rest as text; values
    with all their digits.
    """
    page = _with_names(path.read_text(), names)
    for name in MASKED_SECTIONS:
        page = re.sub(rf'<section id="{name}">.*?</section>', "", page, flags=re.DOTALL)
    for number, script in enumerate(
        re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page, flags=re.DOTALL)
    ):
        yield from _json_leaves(json.loads(script), f": data {number}/")
    page = re.sub(r'<script type="application/json".*?</script>', "", page, flags=re.DOTALL)
    for number, (kind, coded) in enumerate(LONG_BASE64.findall(page)):
        content = base64.b64decode(coded)
        if kind == "image/png":
            yield f": picture {number}", _pixels(io.BytesIO(content))
        else:
            yield from (
                (f": table {number}{inner}", leaf) for inner, leaf in _csv_leaves(content.decode())
            )
    page = LONG_BASE64.sub("DATA", page)
    page = re.sub(r'<data[^>]*value="([^"]*)"[^>]*>[^<]*</data>', r"\1", page)
    page = re.sub(r"<small>([^<]*)</small>", r"\1", page)
    yield ": page", html.unescape(page)


def _read_hdf5(path: Path, names: Names) -> Leaves:
    with h5py.File(path) as file:
        items: list[tuple[str, Any]] = [("", file)]
        file.visititems(lambda name, item: items.append((name, item)))
        for name, item in items:
            if any(map(_is_masked, name.split("/"))):
                continue
            for key in item.attrs:
                if not _is_masked(key):
                    yield from _values(f":/{name}@{key}", np.asarray(item.attrs[key]), names)
            if name == "record/text":
                record = _with_names(bytes(item[()]).decode(), names)
                yield from _json_leaves(_fields_by_name(json.loads(record)), f":/{name}/")
            elif isinstance(item, h5py.Dataset):
                yield from _values(f":/{name}", np.asarray(item[()]), names)
            else:
                yield f":/{name}", "group"


def _fields_by_name(value: object) -> object:
    """Return a record whose lists of (field, value) are dictionaries, so that keys mask fields."""
    if isinstance(value, dict):
        return {key: _fields_by_name(inner) for key, inner in value.items()}
    if not isinstance(value, list):
        return value
    if value and all(
        isinstance(pair, list) and len(pair) == 2 and isinstance(pair[0], str) for pair in value
    ):
        return {key: _fields_by_name(inner) for key, inner in value}
    return [_fields_by_name(inner) for inner in value]


def _values(place: str, values: Numbers, names: Names) -> Leaves:
    """An array as it is, its fields one by one, or its texts."""
    if values.dtype.names:
        for name in values.dtype.names:
            yield from _values(f"{place}.{name}", values[name], names)
    elif values.dtype.kind in "biufc":
        yield place, values.astype(np.int8) if values.dtype.kind == "b" else values
    else:
        texts = [_decoded(text) for text in values.ravel().tolist()]
        yield place, _with_names("\n".join(text or "-" for text in texts), names)


def _decoded(text: object) -> str:
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)


def _read_mat(path: Path, names: Names) -> Leaves:
    for key, value in scipy.io.loadmat(path).items():
        if not key.startswith("__"):
            yield from _values(f":/{key}", np.asarray(value), names)


VTK_TYPES = {
    "Float64": "<f8",
    "Float32": "<f4",
    "Int64": "<i8",
    "Int32": "<i4",
    "UInt64": "<u8",
    "UInt8": "<u1",
    "Int8": "<i1",
}


def _read_vtk(path: Path, names: Names) -> Leaves:
    """Data arrays in base64 behind a header of 8 bytes; everything else of the file as text."""
    root = ElementTree.fromstring(path.read_text())
    if root.get("compressor") is not None:
        raise ValueError("compressed arrays are not read here")
    parents = {child: parent for parent in root.iter() for child in parent}
    for number, array in enumerate(root.iter("DataArray")):
        place = f":/{parents[array].tag}/{number} {array.get('Name')}"
        kind = array.get("type", "")
        if array.get("format") == "binary" and kind in VTK_TYPES:
            yield (
                place,
                np.frombuffer(base64.b64decode(array.text or "")[8:], dtype=VTK_TYPES[kind]),
            )
            array.text = ""
    yield ": xml", _with_names(ElementTree.tostring(root, encoding="unicode"), names)


GLB_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
GLB_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def _read_glb(path: Path, names: Names) -> Leaves:
    """The JSON of a binary glTF file, and each accessor's array."""
    content = path.read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    scene = json.loads(content[20 : 20 + length])
    data = content[20 + length + 8 :]
    yield from _json_leaves(scene, ":/")
    for number, accessor in enumerate(scene.get("accessors", [])):
        view = scene["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        count = accessor["count"] * GLB_WIDTHS[accessor["type"]]
        yield (
            f":/accessor {number}",
            np.frombuffer(data, GLB_TYPES[accessor["componentType"]], count, start),
        )


def _read_nothing(path: Path, names: Names) -> Leaves:
    """Journals: what they hold is in the files of the sweep."""
    return iter(())


def _read_png(path: Path, names: Names) -> Leaves:
    yield ": pixels", _pixels(path)


def _pixels(picture: Path | io.BytesIO) -> Numbers:
    return np.asarray(np.round(255 * matplotlib.image.imread(picture)), dtype=np.uint8)


READERS: dict[str, Callable[[Path, Names], Leaves]] = {
    ".json": _read_json,
    ".jsonl": _read_json_lines,
    ".csv": _read_csv,
    ".html": _read_html,
    ".h5": _read_hdf5,
    ".mat": _read_mat,
    ".vtu": _read_vtk,
    ".vtp": _read_vtk,
    ".glb": _read_glb,
    ".png": _read_png,
    ".journal": _read_nothing,
}
