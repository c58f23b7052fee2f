"""a disk that is full, read-only or failing ends a run with a named error and leaves the old
result (errors of fsync: test_atomic_files).
"""

import contextlib
import io
import shutil
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Self

import pytest
from mpi4py import MPI

from faults.disk import OLD, ResumeTrials, fill_disks
from faults.resume import SCENE
from faults.runs import VARIANTS, FaultError, Places, make_places, read_numbers
from headstock.app.actions.studying import study_command
from headstock.app.actions.sweeping import sweep_command
from headstock.app.command_line import main
from headstock.app.commands.batch_commands import StudyOptions, SweepOptions
from headstock.app.terminal.guard import run_guarded

pytestmark = [pytest.mark.hard("H45"), pytest.mark.workers, pytest.mark.fem, pytest.mark.process]

LIGHT_SCENE = (
    SCENE.replace('"200 mm", 500]', '"200 mm", 8]').replace(
        "[6, 7, 8, 9, 10, 11, 12, 13]", "[3, 4, 5]"
    )
    + f'[variants.{OLD}]\n"materials.steel.rho" = "7000 kg/m^3"\n'
)


@pytest.mark.trials
def test_three_runs_on_a_small_disk_end_right_or_with_a_named_error_and_the_old_result(
    tmp_path: Path,
) -> None:
    outcome = fill_disks(3, seed=5, root=tmp_path, kinds=("run",))
    assert outcome.faults == []
    assert outcome.trials == 3
    assert any(ending.startswith("run: exit 1") for ending in outcome.happened)


def start_here(
    root: Path, folder: Path, kind: str, variant: str | None, _: Mapping[str, str]
) -> tuple[int, str]:
    """A sweep or a study in this process, as the command line starts it."""
    scene, said = root / "scene.toml", io.StringIO()

    def work(comm: MPI.Comm) -> int:
        if kind == "sweep":
            options = SweepOptions(scene=scene, variant=variant, name="line", output=folder)
            return sweep_command(options, comm)
        grid = StudyOptions(scene=scene, variant=variant, name="grid", output=folder)
        return study_command(grid, comm)

    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        code = run_guarded(work, debug=False)
    return code, said.getvalue()


class StoppedClock(datetime):
    """A clock that stands still: files that hold the date are equal byte for byte."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> Self:
        return cls(2026, 1, 1, 12, tzinfo=tz)


@pytest.fixture(scope="module", params=["sweep", "study"])
def trials(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ResumeTrials]:
    root = tmp_path_factory.mktemp("trials")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADSTOCK_STORE", str(root / "store"))
        patch.setattr("headstock.pipeline.storage.provenance.datetime", StoppedClock)
        yield ResumeTrials(
            root / "sound", request.param, limited_files=True, scene=LIGHT_SCENE, start=start_here
        )


def test_a_full_disk_ends_a_sweep_or_study_by_name_and_it_goes_on_to_the_result_of_an_undisturbed_one(
    trials: ResumeTrials, tmp_path: Path
) -> None:
    # no room for a picture or page, and none while poses or points are being finished
    shares = enumerate((0.2, 0.5))
    endings = [trials.attempt(tmp_path / f"trial-{turn}", share, turn) for turn, share in shares]
    right = [text for text in endings if text.startswith("the right result after OutputError")]
    assert len(right) == 2, endings


@pytest.mark.parametrize("trials", ["study"], indirect=True)
def test_a_trial_tells_what_a_full_disk_must_not_do(
    trials: ResumeTrials, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = trials.results

    def attempt(name: str, change: Callable[[Path], tuple[int, str]]) -> str:
        def start(_root: Path, folder: Path, *_: object) -> tuple[int, str]:
            shutil.copytree(results, folder, dirs_exist_ok=True)
            return change(folder)

        monkeypatch.setattr(trials, "_run", start)
        with pytest.raises(FaultError) as caught:
            trials.attempt(tmp_path / name, 1.0, 0)
        return str(caught.value)

    def write(name: str, content: bytes, code: int = 0) -> Callable[[Path], tuple[int, str]]:
        def change(folder: Path) -> tuple[int, str]:
            (folder / name).write_bytes(content)
            return code, ""

        return change

    whole = (results / "points.jsonl").read_bytes()
    record = whole.splitlines(keepends=True)[-1]
    assert "study.json is torn" in attempt("torn", write("study.json", b'{"rows": ['))
    assert "study.png is neither" in attempt("picture", write("study.png", b"\x89PNG"))
    assert "a temporary stayed behind" in attempt("temporary", write(".study.png.x.part", b"x"))
    assert "lost what was finished" in attempt("lost", write("points.jsonl", record))
    assert "not that of an undisturbed one" in attempt(
        "other", write("points.jsonl", whole + record.replace(b'"done"', b'"failed"'))
    )
    assert "ended with 2" in attempt("code", write("points.jsonl", whole, 2))


def run_here(places: Places) -> tuple[int, str]:
    """A run in this process; its exit code and what it said on standard error."""
    words = ("run", str(places.scene), "-o", str(places.results), "--variant", VARIANTS[0])
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(said):
        patch.setenv("HEADSTOCK_STORE", str(places.store))
        code = main([*words, "--no-figures"])
    return code, said.getvalue()


def test_a_read_only_output_folder_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    places = make_places(tmp_path)
    places.results.symlink_to("/sys/kernel")  # refuses new files to everybody
    code, said = run_here(places)
    assert code == 2
    assert "cannot be written" in said and "-o DIR" in said
    assert "Traceback" not in said
    assert list(places.store.rglob("*.h5")) == []


def test_a_store_that_cannot_be_written_is_a_warning(tmp_path: Path) -> None:
    places = make_places(tmp_path)
    places.store.rmdir()
    places.store.symlink_to("/sys/kernel")
    code, said = run_here(places)
    assert code == 0, said
    assert "cannot be written" in (places.results / "summary.json").read_text()
    assert read_numbers(places.results).frequencies_hz[0] > 0.0
