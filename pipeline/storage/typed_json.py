"""Frozen dataclasses of many small values as one JSON text, which is much faster to write than a
group for each of them (``records.py``); large arrays go into data sets.

Tuples are lists, a dataclass, a dict, an array or a complex number is a mapping with one key that
says which. Only classes that the reader names can come out: no pickle.
"""

import dataclasses
import json
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.pipeline.storage.records import RecordError

LARGE = 256  # values of an array that has a data set of its own
AnyArray = NDArray[Any]
type Coded = str | float | bool | None | list[Coded] | dict[str, Coded]


def encode_value(value: object, keep: Callable[[AnyArray], str] | None = None) -> Coded:
    """A value as JSON has it.

    Args:
        value: A dataclass, or anything it may hold.
        keep: Stores a large array and returns where; without it all arrays are in the text.

    Raises:
        TypeError: A kind of value that has no place in a file.
    """
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, np.generic):
        return encode_value(value.item(), keep)
    if isinstance(value, int | float):
        return value
    if isinstance(value, complex):
        return {"complex": [value.real, value.imag]}
    if isinstance(value, np.ndarray):
        return _encode_array(value, keep)
    if isinstance(value, tuple | list):
        return [encode_value(item, keep) for item in value]
    if isinstance(value, Mapping):
        # pairs: a key may be a tuple
        return {
            "dict": [
                [encode_value(key, keep), encode_value(item, keep)] for key, item in value.items()
            ]
        }
    if dataclasses.is_dataclass(value):
        return {
            type(value).__name__: [
                [field.name, encode_value(getattr(value, field.name), keep)]
                for field in dataclasses.fields(value)
            ]
        }
    raise TypeError(f"a {type(value).__name__} has no place in a file of results")


def _encode_array(array: AnyArray, keep: Callable[[AnyArray], str] | None) -> Coded:
    if keep is not None and array.size > LARGE:
        return {"stored": keep(array)}
    flat = np.ascontiguousarray(array).ravel()
    values = flat.astype(complex).view(float) if array.dtype.kind == "c" else flat
    return {"array": [array.dtype.str, list(array.shape), [*values.tolist()]]}


def _fetch_nothing(name: str) -> AnyArray:
    """Of a text that holds all its arrays.

    Raises:
        KeyError: Always.
    """
    raise KeyError(name)


def decode_value(
    coded: Coded,
    classes: Mapping[str, type[Any]],
    fetch: Callable[[str], AnyArray] = _fetch_nothing,
) -> Any:
    """What ``encode_value`` made JSON of.

    Args:
        classes: By name; no others come out.
        fetch: Large array from where it was stored.

    Raises:
        RecordError: It holds something else.
    """
    try:
        return _decode(coded, classes, fetch)
    except (TypeError, ValueError, KeyError, RecursionError) as error:
        raise RecordError(f"no readable record: {error}") from error


def _decode(
    coded: Coded, classes: Mapping[str, type[Any]], fetch: Callable[[str], AnyArray]
) -> Any:
    if isinstance(coded, list):
        return tuple(_decode(item, classes, fetch) for item in coded)
    if not isinstance(coded, dict):
        return coded
    ((kind, content),) = coded.items()
    if kind == "stored":
        return fetch(str(content))
    if not isinstance(content, list):
        raise TypeError(f"{kind[:40]!r} holds no list")
    if kind == "complex":
        return complex(*typing.cast(list[float], content))
    if kind == "array":
        return _decode_array(*typing.cast(tuple[str, list[int], list[float]], content))
    pairs = [_decode(item, classes, fetch) for item in content]
    if kind == "dict":
        return dict(pairs)
    if kind not in classes:
        raise TypeError(f"{kind[:40]!r} is unknown here")
    return classes[kind](**dict(pairs))


def _decode_array(kind: str, shape: list[int], values: list[float]) -> AnyArray:
    dtype = np.dtype(kind)
    if dtype.kind not in "fiubc":
        raise TypeError(f"an array of {kind[:20]!r}")
    if dtype.kind == "c":
        return np.array(values, dtype=float).view(complex).astype(dtype).reshape(shape)
    return np.array(values, dtype=dtype).reshape(shape)


def reachable_classes(starts: Iterable[type[Any]]) -> dict[str, type[Any]]:
    """Dataclasses that the fields of some may hold, with themselves, by name.

    Raises:
        TypeError: Two of them have the same name.
    """
    found: dict[str, type[Any]] = {}
    waiting: list[Any] = list(starts)
    while waiting:
        hint = waiting.pop()
        waiting += typing.get_args(hint)
        if not isinstance(hint, type) or not dataclasses.is_dataclass(hint):
            continue
        if found.setdefault(hint.__name__, hint) is not hint:
            raise TypeError(f"two classes are called {hint.__name__}")
        hints = typing.get_type_hints(hint)
        waiting += [
            item
            for item in (hints[field.name] for field in dataclasses.fields(hint))
            if not (isinstance(item, type) and item.__name__ in found)
        ]
    return found


def dump_coded(coded: Coded) -> bytes:
    """JSON text; NaN and infinite numbers are written as Python reads them."""
    return json.dumps(coded, ensure_ascii=False, separators=(",", ":")).encode()
