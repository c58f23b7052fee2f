"""What both worker processes do: read a job, perform it within its limits, write the result or one
line of refusal.
"""

import os
import sys
from collections.abc import Callable

from headstock.meshing.errors import MeshError, MeshQualityError, PartFileError, PatchError
from headstock.meshing.process.isolation import accept_limits
from headstock.meshing.process.job import MeshData, MeshJob, parse_job, write_data

REFUSED, BAD_FILE, BAD_PATCH, BAD_MESH = 3, 4, 5, 6


def serve_job(arguments: list[str], perform: Callable[[MeshJob], MeshData]) -> int:
    """Do the job that comes on standard input and write its result to a file the parent holds open.

    Args:
        arguments: The limits, and the number of the open file that takes the result (npz).

    Returns:
        Exit code: 0 done, 3 refused for a stated reason, 4 the file is to blame, 5 it lacks a patch, whose
        group is the line's first word, 6 a finer mesh may do.
    """
    (result,) = accept_limits(arguments)
    try:
        data = perform(parse_job(sys.stdin.read()))
    except PatchError as error:
        sys.stderr.write("\n" + " ".join((error.group, *str(error).split())) + "\n")
        return BAD_PATCH
    except MeshError as error:
        sys.stderr.write("\n" + " ".join(str(error).split()) + "\n")
        if isinstance(error, MeshQualityError):
            return BAD_MESH
        return BAD_FILE if isinstance(error, PartFileError) else REFUSED
    with os.fdopen(int(result), "wb") as file:
        write_data(file, data)
    return 0
