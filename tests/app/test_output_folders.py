"""No command writes over or removes what it did not write; running it again into the same place
just works.
"""

import dataclasses
from pathlib import Path

import pytest

from headstock.app.charts.axis_kit import FIGURE_NAME
from headstock.app.command_line import main
from headstock.pipeline.storage.outputs import LIST_FILE
from headstock.validation.machines.axis_kit_cases import CASE, FIDELITIES, VARIANTS, compliance_name
from headstock.validation.references.rows import Target, compare_value

# what each command writes into OUT whatever it computes
FOLDER_COMMANDS = {
    "run {scene} --no-figures -o {out}": ("results.h5", "summary.json", "report.html"),
    "sweep {scene} line -o {out}": ("sweep.h5", "sweep.json", "report.html"),
    "study {scene} E -o {out}": ("study.csv", "study.json", "points.jsonl"),
    "compare {scene} -o {out}": ("compare.json", "compare.html"),
    "identify {scene} {targets} -o {out}": ("calibrated.toml", "identification.json"),
}
FILE_COMMANDS = (
    "check {scene} --json {file}",
    "plan {scene} --json {file}",
    "run {scene} --no-figures -o {out} --json {file}",
    "sweep {scene} line -o {out} --json {file}",
    "study {scene} E -o {out} --json {file}",
    "compare {scene} -o {out} --json {file}",
    pytest.param("effects {scene} --json {file}", marks=pytest.mark.trials),
    "identify {scene} {targets} -o {out} --json {file}",
    "export {scene} block -o {file}",
    "export {scene} --state-space 500_Hz -o {file}",
    pytest.param("show {scene} -o {file}", marks=pytest.mark.trials),
    "schema --json {file}",
    "catalogue --json {file}",
    "validate torsion-constant --json {file}",
    pytest.param("doctor --json {file}", marks=pytest.mark.trials),
)


def call(text: str, scene: Path, *, out: Path | None = None, file: Path | None = None) -> int:
    places = {"scene": scene, "targets": scene.with_name("targets.toml"), "out": out, "file": file}
    words = [word.format(**places).replace("_Hz", " Hz") for word in text.split()]
    return main(words)


@pytest.mark.parametrize("text", FOLDER_COMMANDS)
def test_a_command_runs_again_into_its_folder_and_keeps_what_the_user_put_there(
    scene_file: Path, tmp_path: Path, text: str
) -> None:
    out = tmp_path / "out"
    assert call(text, scene_file, out=out) == 0
    folders = (out, *(path for path in out.iterdir() if path.is_dir()))
    mine = [
        folder / f"mine.{suffix}"
        for folder in folders
        for suffix in ("csv", "png", "glb", "vtu", "h5", "journal")
    ]
    for path in mine:
        path.write_text("mine")
    assert call(text, scene_file, out=out) == 0
    assert [path.read_text() for path in mine] == ["mine"] * len(mine)


@pytest.mark.parametrize(
    ("text", "name"), [(text, name) for text, names in FOLDER_COMMANDS.items() for name in names]
)
def test_a_file_of_the_user_with_a_fixed_name_is_refused_by_name_before_anything_is_computed(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, name: str
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert call(text, scene_file, out=out) == 2
    captured = capsys.readouterr()
    assert name in captured.err and "Traceback" not in captured.err
    assert (out / name).read_text() == "mine"
    assert [path.name for path in out.iterdir()] == [name]
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize("text", FOLDER_COMMANDS)
def test_an_output_folder_that_is_a_link_is_refused(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "out").symlink_to("mine")
    assert call(text, scene_file, out=tmp_path / "out") == 2
    assert "it is a link" in capsys.readouterr().err
    assert list((tmp_path / "mine").iterdir()) == []


@pytest.mark.parametrize("text", FILE_COMMANDS)
def test_a_command_writes_its_file_again_but_not_over_one_of_the_user(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    file = tmp_path / "files" / "written"
    file.parent.mkdir()
    assert call(text, scene_file, out=tmp_path / "out", file=file) == 0
    written = file.read_bytes()
    assert call(text, scene_file, out=tmp_path / "out", file=file) == 0
    assert file.read_bytes()[:1] == written[:1]
    file.write_text("mine")
    capsys.readouterr()
    assert call(text, scene_file, out=tmp_path / "out", file=file) != 0
    assert str(file) in capsys.readouterr().err
    assert file.read_text() == "mine"
    file.unlink()
    file.symlink_to(tmp_path / "nowhere")
    assert call(text, scene_file, out=tmp_path / "out", file=file) != 0
    assert not (tmp_path / "nowhere").exists()
    assert {path.name for path in file.parent.iterdir()} == {LIST_FILE, "written"}


def test_a_validation_writes_its_figures_beside_those_of_the_user_and_not_through_a_link(
    scene_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown = Target(1.0, "um/kN", float("nan"), "shown only")
    rows = [
        dataclasses.replace(
            compare_value(compliance_name(variant, kind, axis), 2.0, shown), case=CASE
        )
        for variant in VARIANTS
        for kind in FIDELITIES
        for axis in "xyz"
    ]
    monkeypatch.setattr(
        "headstock.app.actions.validating.run_validation", lambda *args, **settings: rows
    )
    out = tmp_path / "out"
    for _ in range(2):
        assert call("validate -o {out}", scene_file, out=out) == 0
        assert {path.name for path in out.iterdir()} == {LIST_FILE, f"{FIGURE_NAME}.png"}
    (out / f"{FIGURE_NAME}.png").write_text("mine")
    assert call("validate -o {out}", scene_file, out=out) == 0
    assert (out / f"{FIGURE_NAME}.png").read_text() == "mine" and (
        out / f"{FIGURE_NAME}-2.png"
    ).stat().st_size > 1000
    (tmp_path / "linked").symlink_to("out")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    capsys.readouterr()
    assert call("validate -o {out}", scene_file, out=tmp_path / "linked") == 2
    assert "it is a link" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_new_scene_is_not_written_into_a_folder_that_exists_or_through_a_link(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "scene.toml").write_text("mine")
    (tmp_path / "linked").symlink_to("mine")
    (tmp_path / "nowhere").symlink_to("nothing")
    for folder in (mine, tmp_path / "linked", tmp_path / "nowhere"):
        assert call("new {out}", scene_file, out=folder) != 0
        assert "Traceback" not in capsys.readouterr().err
    assert [path.name for path in mine.iterdir()] == ["scene.toml"] and (
        mine / "scene.toml"
    ).read_text() == "mine"
    assert not (tmp_path / "nothing").exists()


def test_a_report_is_not_written_over_one_that_was_edited(scene_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert call("run {scene} --no-figures -o {out}", scene_file, out=out) == 0
    (out / "report.html").write_text("edited")
    assert call("report {out}", scene_file, out=out) == 2
    assert (out / "report.html").read_text() == "edited"
