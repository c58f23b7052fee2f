"""Usual work materials by name: what ``material = "c45"`` stands for where a scene has no
``[cutting.c45]``. The values are data, in ``cutting_materials.toml`` beside this file.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from headstock.scene.reading.files import TomlTable
from headstock.scene.schema.cutting import CuttingTable
from headstock.scene.schema.types import StrictTable

DATA = Path(__file__).with_name("cutting_materials.toml")


class _GroupTable(StrictTable):
    """What materials of one source have in common."""

    title: str
    source: str | None = None
    ranges: dict[str, str] = {}


class _FileTable(StrictTable):
    """The file: materials have the keys of a scene, and ``title`` and ``group``."""

    groups: dict[str, _GroupTable]
    materials: Annotated[dict[str, dict[str, Any]], Field(min_length=1)]


@dataclass(frozen=True, eq=False)
class CuttingMaterial:
    """A work material of the catalogue.

    Attributes:
        keys: Its coefficients as a scene writes them.
    """

    name: str
    title: str
    group: str
    source: str
    keys: TomlTable
    table: CuttingTable

    @property
    def ranges(self) -> TomlTable:
        """Half widths of ranges as written, by key."""
        found = self.keys.get("ranges", {})
        return found if isinstance(found, dict) else {}


@cache
def read_cutting_materials() -> dict[str, CuttingMaterial]:
    """Every material by name, in the order of the file."""
    file = _FileTable.model_validate(tomllib.loads(DATA.read_text(encoding="utf-8")))
    found = {}
    for name, entry in file.materials.items():
        keys: TomlTable = dict(entry)
        title, group = str(keys.pop("title")), file.groups[str(keys.pop("group"))]
        keys.setdefault("source", group.source or "")
        if group.ranges:
            keys.setdefault("ranges", dict(group.ranges))
        table = CuttingTable.model_validate(keys)
        found[name] = CuttingMaterial(name, title, group.title, table.source or "", keys, table)
    return found
