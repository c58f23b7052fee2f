"""Bad scenes: every problem is reported at once, at its line, with what to write."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from cases import cases
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import keep_analyses

DATA = Path(__file__).parents[2] / "data"
GOOD = (DATA / "good_scene.toml").read_text()
BAD = tomllib.loads((DATA / "refused" / "bad_scenes.toml").read_text())


def write_scene(folder: Path, text: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def line_of(text: str, marker: str) -> int:
    return text[: text.index(marker)].count("\n") + 1


def test_the_scene_the_bad_ones_are_made_from_is_good(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, GOOD))
    assert scene.machine.axes["X"].moves == ("slider",)
    assert scene.warnings == ()


@pytest.mark.parametrize("row", BAD.values(), ids=list(BAD))
def test_a_bad_scene_is_refused_at_its_line(tmp_path: Path, row: dict[str, Any]) -> None:
    assert GOOD.count(row["old"]) == 1, "the row must change one place"
    text = GOOD.replace(row["old"], row["new"])
    path = write_scene(tmp_path, text)
    for name, content in row.get("files", {}).items():
        (tmp_path / name).write_text(content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    matching = [
        problem
        for problem in caught.value.problems
        if problem.key == row["key"] and all(word in problem.message for word in row["words"])
    ]
    assert matching, str(caught.value)
    line = line_of(text, row["marker"])
    assert matching[0].place.split(" (")[0] == f"{path}:{line}"
    assert matching[0].source == text.split("\n")[line - 1].strip()


@cases
def test_one_mistake_is_one_problem(tmp_path: Path, name: str) -> None:
    row = BAD[name]
    with pytest.raises(SceneError) as caught:
        load_scene(write_scene(tmp_path, GOOD.replace(row["old"], row["new"])))
    assert len(caught.value.problems) == 1, str(caught.value)


def test_every_problem_is_reported_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    names = [
        "wrong unit",
        "unknown material",
        "patch outside",
        "wall thicker than the column",
        "missing interface",
        "negative stiffness",
        "axis limits reversed",
        "unknown axis of a pose",
        "unknown effect",
        "unknown point",
        "unknown section",
    ]
    text = GOOD
    for name in names:
        if name != "unknown section":
            text = text.replace(BAD[name]["old"], BAD[name]["new"])
    text += "[posses]\n"
    with pytest.raises(SceneError) as caught:
        load_scene(write_scene(tmp_path, text))
    found = [problem.key for problem in caught.value.problems]
    for name in names:
        assert (BAD[name]["key"] if name != "unknown section" else "posses") in found, name
    lines = [int(problem.place.rsplit(":", 1)[1]) for problem in caught.value.problems]
    assert lines == sorted(lines)
    assert f"{len(found)} problems; nothing was computed" in str(caught.value)


def test_a_floating_component_is_named_with_its_free_motions(tmp_path: Path) -> None:
    text = GOOD.replace('[supports.plane]\nface = "plinth.z-"\nfix = ["x", "y", "z"]\n', "")
    text = text.replace(
        'between = ["bed.bottom", "ground"]', 'between = ["bed.bottom", "plinth.head"]'
    )
    with pytest.raises(SceneError) as caught:
        load_scene(write_scene(tmp_path, text))
    messages = [
        problem.message for problem in caught.value.problems if problem.key == "components.bed"
    ]
    assert len(messages) == 1
    for word in ("bed, slider, plinth", "6 rigid-body motions", '"ground"', "free = true"):
        assert word in messages[0]


def test_a_joint_without_stiffness_connects_nothing(tmp_path: Path) -> None:
    text = GOOD.replace('[supports.plane]\nface = "plinth.z-"\nfix = ["x", "y", "z"]\n', "")
    text = text.replace(
        'normal = "500 N/um", shear = "300 N/um", tilt = "1e7 N m/rad"',
        'normal = "0 N/um", shear = "0 N/um"',
    )
    with pytest.raises(SceneError, match="6 rigid-body motions"):
        load_scene(write_scene(tmp_path, text))


def test_a_machine_declared_free_may_float(tmp_path: Path) -> None:
    text = 'free = true\n[materials.steel]\nE = "210 GPa"\nnu = 0.3\nrho = "7850 kg/m^3"\n'
    text += '[components.bar]\nsolid = { box = ["10 mm", "10 mm", "1 m"] }\nmaterial = "steel"\n[analyses.modal]\n'
    assert load_scene(write_scene(tmp_path, text)).machine.components["bar"].free
    with pytest.raises(SceneError, match=r"bar .*6 rigid-body motions.*free = true"):
        load_scene(write_scene(tmp_path, text.removeprefix("free = true\n")))


@cases
def test_text_that_is_not_toml_is_refused_at_its_line(
    tmp_path: Path, text: str, line: int, fragment: str
) -> None:
    path = write_scene(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    (problem,) = caught.value.problems
    assert problem.place == f"{path}:{line}"
    assert fragment in problem.message


@cases
def test_numbers_that_look_wrong_are_warned_of_with_their_line(
    tmp_path: Path, old: str, new: str, fragment: str
) -> None:
    text = GOOD.replace(old, new)
    path = write_scene(tmp_path, text)
    warnings = [warning for warning in load_scene(path).warnings if fragment in warning]
    assert warnings
    assert warnings[0].startswith(f"{path}:")


def test_an_interface_that_nothing_refers_to_may_average(tmp_path: Path) -> None:
    text = GOOD.replace("nose =", 'back = { face = "y+", coupling = "average" }\nnose =')
    assert load_scene(write_scene(tmp_path, text)).warnings == ()


def test_what_an_analysis_on_request_lacks_is_a_problem_once_it_is_asked_for(
    tmp_path: Path,
) -> None:
    wanted = '[analyses.control]\nup_to = "300 Hz"\n'
    with pytest.raises(SceneError, match="drive_control = true"):
        load_scene(write_scene(tmp_path, GOOD + wanted))
    scene = load_scene(write_scene(tmp_path, GOOD + wanted + "on_request = true\n"))
    assert ModalRequest in keep_analyses(scene, ["modal"]).analyses
    with pytest.raises(SceneError, match="drive_control = true") as caught:
        keep_analyses(scene, ["control"])
    assert caught.value.problems[0].key == "analyses.control"
