"""From errors to exit codes and messages; under MPI one failing rank ends all of them."""

import codecs
import errno
import inspect
import io
import os
import pwd
import sys
import time
import traceback
from collections.abc import Buffer, Callable
from typing import Any

from headstock.geometry.errors import printable

VERDICT = "HEADSTOCK_VERDICT"
DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
LOST_OUTPUT = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EFBIG)
# a rank that fails waits so long for the others to end as well, before it ends them
HOLD_BACK_SECONDS = 0.5
POLL_SECONDS = 0.002
# characters of tables and messages, for terminals whose encoding has not got them
SPELLED = {
    "→": "->", "←": "<-", "±": "+-", "µ": "u", "μ": "u", "·": "*", "×": "x", "°": " deg", "²": "^2", "³": "^3", "⁴": "^4", "–": "-", "−": "-",
    "≤": "<=", "≥": ">=", "…": "...", "─": "-", "│": "|", "█": "#", "▏": " ", "π": "pi", "ω": "omega", "ζ": "zeta", "“": '"', "”": '"', "’": "'",
}  # fmt: skip


def run_guarded(action: Callable[..., int], *, debug: bool) -> int:
    """Run a command and turn what it raises into a message and an exit code.

    Args:
        action: Takes nothing, or the world communicator when the command is collective.
        debug: Show the traceback too.
    """
    from headstock.geometry.errors import require_least_memory

    ending: Any = None
    code, message = DONE, ""
    try:
        require_least_memory()
        if inspect.signature(action).parameters:
            from headstock.solvers.mpi import MPI

            comm = MPI.COMM_WORLD
            # messages of what failed half way are not taken for those about the end
            ending = comm.Dup() if comm.size > 1 else None
            code = action(comm)
        else:
            code = action()
    except BaseException as error:
        code, message = _judge_shared(error)
        if debug and message:
            traceback.print_exc()
    if ending is None:
        _print_message(message)
        return code
    ends = _end_together(ending, code, message)
    if ends is None:
        _print_message(f"rank {ending.rank}: {message}" if ending.rank else message)
        ending.Abort(code)
        return code
    code, rank, message = next((end for end in ends if end[0]), ends[0])
    if ending.rank == 0:
        _print_message(f"rank {rank}: {message}" if rank else message)
    return code


def _print_message(message: str) -> None:
    """Say why a command ends; names from files of strangers are no commands to the terminal."""
    if message:
        text = "\n".join(printable(line) for line in message.split("\n"))
        print(text, file=sys.stderr, flush=True)


def _end_together(ending: Any, code: int, message: str) -> list[tuple[int, int, str]] | None:
    """Code, rank and message of every rank once all have ended; None where others go on although
    this rank has failed.
    """
    waiting = ending.Ibarrier()
    deadline = time.monotonic() + HOLD_BACK_SECONDS
    while not waiting.Test():
        if message and time.monotonic() > deadline:
            return None
        time.sleep(POLL_SECONDS)
    return list(ending.allgather((code, ending.rank, message)))


def _judge_shared(error: BaseException) -> tuple[int, str]:
    """Exit code and message; both empty on ranks that know of a failure on rank 0 only."""
    ranks = sys.modules.get("headstock.solvers.ranks")
    if ranks is None or not isinstance(error, ranks.SharedFailure):
        return _judge(error)
    return (DONE, "") if error.__cause__ is None else _judge(error.__cause__)


def hand_over(code: int) -> int:
    """Exit code for the operating system; where the launcher started several ranks, rank 0 leaves
    it in a file.

    An MPI runtime takes a code other than 0 for a crash of that rank, and reports one.
    """
    verdict = os.environ.get(VERDICT)
    if verdict is None:
        return code
    rank = os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0"))
    if rank == "0":
        with open(verdict, "w", encoding="ascii") as file:  # noqa: PTH123 (no pathlib at start-up)
            file.write(f"{code}\n")
    return 0


class _LosableOutput(io.FileIO):
    """A descriptor whose reader may leave: what nobody reads any more is dropped, and the work goes
    on.
    """

    def write(self, data: Buffer) -> int:
        try:
            return super().write(data) or 0
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return memoryview(data).nbytes


def prepare_streams() -> None:
    """Make sure that nothing printed can stop a computation.

    A stream that the caller closed (``>&-``) leads nowhere, one whose reader leaves (``run SCENE |
    head -1``) leads nowhere from then on, and a character that a terminal's encoding has not is
    spelled with those it has. Streams that a test put in place stay.
    """
    codecs.register_error("spelled", _spell)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
        elif stream is getattr(sys, f"__{name}__"):
            stream.flush()
            output = io.BufferedWriter(_LosableOutput(stream.fileno(), "w", closefd=False))
            buffered = io.TextIOWrapper(
                output,
                stream.encoding,
                "spelled",
                line_buffering=name == "stderr" or stream.isatty(),
            )
            setattr(sys, name, buffered)


def find_home() -> None:
    """Without HOME take the folder of the account: MPI ends a process that has none."""
    if os.environ.get("HOME"):
        return
    try:
        os.environ["HOME"] = pwd.getpwuid(os.geteuid()).pw_dir
    except KeyError:
        os.environ["HOME"] = os.environ.get("XDG_CACHE_HOME") or "/"


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(
        SPELLED.get(letter, "?") for letter in error.object[error.start : error.end]
    ), error.end


def _judge(error: BaseException) -> tuple[int, str]:
    import click

    from headstock.geometry.errors import (
        HeadstockError,
        NumberNameError,
        lacks_memory,
        out_of_memory,
    )
    from headstock.meshing.errors import PartFileError
    from headstock.pipeline.storage.outputs import UnusableOutputError
    from headstock.scene.reading.findings import SceneError
    from headstock.scene.test_data.errors import MeasurementError

    if isinstance(error, SceneError):
        return BAD_INPUT, str(error)
    if isinstance(error, click.ClickException):
        return error.exit_code, f"error: {error.format_message()}"
    if isinstance(error, PartFileError | MeasurementError | UnusableOutputError | NumberNameError):
        return BAD_INPUT, f"error: {error}"
    if isinstance(error, HeadstockError):
        return FAILED, f"{type(error).__name__}: {error}"
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, "interrupted"
    if not isinstance(error, SystemExit) and lacks_memory(error):
        return FAILED, f"OutOfMemoryError: {out_of_memory('the command')}"
    if isinstance(error, OSError) and error.errno in LOST_OUTPUT and error.filename is None:
        return FAILED, f"OutputError: what is printed cannot be written: {error.strerror}"
    if isinstance(error, OSError):
        return FAILED, f"{type(error).__name__}: {error} (--debug shows where)"
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else FAILED, "stopped"
    return (
        FAILED,
        f"internal error: {type(error).__name__}: {error} (a fault of this program: --debug shows where)",
    )
