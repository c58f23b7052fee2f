"""What kind each test is (markers)."""

import faulthandler
import functools
import gc
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies

from common import Dense, Shell, draw_here, work_here

ROOT = Path(__file__).resolve().parent.parent
ELASTIC = {"dolfinx", "petsc4py", "slepc4py"}
IMPORT = re.compile(r"^\s*(?:from ([\w.]+) import (\([^)]*\)|.*)|import ([\w.]+))", re.MULTILINE)
DOCUMENTS = {"test_documents.py", "test_mechanism_document.py", "test_snippets.py"}
SOURCE = {"test_contributing.py", "test_layering.py", "test_release_check.py", "test_tolerances.py"}
# a module that is loaded by its name
NAMED = re.compile(r'"(headstock\.[\w.]+)"')
# what `./headstock test --quick` leaves out, but for the tests of the kind smoke
SLOW_KINDS = (
    *("fem", "scenes", "process", "mpi", "faults", "trials", "slow", "hard", "documents", "source"),
)


@functools.cache
def imported_by(path: Path) -> set[str]:
    """Modules that the import statements of a file name, and the names it takes from them: any of
    these may be a module.
    """
    found = set()
    for module, names, plain in IMPORT.findall(path.read_text()):
        found |= {module or plain, *(f"{module}.{name}" for name in re.findall(r"\w+", names))}
    return found


@functools.cache
def own_modules() -> dict[str, Path]:
    """Our modules, and those that tests share, by name; not `common`, which every run loads."""
    found = {}
    for layer in (typed.parent for typed in ROOT.glob("*/py.typed")):
        for file in layer.rglob("*.py"):
            words = file.relative_to(layer if layer.name == "api" else ROOT).with_suffix("").parts
            found[".".join(("headstock", *words)).removesuffix(".__init__")] = file
    for file in (ROOT / "tests").rglob("*.py"):
        found[".".join(file.relative_to(ROOT / "tests").with_suffix("").parts)] = file
    return {name: file for name, file in found.items() if file.stem != "common"}


@functools.cache
def element_modules(*, by_name: bool) -> frozenset[str]:
    """Our modules that import finite elements, however indirectly."""
    behind: dict[str, list[str]] = {}
    for module, file in own_modules().items():
        for name in names_in(file, by_name=by_name):
            behind.setdefault(name, []).append(module)
    edge = [module for name in behind if is_elastic(name) for module in behind[name]]
    found = set(edge)
    while edge:
        beside = set(behind.get(edge.pop(), ())) - found
        found |= beside
        edge += beside
    return frozenset(found)


def names_in(path: Path, *, by_name: bool) -> set[str]:
    """What a file imports; also by the names of modules in its texts, which are loaded when a scene
    needs them.
    """
    return imported_by(path) | (set(NAMED.findall(path.read_text())) if by_name else set())


def is_elastic(name: str) -> bool:
    return name.split(".")[0] in ELASTIC


def uses_elements(path: Path, *, by_name: bool) -> bool:
    """Whether finite elements are imported along with a file, or may be while its tests run."""
    reached = element_modules(by_name=by_name)
    return any(is_elastic(name) or name in reached for name in names_in(path, by_name=by_name))


@functools.cache
def kinds_of(path: Path) -> frozenset[str]:
    """Markers of all tests of a file, from what it imports and where it lies; others are written in
    the file (``pytestmark``).
    """
    imports = {name.split(".")[0] for name in imported_by(path)}
    text = path.read_text()
    elements = uses_elements(path, by_name=False)
    runs = any(word in text for word in ("run_alone", "run_command", "Shell"))
    starts = any(word in text for word in ("run_process", "run_in", "loaded_by"))
    signs = {
        "fem": elements,
        "scenes": runs or (not elements and uses_elements(path, by_name=True)),
        "smoke": "pytestmark = pytest.mark.smoke" in text,
        "process": starts or bool(imports & {"subprocess", "multiprocessing"}),
        "mpi": any(word in text for word in ("mpirun", "run_on_ranks", "rank_words")),
        "faults": path.is_relative_to(ROOT / "tests" / "faults"),
        "hard": "pytest.mark.hard(" in text,
        "documents": path.name in DOCUMENTS,
        "source": path.name in SOURCE,
    }
    return frozenset(kind for kind, sign in signs.items() if sign)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--quick",
        action="store_true",
        help=f"a minute: one test of each capability (smoke), and none of the kinds {', '.join(SLOW_KINDS)}",
    )
    parser.addoption(
        "--none-skipped",
        action="store_true",
        help="a skipped test fails the run: all that tests need has to be there",
    )
    parser.addoption(
        "--trials",
        type=int,
        help="how many faults each test of -m faults injects (200, 60, 20, 100000, 500, 4)",
    )
    parser.addoption(
        "--seed", type=int, default=1, help="of what is random in the tests of -m faults"
    )


def pytest_configure(config: pytest.Config) -> None:
    config.stash[STDERR] = os.dup(2)  # what tests print goes elsewhere from here on
    if config.getoption("--quick"):
        left_out = " and ".join(f"not {kind}" for kind in SLOW_KINDS)
        config.option.markexpr = f"smoke or ({left_out})"
        sys.addaudithook(refuse_slow_kinds)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    # not even imported: finite elements take seconds to load
    quick = config.getoption("--quick") and collection_path.name.startswith("test_")
    kinds = kinds_of(collection_path) if quick else frozenset[str]()
    return True if kinds and "smoke" not in kinds else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        dense = {"fem"} if "dense" in getattr(item, "fixturenames", ()) else set()
        for kind in sorted(kinds_of(item.path) | dense):
            item.add_marker(kind)
    for marker in (
        "faults",
        "trials",
        "neighbours",
    ):  # minutes to hours, only when they are asked for
        if marker not in config.option.markexpr:
            left_out = [item for item in items if item.get_closest_marker(marker)]
            config.hook.pytest_deselected(items=left_out)
            items[:] = [item for item in items if item not in left_out]
    # files that take long first (stable): in the end both workers have short tests left, and
    # neither waits for the other
    weights = {"process": 2, "mpi": 2, "documents": 2, "fem": 1}
    lengths = {item.path: 0 for item in items}
    for item in items:
        length = sum(weights[kind] for kind in weights if item.get_closest_marker(kind))
        lengths[item.path] = max(lengths[item.path], length)
    items.sort(key=lambda item: -lengths[item.path])


@settings(derandomize=True, max_examples=1, database=None)
@given(strategies.none())
def _try_nothing(_nothing: None) -> None:
    """Let hypothesis make its generator of random numbers."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection() -> None:
    # before much is there: it looks through all objects, and would not find the frozen holder
    _try_nothing()


def pytest_collection_finish() -> None:
    # what collecting made (4 000 tests, all their modules) stays for good: searching it for garbage
    # again and again would be a good part of what small tests cost
    gc.freeze()


def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    skipped = reporter is not None and reporter.stats.get("skipped")
    if skipped and session.config.getoption("--none-skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def refuse_slow_kinds(event: str, details: tuple[object, ...]) -> None:
    """Audit hook of a quick run: a test that does what its markers do not say fails. Commands may
    ask the system for its name.
    """
    if not running:
        return
    starts = event in ("subprocess.Popen", "os.fork", "os.posix_spawn")
    if starts and running[0].get_closest_marker("smoke") is None:
        lacks = "pytestmark = pytest.mark.process is missing"
        raise RuntimeError(f"this test starts a process: {lacks} ({details[0]})")
    if event == "import" and details[0] in ELASTIC:
        lacks = "pytestmark = pytest.mark.fem is missing"
        raise RuntimeError(f"this test imports {details[0]}: {lacks}")


running: list[pytest.Item] = []
STDERR = pytest.StashKey[int]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    # pytest itself prints where a test hangs and lets it hang; this process ends, and xdist starts
    # another for the tests left
    limit = float(item.config.getini("faulthandler_timeout") or 0.0)
    if limit > 0.0 and not item.get_closest_marker("faults"):
        faulthandler.dump_traceback_later(limit, exit=True, file=item.config.stash[STDERR])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    running.append(item)
    try:
        with pytest.MonkeyPatch.context() as patch:
            # what a test writes need not outlive a power cut: waiting for the disk takes longer than
            # most runs compute
            patch.setattr(os, "fsync", os.fstat)
            if item.get_closest_marker("workers") is None:
                patch.setattr("headstock.meshing.process.running.call_apart", work_here)
                patch.setattr("headstock.app.pictures.pictures._run", draw_here)
            return (yield)
    finally:
        running.clear()


@pytest.fixture(scope="session")
def dense() -> Dense:
    return Dense()


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    return Shell(tmp_path, capsys)
