"""Typical machine elements and work materials by name: what ``from = "catalogue:guide_35"`` in a joint
stands for, and ``material = "c45"`` where a scene has no ``[cutting.c45]``.

The values are data, in ``catalogue.toml`` and ``cutting_materials.toml`` beside this file; a joint's own keys
go before them.
"""

import difflib
import re
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import Findings, KeyPath, show_key
from headstock.scene.reading.units import quote_value
from headstock.scene.schema.cutting import CuttingTable
from headstock.scene.schema.types import StrictTable

FROM, CATALOGUE = "from", "catalogue:"
ELEMENTS = Path(__file__).with_name("catalogue.toml")
NEAR = 0.6  # how alike a name is that was probably meant
# keys of a screw that one stiffness of a bearing can stand for
BEARINGS = ("bearing", "second_bearing")


class _SizeTable(StrictTable):
    """What one size of a family gives to a joint."""

    stiffness: dict[str, str]
    screw: dict[str, str] = {}


class FamilyTable(StrictTable):
    """Elements of one kind in several sizes, as ``catalogue.toml`` has them.

    Attributes:
        size: What the number in the name is.
        factor: The stiffness of a real one lies within the value divided and multiplied by this.
        rotation_factor: The same of rotations; as ``factor`` where there is none.
        soft: Whether it deflects visibly under the weight it carries.
        loss_factor: Structural damping as a share of the stiffness.
        loss_factor_range: Where that of a real one lies.
        derived: How they follow from the size.
        source: Of the rule, and of what it was compared with.
        sizes: Keys of the joint by the end of the name.
    """

    title: str
    kind: Literal["linear_guide", "ball_screw", "bearing", "mount"]
    size: str
    soft: bool = False
    factor: Annotated[float, Field(gt=1.0)]
    rotation_factor: Annotated[float | None, Field(gt=1.0)] = None
    loss_factor: Annotated[float, Field(gt=0.0, lt=1.0)]
    loss_factor_range: Annotated[list[float], Field(min_length=2, max_length=2)]
    preload: str
    derived: str
    source: Annotated[list[str], Field(min_length=1)]
    sizes: Annotated[dict[str, _SizeTable], Field(min_length=1)]


@dataclass(frozen=True)
class CatalogueEntry:
    """One element of the catalogue.

    Attributes:
        name: Behind ``catalogue:``.
        family: What all of its sizes have in common.
    """

    name: str
    stem: str
    family: FamilyTable
    joint: TomlTable

    def uncertainty(self) -> str:
        """Return how far a real one may be off, in words."""
        family = self.family
        low, high = family.loss_factor_range
        turns = f" ({family.rotation_factor:g} for rotations)" if family.rotation_factor else ""
        return f"stiffness within a factor of {family.factor:g}{turns}, loss factor {low:g} to {high:g}"


@cache
def read_catalogue() -> dict[str, CatalogueEntry]:
    """Every element by name, in the order of the file."""
    families = tomllib.loads(ELEMENTS.read_text(encoding="utf-8"))
    entries: dict[str, CatalogueEntry] = {}
    for stem, table in families.items():
        family = FamilyTable.model_validate(table)
        for size, values in family.sizes.items():
            keys: TomlTable = {"kind": family.kind, "stiffness": {**values.stiffness}}
            if values.screw:
                keys["screw"] = {**values.screw}
            keys["loss_factor"] = family.loss_factor
            if family.soft:
                keys["soft"] = True
            entries[f"{stem}_{size}"] = CatalogueEntry(f"{stem}_{size}", stem, family, keys)
    return entries


def fill_joints(joints: TomlTable, findings: Findings) -> TomlTable:
    """Joints with what the catalogue gives them, in full.

    Args:
        joints: With one entry per place.
        findings: Receives problems, and what is assumed.
    """
    return {
        name: fill_joint(entry, ("joints", name), findings) if isinstance(entry, dict) else entry
        for name, entry in joints.items()
    }


def fill_joint(joint: TomlTable, key: KeyPath, findings: Findings) -> TomlTable:
    """A joint with the keys of the catalogue that it does not have itself.

    Args:
        findings: Receives problems, and what is assumed.
    """
    full = dict(joint)
    if FROM in joint:
        entry = _find(joint[FROM], (*key, FROM), findings)
        if joint.get("kind", entry.family.kind) != entry.family.kind:
            findings.add(
                (*key, "kind"),
                f"{entry.name} of the catalogue is a {entry.family.kind}; remove kind, or name another one",
            )
        full = _merged(joint, entry.joint)
        full |= {FROM: f"{CATALOGUE}{entry.name}", "kind": entry.family.kind}
        constrained = isinstance(stiffness := full["stiffness"], dict) and all(
            value == "rigid" for value in stiffness.values()
        )
        if constrained and "loss_factor" not in joint:
            del full["loss_factor"]  # there is nothing left that it is a share of
        for name in entry.joint:
            if name not in joint:
                # what is wrong with it is said at the line that names the element
                findings.written_at[(*key, name)] = (*key, FROM)
        _assume(joint, entry, key, findings)
    if isinstance(screw := full.get("screw"), dict):
        full["screw"] = _fill_screw(screw, (*key, "screw"), findings)
    return full


def _find(text: TomlValue, key: KeyPath, findings: Findings) -> CatalogueEntry:
    """The element that a text names; the nearest one where it names none, which is reported, so
    that the rest can be checked.
    """
    entries = read_catalogue()
    name = str(text).removeprefix(CATALOGUE)
    if not isinstance(text, str) or not text.startswith(CATALOGUE):
        findings.add(
            key,
            f'{quote_value(text)} is no element of the catalogue; write for example from = "{CATALOGUE}guide_35"',
        )
    elif name in entries:
        return entries[name]
    else:
        findings.add(
            key,
            f"there is no {name[:80]!r} in the catalogue; {nearest_names(name)}; "
            "`headstock catalogue` lists all",
        )
    return entries[nearest_elements(name)[0]]


def nearest_elements(name: str) -> list[str]:
    """Three names: of the same family by size, else by spelling."""
    stem, _, size = name.rpartition("_")
    family = [entry.name for entry in read_catalogue().values() if entry.stem == stem]
    wanted = [int(number[:6]) for number in re.findall(r"\d+", size)]
    if not family or not wanted:
        return difflib.get_close_matches(name[:80], read_catalogue(), n=3, cutoff=0.0)

    def distance(other: str) -> list[int]:
        sizes = map(int, re.findall(r"\d+", other.removeprefix(stem)))
        return [abs(one - two) for one, two in zip(sizes, wanted, strict=False)]

    return sorted(family, key=distance)[:3]


def nearest_names(name: str) -> str:
    """The nearest names; the families where none is near."""
    near = nearest_elements(name)
    if difflib.SequenceMatcher(a=name[:80], b=near[0]).ratio() > NEAR:
        return f"the nearest names: {', '.join(near)}"
    stems = dict.fromkeys(f"{entry.stem}_..." for entry in read_catalogue().values())
    return f"names: {', '.join(stems)}"


def _merged(written: TomlTable, given: TomlTable) -> TomlTable:
    """Own keys before those of the catalogue, table by table."""
    full = given | written
    for name, value in given.items():
        if isinstance(value, dict) and isinstance(mine := written.get(name), dict):
            full[name] = _merged(mine, value)
    return full


def _fill_screw(screw: TomlTable, key: KeyPath, findings: Findings) -> TomlTable:
    """A screw whose shaft and bearings may be elements of the catalogue; of bearings the axial
    stiffness counts.
    """
    full = dict(screw)
    if FROM in screw:
        entry = _find(screw[FROM], (*key, FROM), findings)
        given = entry.joint.get("screw")
        if isinstance(given, dict):
            full = given | full | {FROM: f"{CATALOGUE}{entry.name}"}
            findings.assume(key, f"{CATALOGUE}{entry.name}, diameter and lead of its shaft")
        else:
            _refuse(entry, (*key, FROM), "ball_screw_40x10", findings)
            full = {"diameter": "1 m"} | full | {FROM: ""}
    for name in BEARINGS:
        text = screw.get(name)
        if not isinstance(text, str) or not text.startswith(CATALOGUE):
            continue
        entry = _find(text, (*key, name), findings)
        stiffness = entry.joint["stiffness"]
        if entry.family.kind != "bearing" or not isinstance(stiffness, dict):
            _refuse(entry, (*key, name), "screw_bearing_30", findings)
            del full[name]
            continue
        full[name] = stiffness["axial"]
        factor = f"stiffness within a factor of {entry.family.factor:g}"
        findings.assume((*key, name), f"{text}, {factor}")
    return full


def _refuse(entry: CatalogueEntry, key: KeyPath, example: str, findings: Findings) -> None:
    findings.add(
        key,
        f"{entry.name} of the catalogue is a {entry.family.kind}; write for example "
        f'{key[-1]} = "{CATALOGUE}{example}"',
    )


def _assume(joint: TomlTable, entry: CatalogueEntry, key: KeyPath, findings: Findings) -> None:
    """Note what an element of the catalogue gives to a joint."""
    replaced = [
        show_key((name, part))
        for name, table in entry.joint.items()
        if isinstance(table, dict) and isinstance(mine := joint.get(name), dict)
        for part in table
        if part in mine
    ]
    others = [
        name for name in entry.joint if name in joint and name not in ("kind", "stiffness", "screw")
    ]
    but = f"; own values: {', '.join(replaced + others)}" if replaced or others else ""
    findings.assume(key, f"{CATALOGUE}{entry.name}, {entry.uncertainty()}{but}")


MATERIALS = Path(__file__).with_name("cutting_materials.toml")


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
        ranges = self.keys.get("ranges", {})
        return ranges if isinstance(ranges, dict) else {}


@cache
def read_cutting_materials() -> dict[str, CuttingMaterial]:
    """Every material by name, in the order of the file."""
    file = _FileTable.model_validate(tomllib.loads(MATERIALS.read_text(encoding="utf-8")))
    materials = {}
    for name, entry in file.materials.items():
        keys: TomlTable = dict(entry)
        title, group = str(keys.pop("title")), file.groups[str(keys.pop("group"))]
        keys.setdefault("source", group.source or "")
        if group.ranges:
            keys.setdefault("ranges", dict(group.ranges))
        table = CuttingTable.model_validate(keys)
        materials[name] = CuttingMaterial(name, title, group.title, table.source or "", keys, table)
    return materials
