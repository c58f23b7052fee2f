"""Limits a child process sets on itself before it touches a file it does not trust."""

import ctypes
import os
import resource
import signal
import sys

SET_PARENT_DEATH_SIGNAL = 1  # prctl(2)
GRACE_SECONDS = 2


def end_with_parent(parent: int) -> None:
    """Die when the parent does, so that a killed run leaves no child behind (Linux; elsewhere the CPU limit ends it).

    Args:
        parent: Process number of the parent.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != parent:  # it died before we asked
            os.kill(os.getpid(), signal.SIGKILL)


def set_limits(*, memory_bytes: int, cpu_seconds: int) -> None:
    """Bound the address space and the processor time of this process; no core dump when it meets them."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    # the soft limit ends the process by SIGXCPU, which tells it from a kill for lack of memory
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_seconds, cpu_seconds + GRACE_SECONDS))
