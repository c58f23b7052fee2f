import ast
import sys
from pathlib import Path

import pytest

from common import read_json
from headstock.app.actions import doctor as environment_checks
from headstock.app.actions.doctor import (
    LIBRARIES,
    PYTHON_PACKAGES,
    Check,
    _check_environment,
    _check_package,
    _describe_checks,
    _free_memory_mb,
    _Package,
    _Question,
    _run_child,
    ask,
    doctor_command,
)
from headstock.app.commands.tool_commands import DoctorOptions

pytestmark = [pytest.mark.process, pytest.mark.workers]

ROOT = Path(__file__).resolve().parents[3]

GOOD = Check("python", "3.13.5", "ok")
BROKEN = Check("PETSc", "complex scalars", "missing", "install the real one")
SLOW = Check("BLAS", "reference", "warning", "install a fast one")


def test_this_environment_is_healthy() -> None:
    checks = _check_environment()
    assert [check for check in checks if check.status == "missing"] == []
    names = {check.name for check in checks}
    assert {"dolfinx", "PETSc", "MUMPS", "SLEPc", "gmsh", "h5py", "MPI, 2 ranks"} <= names
    assert "C compiler" in names


def imported_packages(code: str) -> set[str]:
    """Top-level packages that code imports, by statement or by name, besides the standard library
    and this program.
    """
    found = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            found.add(node.module)
        elif (
            isinstance(node, ast.Call)
            and ast.unparse(node.func).split(".")[-1]
            in {"import_module", "load_library", "__import__"}
            and isinstance(node.args[0], ast.Constant)
        ):
            found.add(str(node.args[0].value))
    return {name.split(".")[0] for name in found} - sys.stdlib_module_names - {"headstock"}


def test_the_doctor_asks_for_exactly_the_packages_that_the_program_imports() -> None:
    layers = sorted(link.name for link in (ROOT / ".typing" / "headstock").iterdir())
    trees = [path for layer in ("api", *layers) for path in (ROOT / layer).rglob("*.py")]
    assert len(trees) > 300
    imported = set().union(*(imported_packages(path.read_text()) for path in trees))
    # type stubs of the standard library, imported for type checkers alone
    imported -= {"_typeshed"}
    asked = [module for question in LIBRARIES for module in question.modules]
    asked += [package.module for package in PYTHON_PACKAGES]
    assert sorted(asked) == sorted(imported)


def test_a_question_imports_the_packages_it_stands_for() -> None:
    for question in LIBRARIES:
        assert set(question.modules) <= imported_packages(question.code), question.name
    assert sum(len(question.modules) for question in LIBRARIES) > 8


NOBODY = "no-such-package-of-any-kind"


def test_a_package_is_missing_or_optional_with_what_is_lost() -> None:
    missing = _check_package(_Package(NOBODY, without="singing"))
    assert (missing.status, missing.remedy) == ("warning", "without: singing")
    assert missing.found == "not installed (optional)"
    assert _check_package(_Package(NOBODY)).status == "missing"
    assert _check_package(_Package("numpy", without="singing")).found.endswith("(optional)")
    assert not _check_package(_Package("numpy")).found.endswith("(optional)")


@pytest.mark.parametrize(
    ("second", "code", "words"),
    [(BROKEN, 1, "-> install the real one"), (SLOW, 0, "install a fast one")],
)
def test_what_is_missing_makes_the_exit_code_1_and_a_warning_does_not(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, second: Check, code: int, words: str
) -> None:
    options = DoctorOptions(json=tmp_path / "doctor.json")
    assert doctor_command(options, lambda: [GOOD, second]) == code
    printed = capsys.readouterr().out
    assert words in printed
    assert printed.endswith("missing: PETSc\n") == bool(code)
    content = read_json(tmp_path / "doctor.json")
    assert content["healthy"] is not bool(code)
    assert [check["name"] for check in content["checks"]] == ["python", second.name]


def test_values_are_aligned() -> None:
    lines = _describe_checks([GOOD, Check("a longer name", "x", "ok")]).splitlines()
    assert lines[0].index("3.13.5") == lines[1].index("x")


@pytest.mark.parametrize(
    "code",
    ["import no_such_module", "import os; os.abort()", "print('0.10.0')", "pass"],
    ids=["absent", "crashing", "wrong", "silent"],
)
def test_a_library_that_is_absent_crashing_wrong_or_silent_is_missing_with_a_remedy(
    code: str,
) -> None:
    check = ask(_Question("library", code, expected="0.9", remedy="do this"))
    assert (check.status, check.remedy) == ("missing", "do this")
    # an optional one only warns
    assert ask(_Question("library", code, expected="0.9", needed=False)).status == "warning"


def test_a_child_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment_checks, "TIME_LIMIT_S", 0.2)
    code, answer = _run_child([sys.executable, "-c", "import time; time.sleep(60)"])
    assert code == 1
    assert "no answer within" in answer


def test_free_memory_is_what_the_kernel_calls_available(tmp_path: Path) -> None:
    (tmp_path / "meminfo").write_text("MemTotal:  9999999 kB\nMemAvailable:  2048000 kB\n")
    assert _free_memory_mb(tmp_path / "meminfo") == 2000
