"""Nothing that lies in the working folder is read that was not named: settings of libraries there
are code to some of them.

What programs and their children open is noted by a library that is preloaded into them.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHIM = Path(__file__).with_name("data") / "opened_files.c"
SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.bar]
solid = { box = ["40 mm", "40 mm", "200 mm"] }
material = "steel"
mesh = { size = "100 mm" }
[components.bar.interfaces]
foot = { face = "z-" }
tip = { face = "z+" }
[joints.clamp]
between = ["ground", "bar.foot"]
kind = "rigid"
[points]
tcp = { tool = "bar.tip", work = "ground" }
[analyses.static]
at = "tcp"
"""
# a module that says that it was imported
TELLTALE = "open({place!r}, 'w')\n"
MODULES = (
    *("sitecustomize", "usercustomize", "random", "json", "tempfile", "pip", "numpy", "h5py"),
    *("gmsh", "meshio", "matplotlib", "mpi4py", "petsc4py", "dolfinx", "PETSc", "SLEPc", "MPI"),
    *("headstock", "_distutils_hack", "jupyterlab", "ipykernel_launcher", "numba", "control"),
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


def opened(
    folder: Path, command: Sequence[str | Path], shim: Path, **variables: str
) -> tuple[set[str], str]:
    """Run a command in a planted folder: what it opened there, and what it printed."""
    log = folder.parent / "opened.txt"
    own = {
        "LD_PRELOAD": str(shim),
        "OPENED_FILES": str(log),
        "HEADSTOCK_PYTHON": sys.executable,
        "HEADSTOCK_STORE": str(folder.parent / "store"),
        "HEADSTOCK_THREADS": "1",
    }
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | own | variables,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    paths = {Path(os.path.normpath(line)) for line in log.read_text().splitlines()}
    assert len(paths) > 50, "nothing was noted"
    assert not (folder / "overwritten.txt").exists()
    inside = {str(path.relative_to(folder)) for path in paths if path.is_relative_to(folder)}
    return {
        name for name in inside if name.split("/")[0] not in (".", "out", "scene.toml")
    }, done.stdout + done.stderr


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.mpi)])
def test_a_run_opens_its_scene_and_its_results_and_nothing_else(
    tmp_path: Path, shim: Path, ranks: int
) -> None:
    folder = plant(tmp_path / "work")
    words = ["run", "scene.toml", "-o", "out", "--ranks", str(ranks)]
    if ranks == 2:
        words.append("--no-figures")
    # empty entries of search paths are the working folder, too
    empty = {"PYTHONPATH": os.environ.get("PYTHONPATH", "") + ":", "LD_LIBRARY_PATH": ":"}
    found, said = opened(folder, [ROOT / "headstock", *words], shim, **empty)
    assert "compliance" in said
    assert found == set()


def test_checking_loads_no_library_that_reads_settings(tmp_path: Path, shim: Path) -> None:
    folder = plant(tmp_path / "work")
    assert opened(folder, [ROOT / "headstock", "check", "scene.toml"], shim)[0] == set()
    heavy = "[name for name in ('mpi4py', 'h5py', 'petsc4py', 'dolfinx', 'matplotlib') if name in sys.modules]"
    script = tmp_path / "script.py"
    script.write_text(
        f"import sys\nimport headstock as hs\nhs.check('scene.toml')\nprint({heavy})\n"
    )
    found, said = opened(folder, [ROOT / "headstock", "python", script], shim)
    assert (found, said) == (set(), "[]\n")


def test_a_program_of_the_users_stays_in_its_folder_and_reads_nothing_there(
    tmp_path: Path, shim: Path
) -> None:
    """Also from a second thread's point of view, while the libraries are loaded."""
    folder = plant(tmp_path / "work")
    script = tmp_path / "script.py"
    script.write_text(
        "import os, sys, threading\nimport headstock as hs\nfolders, ended = set(), threading.Event()\n"
        "def watch():\n    while not ended.wait(1e-4):\n        folders.add(os.getcwd())\n"
        "watcher = threading.Thread(target=watch, daemon=True)\nwatcher.start()\n"
        "hs.run('scene.toml', output='out')\nended.set()\nwatcher.join()\n"
        "print([os.path.basename(one) for one in folders], 'petsc4py.PETSc' in sys.modules)\n"
    )
    found, said = opened(folder, [ROOT / "headstock", "python", script], shim)
    assert found == set()
    assert said.splitlines()[-1] == "['work'] True"


def test_a_library_that_the_user_loaded_in_such_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "ucx.conf").write_text("")
    code = "import mpi4py.MPI\nimport headstock as hs\nhs.run('scene.toml')\n"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        env=os.environ | {"HEADSTOCK_STORE": str(tmp_path / "store")},
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    assert "mpi4py.MPI was loaded before Headstock needed it" in done.stderr
    assert "ucx.conf" in done.stderr


def test_settings_of_the_account_are_read(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / ".petscrc").write_text("-headstock_mine 7\n")
    code = (
        "import headstock as hs\nhs.run('scene.toml')\nfrom petsc4py import PETSc\n"
        "print(PETSc.Options().getInt('headstock_mine'))\n"
    )
    own = {
        "HOME": str(tmp_path / "home"),
        "HEADSTOCK_STORE": str(tmp_path / "store"),
        "XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache"),
    }
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        env=os.environ | own,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.stdout == "7\n", done.stderr
