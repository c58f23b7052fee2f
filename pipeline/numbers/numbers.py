"""``Number``: a number of a run with its key, unit and ±; and ``Series``: numbers along axes.

Tables of them can be read without importing an answer or a solver.
"""

import fnmatch
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.errors import NumberNameError
from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.kinds import KINDS, WHOLE_ROLES, Kind
from headstock.pipeline.storage.frames import Frame, frame_columns

# heads of tables and keys of JSON files
BOUND, KNOWN, BY_SOURCE, LEFT_OUT = "±", "± known", "± by source", "not in ±"
MOST_NAMES = 20  # number of names that a message lists
_KEY = re.compile(r"(?P<kind>[a-z_]+)\((?P<at>.*)\)")
_PAIR = re.compile(r'(?P<role>[a-z]+)=(?P<value>"(?:[^"\\]|\\.)*"|[^,"]*)(?:,|$)')
_PLAIN = re.compile(r'[^,"()=]+')


@dataclass(frozen=True)
class Key:
    """Identify a number, the same way in every run of a scene:
    ``frequency(pose=reference,mode=3)``.

    Attributes:
        kind: A word of :data:`KINDS`.
        at: Role and value, in the order of the kind's roles.
    """

    kind: str
    at: tuple[tuple[str, str | int], ...]

    def __str__(self) -> str:
        return f"{self.kind}({','.join(f'{role}={_quote(value)}' for role, value in self.at)})"

    def __getitem__(self, role: str) -> str | int:
        return dict(self.at)[role]

    def get(self, role: str) -> str | int | None:
        """Return the value of a role; None where the key does not name it."""
        return dict(self.at).get(role)

    @property
    def group(self) -> Kind:
        """Kind of the number."""
        return KINDS[self.kind]

    @property
    def vector(self) -> "Key":
        """Key of the vector that the number is a component of; else the key itself."""
        across = self.group.across
        return Key(self.kind, tuple(item for item in self.at if item[0] not in across))

    def describe_place(self) -> str:
        """Return the values of its roles: ``face 1, mean``, ``tcp, x``."""
        texts = [
            f"{role} {value}" if role in WHOLE_ROLES else str(value) for role, value in self.at
        ]
        return ", ".join(texts)

    def describe(self, *, several_poses: bool = False) -> str:
        """Return the key in plain words: ``frequency 3``, ``x compliance at tcp``."""
        at = dict(self.at)
        pose = f" in pose {at.pop('pose', '')}" if several_poses and "pose" in at else ""
        at.pop("pose", None)
        words = self.group.words
        if words:
            return words.format(**at) + pose
        return f"{self.group.label} ({', '.join(map(str, at.values()))}){pose}"


def make_key(kind: str, **at: str | int) -> Key:
    """Return a key with its roles in order.

    Raises:
        KeyError: The kind is unknown, or has no such role.
    """
    if kind not in KINDS:
        raise KeyError(f"{kind} is no kind of number; add it to pipeline/numbers/kinds.py")
    roles = KINDS[kind].roles
    if missing := at.keys() - set(roles):
        raise KeyError(f"{kind} has no {', '.join(sorted(missing))}")
    return Key(kind, tuple((role, at[role]) for role in roles if role in at))


def parse_key(text: str) -> Key:
    """Return the key that a text spells.

    Raises:
        NumberNameError: The text is not a key.
    """
    match = _KEY.fullmatch(text)
    at: dict[str, str | int] = {}
    if match and match["kind"] in KINDS:
        rest = match["at"]
        while pair := _PAIR.match(rest):
            value = json.loads(pair["value"]) if pair["value"][:1] == '"' else pair["value"]
            at[pair["role"]] = int(value) if pair["role"] in WHOLE_ROLES else value
            rest = rest[pair.end() :]
        if not rest and not at.keys() - set(KINDS[match["kind"]].roles):
            return make_key(match["kind"], **at)
    raise NumberNameError(
        f"{text[:80]!r} is no name of a number; write one such as frequency(pose=reference,mode=1)"
    )


@dataclass(frozen=True, eq=False)
class Number:
    """Store a number of a run.

    Attributes:
        value: In SI; NaN where it is undetermined.
        unit: SI unit; ``1`` without one.
        error: ±; None where nothing was estimated.
    """

    key: Key
    value: float
    unit: str
    error: Estimate | None = None

    def describe(self, *, several_poses: bool = False) -> str:
        """Return the key in plain words, of a frequency with its value."""
        words = self.key.describe()
        if self.key.kind == "frequency":
            words += f" ({self.value:.4g} Hz)"
        return words + (f" in pose {self.key.get('pose')}" if several_poses else "")

    @property
    def shown(self) -> tuple[str, float]:
        """Unit on screen, and the factor to it."""
        return self.key.group.show_unit(self.unit)

    def summarise(self) -> dict[str, object]:
        """Return name, value, unit and ± as in JSON files, in SI."""
        error = self.error or Estimate()
        return {
            "name": str(self.key),
            "value": self.value if np.isfinite(self.value) else None,
            "unit": self.unit,
            BOUND: error.total,
            KNOWN: error.known,
            BY_SOURCE: dict(error.shares),
            LEFT_OUT: list(error.left_out),
        }


@dataclass(frozen=True, eq=False)
class Series:
    """Store numbers along axes: response lines, grids, limits over speeds, curves over time.

    Attributes:
        axes: Name with unit, such as ``frequency [Hz]``, to positions ``(n,)``, in the order of the
            values' axes.
        values: ``(n0, n1, ...)`` in SI; NaN where undetermined.
        errors: Source of error to ± of every value; NaN where there is no bound.
    """

    key: str
    axes: Mapping[str, FloatArray]
    values: NDArray[Any]
    unit: str
    errors: Mapping[str, FloatArray] = field(default_factory=dict)


# columns of a table: whole numbers are codes of texts, or rows where those of a number begin
_COLUMNS: Mapping[str, type[Any]] = {
    "name": np.int32,
    "value": np.float64,
    "unit": np.int32,
    "estimated": np.bool_,
    "share_begin": np.int64,
    "share_source": np.int32,
    "share_size": np.float64,
    "part_begin": np.int64,
    "part_source": np.int32,
    "part_owner": np.int32,
    "part_size": np.float64,
    "left_out_begin": np.int64,
    "left_out": np.int32,
}


# column of first rows to the columns that it indexes, which have a row per share, part or text
_BEGINS: Mapping[str, tuple[str, ...]] = {
    "share_begin": ("share_source", "share_size"),
    "part_begin": ("part_source", "part_owner", "part_size"),
    "left_out_begin": ("left_out",),
}
_CODED = ("name", "unit", "share_source", "part_source", "part_owner", "left_out")


class Numbers(Mapping[Key, Number]):
    """Store numbers of a run by key, in columns; a ``Number`` is created when it is asked for."""

    def __init__(self, columns: Mapping[str, NDArray[Any]], texts: Sequence[str]) -> None:
        self._columns, self._texts = columns, tuple(texts)

    @classmethod
    def collect(cls, numbers: Iterable[Number]) -> "Numbers":
        """Return a table of numbers; of equal keys the last one is kept."""
        rows = {number.key: number for number in numbers}
        codes: dict[str, int] = {}
        columns: dict[str, list[Any]] = {name: [] for name in _COLUMNS}

        def code(text: str) -> int:
            return codes.setdefault(text, len(codes))

        for key, number in rows.items():
            error = number.error or Estimate()
            columns["name"].append(code(str(key)))
            columns["value"].append(number.value)
            columns["unit"].append(code(number.unit))
            columns["estimated"].append(number.error is not None)
            for begin, others in _BEGINS.items():
                columns[begin].append(len(columns[others[0]]))
            for source, size in error.shares.items():
                columns["share_source"].append(code(source))
                columns["share_size"].append(np.nan if size is None else size)
            for source, parts in error.parts.items():
                for owner, size in parts.items():
                    columns["part_source"].append(code(source))
                    columns["part_owner"].append(code(owner))
                    columns["part_size"].append(size)
            columns["left_out"] += map(code, error.left_out)
        return cls(
            {name: np.array(values, _COLUMNS[name]) for name, values in columns.items()},
            tuple(codes),
        )

    @classmethod
    def empty(cls) -> "Numbers":
        """Return a table without numbers."""
        return cls.collect(())

    @cached_property
    def _rows(self) -> dict[str, int]:
        return {self._texts[code]: row for row, code in enumerate(self._columns["name"])}

    def __getitem__(self, key: Key | str) -> Number:
        if (row := self._rows.get(str(key))) is None:
            raise NumberNameError(_list_alternatives(str(key), self._rows))
        estimated = bool(self._columns["estimated"][row])
        return Number(
            parse_key(str(key)),
            float(self._columns["value"][row]),
            self._texts[self._columns["unit"][row]],
            self._estimate(row) if estimated else None,
        )

    def __iter__(self) -> Iterator[Key]:
        return map(parse_key, self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return "\n".join(map(str, self.values()))

    def select(self, pattern: str) -> "Numbers":
        """Return the numbers whose names fit a pattern: a name, a kind, or a name with ``*`` and ``?``.

        Raises:
            NumberNameError: No name fits; the message lists names that exist.
        """
        whole = pattern if "(" in pattern else f"{pattern}(*)"
        expression = re.compile(fnmatch.translate(whole.replace("[", "[[]")))
        names = [name for name in self._rows if expression.match(name)]
        if not names:
            raise NumberNameError(_list_alternatives(pattern, self._rows))
        return Numbers.collect(self[name] for name in names)

    def to_pandas(self) -> Frame:
        """Return a data frame with name, kind and a column per role, then value [SI], unit, ±, its
        known part and what it leaves out.

        Raises:
            HeadstockError: pandas is missing.
        """
        return frame_columns(self.tabulate())

    def tabulate(self) -> dict[str, list[object]]:
        """Return heading to column: name, kind, roles, value [SI], unit, ±, its known part, what it
        leaves out.
        """
        numbers = list(self.values())
        roles = dict.fromkeys(role for number in numbers for role, _ in number.key.at)
        errors = [number.error or Estimate() for number in numbers]
        return {
            "name": [str(number.key) for number in numbers],
            "kind": [number.key.kind for number in numbers],
            **{role: [number.key.get(role) for number in numbers] for role in roles},
            "value": [number.value for number in numbers],
            "unit": [number.unit for number in numbers],
            BOUND: [error.total for error in errors],
            KNOWN: [error.known for error in errors],
            LEFT_OUT: ["; ".join(error.left_out) for error in errors],
        }

    def write(self, group: "h5py.Group") -> None:
        """Write the table into a group of a file."""
        for name, values in self._columns.items():
            group.create_dataset(name, data=values, compression="gzip" if len(values) else None)
        group["texts"] = np.frombuffer(json.dumps(self._texts).encode(), dtype=np.uint8)

    @classmethod
    def read(cls, group: "h5py.Group") -> "Numbers":
        """Return the table that a group holds.

        Raises:
            KeyError: A column is missing.
            ValueError: A column is not what ``write`` has written.
        """
        texts = json.loads(group["texts"][()].tobytes())
        return cls._build({name: np.asarray(group[name][()]) for name in _COLUMNS}, texts)

    def encode(self) -> dict[str, list[object]]:
        """Return the columns as lists for JSON, None where a value is not finite, and the texts
        that their codes refer to.
        """
        columns = {
            name: [value if np.isfinite(value) else None for value in values.tolist()]
            for name, values in self._columns.items()
        }
        return {**columns, "texts": list(self._texts)}

    @classmethod
    def decode(cls, columns: Mapping[str, Any]) -> "Numbers":
        """Return the table from columns that ``encode`` returned.

        Raises:
            KeyError: A column is missing.
            ValueError: A column is not what ``encode`` has written.
        """
        return cls._build(
            {name: np.array(columns[name], kind) for name, kind in _COLUMNS.items()},
            columns["texts"],
        )

    @classmethod
    def _build(cls, columns: Mapping[str, NDArray[Any]], texts: Any) -> "Numbers":
        _check_columns(columns, texts)
        return cls(columns, texts)

    def _estimate(self, row: int) -> Estimate:
        columns, texts = self._columns, self._texts
        shares, parts, left_out = (self._rows_of(row, begin) for begin in _BEGINS)
        owners: dict[str, dict[str, float]] = {}
        for part in range(*parts):
            sizes = owners.setdefault(texts[columns["part_source"][part]], {})
            sizes[texts[columns["part_owner"][part]]] = float(columns["part_size"][part])
        return Estimate(
            {
                texts[columns["share_source"][share]]: None
                if np.isnan(size := columns["share_size"][share])
                else float(size)
                for share in range(*shares)
            },
            tuple(texts[code] for code in columns["left_out"][slice(*left_out)]),
            owners,
        )

    def _rows_of(self, row: int, begin: str) -> tuple[int, int]:
        """Return the first rows of a number and of the next one in other columns."""
        begins = self._columns[begin]
        whole = len(self._columns[_BEGINS[begin][0]])
        return int(begins[row]), whole if row + 1 == len(begins) else int(begins[row + 1])


def _check_columns(columns: Mapping[str, NDArray[Any]], texts: object) -> None:
    """Refuse a table whose columns or codes are invalid.

    Raises:
        ValueError: They are invalid.
    """
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise ValueError("texts of numbers are no list of texts")
    for name, kind in _COLUMNS.items():
        if columns[name].ndim != 1 or columns[name].dtype.kind != np.dtype(kind).kind:
            raise ValueError(f"numbers/{name} is no column of {np.dtype(kind)}")
    for name in _CODED:
        codes = columns[name]
        if len(codes) and not 0 <= codes.min() <= codes.max() < len(texts):
            raise ValueError(f"numbers/{name} names a text that is not there")
    _check_rows(columns)
    for code in columns["name"]:
        parse_key(texts[code])


def _check_rows(columns: Mapping[str, NDArray[Any]]) -> None:
    """Refuse columns that do not belong together.

    Raises:
        ValueError: They do not.
    """
    for begin, others in _BEGINS.items():
        ends = np.append(columns[begin], len(columns[others[0]]))
        if (np.diff(ends) < 0).any() or ends[0] != 0:
            raise ValueError(f"numbers/{begin} does not rise from zero")
        if len({len(columns[name]) for name in others}) > 1:
            raise ValueError(f"numbers/{others[0]} and numbers/{others[-1]} differ in length")
    inside = {name for others in _BEGINS.values() for name in others}
    if len({len(columns[name]) for name in _COLUMNS.keys() - inside}) > 1:
        raise ValueError("columns of numbers differ in length")


def _list_alternatives(name: str, names: Iterable[str]) -> str:
    """Return a message that no number has a name, with alternatives: those of its kind, or the
    first of every kind.
    """
    kinds: dict[str, list[str]] = {}
    for each in names:
        kinds.setdefault(each.partition("(")[0], []).append(each)
    kind = name.partition("(")[0]
    shown = kinds.get(kind, [])[:MOST_NAMES]
    if not shown:
        shown = [
            alike[0] + (f" and {len(alike) - 1} more" if len(alike) > 1 else "")
            for alike in kinds.values()
        ]
    elif len(kinds[kind]) > MOST_NAMES:
        shown.append(f"and {len(kinds[kind]) - MOST_NAMES} more")
    return f"no number is called {name[:80]!r}; there are: {', '.join(shown) or 'none'}"


def _quote(value: str | int) -> str:
    text = str(value)
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)
