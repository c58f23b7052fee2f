"""Nothing that lies in the working folder is read that was not named: settings of libraries there
are code to some of them.

What programs and their children open is noted by a library that is preloaded into them.
"""

import os
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from slurm_stand_ins import write_stand_ins

from common import Done, run_process
from fixture_machines import machine

ROOT = Path(__file__).resolve().parents[2]
SHIM = Path(__file__).with_name("data") / "opened_files.c"
SCENE = machine("""
machine = "bar"
components.bar.mesh = { size = "100 mm" }
components.bar.interfaces = { foot = { face = "z-" }, tip = { face = "z+" } }
analyses.static = { at = "tcp" }
""")
# a module that says that it was imported
TELLTALE = "open({place!r}, 'w')\n"
MODULES = (
    *("sitecustomize", "usercustomize", "random", "json", "tempfile", "pip", "numpy", "h5py"),
    *("gmsh", "meshio", "matplotlib", "mpi4py", "petsc4py", "dolfinx", "PETSc", "SLEPc", "MPI"),
    *("headstock", "_distutils_hack", "jupyterlab", "ipykernel_launcher", "numba", "control"),
    *("jupyter_config", "jupyter_server_config", "jupyter_lab_config", "jupyter_notebook_config"),
    *("ipython_config", "ipython_kernel_config", "mkdocs", "IPython", "traitlets"),
)
SETTINGS = {
    "petscrc": "-log_view :{folder}/overwritten.txt\n-dll_prepend ./evil.so\n",
    ".petscrc": "-log_view :{folder}/overwritten.txt\n-dll_prepend ./evil.so\n",
    "petsc.cfg": "PETSC_ARCH = %(PWD)s\n",
    "slepc.cfg": "PETSC_ARCH = %(PWD)s\n",
    "ucx.conf": "UCX_LOG_FILE={folder}/overwritten.txt\nUCX_LOG_LEVEL=debug\n",
    "matplotlibrc": "backend: module://random\n",
    "dolfinx_jit_options.json": '{{"cffi_libraries": ["evil"]}}',
    "ffcx_options.json": "no JSON",
    ".gmshrc": 'SystemCall "touch {folder}/overwritten.txt";\n',
    ".gmsh-options": 'SystemCall "touch {folder}/overwritten.txt";\n',
    "pyvenv.cfg": "home = {folder}\n",
    "python313._pth": "{folder}\n",
    "setup.cfg": "[build_ext]\ninclude_dirs = {folder}\nlibraries = evil\n",
    "pyproject.toml": "no TOML",
    "pip.conf": "[global]\nindex-url = file://{folder}\n",
    "jupyter_server_config.json": '{{"ServerApp": {{"root_dir": "/"}}}}',
    "mkdocs.yml": "hooks: [random.py]\n",
}
SETTINGS |= dict.fromkeys(
    (
        *("openmpi-mca-params.conf", "prte-mca-params.conf", "pmix-mca-params.conf"),
        *("untitled.geo", "hosts", ".drirc", "fonts.conf", "libgcc_s.so.1", "libmpi.so.40"),
    ),
    "nothing of use\n",
)


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    library = tmp_path_factory.mktemp("shim") / "opened_files.so"
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-o", library, SHIM, "-ldl"], check=True)
    return library


def plant(folder: Path) -> Path:
    """A folder with the scene and with everything that a library may look for."""
    folder.mkdir()
    telltale = TELLTALE.format(place=str(folder / "overwritten.txt"))
    for name in MODULES:
        (folder / f"{name}.py").write_text(telltale)
    for name, content in SETTINGS.items():
        (folder / name).write_text(content.format(folder=folder))
    (folder / "scene.toml").write_text(SCENE)
    return folder


def settings(folder: Path, shim: Path) -> dict[str, str]:
    """Variables of a command whose files are noted."""
    return os.environ | {
        "LD_PRELOAD": str(shim),
        "OPENED_FILES": str(folder.parent / "opened.txt"),
        "HEADSTOCK_PYTHON": sys.executable,
        "HEADSTOCK_STORE": str(folder.parent / "store"),
        "HEADSTOCK_THREADS": "1",
    }


def opened(
    folder: Path,
    command: Sequence[str | Path],
    shim: Path,
    variables: Mapping[str, str] | None = None,
    *,
    code: int = 0,
) -> tuple[set[str], str]:
    """Run a command in a planted folder: what it opened there, and what it printed."""
    own = settings(folder, shim) | {**(variables or {})}
    done = run_process(command, cwd=folder, env=own, timeout=100)
    assert done.returncode == code, done.stderr
    return list_opened(folder), done.stdout + done.stderr


def list_opened(folder: Path) -> set[str]:
    """Return what was opened in a planted folder besides the scene and its results."""
    log = folder.parent / "opened.txt"
    paths = {Path(os.path.normpath(line)) for line in log.read_text().splitlines()}
    assert len(paths) > 50, "nothing was noted"
    assert not (folder / "overwritten.txt").exists()
    inside = {str(path.relative_to(folder)) for path in paths if path.is_relative_to(folder)}
    return {name for name in inside if name.split("/")[0] not in (".", "out", "scene.toml")}


# empty entries of search paths are the working folder, too
EMPTY = {"PYTHONPATH": os.environ.get("PYTHONPATH", "") + ":", "LD_LIBRARY_PATH": ":"}


def launch(line: str, *words: str | Path) -> list[str | Path]:
    return [ROOT / "headstock", *line.split(), *words]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return plant(tmp_path / "work")


@pytest.mark.mpi
def test_a_run_on_two_ranks_opens_its_scene_and_its_results_and_nothing_else(
    folder: Path, shim: Path
) -> None:
    words = launch("run scene.toml -o out --ranks 2 --no-figures")
    found, said = opened(folder, words, shim, EMPTY)
    assert "compliance" in said
    assert found == set()


def test_checking_loads_no_library_that_reads_settings(folder: Path, shim: Path) -> None:
    assert opened(folder, launch("check scene.toml"), shim)[0] == set()
    heavy = "[name for name in ('mpi4py', 'h5py', 'petsc4py', 'dolfinx', 'matplotlib') if name in sys.modules]"
    script = folder.parent / "script.py"
    script.write_text(
        f"import sys\nimport headstock as hs\nhs.check('scene.toml')\nprint({heavy})\n"
    )
    assert opened(folder, launch("python", script), shim) == (set(), "[]\n")


def test_commands_open_what_they_name_and_nothing_else(folder: Path, shim: Path) -> None:
    """The store knows the part from the first; the trace of all is one file."""
    lines = ("run scene.toml -o out", "report out", "export scene.toml bar --mesh out/bar.med")
    found = [opened(folder, launch(line), shim, EMPTY) for line in lines]
    assert [names for names, _ in found] == [set()] * len(lines)
    assert "compliance" in found[0][1]


def test_a_job_of_slurm_opens_its_scene_and_its_results_and_nothing_else(
    folder: Path, shim: Path
) -> None:
    stand_ins = folder.parent / "bin"
    write_stand_ins(stand_ins)
    path = {"PATH": f"{stand_ins}:{os.environ['PATH']}"}
    words = launch("run scene.toml -o out --no-figures --on slurm")
    found, said = opened(folder, words, shim, path)
    assert "compliance" in said
    # the script, the log and what is on record of the job
    assert {name for name in found if not name.startswith("results/slurm/")} == set()


def test_pip_reads_no_settings_of_the_working_folder(folder: Path, shim: Path) -> None:
    """Not from a folder that a relative name of the environment stands for, either."""
    own = {
        "XDG_CACHE_HOME": str(folder.parent / "cache"),
        "PIP_NO_INDEX": "1",
        "PIP_FIND_LINKS": "",
        "PIP_CONFIG_FILE": "pip.conf",
    }
    words = launch("exec --with benchmarks true")
    found, said = opened(folder, words, shim, own, code=1)
    assert "No matching distribution" in said
    assert found == set()


def test_jupyterlab_and_its_kernel_read_nothing_of_the_working_folder(
    folder: Path, tmp_path: Path, shim: Path
) -> None:
    command = launch("notebook --no-browser --allow-root --IdentityProvider.token=t")
    # the packages of tests, in front of its own, would be others than it needs
    own = {"IPYTHONDIR": str(tmp_path / "profiles"), "PYTHONPATH": ""}
    own["JUPYTER_RUNTIME_DIR"] = str(tmp_path / "runtime")
    variables = settings(folder, shim) | own

    def ask(path: str, data: bytes | None = None) -> str:
        request = urllib.request.Request(f"{address}{path}?token=t", data=data)
        with urllib.request.urlopen(request, timeout=30) as reply:
            return str(reply.read().decode())

    with subprocess.Popen(
        command, cwd=folder, env=variables, stderr=subprocess.PIPE, text=True
    ) as server:
        assert server.stderr is not None
        try:
            said = ""
            for line in server.stderr:
                said += line
                if address := "".join(re.findall(r"http://localhost:\d+", line)):
                    break
            else:
                if "pip could not install" in said:
                    pytest.skip("no registry, and the packages of the notebook are not there")
                pytest.fail(said)
            # the page itself, which needs the files beside the package
            assert "JupyterLab Error" not in ask("/lab")
            assert "scene.toml" in ask("/api/contents")
            assert '"id"' in ask("/api/kernels", b"")
            # the last that a kernel opens before somebody speaks to it
            until = time.monotonic() + 60
            while "history.sqlite" not in (tmp_path / "opened.txt").read_text():
                assert time.monotonic() < until, "the kernel does not start"
                time.sleep(0.2)
            ask("/api/shutdown", b"")
            server.wait(60)
        finally:
            server.kill()
    assert list_opened(folder) == set()


def test_a_program_of_the_users_stays_in_its_folder_and_reads_nothing_there(
    folder: Path, shim: Path
) -> None:
    """Also from a second thread's point of view, while the libraries are loaded."""
    script = folder.parent / "script.py"
    script.write_text(
        "import os, sys, threading\nimport headstock as hs\nfolders, ended = set(), threading.Event()\n"
        "def watch():\n    while not ended.wait(1e-4):\n        folders.add(os.getcwd())\n"
        "watcher = threading.Thread(target=watch, daemon=True)\nwatcher.start()\n"
        "hs.run('scene.toml', output='out')\nended.set()\nwatcher.join()\n"
        "print([os.path.basename(one) for one in folders], 'petsc4py.PETSc' in sys.modules)\n"
    )
    found, said = opened(folder, launch("python", script), shim)
    assert found == set()
    assert said.splitlines()[-1] == "['work'] True"


def run_code(folder: Path, code: str, **variables: str) -> Done:
    """A program of the user's in a folder with the scene."""
    (folder / "scene.toml").write_text(SCENE)
    own = os.environ | {"HEADSTOCK_STORE": str(folder / "store")} | variables
    done = run_process([sys.executable, "-P", "-c", code], cwd=folder, env=own, timeout=100)
    assert done.returncode == 0, done.stderr
    return done


def test_a_library_that_the_user_loaded_in_such_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "ucx.conf").write_text("")
    code = "import mpi4py.MPI\nimport headstock as hs\nhs.run('scene.toml')\n"
    said = run_code(tmp_path, code).stderr
    assert "mpi4py.MPI was loaded before Headstock needed it" in said
    assert "ucx.conf" in said


def test_settings_of_the_account_are_read(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / ".petscrc").write_text("-headstock_mine 7\n")
    code = (
        "import headstock as hs\nhs.run('scene.toml')\nfrom petsc4py import PETSc\n"
        "print(PETSc.Options().getInt('headstock_mine'))\n"
    )
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    done = run_code(tmp_path, code, HOME=str(tmp_path / "home"), XDG_CACHE_HOME=cache)
    assert done.stdout == "7\n"
