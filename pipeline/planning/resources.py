"""Memory of a node against what its ranks hold together, and wall time, processor time and peak memory
of a piece of work.

Another process watches the memory: some kernels let no process reset the record of its own peak.
"""

import contextlib
import ctypes
import gc
import math
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from headstock.pipeline.planning.budgets import BASE_MB, PATH_KEYS, BudgetError
from headstock.pipeline.planning.plan import Stage

OWN_GROUP, GROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")

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


@dataclass(frozen=True)
class RanksOnNodes:
    """Where the ranks of a run are.

    Attributes:
        ranks: How many there are.
        together: The most that are on one node.
        memory_mb: The least that a node has for them.
    """

    ranks: int
    together: int
    memory_mb: float


def node_memory_bytes(
    variables: Mapping[str, str] = os.environ, own_group: Path = OWN_GROUP, groups: Path = GROUPS
) -> float:
    """Memory [byte] that this node has for this job: the machine's, or less where Slurm or a control
    group allows less.

    Args:
        variables: Of the environment, with what Slurm says of the job.
        own_group: File with the control group of this process.
    """
    limits = [float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))]
    # 0 is all memory of the node
    with contextlib.suppress(KeyError, ValueError):
        limits.append(float(variables["SLURM_MEM_PER_NODE"]) * 2**20)
    with contextlib.suppress(KeyError, ValueError):
        cpus = float(variables["SLURM_CPUS_ON_NODE"])
        limits.append(float(variables["SLURM_MEM_PER_CPU"]) * cpus * 2**20)
    with contextlib.suppress(OSError):
        own = own_group.read_text().rpartition("::")[2].strip().strip("/")
        for group in (groups / own, *(groups / own).parents):
            if not group.is_relative_to(groups):
                break
            with contextlib.suppress(OSError, ValueError):  # "max" is none
                limits.append(float((group / "memory.max").read_text()))
    return min(limit for limit in limits if limit > 0.0)


def _memory_on_node(stage: Stage, held: RanksOnNodes, *, split: bool) -> float:
    """Peak memory [MB] of all ranks on a node while a component is meshed or reduced.

    Args:
        stage: With its estimate for one rank.
        split: Whether all ranks share the stage, or one does it and the others wait.
    """
    waiting = BASE_MB * (held.together - 1)
    alone = stage.estimated_memory_mb or 0.0
    if not split:
        return alone + waiting
    return BASE_MB + waiting + max(0.0, alone - BASE_MB) * held.together / held.ranks


def check_memory(
    stages: Sequence[Stage],
    limit_bytes: float | None,
    *,
    held: RanksOnNodes | None = None,
    split_dofs: float = math.inf,
) -> None:
    """Refuse stages that would need more memory than the scene allows, or than a node has.

    Args:
        limit_bytes: ``limits.memory`` of the scene; None for what the node has.
        held: Where the ranks are; None for one rank on this machine.
        split_dofs: Larger components are split over all ranks.

    Raises:
        BudgetError: Names the stage, its estimate and the limit.
    """
    held = held or RanksOnNodes(1, 1, node_memory_bytes() / 1e6)
    limit_mb = held.memory_mb if limit_bytes is None else limit_bytes / 1e6
    for stage in stages:
        # meshing is rank 0's
        split = stage.kind == "reduce" and (stage.estimated_dofs or 0) > split_dofs
        need_mb = _memory_on_node(stage, held, split=split)
        if stage.estimated_memory_mb is not None and need_mb > limit_mb:
            whose = "this machine has" if limit_bytes is None else "limits.memory allows"
            where, remedy = "", "write a larger mesh size or keep fewer modes"
            what = (
                f" of component {stage.component!r} with about {stage.estimated_dofs or 0:.3g} dofs"
            )
            whole = "component"
            if stage.component is None:
                what, whole = "", stage.kind
                remedy = PATH_KEYS.get(stage.kind, "write a lower sampling")
            if held.ranks > 1:
                how = f"that share the {whole}" if split else f"of which one has the {whole}"
                where = f" on a node with {held.together} of {held.ranks} ranks, {how}"
                remedy += ", or start fewer ranks on a node"
            raise BudgetError(
                f"{stage.kind}{what} would need about {need_mb:.3g} MB{where}; {whose} {limit_mb:.3g} MB; {remedy}"
            )


@dataclass
class _PeakMemory:
    """Most resident memory of this process during a piece of work [MB]; None where unknown."""

    megabytes: float | None = None


@contextlib.contextmanager
def watch_memory() -> Iterator[_PeakMemory]:
    """Watch the body of a ``with`` statement; what earlier work left behind is given back to the
    system before.

    Child processes are not counted.
    """
    peak = _PeakMemory()
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
