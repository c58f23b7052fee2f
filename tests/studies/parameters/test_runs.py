import dataclasses
import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

import headstock.studies.parameters.runs
from common import approx, present, run_process
from fixture_machines import write_scene
from headstock.geometry.errors import HeadstockError
from headstock.meshing.errors import MeshError
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.run_state import Announcer
from headstock.pipeline.storage.content_keys import file_digests
from headstock.pipeline.storage.outputs import OutputError
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene
from headstock.scene.studies import Study, StudyFamily, describe_point, expand_study
from headstock.solvers.errors import CompileError
from headstock.studies.parameters.records import (
    POINTS_FILE,
    StudyRecord,
    append_record,
    open_records,
    read_records,
)
from headstock.studies.parameters.runs import (
    StudyError,
    StudyJob,
    check_study,
    hash_scene,
    run_study,
)
from headstock.studies.parameters.tables import tabulate_study

COLUMN = Path(__file__).resolve().parents[2] / "data" / "segmented_column.toml"
SCENE = (
    COLUMN.read_text()
    + """
[variants.aluminium]
"materials.steel.E" = "70 GPa"
[studies.grid]
vary = { "components.column.segments.count" = [2, 3, 4], "variant" = ["", "aluminium"] }
watch = ["static.tcp.compliance_um_per_kN[0][0]", "modal.frequencies_hz[0]"]
[analyses.static]
[analyses.modal]
"""
)
COUNT = "components.column.segments.count"


class Bench:
    """A scene with studies, which are computed into folders beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.write()

    def write(self, *changes: tuple[str, str], add: str = "") -> Path:
        return write_scene(self.folder, SCENE + add, *changes)

    def job(self, study: Study | None = None, *, retry: bool = False) -> StudyJob:
        path = self.folder / "scene.toml"
        scene = load_scene(path)
        chosen = study or scene.studies["grid"]
        return StudyJob(path, chosen, scene.raw, hash_scene(path), retry=retry)

    def compute(
        self, study: Study | None = None, into: str = "out", *, retry: bool = False
    ) -> tuple[list[StudyRecord], list[bool]]:
        """Records of a study, and of each point whether it was finished before."""
        return compute(self.job(study, retry=retry), self.folder / into)


def compute(job: StudyJob, folder: Path) -> tuple[list[StudyRecord], list[bool]]:
    known: list[bool] = []
    folder.mkdir(exist_ok=True)
    records = run_study(
        job, folder, comm=MPI.COMM_WORLD, observer=lambda point: known.append(point.known)
    )
    return records, known


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def vary(keys: dict[str, tuple[TomlValue, ...]], **family: Any) -> Study:
    return Study(
        "s", (StudyFamily("", "s", family.pop("settings", {}), keys, **family),), ("status",)
    )


def test_a_grid_has_every_combination_and_pairs_go_together() -> None:
    vary: dict[str, tuple[TomlValue, ...]] = {"a": (1, 2), "b": ("x", "y")}
    grid = Study("s", (StudyFamily("", "s", {"c": 0}, vary),))
    pairs = dataclasses.replace(grid, families=(StudyFamily("f", "F", {}, vary, pairwise=True),))
    varied = [tuple(point.varied.values()) for point in expand_study(grid)]
    assert varied == [(1, "x"), (1, "y"), (2, "x"), (2, "y")]
    assert expand_study(grid)[3].settings == {"c": 0, "a": 2, "b": "y"}
    described = [describe_point(point) for point in expand_study(pairs)]
    assert described == ["f, a = 1, b = x", "f, a = 2, b = y"]


def test_a_point_gives_what_a_run_of_the_same_scene_gives(bench: Bench) -> None:
    records, _ = bench.compute()
    table = tabulate_study(bench.job().study, records)
    soft = [row.values["static.tcp.compliance_um_per_kN[0][0]"] for row in table.rows]
    # 1 kN at the tip by Timoshenko, in um; exact beam springs give it with any number of segments
    assert soft[::2] == approx([435.8276] * 3, rel=1e-5)
    assert soft[1::2] == approx([435.8276 * 3.0] * 3, rel=1e-5)
    rough, fine = (row.values["modal.frequencies_hz[0]"] for row in (table.rows[0], table.rows[4]))
    assert isinstance(rough, float) and isinstance(fine, float) and rough > fine > 126.426


def test_a_second_study_computes_nothing_again_and_a_changed_scene_only_what_changed(
    bench: Bench,
) -> None:
    first, _ = bench.compute()
    again, known = bench.compute()
    assert [record.summary for record in again] == [record.summary for record in first]
    assert len(known) == 6 and all(known)
    bench.write(('"70 GPa"', '"71 GPa"'), ("[2, 3, 4]", "[2, 5]"))
    assert bench.compute()[1] == [True, False, False, False]


def test_a_point_that_fails_is_recorded_with_its_error_and_the_others_are_computed(
    bench: Bench,
) -> None:
    study = vary({"joints.clamp.kind": ("rigid", "mount"), COUNT: (2, 3)})
    records, _ = bench.compute(study)
    assert [record.status for record in records] == ["done", "done", "failed", "failed"]
    assert "joints.clamp" in records[2].error
    assert bench.compute(study)[1] == [True] * 4
    assert bench.compute(study, retry=True)[1] == [True, True, False, False]


@pytest.mark.parametrize(
    "fault",
    [
        OutputError("x cannot be written"),
        CompileError("a form could not be compiled"),
        MeshError("the mesh could not be written"),
    ],
)
def test_a_point_that_met_a_full_disk_ends_the_study_and_is_computed_when_it_is_started_again(
    fault: HeadstockError, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed, _ = bench.compute(into="alone")
    calls = iter(range(100))

    def run(
        scene: Scene, folder: Path, *, comm: MPI.Comm, store: Store, announce: Announcer
    ) -> Results:
        if next(calls) == 2:
            raise fault from OSError(errno.ENOSPC, "No space left on device")
        return run_scene(scene, folder, comm=comm, store=store, announce=announce)

    monkeypatch.setattr(headstock.studies.parameters.runs, "run_scene", run)
    with pytest.raises(type(fault), match=r"could not be|cannot be"):
        bench.compute()
    assert len(read_records(bench.folder / "out")) == 2
    records, known = bench.compute()
    assert known == [True, True, False, False, False, False]
    assert [record.key for record in records] == [record.key for record in undisturbed]
    for record, alone in zip(records, undisturbed, strict=True):
        assert record.status == "done"
        found, right = present(record.summary), present(alone.summary)
        assert (found["modal"], found["static"]) == (right["modal"], right["static"])


def test_values_that_do_not_fit_are_all_told_before_anything_is_computed(bench: Bench) -> None:
    with pytest.raises(SceneError) as caught:
        check_study(bench.job(vary({COUNT: (2, 0, 2.5)})))
    assert [COUNT in problem.key for problem in caught.value.problems] == [True, True]


def test_a_scene_that_changes_while_its_study_runs_ends_it_by_name(bench: Bench) -> None:
    job = bench.job()
    bench.write(add="# later\n")
    with pytest.raises(StudyError, match="changed while the study ran"):
        compute(job, bench.folder / "out")


def test_measured_forces_are_among_the_files_results_depend_on(tmp_path: Path) -> None:
    (tmp_path / "measured.csv").write_text("time,fx,fy,fz\n")
    raw: TomlTable = {"analyses": {"contouring": {"forces": "measured.csv"}, "modal": {}}}
    before = dict(file_digests(tmp_path, raw))
    (tmp_path / "measured.csv").write_text("time,fx,fy,fz\n0,0,0,0\n")
    assert before.keys() == {"measured.csv"}
    assert dict(file_digests(tmp_path, raw)) != before
    assert dict(file_digests(tmp_path, {"analyses": {"contouring": False}})) == {}


def test_a_cold_study_uses_an_empty_store_and_keeps_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(bench.folder / "store"))
    elastic: dict[str, TomlValue] = {
        "components.column.fidelity": "elastic",
        "components.column.mesh.cells": "hex",
        "components.column.mesh.order": 1,
    }
    sizes: dict[str, tuple[TomlValue, ...]] = {"components.column.mesh.size": ("200 mm",)}
    study = dataclasses.replace(vary(sizes, settings=elastic, analyses=("static",)), repeats=2)
    (record,), _ = bench.compute(dataclasses.replace(study, cold=True), "cold")
    assert len(record.seconds) == len(record.cpu_seconds) == 2
    assert record.cached_stages == 0
    assert not (bench.folder / "store").exists()
    (record,), _ = bench.compute(study, "warm")
    assert record.cached_stages > 0


def test_a_line_that_was_cut_short_is_dropped_and_the_file_goes_on_behind_it(bench: Bench) -> None:
    records, _ = bench.compute()
    out = bench.folder / "out"
    path = out / POINTS_FILE
    path.write_bytes(path.read_bytes()[:-40])
    assert len(read_records(out)) == len(records) - 1
    with open_records(out) as journal:
        append_record(journal, records[-1])
    assert len(path.read_bytes().splitlines()) == len(records)
    assert read_records(out).keys() == {record.key for record in records}


def test_lines_of_another_version_or_of_no_record_are_computed_anew(bench: Bench) -> None:
    bench.compute()
    path = bench.folder / "out" / POINTS_FILE
    old = json.loads(path.read_text().splitlines()[0])
    assert len(read_records(path.parent)) == 6
    lines = [json.dumps(old | change) for change in ({"format": 0}, {"new": 1})]
    path.write_text("\n".join([*lines, "[]", "{}", "not json", "5", ""]))
    assert read_records(path.parent) == {}


@pytest.mark.trials
def test_a_killed_study_loses_no_finished_point(bench: Bench) -> None:
    counts = ", ".join(str(count) for count in range(1, 13))
    path = bench.write(
        ("[2, 3, 4]", f"[{counts}]"), ("watch = [", 'analyses = "static"\nwatch = [')
    )
    program = [sys.executable, "-P", "-m", "headstock.app.command_line"]
    command = [*program, "study", str(path), "grid", "-o", str(bench.folder / "out")]
    points = bench.folder / "out" / POINTS_FILE
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 60.0
        while (
            time.monotonic() < deadline
            and process.poll() is None
            and (not points.exists() or points.read_bytes().count(b"\n") < 3)
        ):
            time.sleep(0.005)
        os.kill(process.pid, signal.SIGKILL)
    finished = points.read_bytes()[: points.read_bytes().rfind(b"\n") + 1]
    assert 3 <= finished.count(b"\n") < 24
    done = run_process(command, timeout=120)
    assert done.returncode == 0, done.stderr
    assert points.read_bytes().startswith(finished)
    assert points.read_bytes().count(b"\n") == 24
    assert done.stdout.count("finished before") == finished.count(b"\n")
