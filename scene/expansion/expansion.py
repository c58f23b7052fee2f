"""What a scene writes in short, in full: calculated values, entries that stand at several places,
chains of masses and springs, and elements of the catalogue.

A component, joint, interface or patch with ``places`` is one entry for each of them: ``x_pad`` with
four becomes ``x_pad_1`` to ``x_pad_4``, ``column`` with a place ``left`` becomes ``column_left``;
``{n}`` in its texts is the number or the name. Overrides reach all of them by the name that is
written and one by its own.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal

from pydantic import ValidationError

from headstock.geometry.parts.solids import CENTER_FACE
from headstock.scene.expansion.catalogue import fill_joints
from headstock.scene.expansion.parameters import calculate_tables
from headstock.scene.reading.files import (
    MAX_DEPTH,
    TomlTable,
    TomlValue,
    count_entries,
)
from headstock.scene.reading.findings import Findings, KeyPath, show_key, suggest_names
from headstock.scene.reading.open_values import default_of
from headstock.scene.schema.joints import CarriagesTable, ChainTable
from headstock.scene.schema.patches import CENTERED_SHAPES
from headstock.scene.schema.validation import validate_part

PLACES, CARRIAGES, EACH = "places", "carriages", "each"
MOST_PLACES, MOST_CARRIAGES = 200, 14
MAX_WRITTEN_OUT = 100_000  # entries of a scene that places make
LONGEST_NAME = 128  # of an entry and its place
_PLACE_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
AXES = {"x": 0, "y": 1, "z": 2}


def expand_scene(raw: TomlTable, findings: Findings) -> TomlTable:
    """A parsed scene in full; ``parameters`` stays for whoever looks.

    Args:
        raw: As parsed, variants and overrides applied; left as it is.
        findings: Receives problems, and where each entry was written.
    """
    calculated = calculate_tables(raw, findings)
    full = dict(calculated)
    expansion = _Expansion(findings)
    for section in ("components", "joints"):
        entries = full.get(section)
        if isinstance(entries, dict):
            full[section] = expansion.expand_entries(entries, (section,))
    if isinstance(each_joint := full.get("joints"), dict):
        full["joints"] = fill_joints(each_joint, findings)
    _expand_chains(full, findings)
    components, axes = full.get("components"), full.get("axes")
    if isinstance(components, dict):
        full["components"] = {
            name: expansion.expand_component(entry, ("components", name))
            for name, entry in components.items()
        }
    if isinstance(axes, dict) and isinstance(joints := calculated.get("joints"), dict):
        full["axes"] = {name: _expand_axis(axis, joints) for name, axis in axes.items()}
    return full


def is_repeated(entry: TomlValue | None) -> bool:
    """Return whether an entry of a scene stands at several places."""
    return isinstance(entry, dict) and (PLACES in entry or CARRIAGES in entry)


def place_names(entry: TomlValue | None) -> list[str]:
    """Numbers from 1, or names, of the places of a repeated entry."""
    if not isinstance(entry, dict):
        return []
    if CARRIAGES in entry:
        rails, per_rail = _carriage_counts(entry) or (0, 0)
        return [str(number + 1) for number in range(rails * per_rail)]
    places = default_of(entry.get(PLACES))
    if isinstance(places, dict):
        return list(places)
    return [str(number + 1) for number in range(len(places) if isinstance(places, list) else 0)]


def _carriage_counts(entry: TomlTable) -> tuple[int, int] | None:
    """Rails of a set of carriages, and carriages on each; None where they are no numbers."""
    table = entry.get(CARRIAGES)
    if not isinstance(table, dict):
        return None
    rails, per_rail = table.get("rails", 2), table.get("per_rail", 2)
    if isinstance(rails, int) and isinstance(per_rail, int) and min(rails, per_rail) > 0:
        return (rails, per_rail) if max(rails, per_rail) <= MOST_CARRIAGES else None
    return None


def written_entry(entries: TomlTable, name: str) -> tuple[str, str] | None:
    """The repeated entry that a name is one place of, and the name of the place; None for others."""
    if name in entries or len(name) > LONGEST_NAME:
        return None
    for length in range(len(name) - 2, 0, -1):
        entry, rest = name[:length], name[length + 1 :]
        if name[length] == "_" and is_repeated(entries.get(entry)):
            return (entry, rest) if rest in place_names(entries[entry]) else None
    return None


def _expand_axis(axis: TomlValue, joints: TomlTable) -> TomlValue:
    """An axis that names a repeated joint has it at all of its places."""
    if not isinstance(axis, dict) or not isinstance(names := axis.get("joints"), list):
        return axis
    full: list[TomlValue] = []
    for name in names:
        entry = joints.get(name) if isinstance(name, str) else None
        full += (
            [f"{name}_{place}" for place in place_names(entry)] if is_repeated(entry) else [name]
        )
    return axis | {"joints": full}


@dataclass(frozen=True)
class _Place:
    """What a repeated entry is at one of its places.

    Attributes:
        name: Number from 1, or name.
        key: Where the place stands in it.
        written: Under which key or number it is written.
    """

    name: str
    entry: TomlTable
    key: KeyPath
    written: str | int


class _Expansion:
    """Writes out what stands at several places, within a limit."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._entries = 0

    def expand_component(self, entry: TomlValue, key: KeyPath) -> TomlValue:
        """A component with its interfaces in full."""
        if not isinstance(entry, dict):
            return entry
        if isinstance(solid := entry.get("solid"), dict) and "point_mass" in solid:
            # what every point mass has, so that nothing else need know of it
            defaults: TomlTable = {"fidelity": "rigid", "interfaces": {}}
            entry = defaults | entry
            if isinstance(given := entry["interfaces"], dict):
                center: TomlTable = {CENTER_FACE: {"face": CENTER_FACE}}
                entry = entry | {"interfaces": center | given}
        if not isinstance(interfaces := entry.get("interfaces"), dict):
            return entry
        return entry | {"interfaces": self.expand_entries(interfaces, (*key, "interfaces"))}

    def expand_entries(self, entries: TomlTable, key: KeyPath) -> TomlTable:
        """Joints or interfaces, repeated ones in full."""
        full: TomlTable = {}
        for name, entry in entries.items():
            if not isinstance(entry, dict):
                full[name] = entry
                continue
            if isinstance(patches := entry.get("patches"), list):
                entry = entry | {"patches": self._expand_patches(patches, (*key, name, "patches"))}
            if not is_repeated(entry):
                full[name] = entry
                continue
            for place in self._members(entry, (*key, name)):
                member = f"{name}_{place.name}"
                if member in entries:
                    self._findings.add(
                        (*key, member),
                        f"{show_key((*key, name))} makes an entry of this name too; rename one of them",
                    )
                full[member] = place.entry
                self._note((*key, member), (*key, name), place)
        return full

    def _expand_patches(self, patches: list[TomlValue], key: KeyPath) -> list[TomlValue]:
        full: list[TomlValue] = []
        for index, patch in enumerate(patches):
            if isinstance(patch, dict) and is_repeated(patch):
                for place in self._members(patch, (*key, index)):
                    self._note((*key, len(full)), (*key, index), place)
                    full.append(place.entry)
            else:
                self._findings.written_at[(*key, len(full))] = (*key, index)
                full.append(patch)
        return full

    def _note(self, made: KeyPath, written: KeyPath, place: _Place) -> None:
        """Note where an entry, and its place, are written."""
        self._findings.written_at[made] = written
        self._findings.written_at[*made, *place.key] = (*written, PLACES, place.written)

    def _within_limits(
        self, places: list[TomlValue], common: TomlTable, key: KeyPath
    ) -> list[TomlValue]:
        """Places of a repeated entry, none once the scene would become too large."""
        before, most = self._entries, MAX_WRITTEN_OUT
        self._entries += len(places) * count_entries(common)
        if before <= most < self._entries:
            self._findings.add(
                (*key, PLACES),
                f"makes the scene larger than {most} entries, written out; write fewer places",
            )
        return places if self._entries <= most else []

    def _members(self, entry: TomlTable, key: KeyPath) -> Iterator[_Place]:
        """A repeated entry at each of its places."""
        common = {
            name: value for name, value in entry.items() if name not in (PLACES, CARRIAGES, EACH)
        }
        places = self._within_limits(_list_places(entry, key, self._findings), common, key)
        names = place_names(entry)[: len(places)]
        exceptions = _read_each(entry, key, names, self._findings)
        where = _place_key(common, key, self._findings)
        _, per_rail = _carriage_counts(entry) or (1, 1)
        for number, (name, place) in enumerate(zip(names, places, strict=True)):
            member = _with(_numbered(common, name, rail=number // per_rail + 1), where, place)
            for path, value in exceptions.get(name, []):
                member = _with(member, path, value)
            yield _Place(
                name, member, where, name if isinstance(entry.get(PLACES), dict) else number
            )


def _list_places(entry: TomlTable, key: KeyPath, findings: Findings) -> list[TomlValue]:
    if CARRIAGES in entry:
        if PLACES in entry:
            findings.add((*key, PLACES), "is not allowed with carriages; write one of them")
        return _list_carriages(entry, key, findings)
    places = entry[PLACES]
    listed = list(places.values()) if isinstance(places, dict) else places
    if isinstance(places, dict):
        for name in [name for name in places if _PLACE_NAME.fullmatch(name) is None]:
            findings.add(
                (*key, PLACES, name),
                f"{name[:80]!r} is no name of a place; write at most 64 letters, digits, _ and -",
            )
            return []
    if isinstance(listed, list) and 0 < len(listed) <= MOST_PLACES:
        return listed
    findings.add(
        (*key, PLACES),
        f"is neither a list nor a table of 1 to {MOST_PLACES} places; write for example "
        'places = [["10 mm", "0 mm", "0 mm"], ["-10 mm", "0 mm", "0 mm"]]',
    )
    return []


def _place_key(common: TomlTable, key: KeyPath, findings: Findings) -> KeyPath:
    """Where a place goes: ``at`` of a component or joint, the centre of the shape of an interface or a patch."""
    if len(key) == 2:
        if "at" in common:
            findings.add((*key, "at"), "is not allowed with places; write one of them")
        return ("at",)
    shapes = [shape for shape in CENTERED_SHAPES if isinstance(common.get(shape), dict)]
    if len(shapes) != 1:
        findings.add(
            (*key, PLACES),
            f"are centres of one of {', '.join(CENTERED_SHAPES)}; write its size too, for example "
            'rect = { size = ["50 mm", "30 mm"] }',
        )
        return ("rect", "center")
    if isinstance(shape := common[shapes[0]], dict) and "center" in shape:
        findings.add((*key, shapes[0], "center"), "is not allowed with places; write one of them")
    return (shapes[0], "center")


def _list_carriages(entry: TomlTable, key: KeyPath, findings: Findings) -> list[TomlValue]:
    """Places of carriages on parallel rails: rail by rail, from the positive side to the negative."""
    table = validate_part(CarriagesTable, entry[CARRIAGES], (*key, CARRIAGES), findings)
    axis, normal = (str(entry.get(name, "")).lstrip("+-") for name in ("axis", "normal"))
    if {axis, normal} - set(AXES):
        findings.add(
            (*key, CARRIAGES),
            "needs axis and normal of the joint along x, y or z; write the rail's direction and that "
            'of the carriage\'s feet, such as axis = "x" and normal = "z"',
        )
        return []
    if table is None:
        return []
    if max(table.rails, table.per_rail) > MOST_CARRIAGES:
        findings.add(
            (*key, CARRIAGES), f"takes numbers from 1 to {MOST_CARRIAGES} for rails and per_rail"
        )
        return []
    # of a normal along the axis, which the joint reports, either of two
    third = min(AXES.keys() - {axis, normal})
    # as decimals: places are written with the digits that a scene would have
    along, across = (Decimal(repr(length)) for length in (table.along, table.across))
    places: list[TomlValue] = []
    for rail in range(table.rails):
        for carriage in range(table.per_rail):
            position = [Decimal(repr(length)) for length in table.middle]
            position[AXES[axis]] += along * (Decimal(table.per_rail - 1) / 2 - carriage)
            position[AXES[third]] += across * (Decimal(table.rails - 1) / 2 - rail)
            places.append([f"{value} m" for value in position])
    return places


def _read_each(
    entry: TomlTable, key: KeyPath, names: Sequence[str], findings: Findings
) -> dict[str, list[tuple[KeyPath, TomlValue]]]:
    """What is different at some places: by their names, keys and values."""
    exceptions: dict[str, list[tuple[KeyPath, TomlValue]]] = {}
    each = entry.get(EACH, {})
    for name, table in each.items() if isinstance(each, dict) else ():
        if name not in names or not isinstance(table, dict):
            findings.add((*key, EACH, name), suggest_names(name, names, what="places"))
            continue
        exceptions[name] = [(split_dotted(path), value) for path, value in table.items()]
        for path, _ in [item for item in exceptions[name] if len(item[0]) > MAX_DEPTH]:
            findings.add(
                (*key, EACH, name), f"has a key of {len(path)} parts; write one that exists"
            )
            del exceptions[name]
            break
    return exceptions


def split_dotted(text: str) -> KeyPath:
    """``at.2`` as a path."""
    return tuple(int(part) if part.isdecimal() else part for part in text.split("."))


def _numbered(value: TomlValue, name: str, *, rail: int) -> TomlTable:
    """A copy with the name of the place and the number of its rail in all texts."""

    def fill(item: TomlValue) -> TomlValue:
        if isinstance(item, dict):
            return {name: fill(inner) for name, inner in item.items()}
        if isinstance(item, list):
            return [fill(inner) for inner in item]
        if isinstance(item, str):
            return item.replace("{n}", name).replace("{rail}", str(rail))
        return item

    filled = fill(value)
    return filled if isinstance(filled, dict) else {}


def replaced(place: TomlValue, path: KeyPath, value: TomlValue) -> TomlValue:
    """Part of a scene with another value at a path, copied along the path only: many variants of a
    large scene share the rest.
    """
    if not path:
        return value
    if isinstance(place, list):
        return [
            replaced(item, path[1:], value) if number == path[0] else item
            for number, item in enumerate(place)
        ]
    table, key = place if isinstance(place, dict) else {}, str(path[0])
    return table | {key: replaced(table.get(key, {}), path[1:], value)}


def _with(place: TomlTable, path: KeyPath, value: TomlValue) -> TomlTable:
    result = replaced(place, path, value)
    return result if isinstance(result, dict) else {}


CHAINS = "chains"


def _expand_chains(full: TomlTable, findings: Findings) -> None:
    """Add the components and joints of every chain to those of a scene; what is wrong with a chain
    is left to the schema.

    Args:
        full: A scene with calculated values.
        findings: Receives problems, and where each entry was written.
    """
    chains = full.get(CHAINS)
    for name, chain in chains.items() if isinstance(chains, dict) else ():
        try:
            table = ChainTable.model_validate(chain)
        except ValidationError:
            continue
        if not isinstance(chain, dict):
            continue
        for section, made in _list_parts(name, chain, table).items():
            entries = full.get(section, {})
            if not isinstance(entries, dict):
                continue
            for member in made.keys() & entries.keys():
                findings.add(
                    (section, member),
                    f"chains.{name} makes an entry of this name too; rename one of them",
                )
            for member in made:
                findings.written_at[(section, member)] = (CHAINS, name)
            full[section] = entries | made


def list_members(tables: TomlTable) -> dict[str, list[str]]:
    """Names of the components and joints that the chains of a scene make, as far as they can be
    told.
    """
    members: dict[str, list[str]] = {"components": [], "joints": []}
    chains = tables.get(CHAINS)
    for name, chain in chains.items() if isinstance(chains, dict) else ():
        for section, key, form in (
            ("components", "masses", "{}_{}"),
            ("joints", "stiffness", "{}_spring_{}"),
        ):
            written = chain.get(key) if isinstance(chain, dict) else None
            count = len(written) if isinstance(written, list) else 0
            members[section] += [form.format(name, number + 1) for number in range(count)]
    return members


def _list_parts(name: str, chain: TomlTable, table: ChainTable) -> dict[str, TomlTable]:
    """Components and joints as a scene has them: prismatic joints between masses, which leave each
    the one motion, and a spring to the other end.
    """
    written = chain["stiffness"], chain["masses"], chain.get("damping")
    springs, masses, dampers = (value if isinstance(value, list) else [] for value in written)
    shared: TomlTable = {key: chain[key] for key in ("axis", "loss_factor") if key in chain}
    components: TomlTable = {}
    joints: TomlTable = {}
    before = chain["from"]
    for number, stiffness in enumerate(springs):
        last = number == len(masses)
        mass = f"{name}_{number + 1}"
        end = chain["to"] if last else f"{mass}.{CENTER_FACE}"
        if not last:
            placed = {} if table.at is None else {"at": chain["at"]}
            components[mass] = {"solid": {"point_mass": masses[number]}, **placed}
        joints[f"{name}_spring_{number + 1}"] = {
            "between": [before, end],
            "kind": "spring" if last else "prismatic",
            "stiffness": {"x": stiffness},
            **({"damping": {"x": dampers[number]}} if dampers else {}),
            **shared,
        }
        before = end
    return {"components": components, "joints": joints}
