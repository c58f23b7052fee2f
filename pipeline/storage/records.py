"""Frozen dataclasses of numbers and arrays to HDF5 groups and back, led by their type hints; no
pickle, no object arrays.

A field becomes a data set (array, list of words), an attribute (number, word) or a group
(dataclass, tuple, dict) of the same name, or of that in its metadata; ``None`` is left out. A reader therefore needs nothing
but the dataclass to know the layout.
"""

import dataclasses
import functools
import json
import types
import typing
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.errors import HeadstockError, printable
from headstock.meshing.process.plain_hdf5 import STORED_AS, h5py, plain_objects

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

NO_WORDS = "S1"
LARGEST_ITEM = 1 << 20  # bytes of a number or a word; the longest is the text of a scene


class RecordError(HeadstockError):
    """A file does not hold the record it should; says which field and what was found."""


def require_plain(file: "h5py.File", *, attribute_axes: int = 0) -> None:
    """Refuse a file of which anything is not in the file itself or of a kind that records do not
    hold, before a value is read.

    Nothing but heads of objects is looked at.

    Args:
        attribute_axes: Axes that an attribute may have: none in a record, two in results.

    Raises:
        RecordError: Names the first such thing.
    """
    _require_plain_attributes(file, attribute_axes)
    for where, item in plain_objects(file, RecordError):
        _require_plain_attributes(item, attribute_axes)
        if isinstance(item, h5py.Dataset) and (
            item.dtype.kind not in "biufcS" or item.dtype.itemsize > LARGEST_ITEM
        ):
            raise RecordError(
                f"{where} holds values of type {printable(str(item.dtype))[:60]}; numbers and plain words are known"
            )


def _require_plain_attributes(item: h5py.Group | h5py.Dataset, most_axes: int) -> None:
    for name in item.attrs:
        attribute = item.attrs.get_id(name)
        text = attribute.get_type().get_class() == h5py.h5t.STRING
        if (
            attribute.shape is None
            or len(attribute.shape) > most_axes
            or not (text or attribute.dtype.kind in "iufb")
        ):
            raise RecordError(
                f"attribute {printable(f'{item.name}.{name}')} must be one number or word"
            )


def write_record(group: h5py.Group, record: "DataclassInstance") -> None:
    """Write every field of a frozen dataclass into a group."""
    for field in dataclasses.fields(record):
        _write_value(group, _stored_name(field), getattr(record, field.name))


def _stored_name(field: "dataclasses.Field[Any]") -> str:
    """What a field is called in files: files outlive names in the program."""
    return str(field.metadata.get(STORED_AS, field.name))


def write_words(group: h5py.Group, content: Mapping[str, object]) -> None:
    """Write numbers, words and lists of words as attributes of a group, a list as JSON; None is
    left out.
    """
    for name, value in content.items():
        if value is not None:
            group.attrs[name] = (
                json.dumps(value, ensure_ascii=False) if isinstance(value, list) else value
            )


def read_record[T](group: h5py.Group, kind: type[T]) -> T:
    """Read a dataclass that ``write_record`` wrote.

    Raises:
        RecordError: A field without default is missing, or holds something else than its type hint
            says.
    """
    hints = _read_hints(typing.cast(Any, kind))
    values: dict[str, Any] = {}
    for field in dataclasses.fields(typing.cast(Any, kind)):
        has_default = (
            field.default is not dataclasses.MISSING
            or field.default_factory is not dataclasses.MISSING
        )
        name = _stored_name(field)
        if name in group or name in group.attrs:
            values[field.name] = _read_value(group, name, hints[field.name])
        elif types.NoneType in _union_options(hints[field.name]):
            values[field.name] = None
        elif not has_default:
            raise RecordError(f"{group.name} has no {name!r}, which a {kind.__name__} needs")
    try:
        return kind(**values)
    except ValueError as error:
        raise RecordError(f"{group.name} is no valid {kind.__name__}: {error}") from error


@functools.cache
def _read_hints(kind: type) -> dict[str, Any]:
    """Return the type hints of a dataclass; reading them takes longer than its numbers."""
    return typing.get_type_hints(kind)


def _write_value(group: h5py.Group, name: str, value: object) -> None:
    if value is None:
        return
    if isinstance(value, bool | int | float | str):
        group.attrs[name] = value
    elif isinstance(value, np.ndarray):
        group.create_dataset(name, data=value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        write_record(group.create_group(name, track_order=True), value)
    elif isinstance(value, Mapping):
        inner = group.create_group(name, track_order=True)
        for key, item in value.items():
            _write_value(inner, quote(key, safe=": "), item)
    elif isinstance(value, tuple) and value and dataclasses.is_dataclass(value[0]):
        inner = group.create_group(name, track_order=True)
        for index, item in enumerate(value):
            _write_value(inner, str(index), item)
    elif isinstance(value, tuple):
        group.create_dataset(name, data=_word_array(value))
    else:
        raise TypeError(f"{name!r} of type {type(value).__name__} has no place in a record file")


def _word_array(words: tuple[object, ...]) -> NDArray[np.generic]:
    array = np.array(words if words else np.zeros(0))
    if not words:
        return array.astype(NO_WORDS)
    return np.char.encode(array, "utf-8") if array.dtype.kind == "U" else array


def _read_value(group: h5py.Group, name: str, hint: object) -> object:
    where = f"{group.name}/{name}"
    options = [option for option in _union_options(hint) if option is not types.NoneType]
    for option in options:
        origin = typing.get_origin(option) or option
        if origin is np.ndarray:
            return _read_array(group, name, where)
        if origin is tuple:
            return _read_tuple(group, name, option, where)
        if origin is dict:
            inner = _subgroup(group, name, where)
            item = typing.get_args(option)[1]
            keys = [*inner.keys(), *inner.attrs.keys()]
            return {unquote(key): _read_value(inner, key, item) for key in keys}
        if dataclasses.is_dataclass(origin):
            return read_record(_subgroup(group, name, where), typing.cast(Any, origin))
        return _read_scalar(group, name, option, where)
    raise RecordError(f"{where} has a type hint that record files do not know: {hint}")


def _union_options(hint: object) -> tuple[object, ...]:
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        return typing.get_args(hint)
    return (hint,)


def _subgroup(group: h5py.Group, name: str, where: str) -> h5py.Group:
    inner = group.get(name)
    if not isinstance(inner, h5py.Group):
        raise RecordError(f"{where} must be a group")
    return inner


def _dataset(group: h5py.Group, name: str, where: str) -> h5py.Dataset:
    inner = group.get(name)
    if not isinstance(inner, h5py.Dataset):
        raise RecordError(f"{where} must be a data set")
    return inner


def _read_array(
    group: h5py.Group, name: str, where: str
) -> NDArray[np.float64] | NDArray[np.int64]:
    data = _dataset(group, name, where)
    if data.dtype.kind == "f":
        return np.ascontiguousarray(data[()], dtype=np.float64)
    if data.dtype.kind in "iu":
        return np.ascontiguousarray(data[()], dtype=np.int64)
    raise RecordError(f"{where} must hold numbers, not {data.dtype}")


def _read_tuple(group: h5py.Group, name: str, hint: object, where: str) -> tuple[object, ...]:
    item = typing.get_args(hint)[0]
    if dataclasses.is_dataclass(item):
        inner = group.get(name)
        if isinstance(inner, h5py.Dataset) and inner.size == 0:
            return ()
        inner = _subgroup(group, name, where)
        return tuple(_read_value(inner, str(index), item) for index in range(len(inner)))
    data = _dataset(group, name, where)
    if data.dtype.kind == "S":
        values = np.char.decode(data[()], "utf-8").tolist() if data.size else []
    elif data.dtype.kind in "fiu":
        values = data[()].tolist()
    else:
        raise RecordError(f"{where} must hold words or numbers, not {data.dtype}")
    return tuple(tuple(value) if isinstance(value, list) else value for value in values)


def _read_scalar(group: h5py.Group, name: str, hint: object, where: str) -> object:
    if name not in group.attrs:
        raise RecordError(f"{where} must be an attribute")
    value = group.attrs[name]
    if hint is bool and isinstance(value, np.bool_):
        return bool(value)
    if hint is int and isinstance(value, np.integer):
        return int(value)
    if hint is float and isinstance(value, np.floating | np.integer):
        return float(value)
    if isinstance(value, str) and (hint is str or value in typing.get_args(hint)):
        return value
    raise RecordError(f"{where} must be {getattr(hint, '__name__', hint)}, not {value!r}")
