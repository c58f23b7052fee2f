"""The worker process that calls one function on a file of strangers, within limits: ``python -m
headstock.meshing.process.worker``.
"""

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.errors import HeadstockError
from headstock.meshing.errors import MeshQualityError, PartFileError, PatchError
from headstock.meshing.process.isolation import (
    WorkerEnd,
    WorkerLimits,
    accept_limits,
    run_isolated,
)

type Arrays = Mapping[str, NDArray[Any]]

MODULE = "headstock.meshing.process.worker"
REFUSED, BAD_FILE, BAD_PATCH, BAD_MESH = 3, 4, 5, 6
# exit code by what refuses, the most special first: 3 refused for a stated reason, 4 the file is to
# blame, 5 it lacks a patch, whose group is the line's first word, 6 a finer mesh may do
EXIT_CODES: dict[type[HeadstockError], int] = {
    PatchError: BAD_PATCH,
    PartFileError: BAD_FILE,
    MeshQualityError: BAD_MESH,
    HeadstockError: REFUSED,
}


def call_apart(
    functions: Sequence[str],
    *words: str,
    limits: WorkerLimits,
    readable: Sequence[Path] = (),
    content: bytes = b"",
    result: BinaryIO | None = None,
    progress: Callable[[str], None] | None = None,
) -> WorkerEnd:
    """Call a function in a worker process.

    Args:
        functions: The function, and those that it takes as its first arguments, ``MODULE:NAME``
            each. It returns arrays by name, or raises a ``HeadstockError``.
        words: Its further arguments; ``content`` is the last where there is any.
        limits: What the process may use at most.
        readable: Files it may read.
        result: Open file that takes the arrays (npz).
        progress: Called now and then with the last line that the function wrote on standard error.
    """
    arguments = [json.dumps(functions), json.dumps(words)]
    return run_isolated(
        MODULE,
        arguments,
        limits=limits,
        readable=readable,
        stdin=content,
        result=result,
        progress=progress,
    )


def read_arrays(file: BinaryIO) -> dict[str, NDArray[Any]]:
    """Read the arrays that a worker process wrote into an open file."""
    file.seek(0)
    with np.load(file, allow_pickle=False) as store:
        return {name: store[name] for name in store.files}


def _run_worker(arguments: list[str]) -> int:
    """Call a function as `call_apart` describes it; its modules are loaded before limits hold.

    Returns:
        Exit code: 0 done, one of ``EXIT_CODES`` where standard error ends with a line that says why.
    """
    function, *others = map(_load_function, json.loads(arguments[1]))
    _, words, *result = accept_limits(arguments)
    content = sys.stdin.buffer.read()
    try:
        arrays = function(*others, *json.loads(words), *([content] if content else []))
    except HeadstockError as error:
        group = [error.group] if isinstance(error, PatchError) else []
        sys.stderr.write("\n" + " ".join((*group, *str(error).split())) + "\n")
        return next(code for kind, code in EXIT_CODES.items() if isinstance(error, kind))
    for number in result:
        with os.fdopen(int(number), "wb") as file:
            np.savez(file, **arrays)
    return 0


def _load_function(text: str) -> Callable[..., Any]:
    module, _, name = text.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function


if __name__ == "__main__":
    sys.exit(_run_worker(sys.argv[1:]))
