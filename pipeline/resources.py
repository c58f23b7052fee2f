"""Time and memory of a piece of work."""

import contextlib
import re
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Cost:
    """What a piece of work cost; filled in when it ends: seconds, and peak resident memory [MB] of this process or its children."""

    seconds: float = 0.0
    peak_rss_mb: float = 0.0


@contextlib.contextmanager
def measure() -> Iterator[Cost]:
    """Measure the body of a ``with`` statement."""
    cost = Cost()
    children = _children_kb()
    _restart_peak()
    start = time.perf_counter()
    try:
        yield cost
    finally:
        cost.seconds = time.perf_counter() - start
        # children's peak is a maximum over all that ever ran: it says something about this work only when it rose
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


def _restart_peak() -> None:
    # without the permission (some containers) the peak is that of the process so far: too high, never too low
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _children_kb() -> int:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
