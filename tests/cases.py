"""Tables of cases: what tests try that do the same with many values, a row each."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

TABLES = {
    name: table
    for path in sorted((Path(__file__).parent / "data" / "cases").glob("*.toml"))
    for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items()
}


def cases[**P](test: Callable[P, None]) -> Callable[P, None]:
    """Run a test for every row of the table in ``data/cases`` that has its name.

    A table names the arguments, and lists rows, or has them under ids of their own; lists come as
    tuples.
    """
    table = TABLES[test.__name__.removeprefix("test_")]
    rows = table["rows"]
    ids = list(rows) if isinstance(rows, dict) else None
    values = [_frozen(rows[name]) for name in ids] if ids else _frozen(rows)
    return pytest.mark.parametrize(table["names"], values, ids=ids)(test)


def _frozen(value: object) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
