"""What the JSON schemas accept and refuse, by a standard validator: editors must not underline what
the program takes.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from headstock.app.actions.schemas import _targets_schema, scene_schema
from headstock.app.command_line import main
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
    *sorted(set((ROOT / "machines").glob("*.toml")) - set(TARGETS)),
    *sorted({*(ROOT / "tests" / "data").glob("*.toml")} - {ROOT / "tests/data/questions.toml"}),
]
BAD = tomllib.loads((DATA / "refused" / "bad_scenes.toml").read_text())
# whole scenes in documents: blocks of TOML with materials, and files that a shell block writes
WHOLE = re.compile(
    r"```toml\n((?:(?!```).)*?^\[materials(?:(?!```).)*?)```|\.toml <<'EOF'\n(.*?)^EOF$",
    re.DOTALL | re.MULTILINE,
)
DOCUMENTED = [
    (path.name, match[1] or match[2])
    for path in sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
    for match in WHOLE.finditer(path.read_text())
]


@pytest.fixture(scope="module")
def scenes() -> Any:
    schema = scene_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.fixture(scope="module")
def targets() -> Any:
    schema = _targets_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def faults(validator: Any, text: str) -> list[str]:
    return [
        f"{error.json_path}: {error.message}"
        for error in validator.iter_errors(tomllib.loads(text))
    ]


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


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.name)
def test_a_scene_that_ships_fits_the_schema(scenes: Any, path: Path) -> None:
    assert faults(scenes, path.read_text()) == []


@pytest.mark.parametrize(("document", "text"), DOCUMENTED, ids=[name for name, _ in DOCUMENTED])
def test_a_scene_of_the_documents_fits_the_schema(scenes: Any, document: str, text: str) -> None:
    assert faults(scenes, text) == []


@pytest.mark.parametrize("path", TARGETS, ids=lambda path: path.name)
def test_a_target_file_that_ships_fits_its_schema(targets: Any, path: Path) -> None:
    assert faults(targets, path.read_text()) == []


def test_a_new_scene_names_a_schema_that_lies_beside_it_and_that_it_fits(tmp_path: Path) -> None:
    assert main(["new", str(tmp_path / "mill")]) == 0
    text = (tmp_path / "mill" / "mill.toml").read_text()
    named = re.match(r"#:schema (\S+)\n", text)
    assert named is not None
    found = jsonschema.Draft202012Validator(scene_schema())
    assert (tmp_path / "mill" / named[1]).read_text().strip().startswith("{")
    assert faults(found, text) == []


GOOD = (DATA / "good_scene.toml").read_text()
# the others are wrong in their geometry, in a file, or between tables: no schema can know it
SEEN = [
    "unknown key",
    "unknown section",
    "unknown nested key",
    "missing key",
    "wrong unit",
    "no unit",
    "force as a length",
    "inf",
    "complex",
    "incompressible",
    "below minus one",
    "locking",
    "text for a number",
    "negative density",
    "zero density",
    "zero modulus",
    "zero size",
    "two sizes",
    "two shapes",
    "no shape",
    "empty patch",
    "interface without patch",
    "bad name",
    "not an end",
    "unknown joint kind",
    "stiffness the kind has not",
    "required stiffness missing",
    "guide without axis",
    "no direction",
    "span of two",
    "sweep of nothing",
    "sweep over a grid and a list",
    "unknown analysis",
    "count and frequency",
    "spread as a word",
    "fractional count",
    "zero count",
    "unknown effect",
    "gravity as a force",
    "study that varies nothing",
    "unnamed section",
    "gain in hertz",
    "dead time twice",
    "gain without a unit",
    "control as a number",
    "accuracy with a unit",
    "growth of a mesh out of reach",
]


@pytest.mark.parametrize("name", SEEN)
def test_a_bad_scene_that_a_schema_can_know_is_refused_by_it(scenes: Any, name: str) -> None:
    text = GOOD.replace(BAD[name]["old"], BAD[name]["new"])
    assert faults(scenes, text) != []


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_joint_takes_the_keys_of_its_kind_only(scenes: Any, kind: str) -> None:
    rule = KINDS[kind]
    directions = 'axis = "x"\nnormal = "z"\n'
    stiffness = ", ".join(
        f'{key} = "1 N/m"' if max(dofs) < 3 else f'{key} = "1 N m/rad"'
        for key, dofs in rule.keys.items()
    )
    scene = f'[joints.j]\nbetween = ["a.b", "ground"]\nkind = "{kind}"\n{directions}stiffness = {{ KEYS }}\n'
    assert faults(scenes, scene.replace("KEYS", stiffness)) == []
    assert (
        faults(
            scenes, scene.replace("KEYS", f'{stiffness}{", " if stiffness else ""}wobble = "1 N/m"')
        )
        != []
    )


def test_an_element_of_the_catalogue_brings_what_is_required(scenes: Any) -> None:
    guide = '[joints.j]\nbetween = ["a.b", "ground"]\naxis = "x"\nfrom = "catalogue:guide_35"\n'
    assert faults(scenes, guide) == []
    assert faults(scenes, guide + 'stiffness = { normal = "1 N/m" }') == []
    assert faults(scenes, guide + 'kind = "linear_guide"') == []
    assert faults(scenes, guide + 'stiffness = { axial = "1 N/m" }') != []
    assert faults(scenes, guide.replace('axis = "x"\n', "")) != []
    assert faults(scenes, guide.replace("guide_35", "guide_36")) != []
    assert faults(scenes, guide.replace("catalogue:guide_35", "= pads")) == []
    assert faults(scenes, guide.replace('from = "catalogue:guide_35"', "")) != []
    drive = guide.replace("guide_35", "ball_screw_40x10")
    assert faults(scenes, drive + 'screw = { bearing = "catalogue:screw_bearing_30" }') == []
    assert faults(scenes, drive + 'screw = { bearing = "catalogue:guide_30" }') != []
    own = 'kind = "ball_screw"\nstiffness = { axial = "1 N/m" }\n'
    own = guide.replace('from = "catalogue:guide_35"\n', own)
    assert faults(scenes, own + 'screw = { from = "catalogue:ball_screw_40x10" }') == []
    assert faults(scenes, own + 'screw = { lead = "10 mm" }') != []


@pytest.mark.parametrize("dimension", DIMENSIONS, ids=lambda dimension: dimension.name)
def test_every_example_of_a_quantity_fits_its_pattern(dimension: Dimension) -> None:
    assert re.search(quantity_pattern(dimension), dimension.example)


@pytest.mark.parametrize(
    "text",
    [
        "250 mm",
        "250mm",
        "1e-3 m",
        ".5 in",
        "5. km",
        "+3 µm",
        "3 μm",
        "12 cm",
        "1 inch",
        "  7 mm  ",
        "1 m^2/m",
        "2 mm²/m",
    ],
)
def test_a_pattern_takes_what_is_read(text: str) -> None:
    assert parse_quantity(text, LENGTH).dimension is LENGTH
    assert re.search(quantity_pattern(LENGTH), text)


@pytest.mark.parametrize(
    "text",
    [
        "120 MPaa",
        "210 GN",
        "210",
        "GPa",
        "1,5 GPa",
        "nan GPa",
        "2 GPa 3",
        "",
        "0x10 Pa",
        "2 G Pa",
        "1 kN/mmm^2",
    ],
)
def test_a_pattern_refuses_what_is_no_pressure(text: str) -> None:
    with pytest.raises(UnitError):
        parse_quantity(text, PRESSURE)
    assert not re.search(quantity_pattern(PRESSURE), text)
