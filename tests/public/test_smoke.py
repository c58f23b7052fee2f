"""One small run of each capability, on rigid bodies and springs: what `./headstock test --quick`
tries of whole commands.
"""

import pytest
from cross_slide import ANALYSES, SCENE, TARGETS

from common import Shell

pytestmark = pytest.mark.smoke


@pytest.mark.parametrize("analysis", ANALYSES)
def test_a_run_has_its_answer(shell: Shell, analysis: str) -> None:
    key, table = ANALYSES[analysis]
    shell.write(SCENE + (f"[analyses.{analysis}]\n{table}\n" if table else ""))
    assert shell(f"run scene.toml --analysis {analysis} -o out --no-figures").out
    assert shell.json("out/summary.json")[key]
    assert "report.html" in shell.files("out")


def test_a_contour_under_its_own_cutting_force_has_faces_up_to_their_corners(shell: Shell) -> None:
    shell.write(SCENE, ("guide_errors", "cutting_force = true\nguide_errors"))
    shell.change(add=f"[analyses.contouring]\n{ANALYSES['contouring'][1]}\n")
    shell("run scene.toml --analysis contouring -o out --no-figures")
    assert shell.json("out/summary.json")["contouring"]


@pytest.mark.parametrize(
    ("line", "printed", "file"),
    [
        ("check scene.toml --json check.json", "scene.toml: ok:", "check.json"),
        ("plan scene.toml --json plan.json", "modal", "plan.json"),
        ("sweep scene.toml line -o out", "", "out/sweep.h5"),
        ("compare scene.toml -o out", "stiff", "out/compare.json"),
        ("effects scene.toml --only effects --page effects.html", "damping", "effects.html"),
        ("identify scene.toml targets.toml -o out", "drive", "out/calibrated.toml"),
        ("schema", '"properties": {', "scene.toml"),
        ("catalogue", "guide", "scene.toml"),
    ],
)
def test_a_command_prints_and_writes_what_it_is_for(
    shell: Shell, line: str, printed: str, file: str
) -> None:
    shell.write(SCENE)
    shell.write(TARGETS, name="targets")
    assert printed in shell.prints(line)
    assert (shell.folder / file).stat().st_size > 0


def test_a_finished_run_is_reported_again(shell: Shell) -> None:
    shell.write(SCENE)
    few = "--analysis modal --set analyses.modal.count=1"
    shell(f"run scene.toml {few} -o out --no-figures")
    (shell.folder / "out" / "report.html").unlink()
    shell("report out")
    assert "report.html" in shell.files("out")


def test_a_study_has_a_row_for_each_value(shell: Shell) -> None:
    shell.write(SCENE)
    shell("study scene.toml drive -o out")
    assert len(shell.text("out/study.csv").splitlines()) == 3


def test_a_new_scene_can_be_checked(shell: Shell) -> None:
    shell("new machine")
    shell("check machine/machine.toml")
