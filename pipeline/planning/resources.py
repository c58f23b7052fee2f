"""Wall time, processor time and peak memory of a piece of work.

Another process watches the memory: some kernels let no process reset the record of its own peak.
"""

import contextlib
import ctypes
import gc
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

INTERVAL = 0.005  # seconds between two looks; what is kept for less may be missed
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
    """Most resident memory of this process while a piece of work went on; None where nobody could
    look [MB].
    """

    megabytes: float | None = None


@contextlib.contextmanager
def watch_memory() -> Iterator[PeakMemory]:
    """Watch the body of a ``with`` statement; what earlier work left behind is given back to the
    system before.

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


@contextlib.contextmanager
def search_once() -> Iterator[None]:
    """Within it ``watch_memory`` does not search again for garbage what it found in use: with all
    libraries loaded that takes a tenth of a second each time.
    """
    before = gc.get_freeze_count()
    try:
        yield
    finally:
        if not before:
            gc.unfreeze()


def _give_back() -> None:
    gc.collect()
    gc.freeze()  # `search_once` ends that
    with contextlib.suppress(OSError, AttributeError):  # other C libraries have no such function
        ctypes.CDLL(None).malloc_trim(0)


def _start_watcher() -> subprocess.Popen[str] | None:
    command = [sys.executable, "-I", "-S", "-c", WATCHER, str(os.getpid()), str(INTERVAL)]
    try:
        watcher = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
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


@dataclass
class Cost:
    """What a piece of work cost; filled in when it ends.

    Attributes:
        seconds: Wall-clock time [s].
        cpu_seconds: Processor time of all threads and of children that have ended [s].
        peak_rss_mb: Peak resident memory of this process or its children [MB].
    """

    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_rss_mb: float = 0.0


@contextlib.contextmanager
def measure() -> Iterator[Cost]:
    """Measure the body of a ``with`` statement."""
    cost = Cost()
    children = _children_kb()
    _restart_peak()
    start, cpu_start = time.perf_counter(), _cpu_seconds()
    try:
        yield cost
    finally:
        cost.seconds = time.perf_counter() - start
        cost.cpu_seconds = _cpu_seconds() - cpu_start
        # children's peak is a maximum over all that ever ran: it says something about this work
        # only when it rose
        child = _children_kb() if _children_kb() > children else 0
        cost.peak_rss_mb = max(peak_memory_mb(), child / 1024.0)


def peak_memory_mb() -> float:
    """Peak resident memory of this process since it started, or since ``measure`` last began [MB].

    Not ``ru_maxrss``: Linux carries that over from the process that started this one.
    """
    try:
        match = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    except OSError:
        match = None
    return (int(match[1]) if match else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024.0


def _cpu_seconds() -> float:
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def _restart_peak() -> None:
    # without the permission (some containers) the peak is that of the process so far: too high,
    # never too low
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _children_kb() -> int:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
