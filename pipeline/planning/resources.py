"""Peak memory of a piece of work, watched by another process: some kernels let no process forget its own peak."""

import contextlib
import ctypes
import gc
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

INTERVAL = 0.005  # seconds between two looks; what is held for less may be missed
GRACE = 10.0  # seconds for the watcher to answer
# pages of the watched process, until its input ends
WATCHER = """
import select, sys
pid, interval = sys.argv[1], float(sys.argv[2])
most = 0
with open(f"/proc/{pid}/statm") as file:
    print("ready", flush=True)
    while True:
        file.seek(0)
        most = max(most, int(file.read().split()[1]))
        if select.select([sys.stdin], [], [], interval)[0]:
            break
print(most)
"""


@dataclass
class PeakMemory:
    """Most resident memory of this process while a piece of work went on; None where nobody could look [MB]."""

    megabytes: float | None = None


@contextlib.contextmanager
def watch_memory() -> Iterator[PeakMemory]:
    """Watch the body of a ``with`` statement; what earlier work left behind is given back to the system before.

    Child processes are not counted.
    """
    peak = PeakMemory()
    _give_back()
    watcher = _start_watcher()
    try:
        yield peak
    finally:
        if watcher is not None:
            peak.megabytes = _stop_watcher(watcher)


def _give_back() -> None:
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # other C libraries have no such function
        ctypes.CDLL(None).malloc_trim(0)


def _start_watcher() -> subprocess.Popen[str] | None:
    command = [sys.executable, "-I", "-S", "-c", WATCHER, str(os.getpid()), str(INTERVAL)]
    try:
        watcher = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    except OSError:
        return None
    if watcher.stdout is None or watcher.stdout.readline() != "ready\n":
        _stop_watcher(watcher)
        return None
    return watcher


def _stop_watcher(watcher: subprocess.Popen[str]) -> float | None:
    try:
        answer, _ = watcher.communicate(timeout=GRACE)
    except subprocess.TimeoutExpired:
        watcher.kill()
        answer, _ = watcher.communicate()
    answer = answer.strip()
    return int(answer) * resource.getpagesize() / 2**20 if answer.isdigit() else None
