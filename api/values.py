"""Values of Python as a scene has them: SI floats as texts with a unit, numpy arrays as lists,
nouns as tables; and tables that cannot be changed, which a noun shows of itself.
"""

import math
import types
from collections.abc import Iterable, Mapping
from datetime import date, time
from pathlib import Path
from typing import (
    Annotated,
    Any,
    NoReturn,
    Protocol,
    Union,
    get_args,
    get_origin,
    runtime_checkable,
)

import numpy as np
from pydantic import BaseModel

from headstock.scene.building.joints import KINDS
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.keys import write_number
from headstock.scene.reading.units import (
    ANGLE,
    LENGTH,
    Dimension,
    parse_quantity,
    unit_of,
)
from headstock.scene.schema.types import QuantityOf

# what a user may hand over: a quantity is a text with a unit or a number in SI units
type Quantity = str | float | np.floating[Any]
ROTATIONAL = {key for rule in KINDS.values() for key, dofs in rule.keys.items() if dofs[0] >= 3}

DIGITS = range(12, 18)  # of a text: as few as are exactly the number


@runtime_checkable
class _Tabled(Protocol):
    """What stands for a table of a scene."""

    @property
    def table(self) -> TomlTable:
        """The table."""


def write_table(model: type[BaseModel], keys: Mapping[str, object]) -> TomlTable:
    """Keys of a table of the scene as TOML has them; None is left out."""
    return {
        key: _write(_field_of(model, key), value, (key,))
        for key, value in keys.items()
        if value is not None
    }


def write_at(model: type[BaseModel], key: KeyPath, value: object) -> TomlValue:
    """Return the value of one key of a scene as TOML has it.

    Args:
        value: Any that is accepted there; numbers are in SI units.
    """
    hint: object = model
    for part in key:
        hint = _below(hint, part)
    return _write(hint, value, key)


def _write(hint: object, value: object, key: KeyPath) -> TomlValue:
    if isinstance(value, _Tabled):
        return value.table
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, Mapping):
        return {
            str(name): _write(_below(hint, str(name)), item, (*key, str(name)))
            for name, item in value.items()
            if item is not None
        }
    if isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return [_write(_below(hint, 0), item, (*key, 0)) for item in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        dimension = _dimension(hint, key)
        return value if dimension is None else _write_quantity(float(value), dimension)
    # the schema refuses what is no value of TOML
    return value  # type: ignore[return-value]


def find_strange(value: object) -> str | None:
    """Return the kind of what no file of a scene can hold in a value; None without any."""
    if isinstance(value, dict | list):
        parts = value.values() if isinstance(value, dict) else value
        return next((found for part in parts if (found := find_strange(part)) is not None), None)
    known = isinstance(value, str | int | float | date | time)
    return None if known else "None" if value is None else f"a {type(value).__name__}"


def _write_quantity(value: float, dimension: Dimension) -> str:
    """In the usual unit where that is exactly the same number, else in the SI unit."""
    if not math.isfinite(value):
        return f"{value!r} {dimension.unit}"  # what is wrong with it the scene says
    for digits in DIGITS:
        text = str(write_number(value, unit_of(dimension.example), digits))
        if parse_quantity(text, dimension).value == value:
            return text
    return f"{value!r} {dimension.unit}"


def _dimension(hint: object, key: KeyPath) -> Dimension | None:
    """Return what a number measures at a key; None where it is a plain number, or where the key
    alone does not say.
    """
    kinds = [item for item in _metadata(hint) if isinstance(item, QuantityOf)]
    if not kinds:
        return None
    dimensions = kinds[0].dimensions
    if len(dimensions) == 1:
        return dimensions[0]
    if set(dimensions) == {LENGTH, ANGLE}:
        return None  # the position of an axis: what kind of axis another table says
    return dimensions[key[-1] in ROTATIONAL]


def _metadata(hint: object) -> tuple[object, ...]:
    origin = get_origin(hint)
    if origin is Annotated:
        inner, *own = get_args(hint)
        return (*own, *_metadata(inner))
    if origin in (Union, types.UnionType):
        return tuple(item for option in get_args(hint) for item in _metadata(option))
    return ()


def _field_of(model: type[BaseModel], key: str) -> object:
    for name, field in model.model_fields.items():
        if key == (field.alias or name):
            return Annotated[field.annotation, *field.metadata, None]
    return None


def _below(hint: object, part: str | int) -> object:
    """Return the type of an entry of a table or a list; None where it is not known."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _below(arguments[0], part)
    if origin in (Union, types.UnionType):
        found = [_below(option, part) for option in arguments if option is not type(None)]
        return next((item for item in found if item is not None), None)
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return _field_of(hint, str(part))
    return arguments[-1] if origin in (dict, list) else None


def _refuse(self: object, *args: object, **keys: object) -> NoReturn:
    """Refuse a change."""
    raise TypeError(
        "a table of a machine cannot be changed; machine.change(set={...}) makes another"
    )


class _FrozenTable(dict[str, TomlValue]):
    """A table that is read like any other and not written; a copy of it can be."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __deepcopy__(self, memo: dict[int, Any]) -> TomlTable:
        return {key: _thaw(value) for key, value in self.items()}

    def __reduce__(self) -> tuple[type, tuple[TomlTable]]:
        return _FrozenTable, (dict(self),)


class _FrozenList(list[TomlValue]):
    """A list that is read like any other and not written; a copy of it can be."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __deepcopy__(self, memo: dict[int, Any]) -> list[TomlValue]:
        return [_thaw(value) for value in self]

    def __reduce__(self) -> tuple[type, tuple[list[TomlValue]]]:
        return _FrozenList, (list(self),)


def freeze_table(table: Mapping[str, TomlValue]) -> _FrozenTable:
    """Return a copy of a table that cannot be changed, nor can what is in it."""
    return _FrozenTable({key: _freeze(value) for key, value in table.items()})


def _freeze(value: TomlValue) -> TomlValue:
    if isinstance(value, dict):
        return freeze_table(value)
    return _FrozenList(map(_freeze, value)) if isinstance(value, list) else value


def _thaw(value: TomlValue) -> TomlValue:
    """Return a copy of a value that can be changed."""
    if isinstance(value, dict):
        return {key: _thaw(item) for key, item in value.items()}
    return [_thaw(item) for item in value] if isinstance(value, list) else value
