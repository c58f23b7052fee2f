"""Tables that cannot be changed: what a noun shows of itself."""

from collections.abc import Mapping
from typing import Any, NoReturn

from headstock.scene.reading.files import TomlTable, TomlValue


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
