"""Compiled forms: nothing half compiled blocks a later run, and nothing in the working folder has a
say.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from common import run_process
from headstock.solvers.elastic.form_cache import _clear_unfinished, _require_private
from headstock.solvers.elastic.kernels import form_cache_folder, kernel_link
from headstock.solvers.errors import CompileError

COMPILE = """
import basix.ufl, dolfinx, ufl
from mpi4py import MPI
from headstock.solvers.elastic.form_cache import compile_form
domain = dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, 1)
space = dolfinx.fem.functionspace(domain, ("Lagrange", 1))
u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
compile_form(u * v * ufl.dx, MPI.COMM_SELF, "mass-interval")
print("compiled")
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return form_cache_folder()


def compile_in(cwd: Path) -> "subprocess.CompletedProcess[str]":
    return run_process([sys.executable, "-c", COMPILE], cwd=cwd, timeout=60)


def test_what_a_killed_compilation_left_does_not_block_the_next(
    folder: Path, tmp_path: Path
) -> None:
    assert compile_in(tmp_path).stdout == "compiled\n"
    assert kernel_link("mass-interval").resolve().suffix == ".so"
    sources = list(folder.glob("*.c"))
    assert len(sources) == 1
    sources[0].with_suffix(".c.cached").unlink()
    sources[0].write_text("half")
    done = compile_in(tmp_path)
    assert done.stdout == "compiled\n", done.stderr
    assert sources[0].with_suffix(".c.cached").exists()


def test_finished_forms_are_kept(folder: Path) -> None:
    folder.mkdir(parents=True)
    for name in ("a.c", "a.c.cached", "a.so", "b.c", "b.o"):
        (folder / name).touch()
    _clear_unfinished(folder)
    assert sorted(path.name for path in folder.iterdir()) == ["a.c", "a.c.cached", "a.so"]


def test_compiler_options_in_the_working_folder_are_not_used(folder: Path, tmp_path: Path) -> None:
    evil = {
        "cffi_extra_compile_args": ["-fplugin=/nowhere.so"],
        "cffi_libraries": ["nowhere"],
        "cache_dir": str(tmp_path / "evil"),
    }
    (tmp_path / "dolfinx_jit_options.json").write_text(json.dumps(evil))
    (tmp_path / "ffcx_options.json").write_text(json.dumps({"scalar_type": "float32"}))
    done = compile_in(tmp_path)
    assert done.stdout == "compiled\n", done.stderr
    assert not (tmp_path / "evil").exists()
    assert "_float64" in next(folder.glob("*.c")).read_text()


def test_a_compiler_that_fails_is_a_named_error_with_the_room_there_is(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "false")
    done = compile_in(tmp_path)
    assert done.returncode == 1
    assert "CompileError: a form could not be compiled" in done.stderr
    assert "MB free" in done.stderr
    monkeypatch.delenv("CC")
    assert compile_in(tmp_path).stdout == "compiled\n"


def test_compiled_code_is_not_run_where_others_may_write_it(folder: Path, tmp_path: Path) -> None:
    folder.mkdir(parents=True, mode=0o700)
    _require_private(folder)
    for place, mode in ((folder, 0o777), (folder, 0o1777), (tmp_path / "cache", 0o777)):
        before = place.stat().st_mode & 0o7777
        place.chmod(mode)
        with pytest.raises(
            CompileError,
            match=f"{place} can be written by everybody: compiled code in {folder} is not run",
        ):
            _require_private(folder)
        done = compile_in(tmp_path)
        assert "CompileError" in done.stderr
        place.chmod(before)
    # as the shared temporary folder
    assert (tmp_path / "cache").is_dir()
    (tmp_path / "cache").chmod(0o1777)
    _require_private(folder)


def test_a_link_from_where_others_may_write_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "link").symlink_to(tmp_path / "mine")
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(CompileError, match="open can be written by everybody"):
        _require_private(tmp_path / "open" / "link")
