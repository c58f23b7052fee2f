"""No command writes over or removes what it did not write; running it again into the same place
just works.
"""

import dataclasses

import pytest

from common import Shell
from headstock.app.charts.axis_kit import FIGURE_NAME
from headstock.pipeline.storage.outputs import LIST_FILE
from headstock.validation.machines.axis_kit_cases import CASE, FIDELITIES, VARIANTS, compliance_name
from headstock.validation.references.rows import Target, compare_value

# what each command writes into a folder whatever it computes
FOLDER_COMMANDS = {
    "run scene.toml --no-figures": ("results.h5", "summary.json", "report.html"),
    "sweep scene.toml line": ("sweep.h5", "sweep.json", "report.html"),
    "study scene.toml E": ("study.csv", "study.json", "points.jsonl"),
    "compare scene.toml": ("compare.json", "compare.html"),
    "identify scene.toml targets.toml": ("calibrated.toml", "identification.json"),
}
TRIAL = pytest.mark.trials
FILE_COMMANDS = (
    "check scene.toml --json",
    "plan scene.toml --json",
    *(f"{line} -o out --json" for line in FOLDER_COMMANDS),
    pytest.param("effects scene.toml --json", marks=TRIAL),
    "export scene.toml block -o",
    "export scene.toml --state-space '500 Hz' -o",
    pytest.param("show scene.toml -o", marks=TRIAL),
    "schema --json",
    "catalogue --json",
    "validate torsion-constant --json",
    pytest.param("doctor --json", marks=TRIAL),
)


@pytest.mark.parametrize("line", FOLDER_COMMANDS)
def test_a_command_runs_again_into_its_folder_and_keeps_what_the_user_put_there(
    block: Shell, line: str
) -> None:
    out = block.folder / "out"
    block(f"{line} -o out")
    folders = (out, *(path for path in out.iterdir() if path.is_dir()))
    suffixes = ("csv", "png", "glb", "vtu", "h5", "journal")
    mine = [folder / f"mine.{suffix}" for folder in folders for suffix in suffixes]
    for path in mine:
        path.write_text("mine")
    block(f"{line} -o out")
    assert [path.read_text() for path in mine] == ["mine"] * len(mine)


@pytest.mark.parametrize(
    ("line", "name"), [(line, name) for line, names in FOLDER_COMMANDS.items() for name in names]
)
def test_a_file_of_the_user_with_a_fixed_name_is_refused_by_name_before_anything_is_computed(
    block: Shell, line: str, name: str
) -> None:
    (block.folder / "out").mkdir()
    (block.folder / "out" / name).write_text("mine")
    said = block(f"{line} -o out", code=2).err
    assert name in said and "Traceback" not in said
    assert (block.files("out"), block.text(f"out/{name}")) == ({name}, "mine")
    assert "store" not in block.files()


@pytest.mark.parametrize("line", FOLDER_COMMANDS)
def test_an_output_folder_that_is_a_link_is_refused(block: Shell, line: str) -> None:
    (block.folder / "mine").mkdir()
    (block.folder / "out").symlink_to("mine")
    assert "it is a link" in block(f"{line} -o out", code=2).err
    assert block.files("mine") == set()


@pytest.mark.parametrize("line", FILE_COMMANDS)
def test_a_command_writes_its_file_again_but_not_over_one_of_the_user(
    block: Shell, line: str
) -> None:
    file = block.folder / "files" / "written"
    file.parent.mkdir()
    starts = []
    for _ in range(2):
        block(f"{line} {file}")
        starts.append(file.read_bytes()[:1])
    assert starts[0] == starts[1] != b""
    file.write_text("mine")
    assert str(file) in block.refuses(f"{line} {file}")
    assert file.read_text() == "mine"
    file.unlink()
    file.symlink_to(block.folder / "nowhere")
    block(f"{line} {file}", code=2)
    assert "nowhere" not in block.files()
    assert block.files("files") == {LIST_FILE, "written"}


def test_a_validation_writes_its_figures_beside_those_of_the_user_and_not_through_a_link(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
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
    runs = "headstock.app.actions.validating.run_validation"
    monkeypatch.setattr(runs, lambda *args, **settings: rows)
    figure, out = f"{FIGURE_NAME}.png", shell.folder / "out"
    for _ in range(2):
        shell("validate -o out")
        assert shell.files("out") == {LIST_FILE, figure}
    (out / figure).write_text("mine")
    shell("validate -o out")
    assert shell.text(f"out/{figure}") == "mine"
    assert (out / f"{FIGURE_NAME}-2.png").stat().st_size > 1000
    (shell.folder / "linked").symlink_to("out")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert "it is a link" in shell("validate -o linked", code=2).err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize("folder", ["mine", "linked", "nowhere"])
def test_a_new_scene_is_not_written_into_a_folder_that_exists_or_through_a_link(
    shell: Shell, folder: str
) -> None:
    (shell.folder / "mine").mkdir()
    (shell.folder / "mine" / "scene.toml").write_text("mine")
    (shell.folder / "linked").symlink_to("mine")
    (shell.folder / "nowhere").symlink_to("nothing")
    assert "Traceback" not in shell(f"new {folder}", code=2).err
    assert (shell.files("mine"), shell.text("mine/scene.toml")) == ({"scene.toml"}, "mine")
    assert "nothing" not in shell.files()


def test_a_report_is_not_written_over_one_that_was_edited(block: Shell) -> None:
    block("run scene.toml --no-figures -o out")
    (block.folder / "out" / "report.html").write_text("edited")
    block("report out", code=2)
    assert block.text("out/report.html") == "edited"
