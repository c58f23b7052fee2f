"""Whether a value is what a type hint says: content of files that anyone may have altered."""

import dataclasses
import functools
import math
import types
import typing
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

LARGEST_WHOLE = 2**63
_SHOWN = 80


def find_fault(value: object, hint: Any, where: str = "") -> str | None:
    """What is not as a hint says, with its key; None where everything is.

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
    if hint in (Any, object) or origin in (Callable, typing.get_origin(Callable[[], None])):
        return None
    if origin in (types.UnionType, typing.Union):
        faults = [find_fault(value, option, where) for option in typing.get_args(hint)]
        # of several the last is that of what is no None
        return None if None in faults else _deepest(faults)
    if origin is Literal:
        known = value in typing.get_args(hint) if isinstance(value, str | int) else False
        return None if known else f"{where} is {_show(value)}, not one of {typing.get_args(hint)}"
    if origin is not None and issubclass(origin, Mapping):
        return _find_in_mapping(value, typing.get_args(hint), where)
    if origin is np.ndarray:
        fits = isinstance(value, np.ndarray) and value.dtype.kind in "biufcUS"
        return None if fits else f"{where} is {_show(value)}, not an array of numbers"
    if origin is not None and issubclass(origin, tuple | Sequence):
        return _find_in_sequence(value, hint, where)
    if typing.is_typeddict(hint):
        return _find_in_table(value, hint, where)
    if dataclasses.is_dataclass(hint):
        return _find_in_record(value, hint, where)
    return _find_in_scalar(value, origin or hint, where)


def _deepest(faults: Iterable[str | None]) -> str:
    """Of the faults of the options of a union the one that is found furthest inside."""
    return max(filter(None, faults), key=lambda fault: len(fault.partition(" is ")[0]))


def _find_in_mapping(value: object, inner: tuple[Any, ...], where: str) -> str | None:
    if not isinstance(value, Mapping):
        return f"{where} is {_show(value)}, not a table"
    key_hint, item_hint = inner
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
        if isinstance(value, int | float) and not isinstance(value, bool):
            return (
                None
                if -LARGEST_WHOLE < value < LARGEST_WHOLE or isinstance(value, float)
                else (f"{where} is {_show(value)}, more than any result")
            )
        return f"{where} is {_show(value)}, not a number"
    if kind is int:
        fits = isinstance(value, int) and abs(value) < LARGEST_WHOLE
        return None if fits else f"{where} is {_show(value)}, not a whole number"
    if kind is str and isinstance(value, str):
        odd = next((sign for sign in value if _is_control(sign)), None)
        return None if odd is None else f"{where} holds the control character {odd!r}"
    if isinstance(kind, type) and not isinstance(value, kind):
        return f"{where} is {_show(value)}, not {'empty' if kind is types.NoneType else f'a {kind.__name__}'}"
    return None


def _is_control(sign: str) -> bool:
    return sign not in "\n\t" and unicodedata.category(sign) in ("Cc", "Cs")


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
