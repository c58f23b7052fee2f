"""Whoever waits sees how a long stage goes on: a bar on a terminal that leaves no trace, lines in a
log; and nothing outlives the run.
"""

import contextlib
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from common import approx
from headstock.app.terminal import progress
from headstock.app.terminal.progress_renderer import _render_bar, _render_line

TIME_SCALE = "0.02"
PROGRAM = """
import sys, time
from headstock.app.terminal.progress import Progress
shown = Progress(time_scale=float(sys.argv[1]))
shown.begin("mesh    column", 40.0)
time.sleep(float(sys.argv[2]))
shown.end()
print("mesh column done", flush=True)
shown.close()
"""


def start(stdout: int, seconds: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-P", "-c", PROGRAM, TIME_SCALE, seconds]
    variables = {name: value for name, value in os.environ.items() if not name.startswith("OMPI_")}
    return subprocess.Popen(
        command, stdout=stdout, stderr=subprocess.DEVNULL, start_new_session=True, env=variables
    )


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    ours, theirs = pty.openpty()
    yield ours, theirs
    os.close(ours)


def read_until(handle: int, words: bytes) -> bytes:
    text = b""
    while words not in text:
        text += os.read(handle, 4096)
    return text


def read_until_closed(handle: int) -> None:
    with contextlib.suppress(OSError):
        while True:
            os.read(handle, 4096)


def test_on_a_terminal_a_bar_creeps_on_and_is_gone_when_the_stage_is_told(
    terminal: tuple[int, int],
) -> None:
    ours, theirs = terminal
    process = start(theirs, "0.7")
    os.close(theirs)
    text = read_until(ours, b"done").decode()
    assert process.wait() == 0
    assert text.count("━") + text.count("─") > 0
    assert "mesh    column" in text and "of about 40 s" in text
    # the line of the stage stands on a cleared line
    assert text.split("\x1b[K")[-1].startswith("mesh column done")


def test_without_a_terminal_plain_lines_come_now_and_then() -> None:
    process = start(subprocess.PIPE, "2")
    said, _ = process.communicate()
    lines = said.decode().splitlines()
    assert lines[-1] == "mesh column done"
    assert len(lines) >= 2
    for line in lines[:-1]:
        assert line.startswith("  mesh    column ") and line.endswith("about 40 s expected")
    assert "\x1b" not in said.decode() and "\r" not in said.decode()


def test_a_killed_run_leaves_no_renderer_behind(terminal: tuple[int, int]) -> None:
    ours, theirs = terminal
    process = start(theirs, "60")
    os.close(theirs)
    read_until(ours, b"of about")
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    # the terminal closes when the last process that has it open ends
    read_until_closed(ours)


def test_what_is_quick_starts_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a process was started"))
    with progress.show_progress() as shown:
        shown.begin("static  reference", 0.0)
        shown.end()
        shown.begin("mesh    column", 1.0)
        shown.end()


def test_a_renderer_that_is_killed_or_cannot_start_stops_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(progress, "RENDERER", tmp_path / "gone.py")
    with progress.show_progress() as shown:
        for _ in range(3):
            shown.begin("mesh    column", 10.0)
            shown.end()


@pytest.mark.parametrize(
    ("elapsed", "expected", "share"),
    [(0.0, 10.0, 0.0), (5.0, 10.0, 0.45), (10.0, 10.0, 0.9), (100.0, 10.0, 0.99)],
)
def test_the_bar_is_never_full_however_long_it_takes(
    elapsed: float, expected: float, share: float
) -> None:
    bar = _render_bar("mesh", elapsed, expected, 200)
    filled, rest = bar.count("━"), bar.count("─")
    assert rest >= 1
    assert filled / (filled + rest) == approx(share, abs=0.04)


def test_a_narrow_terminal_gets_one_line_and_a_stage_nobody_can_estimate_gets_its_seconds() -> None:
    assert len(_render_bar("reduce  a_component_with_a_long_name", 12.0, 30.0, 40)) == 39
    assert _render_bar("reduce  part", 12.0, 0.0, 80).split() == ["reduce", "part", "12", "s"]
    assert _render_line("reduce  part", 12.0, 0.0).split() == ["reduce", "part", "for", "12", "s"]


def test_what_is_expected_is_revised_by_earlier_stages_and_by_the_stage_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [0.0]
    told: list[str] = []
    shown = progress.Progress()
    monkeypatch.setattr("headstock.app.terminal.progress.time.monotonic", lambda: clock[0])
    monkeypatch.setattr(shown, "_start", lambda: None)
    monkeypatch.setattr(shown, "_send", told.append)
    for seconds, taken in ((10.0, 30.0), (4.0, 0.0)):
        shown.begin("reduce  part", seconds)
        clock[0] += taken
        shown.end()
    assert [line.split("\t")[0] for line in told] == ["10.000", "12.000"]
    assert _render_line("lobes", 45.0, 12.0).endswith("for 45 s, longer than the 12 s expected")
    assert _render_bar("lobes", 45.0, 12.0, 200).endswith("45 s, longer than the 12 s expected")
