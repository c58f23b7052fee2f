"""Errors that say something of the machine at hand and nothing of what was asked: a disk that is full or failing, no compiler."""

import errno

from headstock.pipeline.storage.outputs import OutputError
from headstock.solvers.errors import CompileError

LOST_DISK = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EFBIG, errno.EROFS)


def blames_surroundings(error: BaseException) -> bool:
    """Whether the same computation may well succeed once there is room on the disk, so that the error must not be kept as its result."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OutputError | CompileError) or (isinstance(cause, OSError) and cause.errno in LOST_DISK):
            return True
        cause = cause.__cause__ or cause.__context__
    return False
