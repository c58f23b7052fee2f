"""Progress of long stages: a bar on a terminal, a line every 15 to 30 s in a log, nothing for short
ones.
"""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from headstock.app.terminal.console import is_terminal

RENDERER = Path(__file__).with_name("progress_renderer.py")
# a stage that is expected to take less is not worth a process
SHORTEST_SECONDS = 2.0
# how far earlier stages revise what is expected of the next one
REVISED = (0.5, 5.0)
NO_BREAKS = str.maketrans("\t\r\n", "   ")


class Progress:
    """Tells a renderer process when something long begins and ends; where none can be started,
    nothing is shown.
    """

    def __init__(self, *, time_scale: float = 1.0) -> None:
        self._time_scale = time_scale
        self._process: subprocess.Popen[bytes] | None = None
        self._answers = -1
        self._silent = False
        self._running = False
        self._expected = self._taken = 0.0  # of the stages so far, and of the one at work [s]
        self._stage = (0.0, 0.0)

    def begin(self, label: str, expected_seconds: float | None = None) -> None:
        """Something begins: what, and how long it is expected to take; None where nobody knows.

        What is expected is revised by the ratio of taken to expected seconds of earlier stages.
        """
        self._stage = (expected_seconds or 0.0, time.monotonic())
        if self._silent or (expected_seconds is not None and expected_seconds < SHORTEST_SECONDS):
            return
        if self._process is None:
            self._start()
        expected = self._revision() * (expected_seconds or 0.0)
        self._running = self._send(f"{expected:.3f}\t{label.translate(NO_BREAKS)}\n")

    def end(self) -> None:
        """It ended; once this returns nothing is left of the bar."""
        expected, begun = self._stage
        if expected > 0.0:
            self._expected += expected
            self._taken += time.monotonic() - begun
        self._stage = (0.0, 0.0)
        if self._running:
            self._running = False
            if self._send("\n"):
                os.read(self._answers, 1)

    def close(self) -> None:
        """End the renderer."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
            self._process.wait()
            os.close(self._answers)
            self._process = None

    def _revision(self) -> float:
        """Return how much longer than expected the stages so far took."""
        if self._expected < SHORTEST_SECONDS:
            return 1.0
        return min(max(self._taken / self._expected, REVISED[0]), REVISED[1])

    def _start(self) -> None:
        self._answers, theirs = os.pipe()
        kind = "bar" if is_terminal(sys.stdout) else "lines"
        command = [
            sys.executable,
            "-I",
            "-S",
            str(RENDERER),
            kind,
            str(theirs),
            str(self._time_scale),
        ]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, pass_fds=(theirs,)
            )
        except OSError:
            self._silent = True
            os.close(self._answers)
        finally:
            os.close(theirs)

    def _send(self, text: str) -> bool:
        if self._process is None or self._process.stdin is None:
            return False
        try:
            self._process.stdin.write(text.encode())
            self._process.stdin.flush()
        except OSError:
            self._silent = True  # it was killed: go on without
        return not self._silent


@contextlib.contextmanager
def show_progress() -> Iterator[Progress]:
    """A progress display that ends with the body."""
    progress = Progress()
    try:
        yield progress
    finally:
        progress.end()
        progress.close()
