"""a run killed at any time leaves whole files, and the next run finds what an undisturbed one
finds.
"""

import random
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from faults import kill
from faults.kill import check_remains, kill_runs
from faults.resume import SCENE, kill_and_resume
from faults.runs import (
    FaultError,
    Numbers,
    Places,
    finish_run,
    make_places,
    read_numbers,
    wait_for_end,
)
from headstock.pipeline.storage.outputs import LIST_FILE

pytestmark = [pytest.mark.hard("H44"), pytest.mark.workers]

KINDS = {".h5", ".json", ".html", ".png", ".glb", ".vtu", ".pvd", ".csv"}
CUTS = 12


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Places, dict[str, Numbers]]:
    places = make_places(tmp_path_factory.mktemp("finished"))
    code, said = finish_run(places, "steel")
    assert code == 0, said
    return places, {"steel": read_numbers(places.results)}


@pytest.mark.trials
def test_two_killed_runs_leave_no_torn_file_and_the_next_run_is_right(tmp_path: Path) -> None:
    outcome = kill_runs(2, seed=44, root=tmp_path)
    assert outcome.faults == []
    assert outcome.trials == 2
    assert any(ending.startswith("killed") for ending in outcome.happened)


def test_every_file_of_a_run_is_known_as_torn_when_its_end_is_missing(
    finished: tuple[Places, dict[str, Numbers]],
) -> None:
    places, expected = finished
    check_remains(places, expected)
    chance, kinds = random.Random(44), set()
    for path in sorted(
        path for path in places.results.rglob("*") if path.is_file() and path.name != LIST_FILE
    ):
        whole = path.read_bytes()
        kinds.add(path.suffix)
        for length in (
            0,
            1,
            len(whole) - 2,
            *(chance.randrange(len(whole) - 1) for _ in range(CUTS)),
        ):
            if path.suffix == ".csv" and whole[:length].endswith(b"\n"):
                continue  # a table without its last lines looks like a whole one
            path.write_bytes(whole[:length])
            with pytest.raises(FaultError, match=path.name):
                check_remains(places, expected)
        path.write_bytes(whole)
    assert kinds == KINDS


def test_what_does_not_end_is_killed_with_its_children_and_is_a_fault() -> None:
    command = ["sh", "-c", "sleep 300 & sleep 300"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    with pytest.raises(FaultError, match=r"did not end in 0.2 s"):
        wait_for_end(process, seconds=0.2)
    # its child, which holds the same pipe, is gone too: else reading to the pipe's end would have
    # taken 300 s
    assert process.returncode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("report.html", b"<html><body>"),
        ("report.html", b"<!doctype html>\n<html><body></body></html>\n"),
        ("summary.json", b"{}"),
        ("results.h5", b"\x89HDF\r\n\x1a\n"),
    ],
    ids=["half a page", "an empty page", "an empty summary", "the head of HDF5"],
)
def test_a_file_that_only_looks_like_one_is_known_as_torn(
    name: str, content: bytes, finished: tuple[Places, dict[str, Numbers]]
) -> None:
    places, expected = finished
    path = places.results / name
    whole = path.read_bytes()
    path.write_bytes(content)
    try:
        with pytest.raises(FaultError, match=name):
            check_remains(places, expected)
    finally:
        path.write_bytes(whole)


def test_torn_files_wrong_numbers_and_temporaries_of_killed_runs_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, finished: tuple[Places, dict[str, Numbers]]
) -> None:
    spoils = iter(["results.h5", "summary.json", "report.html", "numbers", "nothing"])

    def finish(places: Places, variant: str) -> tuple[int, str]:
        shutil.copytree(finished[0].results, places.results, dirs_exist_ok=True)
        return 0, ""

    def spoil(places: Places, *_: object) -> str:
        finish(places, "steel")
        name = next(spoils)
        if name == "numbers":
            summary = places.results / "summary.json"
            summary.write_text(
                summary.read_text().replace('"frequencies_hz": [', '"frequencies_hz": [1.0, ')
            )
        elif name != "nothing":
            path = places.results / name
            path.write_bytes(path.read_bytes()[:-100])
        return "killed by hand"

    monkeypatch.setattr(kill, "_kill_one", spoil)
    monkeypatch.setattr(kill, "finish_run", finish)
    outcome = kill_runs(5, seed=1, root=tmp_path)
    reported = " | ".join(outcome.faults)
    assert [fault.partition(":")[0] for fault in outcome.faults] == [
        "kill 1",
        "kill 2",
        "kill 3",
        "kill 4",
    ], reported
    for number, name in enumerate(
        ("results.h5", "summary.json", "report.html", "numbers of neither variant")
    ):
        assert name in outcome.faults[number]


@pytest.mark.trials
@pytest.mark.parametrize("kind", ["sweep", "study"])
def test_a_sweep_or_study_killed_once_ends_as_an_undisturbed_one(tmp_path: Path, kind: str) -> None:
    short = SCENE.replace('"200 mm", 500]', '"200 mm", 200]').replace(
        "[6, 7, 8, 9, 10, 11, 12, 13]", "[6, 7, 8, 9]"
    )
    # the seed ends it in its last third
    outcome = kill_and_resume(1, seed=105, root=tmp_path, kinds=(kind,), scene=short)
    assert outcome.faults == []
    assert outcome.trials == 1
