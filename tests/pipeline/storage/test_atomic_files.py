"""A file is the old one or the whole new one; nothing else stays, and nobody's temporary is taken
away while it is written.
"""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from headstock.pipeline.storage.atomic_files import lock_folder, write_atomically

WRITER = """
import os, sys, time
from pathlib import Path
from headstock.pipeline.storage import atomic_files
real = os.fsync
def slow(handle):
    print("writing", flush=True)
    time.sleep(float(sys.argv[2]))
    real(handle)
os.fsync = slow
atomic_files.write_atomically(Path(sys.argv[1]), b"new")
"""


def start_writer(path: Path, seconds: float) -> "subprocess.Popen[str]":
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), str(seconds)], stdout=subprocess.PIPE, text=True
    )
    assert writer.stdout is not None and writer.stdout.readline() == "writing\n"
    return writer


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EDQUOT])
@pytest.mark.parametrize("call", ["fsync", "fchmod"])
def test_an_error_of_the_disk_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, call: str
) -> None:
    path = tmp_path / "results.h5"
    path.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, call, fail)
    with pytest.raises(OSError, match=os.strerror(code)):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_killed_writer_leaves_the_old_file_and_the_next_writer_clears_its_temporary(
    tmp_path: Path,
) -> None:
    path = tmp_path / "results.h5"
    path.write_bytes(b"old")
    writer = start_writer(path, 60.0)
    writer.send_signal(signal.SIGKILL)
    writer.communicate()
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 2
    write_atomically(path, b"next")
    assert path.read_bytes() == b"next"
    assert list(tmp_path.iterdir()) == [path]


def test_a_temporary_that_is_being_written_is_left_to_its_writer(tmp_path: Path) -> None:
    path = tmp_path / "results.h5"
    writer = start_writer(path, 1.0)
    write_atomically(path, b"quick")
    assert len(list(tmp_path.iterdir())) == 2
    writer.communicate(timeout=20)
    assert writer.returncode == 0
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_temporaries_of_other_files_are_not_touched(tmp_path: Path) -> None:
    other = tmp_path / ".summary.json.abc.part"
    other.write_bytes(b"")
    write_atomically(tmp_path / "results.h5", b"new")
    assert other.exists()


def test_a_folder_is_locked_by_one_and_free_again_when_that_one_is_killed(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from headstock.pipeline.storage.atomic_files import lock_folder\n"
        "with lock_folder(Path(sys.argv[1])) as mine:\n    print(mine, flush=True)\n    time.sleep(60)\n"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None and holder.stdout.readline() == "True\n"
    with lock_folder(tmp_path) as mine:
        assert not mine
    holder.kill()
    holder.communicate()
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        with lock_folder(tmp_path) as mine:
            if mine:
                return
    raise AssertionError("a dead process still holds the folder")
