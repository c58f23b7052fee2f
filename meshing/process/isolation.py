"""Worker processes that read files of strangers: how they are started, which limits they take, what
they see.

A worker imports what it needs, calls `accept_limits` and only then opens the file. From there on it
has limits on its address space, processor time, wall-clock time and written files, and where the
kernel grants user namespaces it has no capabilities, no network, no other processes, and a file
system of read-only binds and one scratch folder in memory.
"""

import contextlib
import ctypes
import json
import os
import resource
import shutil
import signal
import site
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.machinery import PathFinder
from pathlib import Path
from typing import BinaryIO

from headstock.geometry.errors import OUT_OF_MEMORY
from headstock.geometry.loading import OWN_FOLDER

# gmsh may be linked with MPI: a worker that sees its parent's launcher variables would join the
# parent's job
LAUNCHER_PREFIXES = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
# a process with threads is not let into a user namespace
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
# what a child imports besides the standard library
CODE = {"headstock", "numpy", "scipy", "gmsh", "meshio", "h5py", "netCDF4"}
CODE |= {"basix", "matplotlib", "PIL", "pyuff", "pyvista", "vtkmodules"}
GRACE_SECONDS = 2
PROGRESS_SECONDS = 0.5
SCRATCH_BYTES = 64 << 20
# what shared libraries and Python are made of; of /etc only what the loader reads
SYSTEM = (
    "/usr",
    "/bin",
    "/sbin",
    "/lib",
    "/lib32",
    "/lib64",
    "/etc/alternatives",
    "/etc/ld.so.cache",
)
DEVICES = ("/dev/null", "/dev/zero", "/dev/urandom")
# where the new view grows, in a mount namespace of its own: no file of a user lies below
STAGE = "/proc"

# mount(2), prctl(2), mount_setattr(2), pivot_root(2), capset(2)
MS_NOSUID, MS_NODEV, MS_BIND, MS_REC, MS_PRIVATE, MNT_DETACH = 2, 4, 4096, 16384, 1 << 18, 2
PR_SET_PDEATHSIG, PR_CAPBSET_DROP, PR_SET_NO_NEW_PRIVS = 1, 24, 38
SYS_MOUNT_SETATTR, MOUNT_ATTR_RDONLY, AT_FDCWD, AT_RECURSIVE = 442, 1, -100, 0x8000
SYS_PIVOT_ROOT = {"x86_64": 155, "aarch64": 41}
CAPABILITY_VERSION_3 = 0x20080522


@dataclass(frozen=True)
class WorkerLimits:
    """Limits of a worker process.

    Attributes:
        memory_bytes: Of address space, and of each file it writes.
    """

    memory_bytes: int
    cpu_seconds: int
    wall_seconds: float

    def within_shell(self) -> "WorkerLimits":
        """Return these limits, or those of the calling shell (``ulimit -v``, ``ulimit -t``) where
        they are lower.
        """
        return WorkerLimits(
            _at_most(resource.RLIMIT_AS, self.memory_bytes),
            _at_most(resource.RLIMIT_CPU, self.cpu_seconds),
            self.wall_seconds,
        )


@dataclass(frozen=True)
class WorkerEnd:
    """End of a worker process.

    Attributes:
        code: Exit code; minus the number of the signal that ended it.
        errors: What it wrote on standard error.
        wanted: The limits it was meant to have.
    """

    code: int
    errors: str
    limits: WorkerLimits
    wanted: WorkerLimits

    @property
    def last_line(self) -> str:
        """The last line it wrote on standard error."""
        return next(
            (line for line in reversed(self.errors.splitlines()) if line.strip()), "no message"
        )

    @property
    def out_of_time(self) -> str | None:
        """Return which time limit it met, in words, or None."""
        if self.code == -signal.SIGALRM:
            return f"{self.limits.wall_seconds:g} s"
        if self.code == -signal.SIGXCPU:
            return f"{self.limits.cpu_seconds} s of processor time"
        return None

    @property
    def time_remedy(self) -> str | None:
        """Return what to do where the calling shell set the limit of processor time."""
        bound = self.code == -signal.SIGXCPU and self.limits.cpu_seconds < self.wanted.cpu_seconds
        return "this shell allows no more (ulimit -t)" if bound else None

    @property
    def out_of_memory(self) -> bool:
        """Return whether it met its limit of memory."""
        # threads that could not start are no exception of Python's
        return any(
            text in self.errors for text in (*OUT_OF_MEMORY, "Resource temporarily unavailable")
        )

    @property
    def memory_limit(self) -> str:
        """The limit of memory in words."""
        return f"the limit of {self.limits.memory_bytes / 2**30:.3g} GiB of memory"

    @property
    def memory_remedy(self) -> str | None:
        """Return what to do where the calling shell set the limit of memory."""
        bound = self.limits.memory_bytes < self.wanted.memory_bytes
        if bound:
            return f"this shell allows no more (ulimit -v); {self.wanted.memory_bytes / 2**30:.3g} GiB are wanted"
        return None


def run_isolated(
    module: str,
    words: Sequence[str],
    *,
    limits: WorkerLimits,
    readable: Sequence[Path] = (),
    stdin: bytes = b"",
    result: BinaryIO | None = None,
    progress: Callable[[str], None] | None = None,
) -> WorkerEnd:
    """Run a module that calls `accept_limits` in a worker process.

    Args:
        limits: What it may use at most.
        readable: Files it may read; of its own code and the system's libraries it sees what it
            needs.
        result: Open file it may write; its number is the last argument.
        progress: Called now and then with the last line the worker wrote on standard error.
    """
    wanted, limits = limits, limits.within_shell()
    settings = {
        "parent": os.getpid(),
        "folder": str(Path.cwd()),
        "readable": [str(path) for path in readable],
        **asdict(limits),
    }
    passed = [] if result is None else [result.fileno()]
    # -P: a module in the user's working folder must not stand in for ours
    command = [sys.executable, "-P", "-m", module, json.dumps(settings), *words, *map(str, passed)]
    with subprocess.Popen(
        command,
        cwd=OWN_FOLDER,
        env=child_environment(module) | ONE_THREAD,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        pass_fds=passed,
    ) as worker:
        try:
            errors = _wait(worker, stdin, limits.wall_seconds, progress)
            code = worker.returncode
        except subprocess.TimeoutExpired:
            worker.kill()
            _, errors = worker.communicate()
            code = -signal.SIGALRM
        except BaseException:
            worker.kill()
            raise
    return WorkerEnd(code, errors.decode(errors="replace"), limits, wanted)


def _wait(
    worker: "subprocess.Popen[bytes]",
    stdin: bytes,
    seconds: float,
    progress: Callable[[str], None] | None,
) -> bytes:
    """Wait for a worker's end and return what it wrote on standard error.

    Raises:
        TimeoutExpired: It takes longer than a time [s].
    """
    end = time.monotonic() + seconds
    step = seconds if progress is None else PROGRESS_SECONDS
    content: bytes | None = stdin
    while True:
        left = end - time.monotonic()
        try:
            return worker.communicate(content, timeout=min(step, left))[1]
        except subprocess.TimeoutExpired as expired:
            if progress is None or left <= step:
                raise
            content = None
            lines = (expired.stderr or b"").decode(errors="replace").rpartition("\n")[0]
            if lines:
                progress(lines.rpartition("\n")[2])


def child_environment(module: str) -> dict[str, str]:
    """Return the variables of a child that runs a module of ours: none of an MPI launcher, and of
    the places where this Python looks for modules those that hold our code or a library, and no
    folder of a script.
    """
    needed = CODE | {module.partition(".")[0]}
    script = getattr(sys.modules["__main__"], "__file__", None) or sys.argv[0]
    hidden = {Path.cwd(), Path(script).resolve().parent}
    hidden -= {Path(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep)}
    paths = [
        path
        for path in sys.path
        if Path(path).is_absolute()
        and path not in site.getsitepackages()  # which the child has by itself
        and Path(path).resolve() not in hidden
        and any(PathFinder.find_spec(name, [path]) for name in needed)
    ]
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(LAUNCHER_PREFIXES)
    }
    return environment | {"PYTHONPATH": os.pathsep.join(paths)}


def accept_limits(arguments: Sequence[str]) -> list[str]:
    """Take the limits that `run_isolated` wrote as the first argument; call it once everything
    is imported and nothing is read.

    Returns:
        The other arguments.
    """
    settings = json.loads(arguments[0])
    os.chdir(settings["folder"])
    _end_with_parent(settings["parent"])
    _set_limits(settings["memory_bytes"], settings["cpu_seconds"])
    isolate(settings["readable"])
    # also ends a worker that nobody waits for
    signal.setitimer(signal.ITIMER_REAL, settings["wall_seconds"] + GRACE_SECONDS)
    return list(arguments[1:])


def isolate(readable: Sequence[str]) -> str | None:
    """Continue in a process without capabilities, network and other processes that sees the given
    files and the code only.

    Where the kernel refuses, the process goes on as it is.

    Args:
        readable: Files that stay visible under the names they are given here, read-only.

    Returns:
        What the kernel refused, or None.
    """
    if not hasattr(os, "unshare") or os.uname().machine not in SYS_PIVOT_ROOT:
        return f"no namespaces are known for {sys.platform} on {os.uname().machine}"
    uid, gid = os.geteuid(), os.getegid()
    opened = {}
    for path in readable:
        try:
            opened[str(Path.cwd() / path)] = os.open(
                path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
            )
        except OSError:
            continue  # whoever reads it says why
    try:
        _unshare(uid, gid)
        _continue_in_child(PR_SET_PDEATHSIG)
        _build_view(opened)
        _drop_capabilities()
        _continue_in_child(None)
    except OSError as error:
        return f"{error.strerror}" + (f" ({error.filename})" if error.filename else "")
    finally:
        for handle in opened.values():
            os.close(handle)
    return None


def _unshare(uid: int, gid: int) -> None:
    """Enter namespaces of its own; the next child is the first process of a process namespace."""
    apart = os.CLONE_NEWNS | os.CLONE_NEWPID | os.CLONE_NEWNET | os.CLONE_NEWIPC | os.CLONE_NEWUTS
    try:
        os.unshare(os.CLONE_NEWUSER | apart)
    except OSError:
        if uid != 0:
            raise
        # root needs no user namespace, which the kernel refuses in a chroot
        os.unshare(apart)
        return
    for name, text in (
        ("setgroups", "deny"),
        ("uid_map", f"{uid} {uid} 1"),
        ("gid_map", f"{gid} {gid} 1"),
    ):
        Path("/proc/self", name).write_text(text)
    # no further namespaces from inside: they are a way to parts of the kernel that an ordinary
    # process cannot reach
    with contextlib.suppress(OSError):
        Path("/proc/sys/user/max_user_namespaces").write_text("0")


def _at_most(kind: int, wanted: int) -> int:
    allowed = min(
        (limit for limit in resource.getrlimit(kind) if limit != resource.RLIM_INFINITY),
        default=wanted,
    )
    return min(wanted, allowed)


def _set_limits(memory_bytes: int, cpu_seconds: int) -> None:
    """Bound this process where its bounds are wider; no core dump when it meets a limit."""
    for kind, wanted, hard in (
        (resource.RLIMIT_CORE, 0, 0),
        (resource.RLIMIT_AS, memory_bytes, memory_bytes),
        (resource.RLIMIT_FSIZE, memory_bytes, memory_bytes),
        # the soft limit ends the process by SIGXCPU, distinct from a kill for lack of memory
        (resource.RLIMIT_CPU, cpu_seconds, cpu_seconds + GRACE_SECONDS),
    ):
        allowed = resource.getrlimit(kind)[1]
        hard = hard if allowed == resource.RLIM_INFINITY else min(hard, allowed)
        resource.setrlimit(kind, (_at_most(kind, wanted), hard))


def _end_with_parent(parent: int) -> None:
    """Die when the parent does, so that a killed run leaves no worker behind (Linux; elsewhere the
    alarm ends it).
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before we asked
            os.kill(os.getpid(), signal.SIGKILL)


def _continue_in_child(death_signal: int | None) -> None:
    """Fork; the parent waits, ends as the child does and never returns.

    The first process of a process namespace ignores the signals by which limits end a process, so
    the work is done by the second.
    """
    child = os.fork()
    if child == 0:
        if death_signal is not None:
            _call("prctl", death_signal, signal.SIGKILL)
        return
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0 and death_signal is None:
        os._exit(128 - code)
    if code > 128:
        signal.signal(code - 128, signal.SIG_DFL)
        os.kill(os.getpid(), code - 128)
    os._exit(code if code >= 0 else 128 - code)


def _build_view(opened: dict[str, int]) -> None:
    """Replace the file system of this mount namespace."""
    folder = Path.cwd()
    _call("mount", None, b"/", None, MS_REC | MS_PRIVATE, None)
    size = SCRATCH_BYTES + sum(os.fstat(handle).st_size for handle in opened.values())
    _call(
        "mount",
        b"tmpfs",
        STAGE.encode(),
        b"tmpfs",
        MS_NOSUID | MS_NODEV,
        f"size={size},mode=755".encode(),
    )
    for source in (*SYSTEM, *_code_folders()):
        _show(source)
    for device in DEVICES:
        _show(device, attributes=0)
    for path, handle in opened.items():
        _show(path)
        # root without capabilities may not read what belongs to others
        if not os.access(STAGE + path, os.R_OK):
            _call("umount2", (STAGE + path).encode(), MNT_DETACH)
            with (
                os.fdopen(os.dup(handle), "rb") as source_file,
                Path(STAGE + path).open("wb") as copy,
            ):
                shutil.copyfileobj(source_file, copy)
    for target in ("/tmp", str(folder)):
        Path(STAGE + target).mkdir(parents=True, exist_ok=True)
    os.chdir(STAGE)
    # the old root comes to lie on top of the new one and is taken away (pivot_root(2), notes)
    _syscall(SYS_PIVOT_ROOT[os.uname().machine], b".", b".")
    _call("umount2", b".", MNT_DETACH)
    os.chdir(folder)


def _code_folders() -> list[str]:
    """Return the folders of this program and its Python, links resolved, outer ones first."""
    ours = {
        Path(module.__file__).resolve().parent
        for name, module in sys.modules.items()
        if name.startswith("headstock.") and module.__file__
    }
    paths = {
        Path(path).resolve()
        for path in (*sys.path, sys.prefix, sys.base_prefix)
        if path.startswith("/")
    }
    return sorted(str(path) for path in ours | paths if path.exists() and path != Path("/"))


def _show(path: str, attributes: int = MOUNT_ATTR_RDONLY) -> None:
    """Bind a file or folder under its own name in the new view, unless it is there already."""
    target = Path(STAGE + path)
    if not os.path.lexists(path) or os.path.lexists(target):
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    if Path(path).is_symlink() and path in SYSTEM:
        target.symlink_to(Path(path).readlink())
        return
    if Path(path).is_dir():
        target.mkdir()
    else:
        target.touch()
    _call("mount", path.encode(), str(target).encode(), None, MS_BIND | MS_REC, None)
    if attributes:
        # struct mount_attr: set, clear, propagation, user namespace
        wanted = (ctypes.c_uint64 * 4)(attributes, 0, 0, 0)
        _syscall(
            SYS_MOUNT_SETATTR,
            AT_FDCWD,
            str(target).encode(),
            AT_RECURSIVE,
            wanted,
            ctypes.c_size_t(ctypes.sizeof(wanted)),
        )


def _drop_capabilities() -> None:
    _call("prctl", PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    for capability in range(64):
        if ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, capability, 0, 0, 0) != 0:
            break  # the kernel knows no more
    header = (ctypes.c_uint32 * 2)(CAPABILITY_VERSION_3, 0)
    _call("capset", header, (ctypes.c_uint32 * 6)())


def _syscall(number: int, *arguments: object) -> None:
    _call("syscall", ctypes.c_long(number), *arguments)


def _call(name: str, *arguments: object) -> None:
    if ctypes.CDLL(None, use_errno=True)[name](*arguments) == -1:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code), name)
