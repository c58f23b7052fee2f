"""What is wrong with the arguments of a public function is said before anything is computed, with one
kind of error.
"""

import copy
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import headstock as hs
from fixture_machines import machine, write_scene

wrong: Any = hs  # called with arguments that no type checker lets pass

MACHINES = Path(__file__).resolve().parents[2] / "machines"
LENGTH = "components.head.at[2]"
WATCH = "modal.frequencies_hz[0]"
SCENE = machine('machine = "head"')


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_scene(tmp_path, SCENE)


@pytest.mark.parametrize(
    ("arguments", "key", "words"),
    [
        ({"vary": {LENGTH: "400 mm"}}, f"vary.{LENGTH}", "is not a list"),
        ({"vary": {LENGTH: 0.4}}, f"vary.{LENGTH}", "is not a list"),
        ({"vary": {LENGTH: []}}, f"vary.{LENGTH}", "at least 1"),
        ({"vary": {LENGTH: [math.nan]}}, LENGTH, "nan"),
        ({"vary": {LENGTH: [object()]}}, LENGTH, "no value of a scene"),
        ({"vary": {"components.haed.at[2]": [1.0]}}, "vary.components.haed.at[2]", "did you mean"),
        ({"vary": {3: [1.0]}}, "vary", "dotted keys"),
        ({"vary": LENGTH}, "vary", "dotted keys"),
        ({"vary": {}}, "vary", "is empty"),
        ({}, "vary", "is empty"),
        ({"name": "mine", "vary": {LENGTH: [1.0]}}, "name", "not both"),
        ({"vary": {LENGTH: [1.0], "name": ["a", "b"]}, "pairwise": True}, "", "equal lengths"),
        (
            {"vary": {LENGTH: [1.0]}, "watch": "modal.freqencies_hz[0]"},
            "watch[0]",
            "frequencies_hz",
        ),
        ({"vary": {LENGTH: [1.0]}, "watch": "modal[0]"}, "watch[0]", "is a table"),
        ({"vary": {LENGTH: [1.0]}, "watch": "frf.reference.levels"}, "watch[0]", "analysis frf"),
        ({"vary": {LENGTH: [1.0]}, "watch": "static.tpc.text"}, "watch[0]", "tcp"),
        ({"vary": {LENGTH: [1.0]}, "watch": ["nope"]}, "watch[0]", "no result"),
        ({"vary": {LENGTH: [1.0]}, "watch": 3}, "watch", "no list of names"),
        ({"vary": {LENGTH: [1.0]}, "watch": WATCH, "progress": 3}, "progress", "cannot be called"),
    ],
)
def test_a_study_is_checked_before_its_first_point(
    scene: Path, arguments: dict[str, object], key: str, words: str
) -> None:
    finished: list[object] = []
    with pytest.raises(hs.SceneError) as caught:
        hs.study(scene, **({"progress": finished.append} | arguments))  # type: ignore[arg-type]
    assert finished == []
    assert key in [problem.key for problem in caught.value.problems]
    assert words in str(caught.value)


def test_one_text_is_one_watched_path_and_arrays_are_lists(scene: Path) -> None:
    table = hs.study(scene, vary={LENGTH: np.array([0.8, 1.0])}, watch=WATCH)
    assert table.columns == (WATCH,)
    assert len(table.rows) == 2
    # without a watch there are the records
    (row,) = hs.study(scene, vary={LENGTH: [0.8]}).rows
    assert row.record.summary is not None


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: wrong.load(None),
        lambda scene: wrong.load(scene, variant=["A"]),
        lambda scene: wrong.load(scene, set=["name=a"]),
        lambda scene: wrong.load(scene, set={LENGTH: math.inf}),
        lambda scene: wrong.load(scene, set={"name": len}),
        lambda scene: wrong.check({"name": "a"}),
        lambda scene: wrong.plan(3),
        lambda scene: wrong.run(scene, analyses=[3]),
        lambda scene: wrong.run(scene, output=""),
        lambda scene: wrong.sweep(scene, None),
        lambda scene: wrong.compare(scene, 3),
        lambda scene: wrong.compare(scene, reference="nope"),
        lambda scene: wrong.identify(scene, None),
        lambda scene: wrong.identify(scene, "targets.toml", starts=0),
        lambda scene: wrong.open(3),
        lambda scene: wrong.Machine(name="a", folder=3),
        lambda scene: wrong.load(scene).change(set="name"),
        lambda scene: wrong.load(scene).save(3),
        lambda scene: wrong.Box(math.nan, 1.0, 1.0),
        lambda scene: wrong.Interface(face=3),
        lambda scene: wrong.Load(force=3),
    ],
)
def test_a_wrong_argument_is_one_problem_with_its_key(
    scene: Path, call: Callable[[Path], object]
) -> None:
    with pytest.raises(hs.SceneError) as caught:
        call(scene)
    (problem,) = caught.value.problems
    assert problem.key
    assert problem.message


def test_one_analysis_is_named_by_one_text(scene: Path) -> None:
    assert hs.run(scene, analyses="static").modes == {}


def test_a_mesh_is_read_from_a_folder_given_as_text(scene: Path, tmp_path: Path) -> None:
    write_scene(tmp_path, machine('machine = "block"\nnames = { block = "head" }'))
    found = hs.run(scene, output=tmp_path / "out").mesh("head")
    again = hs.read_mesh(str(tmp_path / "out"), "head")
    assert again.n_points == found.n_points
    with pytest.raises(KeyError, match="head"):
        hs.read_mesh(str(tmp_path / "out"), "haed")
    with pytest.raises(hs.HeadstockError, match="no folder of results"):
        hs.read_mesh(None, "head")  # type: ignore[arg-type]


def test_what_a_machine_shows_of_itself_cannot_be_changed(scene: Path) -> None:
    machine = hs.load(scene)
    shown: Any = machine.table
    tables = shown, shown["components"]["head"], shown["points"]
    for table in tables:
        with pytest.raises(TypeError, match=r"machine\.change"):
            table["mass"] = "1 kg"
        with pytest.raises(TypeError, match=r"machine\.change"):
            table.clear()
    with pytest.raises(TypeError, match=r"machine\.change"):
        tables[1]["at"].append("1 m")
    with pytest.raises(TypeError, match=r"machine\.change"):
        tables[1]["at"].reverse()
    with pytest.raises(AttributeError):
        machine.table = {}
    material = hs.Material(E=2e11, nu=0.3, rho=7850.0)
    with pytest.raises(AttributeError):
        material.E = 1e11
    free = copy.deepcopy(machine.table)
    free["name"] = "mine"
    assert "name" not in machine.table
    assert pickle.loads(pickle.dumps(machine.table)) == machine.table
    assert hs.load(scene, set={"name": "mine"}).table == free


def test_a_machine_that_buckles_under_gravity_says_so(scene: Path) -> None:
    heavy = hs.load(scene, set={"effects": {"gravity": True, "gravity_stiffening": True}})
    # 5 kN m/rad under 1000 kg at 1 m
    with pytest.raises(hs.HeadstockError, match=r"buckles .* at 0\.51 .*gravity_stiffening"):
        hs.run(heavy)
    stiff = heavy.change(set={"joints.foot.stiffness.rx": 9.9e3})
    assert 0.0 < hs.run(stiff).modes["reference"].frequencies_hz[0] < 0.1


PART = machine("""
machine = "bar"
names = { bar = "part" }
without = ["joints", "points", "components.part.interfaces.tip"]
components.part.solid = { step = "FILE" }
""")


@pytest.mark.parametrize("name", ["../mine/part.step", "parts/../../mine/part.step"])
def test_a_name_that_leaves_the_folder_and_comes_back_is_refused(tmp_path: Path, name: str) -> None:
    """Beside a copy of the scene the same name is another file: `save` would have written it."""
    folder = tmp_path / "mine"
    (folder / "parts").mkdir(parents=True)
    (folder / "part.step").write_text("ISO-10303-21;\n")
    scene = write_scene(folder, PART.replace("FILE", name))
    with pytest.raises(hs.SceneError, match="outside the scene's folder"):
        hs.check(scene)


def test_a_copy_of_a_machine_writes_nothing_through_links(tmp_path: Path) -> None:
    source, target, victim = tmp_path / "source", tmp_path / "target", tmp_path / "victim"
    (source / "parts").mkdir(parents=True)
    target.mkdir()
    victim.mkdir()
    (source / "parts" / "part.step").write_bytes((MACHINES / "step_column.step").read_bytes())
    scene = source / "scene.toml"
    text = (MACHINES / "step_column.toml").read_text()
    scene.write_text(text.replace('"step_column.step"', '"parts/part.step"'))
    machine = hs.load(scene)
    (target / "parts").symlink_to(victim)
    with pytest.raises(hs.SceneError, match="link"):
        machine.save(target / "scene.toml")
    (target / "parts").unlink()
    (target / "parts").mkdir()
    (target / "parts" / "part.step").symlink_to(victim / "new.step")  # which leads nowhere yet
    with pytest.raises(hs.SceneError):
        machine.save(target / "scene.toml")
    assert list(victim.iterdir()) == []
