"""No command writes over or removes what it did not write; running it again into the same place just works."""

from pathlib import Path

import pytest

from headstock.app.command_line import main
from headstock.pipeline.outputs import LIST_FILE

SCENE = """
name = "A block on springs"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.block]
solid = { box = ["100 mm", "100 mm", "100 mm"] }
material = "steel"
fidelity = "rigid"
[components.block.interfaces]
foot = { face = "z-" }
tip = { face = "z+" }
[joints.mount]
between = ["ground", "block.foot"]
kind = "spring"
stiffness = { x = "10 N/um", y = "10 N/um", z = "40 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
[axes.X]
joints = ["mount"]
direction = "x"
limits = ["-50 mm", "50 mm"]
[points]
tcp = { tool = "block.tip", work = "ground" }
[analyses.static]
at = "tcp"
[analyses.modal]
count = 6
[variants.heavy]
"materials.steel.rho" = "8000 kg/m^3"
[sweeps.line]
axes = { X = ["0 mm", "10 mm", 2] }
[studies.E]
vary = { "materials.steel.rho" = ["7000 kg/m^3", "8000 kg/m^3"] }
watch = ["modal.frequencies_hz[0:3]"]
"""
# what each command writes into OUT whatever it computes
FOLDER_COMMANDS = {
    "run {scene} --no-figures -o {out}": ("results.h5", "summary.json", "report.html"),
    "sweep {scene} line -o {out}": ("sweep.h5", "sweep.json", "report.html"),
    "study {scene} E -o {out}": ("study.csv", "study.json", "points.jsonl"),
    "compare {scene} -o {out}": ("compare.json", "compare.html"),
}
FILE_COMMANDS = (
    "check {scene} --json {file}",
    "plan {scene} --json {file}",
    "run {scene} --no-figures -o {out} --json {file}",
    "sweep {scene} line -o {out} --json {file}",
    "study {scene} E -o {out} --json {file}",
    "compare {scene} -o {out} --json {file}",
    "effects {scene} --json {file}",
    "export {scene} block -o {file}",
    "export {scene} --state-space 500_Hz -o {file}",
    "show {scene} -o {file}",
    "schema --json {file}",
    "validate torsion-constant --json {file}",
)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path = tmp_path / "block.toml"
    path.write_text(SCENE)
    return path


def call(text: str, scene: Path, *, out: Path | None = None, file: Path | None = None) -> int:
    words = [word.format(scene=scene, out=out, file=file).replace("_Hz", " Hz") for word in text.split()]
    return main(words)


@pytest.mark.parametrize("text", FOLDER_COMMANDS)
def test_a_command_runs_again_into_its_folder_and_keeps_what_the_user_put_there(scene: Path, tmp_path: Path, text: str) -> None:
    out = tmp_path / "out"
    assert call(text, scene, out=out) == 0
    folders = (out, *(path for path in out.iterdir() if path.is_dir()))
    mine = [folder / f"mine.{suffix}" for folder in folders for suffix in ("csv", "png", "glb", "vtu", "h5", "journal")]
    for path in mine:
        path.write_text("mine")
    assert call(text, scene, out=out) == 0
    assert [path.read_text() for path in mine] == ["mine"] * len(mine)


@pytest.mark.parametrize(("text", "name"), [(text, name) for text, names in FOLDER_COMMANDS.items() for name in names])
def test_a_file_of_the_user_with_a_fixed_name_is_refused_by_name_before_anything_is_computed(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, name: str
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert call(text, scene, out=out) != 0
    captured = capsys.readouterr()
    assert name in captured.err and "Traceback" not in captured.err
    assert (out / name).read_text() == "mine"
    assert [path.name for path in out.iterdir()] == [name]
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize("text", FOLDER_COMMANDS)
def test_an_output_folder_that_is_a_link_is_refused(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "out").symlink_to("mine")
    assert call(text, scene, out=tmp_path / "out") != 0
    assert "it is a link" in capsys.readouterr().err
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_run_does_not_write_or_remove_through_linked_parts_of_its_folder(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for part in ("tables", "figures", "modes"):
        mine = tmp_path / f"my {part}"
        mine.mkdir()
        (mine / "a.csv").write_text("mine")
        out.mkdir(exist_ok=True)
        (out / part).symlink_to(mine)
    assert call("run {scene} --no-figures -o {out}", scene, out=out) == 1
    for part in ("tables", "figures", "modes"):
        assert [path.read_text() for path in (tmp_path / f"my {part}").iterdir()] == ["mine"]


@pytest.mark.parametrize("text", FILE_COMMANDS)
def test_a_command_writes_its_file_again_but_not_over_one_of_the_user(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    file = tmp_path / "files" / "written"
    file.parent.mkdir()
    assert call(text, scene, out=tmp_path / "out", file=file) == 0
    written = file.read_bytes()
    assert call(text, scene, out=tmp_path / "out", file=file) == 0
    assert file.read_bytes()[:1] == written[:1]
    file.write_text("mine")
    capsys.readouterr()
    assert call(text, scene, out=tmp_path / "out", file=file) != 0
    assert str(file) in capsys.readouterr().err
    assert file.read_text() == "mine"
    file.unlink()
    file.symlink_to(tmp_path / "nowhere")
    assert call(text, scene, out=tmp_path / "out", file=file) != 0
    assert not (tmp_path / "nowhere").exists()
    assert {path.name for path in file.parent.iterdir()} == {LIST_FILE, "written"}


def test_a_report_is_not_written_over_one_that_was_edited(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert call("run {scene} --no-figures -o {out}", scene, out=out) == 0
    (out / "report.html").write_text("edited")
    assert call("report {out}", scene, out=out) == 1
    assert (out / "report.html").read_text() == "edited"
