"""What Headstock did not write, or what was changed since, is neither written over nor removed,
through links or however a run ends.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from headstock.pipeline.storage import outputs
from headstock.pipeline.storage.outputs import (
    LIST_FILE,
    OutputError,
    PendingOutputs,
    TakenOutputError,
    claim_output,
    prepare_output,
    read_growing_file,
    replace_outputs,
    write_named_files,
    write_output,
)
from headstock.studies.parameters.records import POINTS_FILE, read_records
from headstock.studies.sweeps.journals import FOLDER, open_journal, remove_other_journals

# kills itself in the call of os.NAME whose number is given
KILLED = """
import os, signal, sys
from pathlib import Path
from headstock.pipeline.storage import outputs
name, number, folder = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
owner, real, calls = (Path, Path.replace, []) if name == "replace" else (os, getattr(os, name), [])
def call(*arguments, **options):
    calls.append(name)
    if len(calls) == number:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(*arguments, **options)
setattr(owner, name, call)
outputs.write_output(folder / "summary.json", b"new")
outputs.replace_outputs(folder, "tables", {"new.csv": b"new"})
"""


def visible(folder: Path) -> dict[str, bytes]:
    found = {
        path.relative_to(folder).as_posix(): path
        for path in folder.rglob("*")
        if path.is_file() and not path.is_symlink()
    }
    return {name: path.read_bytes() for name, path in found.items() if path.name != LIST_FILE}


def test_files_of_the_user_stay_and_those_of_an_earlier_run_go(tmp_path: Path) -> None:
    tables = tmp_path / "tables"
    tables.mkdir()
    (tables / "mine.csv").write_bytes(b"years of work")
    assert replace_outputs(tmp_path, "tables", {"a.csv": b"1", "b.csv": b"2"}) == []
    assert replace_outputs(tmp_path, "tables", {"b.csv": b"3"}) == []
    assert visible(tables) == {"mine.csv": b"years of work", "b.csv": b"3"}


def test_a_file_that_was_changed_since_is_kept_and_said_once(tmp_path: Path) -> None:
    replace_outputs(tmp_path, "tables", {"a.csv": b"1"})
    (tmp_path / "tables" / "a.csv").write_bytes(b"with a note")
    (remark,) = replace_outputs(tmp_path, "tables", {})
    assert "a.csv" in remark and "kept" in remark
    assert replace_outputs(tmp_path, "tables", {}) == []
    assert visible(tmp_path) == {"tables/a.csv": b"with a note"}


def test_where_a_file_of_the_user_has_the_name_the_new_one_is_written_beside_it(
    tmp_path: Path,
) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "a.csv").write_bytes(b"mine")
    for content in (b"1", b"2"):
        (remark,) = replace_outputs(tmp_path, "tables", {"a.csv": content})
        assert "a.csv" in remark and "a-2.csv" in remark
        assert visible(tmp_path) == {"tables/a.csv": b"mine", "tables/a-2.csv": content}
    (tmp_path / "tables" / "a.csv").unlink()
    assert replace_outputs(tmp_path, "tables", {"a.csv": b"3"}) == []
    assert visible(tmp_path) == {"tables/a.csv": b"3"}


def test_two_files_never_get_the_same_name(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"mine")
    assert len(write_named_files(tmp_path, {"a-2.png": b"1", "a.png": b"2"})) == 1
    assert visible(tmp_path) == {"a.png": b"mine", "a-2.png": b"1", "a-3.png": b"2"}


def test_a_single_file_is_written_again_and_again_but_not_over_one_of_the_user(
    tmp_path: Path,
) -> None:
    path = tmp_path / "x.json"
    for content in (b"1", b"22", b"1"):
        write_output(path, content)
        assert path.read_bytes() == content
    path.write_bytes(b"mine")
    with pytest.raises(TakenOutputError, match=r"x\.json exists"):
        write_output(path, b"3")
    assert path.read_bytes() == b"mine"


def test_a_copied_folder_of_results_is_written_into_as_the_old_one(tmp_path: Path) -> None:
    write_output(tmp_path / "x.json", b"1")
    (tmp_path / "moved").mkdir()
    for name in ("x.json", LIST_FILE):
        (tmp_path / name).rename(tmp_path / "moved" / name)
    write_output(tmp_path / "moved" / "x.json", b"2")
    assert visible(tmp_path) == {"moved/x.json": b"2"}


def test_taken_names_are_refused_before_anything_is_computed(tmp_path: Path) -> None:
    (tmp_path / "results.h5").write_bytes(b"mine")
    with (
        pytest.raises(TakenOutputError, match=r"results\.h5.*nothing was computed.*-o DIR"),
        claim_output(tmp_path, ["results.h5"]),
    ):
        raise AssertionError("the body ran")
    write_output(tmp_path / "summary.json", b"1")
    prepare_output(tmp_path, ["summary.json", "report.html"])
    (tmp_path / "summary.json").write_bytes(b"edited")
    with pytest.raises(TakenOutputError, match=r"summary\.json"):
        prepare_output(tmp_path, ["summary.json", "report.html"])


def test_a_linked_output_folder_is_refused_and_one_below_a_link_is_not(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with pytest.raises(TakenOutputError, match="it is a link"):
        prepare_output(tmp_path / "link")
    prepare_output(tmp_path / "link" / "run")
    assert (tmp_path / "real" / "run").is_dir()


@pytest.mark.parametrize("kind", ["link", "dangling link", "pipe", "folder", "hard link"])
def test_what_is_no_plain_file_of_headstock_is_not_written_over(tmp_path: Path, kind: str) -> None:
    path, mine = tmp_path / "x.json", tmp_path / "mine.json"
    mine.write_bytes(b"mine")
    write_output(path, b"old")
    path.unlink()
    makers: dict[str, Callable[[], None]] = {
        "link": lambda: path.symlink_to(mine),
        "dangling link": lambda: path.symlink_to(tmp_path / "nowhere"),
        "pipe": lambda: os.mkfifo(path),
        "folder": path.mkdir,
        "hard link": lambda: path.hardlink_to(mine),
    }
    makers[kind]()
    with pytest.raises(TakenOutputError, match=r"x\.json"):
        write_output(path, b"new")
    assert mine.read_bytes() == b"mine"
    assert not (tmp_path / "nowhere").exists()


def test_a_link_to_a_file_of_an_earlier_run_is_not_removed(tmp_path: Path) -> None:
    replace_outputs(tmp_path, "tables", {"a.csv": b"1"})
    (tmp_path / "tables" / "a.csv").rename(tmp_path / "kept.csv")
    (tmp_path / "tables" / "a.csv").symlink_to(tmp_path / "kept.csv")
    replace_outputs(tmp_path, "tables", {})
    assert (tmp_path / "tables" / "a.csv").is_symlink()


@pytest.mark.parametrize("what", ["link", "pipe", "folder"])
def test_a_list_that_is_no_file_is_a_named_error(tmp_path: Path, what: str) -> None:
    path, mine = tmp_path / LIST_FILE, tmp_path / "mine"
    mine.write_bytes(b"mine\n")
    makers: dict[str, Callable[[], None]] = {
        "link": lambda: path.symlink_to(mine),
        "pipe": lambda: os.mkfifo(path),
        "folder": path.mkdir,
    }
    makers[what]()
    with pytest.raises(OutputError, match="cannot be written"):
        write_output(tmp_path / "x.json", b"1")
    assert mine.read_bytes() == b"mine\n"


@pytest.mark.parametrize("call", ["write", "fsync", "replace"])
def test_a_run_that_is_killed_anywhere_leaves_no_file_that_is_taken_for_the_users(
    tmp_path: Path, call: str
) -> None:
    for number in range(1, 12):
        folder = tmp_path / f"{call}{number}"
        folder.mkdir()
        (folder / "mine.csv").write_bytes(b"mine")
        write_output(folder / "summary.json", b"old")
        replace_outputs(folder, "tables", {"old.csv": b"old", "new.csv": b"old"})
        done = subprocess.run([sys.executable, "-P", "-c", KILLED, call, str(number), str(folder)])
        prepare_output(folder, ["summary.json"])
        write_output(folder / "summary.json", b"last")
        assert replace_outputs(folder, "tables", {"last.csv": b"last"}) == []
        assert visible(folder) == {
            "mine.csv": b"mine",
            "summary.json": b"last",
            "tables/last.csv": b"last",
        }
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL
    assert number > 2
    assert done.returncode == 0


def test_a_list_stays_short_and_forgets_nothing_that_lies_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outputs, "LIST_BYTES", 2000)
    write_output(tmp_path / "first.json", b"first")
    for number in range(60):
        write_output(tmp_path / "x.json", f"{number}".encode())
    assert (tmp_path / LIST_FILE).stat().st_size < 2500
    write_output(tmp_path / "first.json", b"second")


def test_a_full_disk_leaves_list_and_files_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_output(tmp_path / "x.json", b"1")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    real = os.write
    monkeypatch.setattr(os, "write", lambda handle, text: real(handle, text[:7]))
    with PendingOutputs() as pending:
        pending.add(tmp_path / "x.json", b"2")
        with pytest.raises(OSError, match="the disk is full"):
            pending.publish()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_file_of_the_user_called_like_that_of_a_study_is_neither_cut_nor_added_to(
    tmp_path: Path,
) -> None:
    path = tmp_path / POINTS_FILE
    path.write_bytes(b"my points, without an end of the line")
    with pytest.raises(TakenOutputError, match=r"points\.jsonl"):
        read_records(tmp_path)
    assert path.read_bytes() == b"my points, without an end of the line"
    path.write_bytes(b'{"key": "half a li')
    assert read_records(tmp_path) == {}


def test_journals_that_headstock_did_not_write_are_neither_emptied_nor_removed(
    tmp_path: Path,
) -> None:
    key, other = "a" * 64, "b" * 64
    mine = tmp_path / FOLDER / f"{key[:16]}-1.journal"
    mine.parent.mkdir()
    mine.write_bytes(b"dear diary")
    with pytest.raises(TakenOutputError, match=r"\.journal exists"):
        open_journal(tmp_path, key, "1")
    remove_other_journals(tmp_path, other)
    assert mine.read_bytes() == b"dear diary"
    with open_journal(tmp_path, key, "2"):
        pass
    remove_other_journals(tmp_path, other)
    assert [path.name for path in mine.parent.iterdir()] == [mine.name]


def test_journals_are_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / FOLDER).symlink_to(tmp_path / "mine")
    with pytest.raises(TakenOutputError, match="it is a link"):
        open_journal(tmp_path, "a" * 64, "1")
    assert list((tmp_path / "mine").iterdir()) == []
    linked = tmp_path / "linked"
    linked.symlink_to(tmp_path / "nowhere")
    with pytest.raises(TakenOutputError, match="it is a link"):
        read_growing_file(linked, b"x")
