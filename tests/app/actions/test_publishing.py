"""What a run leaves besides its results: tables, figures and a report that is the same when it is
made again.
"""

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from common import Shell, read_rows
from headstock.app.actions.publishing import _publish_again, publish_run
from headstock.app.command_line import main
from headstock.app.pictures import pictures
from headstock.app.pictures.pictures import draw_machine
from headstock.app.pictures.scenes import _rest_picture
from headstock.app.tables.table import PlainTable, encode_csv
from headstock.geometry.frames import Frame
from headstock.geometry.parts.skins import box_skin
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import open_results, read_view
from headstock.pipeline.results.views import MachineView, PointView, PoseView
from headstock.pipeline.storage.store import Store

THREE_AXIS = Path(__file__).resolve().parents[3] / "machines" / "three_axis.toml"
CHARTS = {"frequencies", "budget_reference_tcp", "budget_measured_tcp"}


@pytest.fixture(scope="module")
def store_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("store")


@pytest.fixture(scope="module")
def finished(store_root: Path) -> Path:
    out = store_root.parent / "finished"
    few = 'analyses.modal.up_to="150 Hz"'
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADSTOCK_STORE", str(store_root))
        words = ["run", str(THREE_AXIS), "-o", str(out), "--variant", "R", "--set", few]
        assert main(words) == 0
    return out


@pytest.fixture
def folder(
    finished: Path, store_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A copy of a finished run that a test may spoil."""
    monkeypatch.setenv("HEADSTOCK_STORE", str(store_root))
    return Path(shutil.copytree(finished, tmp_path / "out"))


def pictures_in(folder: Path) -> set[str]:
    return {path.stem for path in (folder / "figures").glob("*.png")}


def picture_size(path: Path) -> tuple[int, int]:
    content = path.read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n" and content[-8:-4] == b"IEND"
    return struct.unpack(">II", content[16:24])


def test_a_run_leaves_tables_modes_a_picture_per_pose_and_a_report_with_the_first_of_them(
    folder: Path,
) -> None:
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == {
        "results.h5", "summary.json", "report.html", "tables", "modes", "figures",
    }  # fmt: skip
    assert pictures_in(folder) == {"machine_measured", "machine_reference"}
    assert picture_size(folder / "figures" / "machine_reference.png") == (1500, 960)
    assert '<img class="still"' in (folder / "report.html").read_text()
    summary = read_summary(folder)
    modes = read_rows(folder / "tables" / "modes_reference.csv")
    found = [float(row["frequency [Hz]"]) for row in modes]
    assert found == summary["modal"][0]["frequencies_hz"]
    budget = read_rows(folder / "tables" / "budget_reference_tcp.csv")
    shares = {name: float(z) for name, _, _, z in (row.values() for row in budget)}
    assert shares == summary["static_poses"]["reference"]["tcp"]["budget"]["z"]


def test_report_makes_the_same_page_again_and_draws_every_mode_and_chart(folder: Path) -> None:
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == before
    wanted = {
        f"mode_{pose['pose_name']}_{number:02d}"
        for pose in read_summary(folder)["modal"]
        for number in range(1, len(pose["frequencies_hz"]) + 1)
    }
    assert wanted
    assert pictures_in(folder) == wanted | CHARTS | {"machine_reference", "machine_measured"}


def test_figures_can_be_left_out(folder: Path) -> None:
    assert publish_run(folder, open_results(folder), figures=False) == []
    assert '<img class="still"' not in (folder / "report.html").read_text()
    assert pictures_in(folder) == set()


def test_pictures_of_an_unchanged_machine_come_from_the_store(
    folder: Path, store_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = read_view(folder)
    first = draw_machine(view, Store(store_root))

    def refuse(*arguments: object) -> None:
        raise AssertionError("a child was started")

    monkeypatch.setattr(pictures, "_run", refuse)
    assert draw_machine(view, Store(store_root)).images == first.images
    moved = {
        name: PoseView(pose.placements | {"base": Frame(np.ones(3))}, {}, {})
        for name, pose in view.poses.items()
    }
    with pytest.raises(AssertionError, match="a child was started"):
        draw_machine(MachineView(view.skins, {}, moved), Store(store_root))


@pytest.mark.workers
def test_a_report_without_pyvista_says_why_it_has_no_picture_and_still_has_charts(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pyvista.py").write_text("raise ModuleNotFoundError('no such room: pyvista')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "empty"))
    remarks = _publish_again(folder, open_results(folder))
    why = "ModuleNotFoundError: no such room: pyvista; ./headstock doctor tells what is missing"
    assert remarks == [f"no picture of the machine: {why}", f"no pictures of modes: {why}"]
    assert f"No picture of the machine: {why}." in (folder / "report.html").read_text()
    assert pictures_in(folder) == CHARTS


@pytest.mark.workers
def test_a_renderer_that_ends_its_process_leaves_a_report_and_a_remark(
    folder: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    (shell.folder / "first").mkdir()  # modules of the working folder are not taken
    (shell.folder / "first" / "pyvista.py").write_text("import os\nos.abort()\n")
    monkeypatch.syspath_prepend(shell.folder / "first")
    ended = "VTK ended the process (SIGABRT)"
    said = shell.prints("report", folder)
    assert f"warning: no picture of the machine: {ended}" in said
    assert ended in (folder / "report.html").read_text()
    assert ended in shell(f"show {THREE_AXIS} -o x.png", code=1).err
    assert "x.png" not in shell.files()


@pytest.mark.workers
def test_without_opengl_the_missing_library_is_named(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a library that cannot be loaded, found before the system's
    (tmp_path / "libEGL.so.1").touch()
    monkeypatch.setenv("LD_LIBRARY_PATH", str(tmp_path))
    drawn = draw_machine(read_view(folder), Store(tmp_path / "empty"))
    assert drawn.images == {}
    assert drawn.remark == (
        "no picture of the machine: VTK finds no EGL library; ./headstock doctor tells what is missing"
    )


# of a summary, or what takes its place
EDITED: tuple[object, ...] = ({"stages": 3}, {"files": 3}, [1], None, {})


@pytest.mark.parametrize("edited", [*EDITED, "cut"])
def test_a_summary_that_is_none_is_named_and_nothing_is_overwritten(
    folder: Path, shell: Shell, edited: object
) -> None:
    path, report = folder / "summary.json", (folder / "report.html").read_bytes()
    whole = path.read_text()
    changed = {**json.loads(whole), **edited} if isinstance(edited, dict) and edited else edited
    path.write_text(whole[:-50] if edited == "cut" else json.dumps(changed))
    message = shell("report", folder, code=2).err
    assert message.startswith("error: ") and "internal error" not in message
    assert (folder / "report.html").read_bytes() == report


def test_a_page_is_written_from_the_answers_whatever_somebody_writes_beside_them(
    folder: Path, shell: Shell
) -> None:
    path, report = folder / "summary.json", (folder / "report.html").read_bytes()
    path.write_text(json.dumps({**json.loads(path.read_text()), "modal": [{"x": 1}]}))
    shell("report", folder)
    assert (folder / "report.html").read_bytes() == report


def test_a_spreadsheet_takes_no_text_of_a_scene_for_a_formula() -> None:
    table = PlainTable("t", ("name", "value"), (('=HYPERLINK("x")', -1.5), ("a,b\nc", None)))
    assert encode_csv(table).decode() == 'name,value\r\n"\'=HYPERLINK(""x"")",-1.5\r\n"a,b\nc",\r\n'


def test_a_picture_of_the_machine_shows_bodies_where_they_stand_and_the_tool_where_it_is() -> None:
    pose = PoseView(
        {"a": Frame(np.array([1.0, 0.0, 0.0]))},
        {},
        {"tcp": PointView("a.tip", "ground", np.array([1.0, 0.0, 1.0]))},
    )
    picture = _rest_picture(
        "p", MachineView({"a": box_skin(np.zeros(3), np.ones(3))}, {}, {"p": pose}), pose, (10, 10)
    )
    np.testing.assert_array_equal(
        [picture.points.min(axis=0), picture.points.max(axis=0)], [[1, 0, 0], [2, 1, 1]]
    )
    tools = picture.marks[1]
    np.testing.assert_array_equal(tools.places, [[1, 0, 1]])
    assert tools.in_front


def test_the_same_command_again_leaves_results_and_report_as_they_are(
    store_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(store_root))
    words = ["run", str(THREE_AXIS), "-o", str(tmp_path), "--variant", "R", "--no-figures"]
    words += ["--analysis", "static"]
    kept = ("results.h5", "report.html")

    def run_again(*more: str) -> list[int]:
        assert main([*words, *more]) == 0
        open_results(tmp_path)  # they belong together
        return [(tmp_path / name).stat().st_mtime_ns for name in kept]

    table = tmp_path / "tables" / "compliance_reference_tcp.csv"
    written = run_again()
    content = table.read_bytes()
    assert run_again() == written
    table.unlink()
    results, report = run_again()
    assert results == written[0] and report > written[1] and table.read_bytes() == content
    assert run_again() == [results, report]
    heavier = run_again("--set", "components.base.mass=500 kg")
    assert heavier[0] > results and heavier[1] > report
