"""H45: a disk that is full, read-only or failing ends a run with a named error and leaves the old result (errors of fsync: test_atomic_files)."""

from pathlib import Path

from headstock.validation.campaign_runs import VARIANTS, finish_run, make_places, read_numbers
from headstock.validation.disk_campaign import run_disk_campaign


def test_three_runs_on_a_small_disk_end_right_or_with_a_named_error_and_the_old_result(tmp_path: Path) -> None:
    outcome = run_disk_campaign(3, seed=5, root=tmp_path, on_trial=lambda _: None)
    assert outcome.faults == []
    assert outcome.trials == 3
    assert any(ending.startswith("exit 1") for ending in outcome.happened)


def test_a_read_only_output_folder_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    places = make_places(tmp_path)
    places.results.symlink_to("/sys/kernel")  # refuses new files to everybody
    code, said = finish_run(places, VARIANTS[0])
    assert code == 1
    assert "OutputError" in said and "cannot be written" in said and "-o DIR" in said
    assert "Traceback" not in said
    assert list(places.store.rglob("*.h5")) == []


def test_a_store_that_cannot_be_written_is_a_warning(tmp_path: Path) -> None:
    places = make_places(tmp_path)
    places.store.rmdir()
    places.store.symlink_to("/sys/kernel")
    code, said = finish_run(places, VARIANTS[0])
    assert code == 0, said
    assert "cannot be written" in (places.results / "summary.json").read_text()
    assert read_numbers(places.results).frequencies_hz[0] > 0.0
