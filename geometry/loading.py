"""Heavy libraries, each loaded when it is first needed, and nowhere near a file of the working
folder.

MPI, PETSc, SLEPc, dolfinx and matplotlib read settings in the working folder while they start, and
some of these settings are code (``petscrc`` names libraries to open). So each is imported while the
thread that imports it stands in a folder of ours, which holds none of that. Modules take libraries
from adapters, which are made of `Library` or call `load_library`; no other module imports them.
"""

import contextlib
import gc
import importlib
import importlib.util
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from headstock.geometry.errors import HeadstockError

# of the code itself: nothing has to be made, or can be left over
OWN_FOLDER = str(Path(__file__).resolve().parent)
MPI_FILES = ("ucx.conf",)
PETSC_FILES = ("petscrc", ".petscrc", "petsc.cfg", "slepc.cfg")
OPTION_FILES = ("dolfinx_jit_options.json", "ffcx_options.json")


class LibraryError(HeadstockError):
    """A library cannot be loaded away from the files of the working folder."""


@dataclass(frozen=True)
class _Start:
    """Steps that load a library.

    Attributes:
        modules: Imported in this order; the last is the library.
        files: What it would read in the working folder.
        prepare: Called before the imports.
        finish: Called after them.
    """

    modules: tuple[str, ...]
    files: tuple[str, ...] = ()
    prepare: Callable[[], None] = lambda: None
    finish: Callable[[], None] = lambda: None


def _start_petsc() -> None:
    """Initialise PETSc and SLEPc; of their settings only those of the account are read, and those
    that variables name.
    """
    account_file = Path(os.environ.get("HOME", ""), ".petscrc")
    arguments = ["headstock", "-skip_petscrc"]
    if account_file.is_absolute() and account_file.is_file():
        arguments += ["-options_file", str(account_file)]
    importlib.import_module("petsc4py").init(arguments)
    importlib.import_module("slepc4py").init(arguments)


def _read_form_options() -> None:
    """Let dolfinx and ffcx look for their options once, which they keep: `form_cache` gives all."""
    importlib.import_module("ffcx").get_options()
    importlib.import_module("dolfinx.jit").get_options()
    # its reader of gmsh models was renamed in 0.10
    new = importlib.util.find_spec("dolfinx.io.gmsh")
    importlib.import_module("dolfinx.io.gmsh" if new else "dolfinx.io.gmshio")


_ELASTIC = _Start(
    ("mpi4py.MPI", "petsc4py.PETSc", "slepc4py.SLEPc", "basix.ufl", "ffcx.options", "dolfinx"),
    (*MPI_FILES, *PETSC_FILES, *OPTION_FILES),
    _start_petsc,
    _read_form_options,
)
_STARTS = {
    "mpi4py.MPI": _Start(("mpi4py.MPI",), MPI_FILES),
    "basix": _Start(("basix.ufl",)),
    "scipy": _Start(("scipy",)),
    # Debian's is built with MPI
    "h5py": _Start(("h5py",), MPI_FILES),
    "matplotlib": _Start(("matplotlib.figure", "matplotlib"), ("matplotlibrc",)),
    "pyvista": _Start(("matplotlib.figure", "pyvista"), ("matplotlibrc",)),
} | dict.fromkeys((*_ELASTIC.modules[1:], "dolfinx.fem", "dolfinx.la", "ufl"), _ELASTIC)

_lock = threading.Lock()
_thread = threading.local()
_loaded: set[str] = set()
# modules that came with what was loaded here
_known: set[str] = set()


@contextlib.contextmanager
def without_collecting(*, for_good: bool = False) -> Iterator[None]:
    """Look for no garbage while modules load and rules are built: all of that is kept, and going
    through it again and again takes a tenth of the time.

    Args:
        for_good: In a process of ours no later search goes through what is there now either.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if for_good and _is_ours():
            gc.freeze()
        if enabled:
            gc.enable()


class Library:
    """A library that is loaded when something of it is first used.

    Args:
        annotated: Classes that annotations alone name: what is not loaded yet stands for them.
    """

    def __init__(self, name: str, *, annotated: tuple[str, ...] = ()) -> None:
        self._name = name
        self._annotated = annotated

    def __getattr__(self, name: str) -> Any:
        if name in self._annotated and self._name not in _loaded:
            return type(name, (), {})
        if name.startswith("__") and name not in ("__version__", "__file__"):
            raise AttributeError(name)
        value = getattr(load_library(self._name), name)
        setattr(self, name, value)
        return value


def load_library(name: str) -> ModuleType:
    """Import a library while the importing thread stands in our own folder.

    Args:
        name: Of its module, or of a module of ours that imports libraries.

    Raises:
        LibraryError: The kernel lets no thread have a folder of its own, and a file of the working
            folder would be obeyed.
    """
    start = _STARTS.get(name) or _Start((name,), MPI_FILES)
    if name not in _loaded and getattr(_thread, "apart", False):
        _import_all(name, start)  # one library is loaded by another
    elif name not in _loaded:
        with _lock:
            if name not in _loaded:
                _load(name, start)
    return importlib.import_module(name)


def _load(name: str, start: _Start) -> None:
    before = [module for module in start.modules if module in sys.modules and module not in _known]
    if before and (shadowing := _files_here(start.files)):
        warnings.warn(
            f"{before[0]} was loaded before Headstock needed it, in a folder with {shadowing}, which it "
            "may have obeyed: move the file, or start Python in another folder",
            stacklevel=2,
        )
    present = set(sys.modules)

    def load_apart() -> None:
        _thread.apart = True
        try:
            _import_all(name, start)
        finally:
            _thread.apart = False

    _run_apart(load_apart, start.files)
    _known.update(set(sys.modules) - present)


def _import_all(name: str, start: _Start) -> None:
    start.prepare()
    for module in (*start.modules, name):
        importlib.import_module(module)
    start.finish()
    _loaded.update((name, *start.modules))


def _run_apart(action: Callable[[], None], files: tuple[str, ...]) -> None:
    """Run what loads a library in our own folder: in this thread where the process is ours and has
    no other, else in a thread that shares its folder with nobody.
    """
    ours = _is_ours()
    if not (ours and threading.active_count() == 1) and _run_in_thread(action):
        return
    if ours:
        with _standing_apart():
            action()
        return
    if shadowing := _files_here(files):
        raise LibraryError(
            f"the working folder holds {shadowing}, which a library would obey, and this kernel lets no thread have a folder "
            "of its own (unshare): move the file, or start Python in another folder"
        )
    action()


def _run_in_thread(action: Callable[[], None]) -> bool:
    """Run an action in a thread of its own with another working folder; False where the kernel
    refuses that.
    """
    done: list[bool] = []
    failures: list[BaseException] = []

    def work() -> None:
        try:
            os.unshare(os.CLONE_FS)
        except (OSError, AttributeError):
            return
        done.append(True)
        try:
            os.chdir(OWN_FOLDER)
            action()
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=work, name="headstock-loading")
    thread.start()
    thread.join()
    if failures:
        raise failures[0]
    return bool(done)


@contextlib.contextmanager
def _standing_apart() -> Iterator[None]:
    """Let this process stand in our own folder for a moment."""
    before = os.open(".", os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.chdir(OWN_FOLDER)
        yield
    finally:
        os.fchdir(before)
        os.close(before)


def _is_ours() -> bool:
    """Return whether this process runs a module of the program, and not one of a user's."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return spec is not None and spec.name.startswith("headstock.")


def _files_here(names: tuple[str, ...]) -> str:
    return ", ".join(name for name in names if os.path.lexists(name))
