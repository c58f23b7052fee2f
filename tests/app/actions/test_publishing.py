"""What a run leaves besides its results: tables, figures and a report that is the same when it is
made again.
"""

import csv
import io
import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from common import call
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

MACHINES = Path(__file__).resolve().parents[3] / "machines"


@pytest.fixture(scope="module")
def store_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("store")


@pytest.fixture(scope="module")
def finished(store_root: Path) -> Path:
    out = store_root.parent / "finished"
    few = 'analyses.modal.up_to="150 Hz"'
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADSTOCK_STORE", str(store_root))
        options = ["-o", str(out), "--variant", "R", "--set", few]
        assert main(["run", str(MACHINES / "three_axis.toml"), *options]) == 0
    return out


@pytest.fixture
def folder(
    finished: Path, store_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A copy of a finished run that a test may spoil."""
    monkeypatch.setenv("HEADSTOCK_STORE", str(store_root))
    return Path(shutil.copytree(finished, tmp_path / "out"))


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
    assert sorted(path.name for path in (folder / "figures").iterdir()) == [
        "machine_measured.png",
        "machine_reference.png",
    ]
    assert picture_size(folder / "figures" / "machine_reference.png") == (1500, 960)
    assert '<img class="still"' in (folder / "report.html").read_text()
    summary = read_summary(folder)
    rows = list(csv.reader(io.StringIO((folder / "tables" / "modes_reference.csv").read_text())))
    assert [float(row[1]) for row in rows[1:]] == summary["modal"][0]["frequencies_hz"]
    budget = list(
        csv.reader(io.StringIO((folder / "tables" / "budget_reference_tcp.csv").read_text()))
    )
    assert {row[0]: float(row[3]) for row in budget[1:]} == summary["static_poses"]["reference"][
        "tcp"
    ]["budget"]["z"]


def test_report_makes_the_same_page_again_and_draws_every_mode_and_chart(folder: Path) -> None:
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == before
    names = {path.stem for path in (folder / "figures").glob("*.png")}
    modes = read_summary(folder)["modal"]
    wanted = {
        f"mode_{pose['pose_name']}_{i + 1:02d}"
        for pose in modes
        for i in range(len(pose["frequencies_hz"]))
    }
    assert names == wanted | {
        "machine_reference",
        "machine_measured",
        "frequencies",
        "budget_reference_tcp",
        "budget_measured_tcp",
    }


def test_figures_can_be_left_out(folder: Path) -> None:
    assert publish_run(folder, open_results(folder), figures=False) == []
    assert '<img class="still"' not in (folder / "report.html").read_text()
    assert list((folder / "figures").glob("*.png")) == []


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
    assert {path.stem for path in (folder / "figures").glob("*.png")} == {
        "frequencies",
        "budget_reference_tcp",
        "budget_measured_tcp",
    }


@pytest.mark.workers
def test_a_renderer_that_ends_its_process_leaves_a_report_and_a_remark(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "pyvista.py").write_text("import os\nos.abort()\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "empty"))
    said = " ".join(call(capsys, ["report", str(folder)]).out.split())
    assert "warning: no picture of the machine: VTK ended the process (SIGABRT)" in said
    assert "VTK ended the process (SIGABRT)" in (folder / "report.html").read_text()
    assert main(["show", str(MACHINES / "three_axis.toml"), "-o", str(tmp_path / "x.png")]) == 1
    assert "VTK ended the process (SIGABRT)" in capsys.readouterr().err
    assert not (tmp_path / "x.png").exists()


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


def test_a_summary_that_is_none_is_named_and_nothing_is_overwritten(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, report = folder / "summary.json", (folder / "report.html").read_bytes()
    whole = path.read_text()
    summary = json.loads(whole)
    edited: tuple[object, ...] = (
        {**summary, "stages": 3},
        {**summary, "files": 3},
        [1],
        None,
        {},
    )
    for text in (whole[:-50], *(json.dumps(content) for content in edited)):
        path.write_text(text)
        capsys.readouterr()
        message = call(capsys, ["report", str(folder)], 2).err
        assert message.startswith("error: ") and "internal error" not in message
    assert (folder / "report.html").read_bytes() == report
    # the page is written from the answers: what somebody else writes beside them does not matter
    path.write_text(json.dumps({**summary, "modal": [{"x": 1}]}))
    call(capsys, ["report", str(folder)])
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
