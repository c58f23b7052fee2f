"""Independent jobs dealt out to the ranks of a communicator as these become free.

A counter in a file hands out the jobs: a window of MPI on one rank would answer only while that
rank is inside MPI. A rank without a job sleeps, and its core becomes a thread of those that work.
"""

import contextlib
import fcntl
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import threadpoolctl

from headstock.geometry.errors import HeadstockError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import Node, SharedFailure, find_node, share_from_root

RESULT_TAG = 4712
POLL_SECONDS = 0.005
THREADS, NAMED_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "HEADSTOCK_THREADS"
MOST_THREADS = 4  # more bring next to nothing: benchmarks/ranks.py --threads
FOLDER_PREFIX, ALIVE_FILE = "headstock-jobs-", "alive"
OLD_SECONDS = 60.0  # a younger folder may not be locked yet
QUOTA_FILE = Path("/sys/fs/cgroup/cpu.max")


@dataclass(frozen=True)
class Job:
    """A piece of work that one rank does alone.

    Attributes:
        seconds: Estimated processor time; the longest jobs are begun first.
    """

    seconds: float = 1.0
    memory_mb: float = 0.0


def share_work[T](
    comm: MPI.Comm,
    jobs: Sequence[Job],
    work: Callable[[int, Callable[[], None]], T],
    *,
    folder: Path,
    memory_mb: float,
    idle_mb: float = 0.0,
    observer: Callable[[int, T], None] = lambda number, result: None,
) -> list[T]:
    """Do every job once, each on one rank, the longest first; collective.

    Args:
        comm: Ranks that share the jobs; one alone does them in their order.
        jobs: What each is expected to cost.
        work: Makes the result of the job of a number; results are pickled and not None. It calls its
            second argument between its steps, which gives BLAS the cores of ranks that have nothing
            left to do.
        folder: For a file that all ranks reach, where they are on several nodes.
        memory_mb: Of this rank's node: a job that does not fit with those at work waits.
        idle_mb: What a rank holds without a job; counted for all ranks of the node, and in each job.
        observer: Called on rank 0 with the number of each job that has ended and its result.

    Returns:
        One result per job, in order; empty on other ranks.

    Raises:
        SharedFailure: A job failed, on every rank of several; the cause on rank 0 is the error of
            the first in order. A single rank gets the error itself.
    """
    if comm.size == 1:
        results = []
        for number in range(len(jobs)):
            results.append(work(number, lambda: None))
            observer(number, results[-1])
        return results
    order = sorted(range(len(jobs)), key=lambda number: -jobs[number].seconds)
    node = find_node(comm)
    needs = [max(0.0, jobs[number].memory_mb - idle_mb) for number in order]
    with _shared_folder(comm, node, folder) as folder_path:
        counter = _Counter(folder_path, node, needs, memory_mb - idle_mb * node.ranks)
        mail = _Mail[T](comm, observer)
        _work_off(counter, order, work, mail)
        mail.close()
        failed = share_from_root(comm, bool(mail.failures) if comm.rank == 0 else None)
    if failed:
        raise SharedFailure from mail.failures.get(min(mail.failures, default=0))
    return [mail.results[number] for number in range(len(jobs))] if comm.rank == 0 else []


def _work_off[T](
    counter: "_Counter",
    order: Sequence[int],
    work: Callable[[int, Callable[[], None]], T],
    mail: "_Mail[T]",
) -> None:
    """Do jobs until none is left."""
    cores, threads = free_cores(), int(os.environ.get(THREADS[0], "1"))

    def settle() -> None:
        use_threads(max(1, cores // max(1, counter.working())))
        mail.collect()

    counter.join()
    try:
        while (job := counter.take()) is not None:
            number = order[job]
            try:
                settle()
                mail.send(number, work(number, settle))
            except Exception as error:
                counter.stop()
                mail.send(number, None, error)
            finally:
                counter.end(job)
    finally:
        counter.leave()
        use_threads(threads)


def use_threads(count: int) -> None:
    """Give BLAS and OpenMP so many threads, at most ``MOST_THREADS``, in libraries that are loaded
    and those that will be; where the user has named a number that one stays.
    """
    if NAMED_THREADS in os.environ:
        return
    threads = min(count, MOST_THREADS)
    os.environ.update(dict.fromkeys(THREADS, str(threads)))
    threadpoolctl.threadpool_limits(threads)


@contextlib.contextmanager
def all_cores_on_root(comm: MPI.Comm) -> Iterator[None]:
    """Let rank 0 work alone, with the cores of all."""
    if comm.size == 1 or comm.rank > 0:
        yield
        return
    threads = int(os.environ.get(THREADS[0], "1"))
    use_threads(free_cores())
    try:
        yield
    finally:
        use_threads(threads)


def free_cores() -> int:
    """Return the cores that this process may use and nobody else does, at least 1."""
    cores = len(os.sched_getaffinity(0))
    with contextlib.suppress(OSError, ValueError):  # no quota
        quota, period = QUOTA_FILE.read_text().split()
        cores = min(cores, -(-int(quota) // int(period)))
    return max(1, cores - int(os.getloadavg()[0]))


@contextlib.contextmanager
def _shared_folder(comm: MPI.Comm, node: Node, folder: Path) -> Iterator[Path]:
    """Provide a new folder that all ranks reach and that is gone afterwards, with those of jobs
    that were killed.
    """
    parent = None if node.ranks == comm.size else folder
    if comm.rank:
        yield Path(share_from_root(comm, None))
        return
    if parent is not None:
        parent.mkdir(parents=True, exist_ok=True)
        _clear_dead(parent)
    folder_path = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX, dir=parent))
    try:
        with (folder_path / ALIVE_FILE).open("w", encoding="ascii") as alive:
            with contextlib.suppress(OSError):  # the counter says so, where there are no locks
                fcntl.lockf(alive, fcntl.LOCK_EX)
            share_from_root(comm, folder_path)
            yield folder_path
    finally:
        shutil.rmtree(folder_path, ignore_errors=True)


def _clear_dead(parent: Path) -> None:
    """Remove folders whose job lives no more: nobody holds their lock."""
    for folder_path in parent.glob(f"{FOLDER_PREFIX}*"):
        with (
            contextlib.suppress(OSError),
            (folder_path / ALIVE_FILE).open("r+", encoding="ascii") as file,
        ):
            if time.time() - folder_path.stat().st_mtime > OLD_SECONDS:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder_path)


@dataclass
class _Counts:
    """The work of all ranks; ranks and memory [MB] by node."""

    begun: int = 0
    working: dict[str, int] = field(default_factory=dict)
    memory_mb: dict[str, float] = field(default_factory=dict)


class _Counter:
    """Hands out places in the order of the jobs; its counts are in a file."""

    def __init__(
        self, folder: Path, node: Node, needs_mb: Sequence[float], memory_mb: float
    ) -> None:
        self._path, self._node = folder / "counts.json", str(node.number)
        self._needs_mb, self._memory_mb = needs_mb, memory_mb

    def join(self) -> None:
        """Count this rank among those at work."""
        self._add(ranks=1)

    def leave(self) -> None:
        """Note that this rank has nothing left to do."""
        self._add(ranks=-1)

    def end(self, job: int) -> None:
        """Free the memory of a job that has ended."""
        self._add(memory_mb=-self._needs_mb[job])

    def stop(self) -> None:
        """Begin no further job."""
        with self._open() as counts:
            counts.begun = len(self._needs_mb)

    def working(self) -> int:
        """Return how many ranks work on this node."""
        with self._open() as counts:
            return counts.working.get(self._node, 0)

    def take(self) -> int | None:
        """Return the next place, once its job fits into the memory; None when all are begun."""
        while True:
            with self._open() as counts:
                job, used = counts.begun, counts.memory_mb.get(self._node, 0.0)
                if job >= len(self._needs_mb):
                    return None
                need = self._needs_mb[job]
                if used <= 0.0 or used + need <= self._memory_mb:
                    counts.begun += 1
                    counts.memory_mb[self._node] = used + need
                    return job
            time.sleep(POLL_SECONDS)

    def _add(self, *, ranks: int = 0, memory_mb: float = 0.0) -> None:
        with self._open() as counts:
            counts.working[self._node] = counts.working.get(self._node, 0) + ranks
            counts.memory_mb[self._node] = counts.memory_mb.get(self._node, 0.0) + memory_mb

    @contextlib.contextmanager
    def _open(self) -> Iterator[_Counts]:
        with self._path.open("a+", encoding="ascii") as file:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX)
            except OSError as error:
                raise HeadstockError(
                    f"{self._path.parent}: this file system locks no files ({error.strerror}), which ranks on several"
                    " nodes need to share work; mount it with locks, or put the results (-o) and HEADSTOCK_STORE elsewhere"
                ) from error
            file.seek(0)
            counts = _Counts(**json.loads(file.read() or "{}"))
            yield counts
            file.truncate(0)
            file.write(json.dumps(asdict(counts)))


class _Mail[T]:
    """What jobs returned or raised, on its way to rank 0; who waits for it sleeps."""

    def __init__(self, comm: MPI.Comm, observer: Callable[[int, T], None]) -> None:
        self.results: dict[int, T] = {}
        self.failures: dict[int, BaseException] = {}
        self._comm, self._observer = comm, observer
        self._sent: list[MPI.Request] = []
        self._at_work = comm.size - 1

    def send(self, number: int, result: T | None, error: Exception | None = None) -> None:
        """Hand in what became of a job: its result, or the error it ended with."""
        if self._comm.rank == 0:
            self._keep(number, result, error)
        else:
            letter = (number, result, _portable(error))
            self._sent.append(self._comm.isend(letter, dest=0, tag=RESULT_TAG))

    def collect(self) -> None:
        """Take what has arrived."""
        while self._comm.rank == 0 and self._comm.iprobe(tag=RESULT_TAG):
            letter = self._comm.recv(tag=RESULT_TAG)
            if letter is None:
                self._at_work -= 1
            else:
                self._keep(*letter)

    def close(self) -> None:
        """Wait until everything has arrived."""
        if self._comm.rank > 0:
            self._sent.append(self._comm.isend(None, dest=0, tag=RESULT_TAG))
            while not MPI.Request.Testall(self._sent):
                time.sleep(POLL_SECONDS)
            return
        self.collect()
        while self._at_work:
            time.sleep(POLL_SECONDS)
            self.collect()

    def _keep(self, number: int, result: T | None, error: Exception | None) -> None:
        if error is not None:
            self.failures[number] = error
        elif result is not None:
            self.results[number] = result
            self._observer(number, result)


def _portable(error: Exception | None) -> Exception | None:
    """Return an error as it is, or what it says where it cannot be pickled."""
    try:
        MPI.pickle.loads(MPI.pickle.dumps(error))
    except Exception:
        return HeadstockError(f"{type(error).__name__}: {error}")
    return error
