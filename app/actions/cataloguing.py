"""``headstock catalogue``: typical machine elements, with what a joint gets of them, and cutting
coefficients of usual work materials.
"""

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

import click

from headstock.app.commands.tool_commands import CatalogueOptions
from headstock.app.terminal.console import add_row, make_console, make_table, print_table
from headstock.pipeline.storage.json_texts import dump_json
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.scene.building.joints import KINDS
from headstock.scene.expansion.catalogue import (
    CATALOGUE,
    FROM,
    CatalogueEntry,
    CuttingMaterial,
    nearest_names,
    read_catalogue,
    read_cutting_materials,
)
from headstock.scene.reading.files import TomlTable, write_value
from headstock.scene.schema.cutting import TYPICAL_RANGES, TYPICAL_RATIOS

INTRODUCTION = """\
# Catalogue: stiffness of guides, screws, bearings and mounts

*Which stiffness has a linear guide, a ball screw, a bearing, a mount that is not chosen yet?*

Made from the data by `./headstock catalogue --markdown > docs/catalogue.md`; a test asserts that it is up to date.

```toml
[joints.x_pad]
from = "catalogue:guide_35"
between = ["slide.bottom", "bed.top"]
axis = "x"
normal = "z"
places = [["100 mm", "80 mm", "0 mm"], ["-100 mm", "80 mm", "0 mm"]]
stiffness.lateral = "300 N/um"          # own keys override those of the catalogue

[joints.x_drive]
from = "catalogue:ball_screw_40x10"     # nut, and the shaft's diameter and lead
between = ["slide.nut", "bed.bearing"]
axis = "x"
screw = { bearing = "catalogue:screw_bearing_30" }
```

- `from` brings `kind`, `stiffness`, `loss_factor` and, of a ball screw, `screw`. `bearing` and `second_bearing` of a screw may name a bearing.
  `screw = { from = "catalogue:ball_screw_40x10" }` is the shaft alone.
- The values are keys like all others, for `--set`, `vary` and `identify`; a variant may take another element:
  `"joints.x_pad.from" = "catalogue:guide_45"`.
- `check`, `run` and the report name what comes from the catalogue and how uncertain it is.
- Loss factors count with the effect `damping`. Directions are those of the [kind of joint](scene_reference.md#kinds-of-joints).
- `./headstock catalogue` lists all elements; `./headstock catalogue guide_35` shows one with its keys, to be pasted and edited.

The values are round ones for a first model. Each follows from a rule, which is stated; no number is from a maker's table. A real element
lies within the value divided and multiplied by the factor in its range. Once the compliance budget shows that a joint matters, take its
maker's data or measure it ([identification](identification.md)). Bolts, housings and thin walls around the element come on top.
"""


CUTTING = "cutting"  # the name of all work materials together
CUTTING_PAGE = """\
# Cutting coefficients

*What are the cutting coefficients of steel, aluminium, cast iron, titanium?* Name a material of the tables below, or write your own. Lobes,
paths and contours use the same; `./headstock catalogue c45` prints one with its source.

```toml
[cutting.my_steel]                      # measured in milling
Ktc = "1800 N/mm^2"                     # tangential, of the chip
Krc = "600 N/mm^2"                      # radial
Kac = "300 N/mm^2"                      # axial
Kte = "30 N/mm"                         # of the edge; Kre and Kae alike
ranges = { Ktc = "10 %", Krc = "20 %" } # goes into ±

[cutting.my_iron]                       # Kienzle
kc11 = "1200 N/mm^2"
mc = 0.25
radial_ratio = 0.4                      # of the tangential force

[analyses.lobes]
speeds = ["3000 rpm", "15000 rpm", 400]
mill = { diameter = "12 mm", teeth = 4, helix = "30 deg" }
radial_depth = "6 mm"
material = "my_iron"                    # or of the tables: "c45"
feed_per_tooth = "0.08 mm"
sense = "up"
```

- **Signs.** The tangential force acts against the motion of the edge, the radial one away from the chip, the axial one down where it is
  positive. A negative `Krc` or `Kre` brings a warning: the radial force draws the edge into the part only where the rake exceeds the angle of
  friction.
- **Kienzle.** The force per width is `kc1.1 h^(1 - mc)`, with `h` in millimetres; its tangent at one chip thickness counts. Paths and
  contours know that thickness; lobes take `feed_per_tooth`, without it 0.1 mm ± 50 % is assumed.
- **Radial and axial forces.** Where a source gives the tangential force alone, the others are ratios of it: {radial}, {axial}.
- **Range.** Terminal, report and `assumptions` in `summary.json` name coefficients that have a range. Every range is tried; the changes are
  the share *cutting coefficients* of ±.
- **Sense and side.** Milling down (climb), a clockwise tool has the part on the right of its travel; milling up, on the left. `part_side`
  says otherwise.

Rake, wear, coolant and speed change forces by tens of per cent. Once limits matter, measure: mean forces in slots at several feeds give all
six coefficients (Altintas 2012, section 2.8).
{groups}
"""


def catalogue_command(options: CatalogueOptions) -> int:
    """Print the catalogue, a family or one element.

    Raises:
        click.UsageError: There is no element, family or work material of the name.
    """
    materials = _choose_materials(options.name)
    if materials:
        return _list_materials(materials, options)
    entries = _choose(options.name)
    if options.markdown:
        click.echo(_render_catalogue(read_catalogue().values()), nl=False)
    elif len(entries) == 1:
        click.echo("\n".join(_describe(entries[0])))
    else:
        _print_families(entries)
    options.write_json(dump_json([_summarise_entry(entry) for entry in entries]))
    return 0


def _choose_materials(name: str | None) -> list[CuttingMaterial]:
    known = read_cutting_materials()
    return [*known.values()] if name == CUTTING else [known[name]] if name in known else []


def _list_materials(materials: Sequence[CuttingMaterial], options: CatalogueOptions) -> int:
    if options.markdown:
        click.echo(_render_cutting(materials), nl=False)
    else:
        for material in materials:
            click.echo(f"{material.name}: {material.title}")
            numbers = catalogue_coefficients(material.name).describe()
            click.echo("\n".join(_indented([numbers, f"source: {material.source}"])))
        if len(materials) == 1:
            click.echo(f"\nWith its values:\n\n{_paste_material(materials[0])}")
    summaries = [
        {
            "name": material.name,
            "title": material.title,
            "source": material.source,
            "toml": _paste_material(material),
        }
        for material in materials
    ]
    options.write_json(dump_json(summaries))
    return 0


def _paste_material(material: CuttingMaterial) -> str:
    """A material of a scene with all its keys."""
    lines = [f"{key} = {write_value(value)}" for key, value in material.keys.items()]
    return "\n".join(["[cutting.NAME]", *lines])


def _render_cutting(materials: Iterable[CuttingMaterial]) -> str:
    """``docs/cutting_coefficients.md``."""
    groups = list[str]()
    for title, members in groupby(materials, key=lambda own: own.group):
        own = list(members)
        columns = list(dict.fromkeys(key for each in own for key in each.table.values))
        heads = " | ".join(f"{key}{_unit_in_head(key)}" for key in columns)
        ranges = ", ".join(f"{key} ± {value}" for key, value in own[0].ranges.items())
        groups += [
            f"\n## {title}\n",
            f"| `material` | what it is | {heads} |",
            f"|---|---|{'---:|' * len(columns)}",
            *(
                f"| `{each.name}` | {each.title} | {' | '.join(_show_key(each, key) for key in columns)} |"
                for each in own
            ),
            "",
            *(f"- {source}." for source in dict.fromkeys(each.source for each in own)),
            *([f"- Range, assumed: {ranges}."] if ranges else []),
        ]
    ratios = {
        key.partition("_")[0]: f"{value:g} ± {100.0 * TYPICAL_RANGES[key]:g} %"
        for key, value in TYPICAL_RATIOS.items()
    }
    page = CUTTING_PAGE.replace("{groups}", "\n".join(groups))
    for word, text in ratios.items():
        page = page.replace(f"{{{word}}}", f"{word} {text}")
    return page.rstrip() + "\n"


def _unit_in_head(key: str) -> str:
    if key == "mc":
        return ""
    return " [N/mm]" if key.endswith("e") else " [N/mm^2]"


def _show_key(material: CuttingMaterial, key: str) -> str:
    return str(material.keys.get(key, "–")).partition(" ")[0]


def _choose(name: str | None) -> list[CatalogueEntry]:
    known = read_catalogue()
    wanted = (name or "").removeprefix(CATALOGUE)
    found = [
        entry for entry in known.values() if name is None or wanted in (entry.name, entry.stem)
    ]
    if not found:
        raise click.UsageError(
            f"there is no {wanted[:80]!r} in the catalogue; {nearest_names(wanted)}"
        )
    return found


def _families(entries: Iterable[CatalogueEntry]) -> Iterator[list[CatalogueEntry]]:
    for _, members in groupby(entries, key=lambda entry: entry.stem):
        yield list(members)


def _columns(entry: CatalogueEntry) -> list[str]:
    """Keys of a joint that a family has values for."""
    return [f"{table}.{key}" for table in ("stiffness", "screw") for key in _table(entry, table)]


def _table(entry: CatalogueEntry, key: str) -> TomlTable:
    table = entry.joint.get(key, {})
    return table if isinstance(table, dict) else {}


def _cells(entry: CatalogueEntry, columns: Sequence[str]) -> list[str]:
    pairs = [column.partition(".") for column in columns]
    return [entry.name, *(str(_table(entry, table)[key]) for table, _, key in pairs)]


def _print_families(entries: Iterable[CatalogueEntry]) -> None:
    console = make_console()
    for members in _families(entries):
        first = members[0]
        columns = _columns(first)
        table = make_table("name", *(f">{column.rpartition('.')[2]}" for column in columns))
        for entry in members:
            add_row(table, *_cells(entry, columns))
        print_table(console, f"{first.family.title} ({first.family.kind})", table)
        click.echo("\n".join(_indented(_facts(first))) + "\n")


def _facts(entry: CatalogueEntry) -> list[str]:
    """What all sizes of a family have in common."""
    family = entry.family
    return [
        f"in the name: {family.size}",
        f"range: {entry.uncertainty()}; typical loss factor {family.loss_factor:g}",
        f"preload: {family.preload}",
        f"values: {family.derived}",
        *(f"source: {source}" for source in family.source),
    ]


def _indented(lines: Iterable[str]) -> Iterator[str]:
    for line in lines:
        yield textwrap.fill(line, 98, initial_indent="  ", subsequent_indent="    ")


def _describe(entry: CatalogueEntry) -> Iterator[str]:
    """One element, with what to write."""
    family = entry.family
    yield f"{entry.name}: {family.title} ({family.kind})"
    for key, text in _table(entry, "stiffness").items():
        rotational = KINDS[family.kind].keys[key][0] >= 3
        factor = (family.rotation_factor if rotational else None) or family.factor
        yield f"  {key}: {text}, from {_scaled(text, 1.0 / factor)} to {_scaled(text, factor)}"
    for key, text in _table(entry, "screw").items():
        yield f"  screw {key}: {text}"
    yield from _indented(_facts(entry))
    yield from ["", "By its name:", "", *_toml(entry, {FROM: f"{CATALOGUE}{entry.name}"})]
    yield from ["", "With its values:", "", _paste_text(entry)]


def _scaled(text: object, factor: float) -> str:
    """A quantity times a factor, to two figures in its own unit."""
    number, _, unit = str(text).partition(" ")
    return f"{float(f'{float(number) * factor:.2g}'):g} {unit}"


def _paste_text(entry: CatalogueEntry) -> str:
    """A joint of a scene with all keys of an element."""
    return "\n".join(_toml(entry, entry.joint))


def _toml(entry: CatalogueEntry, keys: TomlTable) -> Iterator[str]:
    yield "[joints.NAME]"
    yield 'between = ["COMPONENT.INTERFACE", "COMPONENT.INTERFACE"]'
    if KINDS[entry.family.kind].needs_axis:
        yield 'axis = "x"'
    for key, value in keys.items():
        yield f"{key} = {write_value(value)}"


def _summarise_entry(entry: CatalogueEntry) -> dict[str, object]:
    """An element for other programs."""
    family = entry.family
    return {
        "name": entry.name,
        "title": family.title,
        "kind": family.kind,
        "size": family.size,
        "stiffness": {key: str(text) for key, text in _table(entry, "stiffness").items()},
        "screw": {key: str(text) for key, text in _table(entry, "screw").items()},
        "stiffness_factor": family.factor,
        "rotation_factor": family.rotation_factor or family.factor,
        "loss_factor": family.loss_factor,
        "loss_factor_range": list(family.loss_factor_range),
        "preload": family.preload,
        "derived": family.derived,
        "source": list(family.source),
        "toml": _paste_text(entry),
    }


def _render_catalogue(entries: Iterable[CatalogueEntry]) -> str:
    """``docs/catalogue.md``."""
    parts = [INTRODUCTION]
    for members in _families(entries):
        first = members[0]
        columns = _columns(first)
        heads = [column.rpartition(".")[2] for column in columns]
        parts += [
            f"## {first.family.title[0].upper()}{first.family.title[1:]}",
            "",
            f"| `{first.family.kind}` | {' | '.join(heads)} |",
            f"|---|{'---:|' * len(heads)}",
        ]
        for entry in members:
            name, *values = _cells(entry, columns)
            parts.append(f"| `{name}` | {' | '.join(values)} |")
        parts += ["", *(f"- {line}" for line in _facts(first)), ""]
    return "\n".join(parts).rstrip() + "\n"
