import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from common import approx, run_process
from headstock.meshing.process.isolation import WorkerEnd, WorkerLimits, isolate, run_isolated

pytestmark = pytest.mark.workers

LIMITS = WorkerLimits(memory_bytes=1 << 30, cpu_seconds=20, wall_seconds=60.0)
Run = Callable[..., WorkerEnd]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs lines of code in an isolated worker process; what it writes on standard error is in ``errors``."""
    modules = tmp_path / "modules"
    modules.mkdir()
    monkeypatch.syspath_prepend(modules)

    def run_code(
        code: str,
        *words: str,
        limits: WorkerLimits = LIMITS,
        readable: tuple[Path, ...] = (),
        imports: str = "",
    ) -> WorkerEnd:
        start = "import os, socket, sys, time\nfrom pathlib import Path\nfrom headstock.meshing.process.isolation import accept_limits\n"
        (modules / "isolated_code.py").write_text(
            imports + start + "words = accept_limits(sys.argv[1:])\n" + textwrap.dedent(code)
        )
        return run_isolated("isolated_code", words, limits=limits, readable=readable)

    return run_code


@pytest.fixture(scope="module")
def _namespaces() -> None:
    code = (
        "from headstock.meshing.process.isolation import isolate; import sys; sys.exit(isolate([]))"
    )
    done = run_process([sys.executable, "-P", "-c", code])
    if done.returncode:
        pytest.skip(f"no namespaces here: {done.stderr}")


@pytest.mark.usefixtures("_namespaces")
def test_a_worker_sees_its_file_and_the_code_but_no_other_file_of_the_user(
    run: Run, tmp_path: Path
) -> None:
    mine, other = tmp_path / "part.step", tmp_path / "secret.txt"
    for path in (mine, other):
        path.write_text(f"text of {path.name}")
    code = """
        beside = sorted(os.listdir(Path(words[0]).parent))
        print(Path(words[0]).read_text(), beside, Path(words[1]).exists(), Path("/etc/passwd").exists(), file=sys.stderr)
        import decimal
    """
    end = run(code, str(mine), str(other), readable=(mine,))
    assert (end.code, end.last_line) == (
        0,
        "text of part.step ['modules', 'part.step'] False False",
    )


@pytest.mark.usefixtures("_namespaces")
def test_threads_of_libraries_are_no_way_out(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "4")
    end = run("print(sorted(os.listdir('/dev')), file=sys.stderr)", imports="import numpy.linalg\n")
    assert end.last_line == "['null', 'urandom', 'zero']"


@pytest.mark.usefixtures("_namespaces")
def test_a_worker_can_write_in_its_scratch_folder_only_and_nothing_of_it_stays(
    run: Run, tmp_path: Path
) -> None:
    mine = tmp_path / "part.step"
    mine.write_text("whole")
    code = """
        Path("/tmp/scratch").write_text("x")
        for path in (words[0], "/usr/planted", os.__file__):
            try:
                open(path, "a")
            except OSError as error:
                print(type(error).__name__, file=sys.stderr)
            else:
                print("open for writing:", path, file=sys.stderr)
    """
    end = run(code, str(mine), readable=(mine,))
    assert end.code == 0, end.errors
    assert "open for writing" not in end.errors
    assert mine.read_text() == "whole"
    assert not Path("/tmp/scratch").exists()


@pytest.mark.usefixtures("_namespaces")
def test_a_worker_has_no_network_no_capabilities_and_no_way_to_its_parent(run: Run) -> None:
    received: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: received.append(number))
    code = """
        for attack in (
            lambda: socket.create_connection(("127.0.0.1", 9), 1),
            lambda: os.kill(int(words[0]), 10),
            lambda: os.unshare(os.CLONE_NEWUSER),
            lambda: os.chroot("/tmp"),
            lambda: os.listdir("/proc/1"),
        ):
            try:
                attack()
            except OSError:
                continue
            sys.exit(9)
    """
    try:
        end = run(code, str(os.getpid()))
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert (end.code, received) == (0, []), end.errors


@pytest.mark.usefixtures("_namespaces")
def test_a_file_is_seen_under_the_name_it_was_given_by(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    (tmp_path / "deep" / "store").write_text("content")
    (tmp_path / "link").symlink_to("deep/er")
    (tmp_path / "part.msh").symlink_to("deep/store")
    monkeypatch.chdir(tmp_path)
    shown = "print(Path(words[0]).read_text(), file=sys.stderr)"
    names = (tmp_path / "part.msh", Path("part.msh"), Path("link/../store"))
    ends = {given: run(shown, str(given), readable=(given,)).last_line for given in names}
    assert ends == dict.fromkeys(names, "content")


def test_a_worker_that_waits_is_ended_by_the_wall_clock(run: Run) -> None:
    end = run("time.sleep(3600)", limits=WorkerLimits(1 << 30, 20, 1.5))
    assert end.out_of_time == "1.5 s"
    assert not end.out_of_memory


def test_a_worker_that_computes_is_ended_by_its_processor_time(run: Run) -> None:
    end = run("while True: pass", limits=WorkerLimits(1 << 30, 1, 60.0))
    assert end.out_of_time == "1 s of processor time"


def test_a_worker_that_takes_memory_is_ended_by_its_limit(run: Run) -> None:
    end = run("bytearray(1 << 30)", limits=WorkerLimits(512 << 20, 20, 60.0))
    assert end.code == 1
    assert end.out_of_memory
    assert "0.5 GiB" in end.memory_limit
    assert end.memory_remedy is None


def test_exit_codes_and_signals_of_a_child_reach_its_parent(run: Run) -> None:
    assert run("sys.exit(3)").code == 3
    assert run("os.abort()").code == -signal.SIGABRT
    assert run("import ctypes; ctypes.string_at(0)").code == -signal.SIGSEGV


def test_a_killed_parent_leaves_no_child(run: Run, tmp_path: Path) -> None:
    run("time.sleep(3600)", limits=WorkerLimits(1 << 30, 20, 0.01))  # writes the module
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path / "modules")!r})
from headstock.meshing.process.isolation import WorkerLimits, run_isolated
run_isolated("isolated_code", [], limits=WorkerLimits(1 << 30, 20, 3600.0), result=sys.stdout)
"""
    parent = subprocess.Popen([sys.executable, "-P", "-c", code], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    time.sleep(1.0)
    parent.kill()
    # the pipe ends when the last process that holds it does
    assert parent.stdout.read() == b""
    parent.stdout.close()
    parent.wait()


def test_where_namespaces_are_refused_the_work_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: int) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "unshare", refuse)
    assert isolate([__file__]) == "Operation not permitted"
    monkeypatch.delattr(os, "unshare")
    assert str(isolate([__file__])).startswith("no namespaces are known for")
    assert Path(__file__).is_file()


@pytest.mark.parametrize(
    "limits",
    [
        pytest.param("ulimit -v 3000000", marks=pytest.mark.trials),
        pytest.param("ulimit -t 30", marks=pytest.mark.trials),
        "ulimit -S -v 3000000",
        "ulimit -v 3000000 -t 30",
    ],
)
def test_a_shell_with_limits_of_its_own_can_mesh(limits: str) -> None:
    code = """
from headstock.geometry.parts.solids import Box
from headstock.meshing.process.job import MeshJob
from headstock.meshing.process.running import run_job
print(run_job(MeshJob("describe", Box((1.0, 2.0, 3.0))), what="box", time_limit=60.0).properties.volume)
"""
    command = ["bash", "-c", f'{limits}; exec "$@"', "bash", sys.executable, "-P", "-c", code]
    done = run_process(command)
    assert done.returncode == 0 and float(done.stdout) == approx(6.0), done.stderr


def test_a_limit_of_the_shell_is_named_when_it_is_met() -> None:
    code = """
from headstock.geometry.parts.solids import Box
from headstock.meshing.process.job import MeshJob
from headstock.meshing.process.running import run_job
run_job(MeshJob("mesh", Box((100.0, 40.0, 1000.0)), size=6.0, straight=True), what="column", time_limit=60.0)
"""
    command = [
        "bash",
        "-c",
        'ulimit -v 358400; exec "$@"',
        "bash",
        sys.executable,
        "-P",
        "-c",
        code,
    ]
    done = run_process(command)
    last = done.stderr.strip().splitlines()[-1]
    assert "column: " in last
    assert "ulimit -v" in last and "8 GiB" in last


@pytest.mark.usefixtures("_namespaces")
def test_a_worker_of_a_script_does_not_see_the_scripts_folder(tmp_path: Path) -> None:
    modules, folder = tmp_path / "modules", tmp_path / "mine"
    for place in (modules, folder):
        place.mkdir()
    (folder / "random.py").write_text(
        "raise SystemExit('imported from the folder of the script')\n"
    )
    (modules / "isolated_code.py").write_text(
        "import sys\nfrom pathlib import Path\nimport random\n"
        "from headstock.meshing.process.isolation import accept_limits\naccept_limits(sys.argv[1:])\n"
        f"print(list(Path({str(folder)!r}).glob('*')), file=sys.stderr)\n"
    )
    # the script itself is not to meet the module that it would shadow
    (folder / "script.py").write_text(
        "import sys\nown = sys.path.pop(0)\n"
        "from headstock.meshing.process.isolation import WorkerLimits, run_isolated\nsys.path.insert(0, own)\n"
        "print(run_isolated('isolated_code', [], limits=WorkerLimits(1 << 30, 20, 60.0)).errors.strip())\n"
    )
    paths = [os.environ.get("PYTHONPATH", ""), str(modules)]
    done = run_process(
        [sys.executable, folder / "script.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    )
    assert done.stdout == "[]\n", done.stderr
