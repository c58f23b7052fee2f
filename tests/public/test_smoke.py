"""One small run of each capability, on rigid bodies and springs: what `./headstock test --quick`
tries of whole commands.
"""

import json
from pathlib import Path

import pytest
from cross_slide import ANALYSES, SCENE, TARGETS

from common import run_alone

pytestmark = pytest.mark.smoke


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def command(folder: Path, *words: str | Path) -> str:
    """What a command prints; it must end well."""
    done = run_alone(folder, *(str(word) for word in words))
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def summary(folder: Path) -> dict[str, object]:
    found = json.loads((folder / "summary.json").read_text())
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("analysis", ANALYSES)
def test_a_run_has_its_answer(scene: Path, analysis: str) -> None:
    key, table = ANALYSES[analysis]
    if table:
        scene.write_text(SCENE + f"[analyses.{analysis}]\n{table}\n")
    out = scene.parent / "out"
    words: list[str | Path] = ["--analysis", analysis, "-o", out, "--no-figures"]
    assert command(scene.parent, "run", scene, *words)
    assert summary(out)[key]
    assert (out / "report.html").is_file()


def test_a_contour_under_its_own_cutting_force_has_faces_up_to_their_corners(scene: Path) -> None:
    text = SCENE.replace("guide_errors", "cutting_force = true\nguide_errors")
    scene.write_text(f"{text}[analyses.contouring]\n{ANALYSES['contouring'][1]}\n")
    out = scene.parent / "out"
    words: list[str | Path] = ["--analysis", "contouring", "-o", out, "--no-figures"]
    command(scene.parent, "run", scene, *words)
    assert summary(out)["contouring"]


def test_a_scene_is_checked_and_planned(scene: Path) -> None:
    assert command(scene.parent, "check", scene)
    assert "modal" in command(scene.parent, "plan", scene)


def test_a_finished_run_is_reported_again(scene: Path) -> None:
    out = scene.parent / "out"
    few = ["--analysis", "modal", "--set", "analyses.modal.count=1"]
    command(scene.parent, "run", scene, *few, "-o", out, "--no-figures")
    (out / "report.html").unlink()
    command(scene.parent, "report", out)
    assert (out / "report.html").is_file()


def test_a_study_has_a_row_for_each_value(scene: Path) -> None:
    out = scene.parent / "study"
    command(scene.parent, "study", scene, "drive", "-o", out)
    assert len((out / "study.csv").read_text().splitlines()) == 3


def test_a_sweep_has_every_pose(scene: Path) -> None:
    out = scene.parent / "sweep"
    command(scene.parent, "sweep", scene, "line", "-o", out)
    assert (out / "sweep.h5").is_file()


def test_variants_are_compared(scene: Path) -> None:
    out = scene.parent / "compare"
    assert "stiff" in command(scene.parent, "compare", scene, "-o", out)


def test_effects_are_switched(scene: Path) -> None:
    page = scene.parent / "effects.html"
    assert "damping" in command(scene.parent, "effects", scene, "--only", "effects", "--page", page)
    assert page.is_file()


def test_a_parameter_is_identified(scene: Path) -> None:
    targets = scene.parent / "targets.toml"
    targets.write_text(TARGETS)
    out = scene.parent / "identify"
    assert "drive" in command(scene.parent, "identify", scene, targets, "-o", out)


def test_a_new_scene_can_be_checked(tmp_path: Path) -> None:
    command(tmp_path, "new", tmp_path / "machine")
    (scene,) = (tmp_path / "machine").glob("*.toml")
    command(tmp_path, "check", scene)


def test_lists_are_printed(tmp_path: Path) -> None:
    assert json.loads(command(tmp_path, "schema"))["properties"]
    assert "guide" in command(tmp_path, "catalogue")
