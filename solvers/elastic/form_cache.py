"""Compiled forms: kept in the user's cache folder, from our own sources only, and safe against
processes killed while compiling.
"""

import contextlib
import fcntl
import grp
import os
import pwd
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from headstock.geometry.errors import lacks_memory, out_of_memory
from headstock.solvers.elastic.kernels import form_cache_folder, kernel_link
from headstock.solvers.elastic.libraries import fem, ffcx_options, ufl
from headstock.solvers.errors import CompileError
from headstock.solvers.mpi import MPI

COMPILER_ARGUMENTS = ["-O3", "-march=native"]
LOCK_FILE = ".lock"


def compile_form(form: ufl.Form, comm: MPI.Comm, name: str) -> fem.Form:
    """Compile a form on rank 0 and load it everywhere; collective.

    Every option is given here: dolfinx and ffcx would otherwise take compiler arguments and
    libraries from files in the working folder.

    Args:
        form: A UFL form over a mesh of the communicator.
        name: Of the kernel; a link of this name is left in the cache folder.

    Returns:
        The compiled dolfinx form.

    Raises:
        CompileError: There is no C compiler, no room for its files, or others may write where
            compiled code is kept.
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
    defaults = {name: value for name, (_, value, _, _) in ffcx_options.FFCX_DEFAULT_OPTIONS.items()}
    with _sole_compiler(folder) if comm.rank == 0 else contextlib.nullcontext():
        try:
            compiled = fem.form(form, form_compiler_options=defaults, jit_options=options)
        except Exception as error:  # cffi, distutils and dolfinx each have their own
            if lacks_memory(error):
                raise out_of_memory("the compiler of a form") from error
            places = ", ".join(
                f"{held}: {shutil.disk_usage(held).free / 1e6:.0f} MB free"
                for held in (folder, tempfile.gettempdir())
            )
            raise CompileError(
                f"a form could not be compiled: {error} ({places}); see that there is room and a C compiler"
            ) from error
        if comm.rank == 0:
            _link_kernel(name, Path(compiled.module.__file__))
    return compiled


def _link_kernel(name: str, library: Path) -> None:
    link = kernel_link(name)
    if not link.exists():
        # without it the kernel is only forecast once more
        with contextlib.suppress(OSError):
            link.unlink(missing_ok=True)
            link.symlink_to(library.name)


def _clear_unfinished(folder: Path) -> None:
    """Remove what a killed process left half compiled: ffcx would wait for it and then give up, in
    every later run.

    Only for the holder of the folder's lock, when nobody else compiles.
    """
    for source in folder.glob("*.c"):
        if not source.with_suffix(".c.cached").exists():
            for part in folder.glob(f"{source.stem}.*"):
                part.unlink(missing_ok=True)


def _require_private(folder: Path) -> None:
    """Check that nobody but this account and root owns or may write a folder whose files are run,
    or a folder on the way to it.

    Raises:
        CompileError: Somebody else may; names the folder and what to do.
    """
    for path in (folder, *folder.absolute().parents, *folder.resolve().parents):
        status = path.stat()
        reason = None
        if status.st_uid not in (os.geteuid(), 0) and not _looks_unmapped(status.st_uid):
            reason = f"belongs to the account with number {status.st_uid}"
        # a folder with the sticky bit, as /tmp, keeps what is ours
        elif path != folder and status.st_mode & stat.S_ISVTX:
            continue
        elif status.st_mode & stat.S_IWOTH:
            reason = "can be written by everybody"
        elif status.st_mode & stat.S_IWGRP and not _is_own_group(status.st_gid):
            reason = f"can be written by the group with number {status.st_gid}"
        if reason:
            raise CompileError(
                f"{path} {reason}: compiled code in {folder} is not run; give it to this account and chmod go-w it, "
                "or name another folder with XDG_CACHE_HOME"
            )


def _looks_unmapped(uid: int) -> bool:
    """Return whether an account may be an unmapped one: in a user namespace all accounts without a
    number of their own there, root among them, look like this one.
    """
    whole = Path("/proc/self/uid_map").read_text().split()[-1] == str(2**32 - 1)
    return not whole and uid == int(Path("/proc/sys/kernel/overflowuid").read_text())


def _is_own_group(gid: int) -> bool:
    """Return whether a group has the account's own name: it has no other members where accounts get
    one each.
    """
    try:
        return (
            gid == os.getegid() and grp.getgrgid(gid).gr_name == pwd.getpwuid(os.geteuid()).pw_name
        )
    except KeyError:
        return False


@contextlib.contextmanager
def _sole_compiler(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    _require_private(folder)
    handle = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        # a file system without locks only loses the protection
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
            _clear_unfinished(folder)
        yield
    finally:
        os.close(handle)
