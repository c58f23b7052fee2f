import json
import sys
from pathlib import Path

import pytest

from headstock.app.actions import doctor as environment_checks
from headstock.app.actions.doctor import (
    Check,
    Question,
    ask,
    check_environment,
    check_package,
    describe_checks,
    free_memory_mb,
    run_child,
    run_doctor,
)

pytestmark = pytest.mark.process

GOOD = Check("python", "3.13.5", "ok")
BROKEN = Check("PETSc", "complex scalars", "missing", "install the real one")
SLOW = Check("BLAS", "reference", "warning", "install a fast one")


def test_this_environment_is_healthy() -> None:
    checks = check_environment()
    assert [check for check in checks if check.status == "missing"] == []
    assert {"dolfinx", "PETSc", "MUMPS", "SLEPc", "gmsh", "h5py", "MPI, 2 ranks", "C compiler"} <= {
        check.name for check in checks
    }


def test_what_is_missing_makes_the_exit_code_1_and_is_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run_doctor(None, lambda: [GOOD, BROKEN]) == 1
    printed = capsys.readouterr().out
    assert "-> install the real one" in printed
    assert printed.endswith("missing: PETSc\n")


def test_a_warning_alone_leaves_the_exit_code_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_doctor(None, lambda: [GOOD, SLOW]) == 0
    assert "install a fast one" in capsys.readouterr().out


def test_the_json_file_holds_every_check(tmp_path: Path) -> None:
    run_doctor(tmp_path / "doctor.json", lambda: [GOOD, BROKEN])
    content = json.loads((tmp_path / "doctor.json").read_text())
    assert content["healthy"] is False
    assert [check["name"] for check in content["checks"]] == ["python", "PETSc"]


def test_values_are_aligned() -> None:
    lines = describe_checks([GOOD, Check("a longer name", "x", "ok")]).splitlines()
    assert lines[0].index("3.13.5") == lines[1].index("x")


@pytest.mark.parametrize(
    "code",
    ["import no_such_module", "import os; os.abort()", "print('0.10.0')", "pass"],
    ids=["absent", "crashing", "wrong", "silent"],
)
def test_a_library_that_is_absent_crashing_wrong_or_silent_is_missing_with_a_remedy(
    code: str,
) -> None:
    check = ask(Question("library", code, expected="0.9", remedy="do this"))
    assert (check.status, check.remedy) == ("missing", "do this")


def test_an_optional_library_only_warns() -> None:
    assert ask(Question("library", "import no_such_module", needed=False)).status == "warning"


def test_a_package_that_is_not_installed_is_missing() -> None:
    assert check_package("no-such-package-of-any-kind").status == "missing"


def test_a_child_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment_checks, "TIME_LIMIT_S", 0.2)
    code, answer = run_child([sys.executable, "-c", "import time; time.sleep(60)"])
    assert code == 1
    assert "no answer within" in answer


def test_free_memory_is_what_the_kernel_calls_available(tmp_path: Path) -> None:
    (tmp_path / "meminfo").write_text("MemTotal:  9999999 kB\nMemAvailable:  2048000 kB\n")
    assert free_memory_mb(tmp_path / "meminfo") == 2000
