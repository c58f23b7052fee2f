"""From errors to exit codes and messages; under MPI one failing rank ends all of them."""

import errno
import inspect
import os
import sys
import time
import traceback
from collections.abc import Callable
from typing import Any

DONE, FAILED, BAD_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141
LOST_OUTPUT = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EFBIG)
# a failure that all ranks share is told by rank 0; the others wait so long before they tell theirs
HOLD_BACK_SECONDS = 0.5


def run_guarded(action: Callable[..., int], *, debug: bool) -> int:
    """Run a command and turn what it raises into a message and an exit code.

    Args:
        action: Takes nothing, or the world communicator when the command is collective.
        debug: Show the traceback too.
    """
    comm: Any = None
    try:
        if inspect.signature(action).parameters:
            from mpi4py import MPI

            comm = MPI.COMM_WORLD
            code = action(comm)
        else:
            code = action()
    except BaseException as error:
        code, message = _judge(error)
        if comm is not None and comm.rank > 0:
            time.sleep(HOLD_BACK_SECONDS)
            message = f"rank {comm.rank}: {message}"
        if debug:
            traceback.print_exc()
        if code == PIPE_CLOSED:
            leave_closed_pipe()
        else:
            print(message, file=sys.stderr, flush=True)
        if comm is not None and comm.size > 1:
            comm.Abort(code)
    return code


def open_missing_streams() -> None:
    """Give what is printed a place to go where the caller closed standard output or error (``>&-``)."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))


def leave_closed_pipe() -> None:
    """Send what is still to be printed nowhere: ``headstock plan SCENE | head -1`` is no fault."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def _judge(error: BaseException) -> tuple[int, str]:
    import click

    from headstock.geometry.errors import HeadstockError
    from headstock.pipeline.scene_errors import SceneError

    if isinstance(error, SceneError):
        return BAD_INPUT, str(error)
    if isinstance(error, click.ClickException):
        return error.exit_code, f"error: {error.format_message()}"
    if isinstance(error, HeadstockError):
        return FAILED, f"{type(error).__name__}: {error}"
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, "interrupted"
    if isinstance(error, BrokenPipeError):
        return PIPE_CLOSED, "the reader of the output closed it"
    if isinstance(error, OSError) and error.errno in LOST_OUTPUT and error.filename is None:
        return FAILED, f"OutputError: what is printed cannot be written: {error.strerror}"
    if isinstance(error, OSError):
        return FAILED, f"{type(error).__name__}: {error} (--debug shows where)"
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else FAILED, "stopped"
    if isinstance(error, MemoryError):
        return FAILED, "MemoryError: out of memory; write a larger mesh size or keep fewer modes"
    return FAILED, f"internal error: {type(error).__name__}: {error} (a fault of this program: --debug shows where)"
