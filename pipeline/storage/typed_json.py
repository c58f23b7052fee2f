"""Frozen dataclasses of many small values as one JSON text, which is much faster to write than a
group for each of them (``records.py``); large arrays go into data sets.

Tuples are lists, a dataclass, a dict, an array or a complex number is a mapping with one key that
says which. Only classes that the reader names can come out: no pickle. Files may have been altered
by anyone: ``find_fault`` compares values with type hints.
"""

import dataclasses
import functools
import json
import math
import re
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.pipeline.storage.records import RecordError

LARGE = 256  # values of an array that has a data set of its own
AnyArray = NDArray[Any]
type Coded = str | float | bool | None | list[Coded] | dict[str, Coded]
LARGEST_WHOLE = 2**63
_SHOWN = 80
# of the categories Cc and Cs, but for what parts lines and columns
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
CALLABLES = (Callable, typing.get_origin(Callable[[], None]))


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
    """Return what ``encode_value`` made JSON of.

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
    classes: dict[str, type[Any]] = {}
    waiting: list[Any] = list(starts)
    while waiting:
        hint = waiting.pop()
        waiting += typing.get_args(hint)
        if not isinstance(hint, type) or not dataclasses.is_dataclass(hint):
            continue
        if classes.setdefault(hint.__name__, hint) is not hint:
            raise TypeError(f"two classes are called {hint.__name__}")
        hints = typing.get_type_hints(hint)
        waiting += [
            item
            for item in (hints[field.name] for field in dataclasses.fields(hint))
            if not (isinstance(item, type) and item.__name__ in classes)
        ]
    return classes


def dump_coded(coded: Coded) -> bytes:
    """JSON text; NaN and infinite numbers are written as Python reads them."""
    return json.dumps(coded, ensure_ascii=False, separators=(",", ":")).encode()


def find_fault(value: object, hint: Any, where: str = "") -> str | None:
    """Find what is not as a hint says, with its key; None where everything is.

    Keys that a ``TypedDict`` does not know are passed over. JSON has lists for tuples.

    Args:
        hint: A class, ``TypedDict``, dataclass, ``Literal``, union, or a container of such.
    """
    if isinstance(hint, typing.TypeAliasType):
        try:
            hint = hint.__value__
        except NameError:  # of a library that is loaded late: nothing that a file holds
            return None
    origin = typing.get_origin(hint)
    for applies, find in FINDERS:
        if applies(hint, origin):
            return find(value, hint, where)
    return _find_in_scalar(value, origin or hint, where)


def _find_in_union(value: object, hint: Any, where: str) -> str | None:
    faults = [find_fault(value, option, where) for option in typing.get_args(hint)]
    # of several that which is found furthest inside, the last that of what is no None
    return max(
        filter(None, faults if None not in faults else ()),
        key=lambda fault: len(fault.partition(" is ")[0]),
        default=None,
    )


def _find_in_literal(value: object, hint: Any, where: str) -> str | None:
    fits = value in typing.get_args(hint) if isinstance(value, str | int) else False
    return None if fits else f"{where} is {_show(value)}, not one of {typing.get_args(hint)}"


def _find_in_array(value: object, hint: Any, where: str) -> str | None:
    fits = isinstance(value, np.ndarray) and value.dtype.kind in "biufcUS"
    return None if fits else f"{where} is {_show(value)}, not an array of numbers"


def _find_in_mapping(value: object, hint: Any, where: str) -> str | None:
    if not isinstance(value, Mapping):
        return f"{where} is {_show(value)}, not a table"
    key_hint, item_hint = typing.get_args(hint)
    for key, item in value.items():
        fault = find_fault(key, key_hint, f"a key of {where or 'it'}")
        fault = fault or find_fault(item, item_hint, f"{where}.{_short(key)}".lstrip("."))
        if fault:
            return fault
    return None


def _find_in_sequence(value: object, hint: Any, where: str) -> str | None:
    if not isinstance(value, list | tuple):
        return f"{where} is {_show(value)}, not a list"
    inner = typing.get_args(hint)
    hints: Iterable[Any] = inner
    if typing.get_origin(hint) is not tuple or Ellipsis in inner:
        hints = (inner[0],) * len(value)
    elif len(inner) != len(value):
        return f"{where} has {len(value)} entries, not {len(inner)}"
    faults = (
        find_fault(item, one, f"{where}[{number}]")
        for number, (item, one) in enumerate(zip(value, hints, strict=True))
    )
    return next(filter(None, faults), None)


def _find_in_table(value: object, hint: Any, where: str) -> str | None:
    if not isinstance(value, dict):
        return f"{where or 'it'} is {_show(value)}, not a table"
    for key in sorted(hint.__required_keys__ - value.keys()):
        return f"{f'{where}.{key}'.lstrip('.')} is missing"
    faults = (
        find_fault(value[key], inner, f"{where}.{key}".lstrip("."))
        for key, inner in _hints(hint).items()
        if key in value
    )
    return next(filter(None, faults), None)


def _find_in_record(value: object, hint: Any, where: str) -> str | None:
    if not isinstance(value, hint) or not dataclasses.is_dataclass(value):
        return f"{where} is {_show(value)}, not a {hint.__name__}"
    kind: Any = type(value)
    hints = _hints(kind)
    faults = (
        find_fault(getattr(value, item.name), hints[item.name], f"{where}.{item.name}".lstrip("."))
        for item in dataclasses.fields(value)
    )
    return next(filter(None, faults), None)


def _find_in_scalar(value: object, kind: Any, where: str) -> str | None:
    if kind is float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return f"{where} is {_show(value)}, not a number"
        fits = isinstance(value, float) or abs(value) < LARGEST_WHOLE
        return None if fits else f"{where} is {_show(value)}, more than any result"
    if kind is int:
        fits = isinstance(value, int) and abs(value) < LARGEST_WHOLE
        return None if fits else f"{where} is {_show(value)}, not a whole number"
    if kind is str and isinstance(value, str):
        odd = CONTROL.search(value)
        return None if odd is None else f"{where} holds the control character {odd[0]!r}"
    if isinstance(kind, type) and not isinstance(value, kind):
        return f"{where} is {_show(value)}, not {'empty' if kind is types.NoneType else f'a {kind.__name__}'}"
    return None


type Finder = Callable[[object, Any, str], str | None]
# what looks at a value, by which hints it is for; scalars come last
FINDERS: tuple[tuple[Callable[[Any, Any], bool], Finder], ...] = (
    (lambda hint, origin: hint in (Any, object) or origin in CALLABLES, lambda *_: None),
    (lambda hint, origin: origin in (types.UnionType, typing.Union), _find_in_union),
    (lambda hint, origin: origin is Literal, _find_in_literal),
    (lambda hint, origin: origin is not None and issubclass(origin, Mapping), _find_in_mapping),
    (lambda hint, origin: origin is np.ndarray, _find_in_array),
    (lambda hint, origin: origin is not None and issubclass(origin, Sequence), _find_in_sequence),
    (lambda hint, origin: typing.is_typeddict(hint), _find_in_table),
    (lambda hint, origin: dataclasses.is_dataclass(hint), _find_in_record),
)


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _show(value: object) -> str:
    if isinstance(value, int) and abs(value) >= LARGEST_WHOLE:
        return "a number of more than 18 digits"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict | list | tuple | np.ndarray) or dataclasses.is_dataclass(value):
        return f"a {type(value).__name__}"
    return _short(value)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
