"""Included files: the scene they make, the names they get, what is refused and where."""

import re
import time
from pathlib import Path

import pytest

from headstock.machine import Machine
from headstock.pipeline.storage.provenance import SceneChoice, trace_content
from headstock.scene.building.loader import load_scene, read_tables
from headstock.scene.expansion.includes import scene_content
from headstock.scene.expansion.overrides import apply_settings
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings, SceneError
from headstock.studies.parameters.runs import hash_scene

PART = """
[parameters]
t = "20 mm"
long = "= 3 * t + @gap"
stack = ["= t", { inner = "= 2 * long" }]
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.$body]
solid = { box = ["= t", "100 mm", "= long"] }
material = "steel"
interfaces = { foot = { face = "z-" }, head = { face = "z+" } }
[components.$slide]
solid = { box = ["= t", "= t", "= t"] }
material = "@iron"
fidelity = "rigid"
places = { near = ["0 mm", "0 mm", "100 mm"], far = ["0 mm", "0 mm", "300 mm"] }
interfaces = { back = { face = "x-" }, nut = { face = "x+" } }
[joints.guide]
between = ["$slide_{n}.back", "$body.head"]
kind = "spring"
stiffness = { x = "9 N/um", y = "= 9 N/um * t / [1 mm]", z = "9 N/um" }
places = { near = ["0 mm", "0 mm", "0 mm"], far = ["0 mm", "1 mm", "0 mm"] }
each.far = { "between.1" = "$body.foot", "stiffness.x" = "= 7 N/um" }
[joints.feed]
between = ["$slide_near.nut", "@base.top"]
kind = "ball_screw"
axis = "z"
screw = { diameter = "= t", floating_end = "$body.head" }
[joints.hold]
between = ["ground", "$body.foot"]
kind = "rigid"
[points.tip]
tool = "$slide_far.nut"
work = "ground"
[axes.Z]
joints = ["guide", "feed"]
moves = "$slide_near"
[supports.rest]
face = "$body.z-"
fix = ["z"]
[loads.push]
at = "$slide_near.nut"
force = ["1 N", "0 N", "0 N"]
[loads.weight]
component = "$body"
body = ["0 m/s^2", "0 m/s^2", "= 1 m/s^2"]
[probes.mid]
component = "$body"
at = ["0 mm", "0 mm", "= t"]
[drives.Z]
axis = "Z"
joint = "feed"
scale = "tip"
inertia = "1e-3 kg m^2"
kv = "20 1/s"
velocity_gain = "2e4 N s/m"
"""
# what the same reads where all is written in one file
RENAMED = (
    ("[parameters]\nt =", "[parameters]\nA_t ="),
    ("\nlong = ", "\nA_long = "),
    ("\nstack = ", "\nA_stack = "),
    ("= t", "= A_t"),
    ("3 * t ", "3 * A_t "),
    ("um * t", "um * A_t"),
    ("= long", "= A_long"),
    ("* long", "* A_long"),
    ('"steel"', '"A_steel"'),
    ("materials.steel", "materials.A_steel"),
    ("$", "A_"),
    ("joints.", "joints.A_"),
    ('"guide", "feed"', '"A_guide", "A_feed"'),
    ('joint = "feed"', 'joint = "A_feed"'),
    ("points.tip", "points.A_tip"),
    ('"tip"', '"A_tip"'),
    ("axes.Z", "axes.A_Z"),
    ('axis = "Z"', 'axis = "A_Z"'),
    ("supports.", "supports.A_"),
    ("loads.", "loads.A_"),
    ("probes.", "probes.A_"),
    ("drives.", "drives.A_"),
    ("@", ""),
)
BLOCK = """
[components.block]
solid = { box = ["40 mm", "40 mm", "100 mm"] }
mass = "1 kg"
fidelity = "rigid"
material = "steel"
interfaces = { foot = { face = "z-" } }
[joints.hold]
between = ["ground", "block.foot"]
kind = "spring"
stiffness = { x = "9 N/um", y = "9 N/um", z = "9 N/um", rx = "9e3 N m/rad", ry = "9e3 N m/rad", rz = "9e3 N m/rad" }
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
"""
REST = '[points.tip]\ntool = "block.foot"\nwork = "ground"\n[analyses.static]\n'


def write(folder: Path, **files: str) -> Path:
    """Scene files by their stems, ``__`` for a folder; the first is the scene."""
    paths = [folder / f"{name.replace('__', '/')}.toml" for name in files]
    for path, text in zip(paths, files.values(), strict=True):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return paths[0]


def tables(path: Path) -> TomlTable:
    return read_tables(path, Findings(str(path)))


def problems(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    return str(caught.value).replace(str(path.parent), "DIR")


def test_a_prefix_reaches_every_name_of_the_file_and_no_other(tmp_path: Path) -> None:
    own = '[parameters]\ngap = "1 mm"\n'
    part = PART.replace("$", "").replace("@", "")
    scene = write(
        tmp_path,
        scene=f'include = [{{ file = "part.toml", prefix = "A_" }}]\n{own}',
        part=part,
        whole=PART,
    )
    text = PART
    for before, after in RENAMED:
        assert before in text, before
        text = text.replace(before, after)
    (tmp_path / "whole.toml").write_text(text.replace("[parameters]", own))
    assert tables(scene) == tables(tmp_path / "whole.toml")
    write(tmp_path, scene=f'include = "part.toml"\n{own}', whole=part.replace("[parameters]", own))
    assert tables(scene) == tables(tmp_path / "whole.toml")


def test_the_manual_s_files_are_the_scene_it_says(tmp_path: Path) -> None:
    manual = Path(__file__).parents[3] / "docs" / "short_scenes.md"
    cell, spindle = re.findall(r"```toml\n(.*?)```", manual.read_text(), re.DOTALL)[3:]
    path = write(tmp_path, cell=cell, parts__spindle=spindle)
    scene = load_scene(path, overrides=['parameters.left_length="250 mm"'])
    assert sorted(scene.machine.components) == ["left_spindle", "right_spindle"]
    assert scene.machine.components["left_spindle"].solid.size[2] == 0.25  # type: ignore[union-attr]
    assert scene.machine.components["right_spindle"].solid.size[2] == 0.3  # type: ignore[union-attr]
    assert sorted(scene.machine.points) == ["left_nose", "right_nose"]


def test_prefixes_and_folders_of_files_in_files_add_up(tmp_path: Path) -> None:
    part = '[components.body]\nsolid = { step = "body.step" }\n'
    path = write(
        tmp_path,
        scene='include = { file = "a/mid.toml", prefix = "out_" }',
        a__mid='include = [{ file = "../b/part.toml", prefix = "in_" }]\n'
        '[points.p]\ntool = "in_body.x"\nwork = "ground"',
        b__part=part,
    )
    read = tables(path)
    assert read["points"] == {"out_p": {"tool": "out_in_body.x", "work": "ground"}}
    assert isinstance(components := read["components"], dict)
    assert components == {"out_in_body": {"solid": {"step": "a/../b/body.step"}}}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({"s": 'include = "p.toml"', "p": "\n[analyses.modal]\n"}, ["DIR/p.toml:2: analyses"]),
        ({"s": 'include = "p.toml"', "p": "\n\na = = 1"}, ["DIR/p.toml:3", "not valid TOML"]),
        ({"s": 'include = "p.toml"', "p": "materials = 3"}, ["p.toml:1", "[materials.name]"]),
        ({"s": '\ninclude = "../p.toml"'}, ["DIR/s.toml:2", "lies outside the scene's folder"]),
        ({"s": 'include = ["q.toml"]'}, ["DIR/s.toml:1", "'q.toml' does not exist"]),
        ({"s": 'include = "p.step"'}, ["does not end in .toml"]),
        ({"s": 'include = [{ file = "p.toml", prefix = "1 " }]'}, ['"1 " is no prefix of names']),
        ({"s": 'include = [{ name = "p.toml" }]'}, ["unknown key 'name'", "known keys: file"]),
        (
            {"s": 'include = "p.toml"', "p": '\ninclude = "q.toml"', "q": 'include = "p.toml"'},
            ["DIR/q.toml:1", "includes itself: p.toml -> q.toml -> p.toml"],
        ),
        (
            {"s": f'include = "p.toml"\n{BLOCK}', "p": f"\n\n{BLOCK}"},
            [
                "DIR/p.toml:4: components.block",
                "DIR/s.toml:3 already has",
                "DIR/p.toml:10: joints.hold",
            ],
        ),
        (
            {"s": f'include = "p.toml"\n{REST}', "p": BLOCK.replace("block.foot", "block.fot")},
            ["DIR/p.toml:9: joints.hold.between[1]", "    | between = [", "foot"],
        ),
        (
            {"s": 'include = { file = "p.toml", prefix = "a" }', "p": '[parameters]\nm = 1\nb = "= 2 N/m"'},
            ["DIR/p.toml:3", "can be read in two ways at 2 N/m"],
        ),
        (
            {"s": 'include = "a.toml"', **{a: f'include = "{b}.toml"' for a, b in zip("abcdef", "bcdefg", strict=True)}, "g": ""},
            ["DIR/e.toml:1", "more than 5 deep"],
        ),
        (
            {"s": f"include = [{', '.join(['"p.toml"'] * 10)}]", "p": f"include = [{', '.join(['"q.toml"'] * 10)}]", "q": ""},
            ["DIR/p.toml:1", "more than 50 included files"],
        ),
        (
            {"s": f"include = [{', '.join(['"p.toml"'] * 5)}]", "p": "#" * 1_000_000},
            ["DIR/s.toml:1", "larger than 4 MiB"],
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_included_is_named_with_its_file_and_line(
    tmp_path: Path, files: dict[str, str], expected: list[str]
) -> None:
    said = problems(write(tmp_path, **files))
    assert [text for text in expected if text not in said] == [], said


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.toml").write_text(BLOCK)
    (tmp_path / "in").mkdir()
    path = write(tmp_path / "in", s=f'include = "p.toml"\n{REST}')
    (tmp_path / "in" / "p.toml").symlink_to(tmp_path / "secret.toml")
    assert "outside the scene's folder" in problems(path)


def test_many_numbers_in_a_text_take_no_time(tmp_path: Path) -> None:
    text = f'[components.{"a" * 60}]\n[points.p]\ntool = "{"{n}" * 60}b.x"\nwork = "a_{{n}}.x"\n'
    path = write(
        tmp_path,
        s='include = { file = "p.toml", prefix = "s_" }',
        p=f"{text}[components.a]\nplaces.left = []",
    )
    begin = time.perf_counter()
    assert tables(path)["points"] == {"s_p": {"tool": f"{'{n}' * 60}b.x", "work": "s_a_{n}.x"}}
    assert time.perf_counter() - begin < 2.0


def test_a_setting_cannot_include(tmp_path: Path) -> None:
    path = write(tmp_path, s=f"{BLOCK}{REST}")
    with pytest.raises(SceneError, match="is read with the scene's file"):
        load_scene(path, overrides=['include="p.toml"'])


def test_a_variant_that_sets_an_included_key_is_what_an_error_names(tmp_path: Path) -> None:
    rest = f'{REST}[variants.bad]\n"components.block.mass" = "1 mm"\n'
    path = write(tmp_path, s=f'include = "p.toml"\n{rest}', p=BLOCK)
    with pytest.raises(SceneError, match=r"s\.toml:7 \(variant bad\): components\.block\.mass"):
        load_scene(path, variant="bad")


def test_digest_and_text_of_a_result_hold_what_is_included(tmp_path: Path) -> None:
    path = write(tmp_path, s=f'include = "p.toml"\n{REST}', p=BLOCK)
    digest = hash_scene(path)
    origin = trace_content(SceneChoice(path), scene_content(path), ranks=1)
    assert origin.scene_sha256 == digest
    (tmp_path / "again.toml").write_text(origin.scene_text)
    assert tables(tmp_path / "again.toml") == tables(path)
    write(tmp_path, p=BLOCK.replace("9 N/um", "8 N/um"))
    assert hash_scene(path) != digest


def test_a_machine_is_saved_whole_and_changed_with_its_places_known(tmp_path: Path) -> None:
    path = write(tmp_path, s=f'include = "p.toml"\n{REST}', p=BLOCK)
    machine = Machine.load(SceneChoice(path))
    saved = machine.save(tmp_path / "saved.toml")
    (tmp_path / "p.toml").unlink()
    assert Machine.load(SceneChoice(saved)) == machine
    with pytest.raises(SceneError, match=r"p\.toml:9: joints\.hold\.between"):
        machine.change(set={"components.block.interfaces": {"other": {"face": "z-"}}})


def test_values_reach_included_entries(tmp_path: Path) -> None:
    path = write(tmp_path, s='include = { file = "p.toml", prefix = "a_" }', p=BLOCK)
    findings = Findings(str(path))
    raw = read_tables(path, findings)
    apply_settings(raw, ["components.a_block.mass=2 kg"], findings)
    assert findings.problems == []
    assert isinstance(components := raw["components"], dict)
    assert isinstance(block := components["a_block"], dict)
    assert block["mass"] == "2 kg"
