"""Included files: the scene they make, the names they get, what is refused and where."""

import re
import time
from pathlib import Path

import pytest

from cases import cases
from fixture_machines import stored_scene
from headstock.machine import Machine
from headstock.pipeline.storage.provenance import SceneChoice, trace_content
from headstock.scene.building.loader import load_scene, read_tables
from headstock.scene.expansion.includes import scene_content
from headstock.scene.expansion.overrides import apply_settings
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings, SceneError
from headstock.studies.parameters.runs import hash_scene

PART = stored_scene("includes_part")  # with $ for its own names and @ for those of others
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
BLOCK = stored_scene("includes_block")
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


@cases
def test_what_cannot_be_included_is_named_with_its_file_and_line(
    tmp_path: Path, files: dict[str, str], expected: list[str]
) -> None:
    texts = {"BLOCK": BLOCK, "REST": REST, "MEGABYTE": "#" * 1_000_000}
    texts["MISSPELT"] = BLOCK.replace("block.foot", "block.fot")
    for word, text in texts.items():
        files = {name: content.replace(word, text) for name, content in files.items()}
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
