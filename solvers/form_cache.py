"""Compiled forms: kept in the user's cache folder, from our own sources only, and safe against processes killed while compiling."""

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dolfinx import fem
from ffcx.options import FFCX_DEFAULT_OPTIONS
from mpi4py import MPI

from headstock.solvers.errors import CompileError

COMPILER_ARGUMENTS = ["-O3", "-march=native"]
LOCK_FILE = ".lock"


def compile_form(form: Any, comm: MPI.Comm) -> Any:
    """Compile a form on rank 0 and load it everywhere; collective.

    Every option is given here: dolfinx and ffcx would otherwise take compiler arguments and libraries from files in the working
    folder.

    Args:
        form: A UFL form over a mesh of the communicator.
        comm: Collective.

    Returns:
        The compiled dolfinx form.

    Raises:
        CompileError: There is no C compiler, or no room for its files.
    """
    folder = form_cache_folder()
    options = {
        "cache_dir": folder,
        "cffi_debug": False,
        "cffi_verbose": False,
        "cffi_libraries": None,
        "cffi_extra_compile_args": COMPILER_ARGUMENTS,
        "timeout": 60,
    }
    defaults = {name: value for name, (_, value, _, _) in FFCX_DEFAULT_OPTIONS.items()}
    with _sole_compiler(folder) if comm.rank == 0 else contextlib.nullcontext():
        try:
            return fem.form(form, form_compiler_options=defaults, jit_options=options)
        except Exception as error:  # cffi, distutils and dolfinx each have their own
            places = ", ".join(
                f"{place}: {shutil.disk_usage(place).free / 1e6:.0f} MB free" for place in (folder, tempfile.gettempdir())
            )
            raise CompileError(
                f"a form could not be compiled: {error} ({places}); see that there is room and a C compiler"
            ) from error


def form_cache_folder() -> Path:
    """``headstock/forms`` in the user's cache folder."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "headstock" / "forms"


def clear_unfinished(folder: Path) -> None:
    """Remove what a killed process left half compiled: ffcx would wait for it and then give up, in every later run.

    Only for the holder of the folder's lock, when nobody else compiles.
    """
    for source in folder.glob("*.c"):
        if not source.with_suffix(".c.cached").exists():
            for part in folder.glob(f"{source.stem}.*"):
                part.unlink(missing_ok=True)


@contextlib.contextmanager
def _sole_compiler(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    handle = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        # a file system without locks only loses the protection
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
            clear_unfinished(folder)
        yield
    finally:
        os.close(handle)
