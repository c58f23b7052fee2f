"""What the JSON schemas accept and refuse, by a standard validator: editors must not underline what
the program takes.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from common import SHIPPED, Shell, present
from headstock.app.actions.schemas import _targets_schema, scene_schema
from headstock.scene.building.joints import KINDS
from headstock.scene.reading.units import (
    DIMENSIONS,
    LENGTH,
    PRESSURE,
    Dimension,
    UnitError,
    parse_quantity,
    quantity_pattern,
)

jsonschema = pytest.importorskip(
    "jsonschema", reason="environment/tests.txt could not be installed"
)

ROOT = Path(__file__).resolve().parents[3]
DATA = Path(__file__).parents[2] / "data"
TARGETS = sorted((ROOT / "machines").glob("*_targets.toml"))
SCENES = [
    *SHIPPED,
    *sorted({*(ROOT / "tests" / "data").glob("*.toml")} - {ROOT / "tests/data/questions.toml"}),
]
BAD = tomllib.loads((DATA / "refused" / "bad_scenes.toml").read_text())
# whole scenes in documents: blocks of TOML with materials, and files that a shell block writes, with what
# the next one adds to it
ADDED = re.compile(r"^EOF\n(?:(?!^EOF$).)*?>> \S*\.toml <<'EOF'\n", re.DOTALL | re.MULTILINE)
WHOLE = re.compile(
    r"```toml\n((?:(?!```).)*?^\[materials(?:(?!```).)*?)```|\.toml <<'EOF'\n(.*?)^EOF$",
    re.DOTALL | re.MULTILINE,
)
DOCUMENTED = [
    (path.name, match[1] or match[2])
    for path in sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
    for match in WHOLE.finditer(ADDED.sub("", path.read_text()))
]


def validator(schema: Any) -> Any:
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.fixture(scope="module")
def scenes() -> Any:
    return validator(scene_schema())


def faults(validator: Any, text: str) -> list[str]:
    errors = validator.iter_errors(tomllib.loads(text))
    return [f"{error.json_path}: {error.message}" for error in errors]


def rules_with_defaults(rule: Any) -> Iterator[dict[str, Any]]:
    if isinstance(rule, list):
        for item in rule:
            yield from rules_with_defaults(item)
    elif isinstance(rule, dict):
        if "default" in rule and "anyOf" in rule:
            yield rule
        for key, inner in rule.items():
            if key != "default":
                yield from rules_with_defaults(inner)


def test_a_default_that_an_editor_offers_is_one_that_the_key_takes(scenes: Any) -> None:
    rules = list(rules_with_defaults(scenes.schema))
    assert len(rules) > 90
    # what a rule refers to lies in the whole schema
    whole = {key: scenes.schema[key] for key in ("$schema", "$defs")}
    checks = [(jsonschema.Draft202012Validator({**whole, **rule}), rule) for rule in rules]
    assert [rule for check, rule in checks if not check.is_valid(rule["default"])] == []


TEXTS = {path.name: path.read_text() for path in SCENES}
TEXTS |= {f"{number} of {name}": text for number, (name, text) in enumerate(DOCUMENTED)}


@pytest.mark.parametrize("name", TEXTS)
def test_a_scene_that_ships_or_is_documented_fits_the_schema(scenes: Any, name: str) -> None:
    assert faults(scenes, TEXTS[name]) == []


@pytest.mark.parametrize("path", TARGETS, ids=lambda path: path.name)
def test_a_target_file_that_ships_fits_its_schema(path: Path) -> None:
    assert faults(validator(_targets_schema()), path.read_text()) == []


def test_a_new_scene_names_a_schema_that_lies_beside_it_and_that_it_fits(
    scenes: Any, shell: Shell
) -> None:
    shell("new mill")
    text = shell.text("mill/mill.toml")
    named = present(re.match(r"#:schema (\S+)\n", text))
    assert shell.text(f"mill/{named[1]}").strip().startswith("{")
    assert faults(scenes, text) == []


GOOD = (DATA / "good_scene.toml").read_text()
# the others are wrong in their geometry, in a file, or between tables: no schema can know it
SEEN = re.split(
    r",\s+",
    """unknown key, unknown section, unknown nested key, missing key, wrong unit, no unit,
force as a length, inf, complex, incompressible, below minus one, locking,
text for a number, negative density, zero density, zero modulus, zero size, two sizes,
two shapes, no shape, empty patch, interface without patch, bad name, not an end,
unknown joint kind, stiffness the kind has not, required stiffness missing,
guide without axis, no direction, span of two, sweep of nothing,
sweep over a grid and a list, unknown analysis, count and frequency, spread as a word,
fractional count, zero count, unknown effect, gravity as a force, study that varies nothing,
unnamed section, gain in hertz, dead time twice, gain without a unit, control as a number,
accuracy with a unit, growth of a mesh out of reach""",
)


@pytest.mark.parametrize("name", SEEN)
def test_a_bad_scene_that_a_schema_can_know_is_refused_by_it(scenes: Any, name: str) -> None:
    text = GOOD.replace(BAD[name]["old"], BAD[name]["new"])
    assert faults(scenes, text) != []


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_joint_takes_the_keys_of_its_kind_only(scenes: Any, kind: str) -> None:
    rule = KINDS[kind]
    directions = 'axis = "x"\nnormal = "z"\n'
    keys = [
        f'{key} = "1 N/m"' if max(dofs) < 3 else f'{key} = "1 N m/rad"'
        for key, dofs in rule.keys.items()
    ]
    scene = f'[joints.j]\nbetween = ["a.b", "ground"]\nkind = "{kind}"\n{directions}stiffness = {{ KEYS }}\n'
    assert faults(scenes, scene.replace("KEYS", ", ".join(keys))) == []
    assert faults(scenes, scene.replace("KEYS", ", ".join([*keys, 'wobble = "1 N/m"']))) != []


GUIDE = '[joints.j]\nbetween = ["a.b", "ground"]\naxis = "x"\nfrom = "catalogue:guide_35"\n'
FROM = 'from = "catalogue:guide_35"'
DRIVE = GUIDE.replace("guide_35", "ball_screw_40x10")
OWN = GUIDE.replace(FROM, 'kind = "ball_screw"\nstiffness = { axial = "1 N/m" }')


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        (GUIDE, True),
        (GUIDE + 'stiffness = { normal = "1 N/m" }', True),
        (GUIDE + 'kind = "linear_guide"', True),
        (GUIDE + 'stiffness = { axial = "1 N/m" }', False),
        (GUIDE.replace('axis = "x"\n', ""), False),
        (GUIDE.replace("guide_35", "guide_36"), False),
        (GUIDE.replace("catalogue:guide_35", "= pads"), True),
        (GUIDE.replace(FROM, ""), False),
        (DRIVE + 'screw = { bearing = "catalogue:screw_bearing_30" }', True),
        (DRIVE + 'screw = { bearing = "catalogue:guide_30" }', False),
        (OWN + 'screw = { from = "catalogue:ball_screw_40x10" }', True),
        (OWN + 'screw = { lead = "10 mm" }', False),
    ],
)
def test_an_element_of_the_catalogue_brings_what_is_required(
    scenes: Any, text: str, fits: bool
) -> None:
    assert (faults(scenes, text) == []) == fits


@pytest.mark.parametrize("dimension", DIMENSIONS, ids=lambda dimension: dimension.name)
def test_every_example_of_a_quantity_fits_its_pattern(dimension: Dimension) -> None:
    assert re.search(quantity_pattern(dimension), dimension.example)


LENGTHS = "250 mm|250mm|1e-3 m|.5 in|5. km|+3 µm|3 μm|12 cm|1 inch|  7 mm  |1 m^2/m|2 mm²/m"
NO_PRESSURES = "120 MPaa|210 GN|210|GPa|1,5 GPa|nan GPa|2 GPa 3||0x10 Pa|2 G Pa|1 kN/mmm^2"


@pytest.mark.parametrize("text", LENGTHS.split("|"))
def test_a_pattern_takes_what_is_read(text: str) -> None:
    assert parse_quantity(text, LENGTH).dimension is LENGTH
    assert re.search(quantity_pattern(LENGTH), text)


@pytest.mark.parametrize("text", NO_PRESSURES.split("|"))
def test_a_pattern_refuses_what_is_no_pressure(text: str) -> None:
    with pytest.raises(UnitError):
        parse_quantity(text, PRESSURE)
    assert not re.search(quantity_pattern(PRESSURE), text)
