"""``headstock doctor``: is everything there that Headstock needs, and if not, what to do.

Each question is asked in a child process, so that a broken library breaks only its own line.
"""

import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from headstock.app.commands.tool_commands import DoctorOptions
from headstock.geometry.loading import OWN_FOLDER
from headstock.pipeline.storage.provenance import PROJECT

Status = Literal["ok", "missing", "warning"]
TIME_LIMIT_S = 120.0
MEMORY_WANTED_MB = 4000
SPACE_WANTED_MB = 2000
# variables by which an MPI process passes its place to its children; with them mpirun takes itself
# for a rank
RANK_PREFIXES = ("OMPI_COMM_", "OMPI_UNIVERSE_", "PMIX_", "PRTE_", "PMI_")
PACKAGES = "install the packages of environment/packages.txt, or unset HEADSTOCK_PYTHON and let ./headstock build its own environment"


@dataclass(frozen=True)
class Check:
    """One line of the doctor: what was looked at, what was found, whether it will do and what to do
    if not.
    """

    name: str
    found: str
    status: Status
    remedy: str = ""


@dataclass(frozen=True)
class _Question:
    """Code whose last printed line says what is there; ``expected``, or one of several, must begin
    it, ``remedy`` says what to do otherwise. ``modules`` are the packages that it imports because the program does.
    """

    name: str
    code: str
    expected: str | tuple[str, ...] = ""
    remedy: str = PACKAGES
    needed: bool = True
    modules: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Package:
    """A Python package of which a version is all there is to ask.

    Attributes:
        module: Top-level module, which has the name of its distribution.
        without: What there is not where it is missing; empty where that is everything.
    """

    module: str
    without: str = ""


LIBRARIES = (
    _Question(
        "dolfinx",
        "import basix, dolfinx, ffcx, ufl; print(dolfinx.__version__)",
        ("0.9", "0.11"),
        "the code was tried on dolfinx 0.9 and 0.11: " + PACKAGES,
        modules=("basix", "dolfinx", "ffcx", "ufl"),
    ),
    _Question(
        "PETSc",
        "import numpy; from petsc4py import PETSc; v = PETSc.Sys.getVersion(); "
        "print('real' if PETSc.ScalarType is numpy.float64 else PETSc.ScalarType.__name__, 'scalars,', '.'.join(map(str, v)))",
        "real",
        "PETSc must have real double scalars: on Debian python3-petsc4py-real",
        modules=("petsc4py",),
    ),
    _Question(
        "MUMPS",
        "import numpy; from petsc4py import PETSc; m = PETSc.Mat().createAIJ([1, 1]); m.setUp(); m[0, 0] = 2.0; m.assemble(); "
        "pc = PETSc.PC().create(); pc.setOperators(m); pc.setType('cholesky'); pc.setFactorSolverType('mumps'); pc.setUp(); "
        "print('factorises')",
        "factorises",
        "PETSc must be built with MUMPS",
    ),
    _Question(
        "SLEPc",
        "import numpy; from slepc4py import SLEPc; print('.'.join(map(str, SLEPc.Sys.getVersion())))",
        modules=("slepc4py",),
    ),
    _Question(
        "MPI library",
        "from mpi4py import MPI; print(MPI.Get_library_version().splitlines()[0].split(',')[0].strip())",
        modules=("mpi4py",),
    ),
    _Question("gmsh", "import gmsh; print(gmsh.__version__)", modules=("gmsh",)),
    _Question(
        "isolation",
        "from headstock.meshing.process.isolation import isolate; print(isolate([]) or 'readers of CAD, mesh and HDF5 files see nothing else')",
        "readers",
        "readers of CAD, mesh and HDF5 files have limits of time and memory, but could reach other files and the network: "
        "user namespaces (Linux 5.12 or newer) would keep them from both",
        needed=False,
    ),
    _Question(
        "h5py",
        "import h5py; print(h5py.__version__, 'with HDF5', h5py.version.hdf5_version)",
        modules=("h5py",),
    ),
    _Question(
        "netCDF4",
        "import netCDF4; print(netCDF4.__version__)",
        remedy="Exodus meshes only: on Debian python3-netcdf4",
        needed=False,
        modules=("netCDF4",),
    ),
    _Question(
        "BLAS",
        "import numpy.linalg, threadpoolctl; print(*{f\"{i['internal_api']} {i['version']} ({i.get('architecture', '')})\""
        " for i in threadpoolctl.threadpool_info() if i['user_api'] == 'blas'} or ['reference'])",
        "openblas",
        "factorisations are many times slower without OpenBLAS: libopenblas0-pthread",
        needed=False,
    ),
    _Question("pillow", "import PIL; print(PIL.__version__)", modules=("PIL",)),
    _Question(
        "pyvista",
        "import pyvista, vtkmodules; p = pyvista.Plotter(off_screen=True, window_size=(8, 8)); p.screenshot(None, return_img=True); "
        "print(pyvista.__version__, 'with VTK', '.'.join(map(str, pyvista.vtk_version_info)), 'draws by', type(p.render_window).__name__[3:])",
        remedy="pictures, and fine surfaces made coarser for them: ./headstock installs environment/pictures.txt where pip reaches a registry; "
        "drawing needs OpenGL, on Debian libegl1, libegl-mesa0 and libgl1-mesa-dri",
        needed=False,
        modules=("pyvista", "vtkmodules"),
    ),
    _Question(
        "pyuff",
        "import importlib.metadata, pyuff; print(importlib.metadata.version('pyuff'))",
        remedy="universal files (UFF) only: ./headstock installs environment/test_data.txt where pip reaches a registry; elsewhere pip install pyuff",
        needed=False,
        modules=("pyuff",),
    ),
)
# with the modules of the questions, all that the program imports besides the standard library
PYTHON_PACKAGES = (
    _Package("numpy"),
    _Package("scipy"),
    _Package("threadpoolctl"),
    _Package("pydantic"),
    _Package("pydantic_core"),
    _Package("typer"),
    _Package("click"),
    _Package("rich"),
    _Package("matplotlib"),
    _Package("jinja2"),
    _Package("markupsafe"),
    _Package("meshio"),
    _Package("pandas", without="results as pandas tables; ./headstock python has it"),
)


TEST_PACKAGES = ("pytest", "pytest-xdist", "hypothesis", "mypy")


def _check_environment() -> list[Check]:
    """Ask everything; two questions at a time."""
    with ThreadPoolExecutor(2) as pool:
        libraries = list(pool.map(ask, LIBRARIES))
        ranks = pool.submit(_check_ranks)
    packages = [_check_package(package) for package in PYTHON_PACKAGES] + [
        _check_package(_Package(name, without="the tests")) for name in TEST_PACKAGES
    ]
    return [
        *_check_python(),
        *libraries,
        ranks.result(),
        *packages,
        _check_compiler(),
        *_check_machine(),
    ]


def _run_child(command: list[str]) -> tuple[int, str]:
    """Exit code and last line of a child process's output (of its errors when it fails)."""
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(RANK_PREFIXES)
    }
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT_S,
            env=environment,
            cwd=OWN_FOLDER,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1, f"no answer within {TIME_LIMIT_S:.0f} s"
    except OSError as error:
        return 1, str(error)
    lines = (
        (done.stdout if done.returncode == 0 else done.stderr or done.stdout).strip().splitlines()
    )
    return done.returncode, lines[
        -1
    ].strip() if lines else f"exit code {done.returncode}, no output"


def ask(question: _Question) -> Check:
    """Run a question's code in a Python of its own."""
    code, answer = _run_child([sys.executable, "-P", "-c", question.code])
    if code == 0 and answer.startswith(question.expected):
        optional = bool(question.modules) and not question.needed
        return Check(question.name, answer + " (optional)" * optional, "ok")
    return Check(
        question.name, answer, "missing" if question.needed else "warning", question.remedy
    )


def _check_package(package: _Package) -> Check:
    """Version of an installed Python package, and whether it is optional."""
    try:
        version = importlib.metadata.version(package.module)
    except importlib.metadata.PackageNotFoundError:
        if package.without:
            return Check(
                package.module, "not installed (optional)", "warning", f"without: {package.without}"
            )
        return Check(package.module, "not installed", "missing", PACKAGES)
    return Check(package.module, version + " (optional)" * bool(package.without), "ok")


def _check_python() -> list[Check]:
    """The interpreter, where it comes from and which copy of the code it runs."""
    version = ".".join(map(str, sys.version_info[:3]))
    marker = Path("/etc/headstock-root")
    origin = (
        f"private root {marker.read_text().strip()}"
        if marker.is_file()
        else f"this system's {sys.executable}"
    )
    status: Status = "ok" if sys.version_info >= (3, 13) else "missing"
    return [
        Check(
            "python", version, status, "" if status == "ok" else "Python 3.13 or newer is needed"
        ),
        Check("environment", origin, "ok"),
        Check("code", str(PROJECT), "ok"),
    ]


def _check_ranks() -> Check:
    """Whether two ranks start and add up."""
    mpirun = shutil.which("mpirun")
    remedy = "--ranks needs mpirun of the MPI that mpi4py was built with: on Debian openmpi-bin"
    if mpirun is None:
        return Check("MPI, 2 ranks", "no mpirun", "missing", remedy)
    code = "from mpi4py import MPI; s = MPI.COMM_WORLD.allreduce(1); MPI.COMM_WORLD.rank or print(s, 'ranks answer')"
    # other makers let ranks share cores without being told
    shared = ["--oversubscribe"] if "open-mpi" in _run_child([mpirun, "--version"])[1] else []
    exit_code, answer = _run_child(
        [
            mpirun,
            *shared,
            "--bind-to",
            "none",
            "-n",
            "2",
            sys.executable,
            "-P",
            "-c",
            code,
        ]
    )
    good = exit_code == 0 and answer == "2 ranks answer"
    return Check("MPI, 2 ranks", answer, "ok" if good else "missing", "" if good else remedy)


def _check_compiler() -> Check:
    """The C compiler and headers by which the element kernels are made."""
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not header.is_file():
        return Check(
            "C compiler",
            "no compiler" if compiler is None else f"no {header}",
            "missing",
            "on Debian: gcc and python3-dev",
        )
    exit_code, answer = _run_child([compiler, "-dumpfullversion"])
    return Check(
        "C compiler",
        answer,
        "ok" if exit_code == 0 else "missing",
        "" if exit_code == 0 else "on Debian: gcc",
    )


def _check_machine() -> list[Check]:
    """Cores, threads, memory and room in the cache folder."""
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    cache = _cache_folder()
    return [
        Check(
            "cores", f"{len(os.sched_getaffinity(0))} usable, load {os.getloadavg()[0]:.1f}", "ok"
        ),
        Check("BLAS threads", f"{threads} (HEADSTOCK_THREADS changes it)", "ok"),
        _at_least(
            "free memory",
            _free_memory_mb(),
            MEMORY_WANTED_MB,
            "300 000 dofs need about 4 GB: close programs or coarsen",
        ),
        _room(cache),
    ]


def _cache_folder() -> Path:
    """Return the folder of the private root and the store of superelements."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "headstock"


def _free_memory_mb(meminfo: Path = Path("/proc/meminfo")) -> int:
    """Memory [MB] that can be had without swapping."""
    for line in meminfo.read_text().splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) // 1024
    raise ValueError(f"{meminfo} has no line MemAvailable")


def _room(cache: Path) -> Check:
    existing = next(folder for folder in (cache, *cache.parents) if folder.is_dir())
    if not os.access(existing, os.W_OK):
        return Check(
            "cache folder",
            f"{cache} cannot be written",
            "missing",
            "choose another folder with XDG_CACHE_HOME",
        )
    free_mb = shutil.disk_usage(existing).free // 1_000_000
    return _at_least(
        f"cache folder {cache}",
        free_mb,
        SPACE_WANTED_MB,
        "free some space or choose another folder with XDG_CACHE_HOME",
    )


def _at_least(name: str, megabytes: int, wanted: int, remedy: str) -> Check:
    enough = megabytes >= wanted
    return Check(
        name, f"{megabytes} MB free", "ok" if enough else "warning", "" if enough else remedy
    )


def doctor_command(
    options: DoctorOptions, examine: Callable[[], list[Check]] = _check_environment
) -> int:
    """Print each check with its remedy, and write ``{"healthy": bool, "checks": [{name, found, status, remedy}]}``
    where a file is asked for.

    Args:
        examine: What makes the checks.

    Returns:
        0 when nothing needed is missing, else 1.
    """
    checks = examine()
    missing = [check.name for check in checks if check.status == "missing"]
    print(_describe_checks(checks))
    print("all there" if not missing else f"missing: {', '.join(missing)}")
    content = {"healthy": not missing, "checks": [asdict(check) for check in checks]}
    options.write_json(json.dumps(content, indent=2) + "\n")
    return 1 if missing else 0


def _describe_checks(checks: list[Check]) -> str:
    """The checks as aligned lines, each remedy below its line."""
    width = max(len(check.name) for check in checks)
    lines = []
    for check in checks:
        lines.append(f"{check.status:8}{check.name:{width}}  {check.found}")
        if check.remedy:
            lines.append(f"{'':8}{'':{width}}  -> {check.remedy}")
    return "\n".join(lines)
