"""The distribution: what the release check builds holds what it is to hold, a scene runs from it,
and its program sets what the launcher of a checkout sets.
"""

import functools
import json
import os
import re
import shutil
import sys
import venv
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import pytest
from slurm_stand_ins import write_stand_ins

import release_check
from common import read_json, run_process

ROOT = Path(__file__).resolve().parent.parent
COLUMN = ROOT / "tests" / "data" / "segmented_column.toml"
# what decides about threads, MPI, PETSc and drawing; a rank has more of the kind, of its own
SETTINGS = re.compile(r"(OMP|OPENBLAS|OMPI_MCA|OMPI_ALLOW|PETSC|UCX|VTK)_\w+")
START = "from headstock.app.start import main; main()"


class Built(NamedTuple):
    """The archives of this tree, and the wheel unpacked."""

    files: list[str]
    wheel: Path
    sdist: Path
    rebuilt: Path
    packages: Path


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    if not (ROOT / ".git").exists():
        pytest.skip("only git knows what belongs into archives")
    folder = tmp_path_factory.mktemp("archives")
    files = release_check.tracked_files(ROOT)
    wheel, sdist, rebuilt = release_check.build_archives(ROOT, files, folder)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "installed")
    return Built(files, wheel, sdist, rebuilt, folder / "installed")


def start(command: list[str | Path], folder: Path, variables: Mapping[str, str]) -> str:
    """What a program prints; threads too are the launcher's to choose."""
    inherited = {name: text for name, text in os.environ.items() if not SETTINGS.fullmatch(name)}
    return run_process(command, cwd=folder, env={**inherited, **variables}, check=True).stdout


def call(built: Built, folder: Path, *words: str, **variables: str) -> str:
    """What the program of the unpacked wheel prints."""
    packages = {"PYTHONPATH": str(built.packages)} | variables
    return start([sys.executable, "-P", "-c", START, *words], folder, packages)


def launch(folder: Path, *words: str, **variables: str) -> str:
    """What the launcher of this checkout prints, with this Python."""
    python = {"HEADSTOCK_PYTHON": sys.executable} | variables
    return start([ROOT / "headstock", *words], folder, python)


def programs(built: Built, folder: Path) -> tuple[Callable[..., str], Callable[..., str]]:
    """The program of the wheel, and that of the checkout."""
    return functools.partial(call, built, folder), functools.partial(launch, folder)


def test_this_checkout_passes_and_its_archives_hold_what_belongs_there_and_no_more(
    built: Built,
) -> None:
    rows = [
        *release_check.check_tree(ROOT, built.files),
        release_check.check_wheel(ROOT, built.files, built.wheel),
        release_check.check_sdist(built.files, built.sdist),
        release_check.check_rebuilt(built.wheel, built.rebuilt),
    ]
    assert [row.wrong for row in rows] == [()] * 7
    # and a file more or less is told
    less = [name for name in built.files if name != "app/report/report.css"]
    assert release_check.check_wheel(ROOT, less, built.wheel).wrong == (
        f"{built.wheel.name} holds headstock/app/report/report.css",
    )
    more = [*built.files, "tests/test_new.py"]
    assert release_check.check_sdist(more, built.sdist).wrong == (
        f"{built.sdist.name} lacks tests/test_new.py",
    )


def test_a_scene_runs_from_the_wheel_with_the_numbers_of_the_checkout(
    built: Built, tmp_path: Path
) -> None:
    (tmp_path / "scene.toml").write_text(COLUMN.read_text() + "[analyses.modal]\ncount = 3\n")
    for program, name in zip(programs(built, tmp_path), ("wheel", "checkout"), strict=True):
        program("run", "scene.toml", "--no-figures", "-o", name)
    wheel, checkout = (
        [pose["frequencies_hz"] for pose in read_json(tmp_path / name / "summary.json")["modal"]]
        for name in ("wheel", "checkout")
    )
    assert wheel == checkout
    assert len(wheel[0]) == 3


def test_the_program_of_the_wheel_sets_what_the_launcher_of_a_checkout_sets(
    built: Built, tmp_path: Path
) -> None:
    code = "import json, os; print(json.dumps(dict(os.environ)))"
    # the number of free cores may change from one call to the next
    words = ("python", "-c", code)
    printed = (program(*words, HEADSTOCK_THREADS="2") for program in programs(built, tmp_path))
    settings = [
        {
            name: text
            for name, text in json.loads(line).items()
            if SETTINGS.fullmatch(name) and name != "PETSC_DIR"
        }
        for line in printed
    ]
    assert settings[0] == settings[1]
    assert {"OMP_NUM_THREADS", "OMPI_MCA_btl", "OMPI_MCA_pml", "PETSC_OPTIONS"} <= set(settings[0])


def test_ranks_of_the_program_of_the_wheel_are_started_as_those_of_a_checkout(
    built: Built, tmp_path: Path
) -> None:
    line, dry = ("run", "x.toml", "--ranks", "2"), {"HEADSTOCK_DRY_RUN": "1"}
    words = [program(*line, **dry).splitlines() for program in programs(built, tmp_path)]
    assert words[0][2:] == words[1][2:]
    assert any("mpirun" in word for word in words[0])

    (tmp_path / "srun").touch(mode=0o755)
    nodes = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_JOB_NUM_NODES": "2"}
    started = call(built, tmp_path, *line, **nodes, **dry).splitlines()
    launcher = Path(started[started.index("run") - 1])
    assert launcher == built.packages / "headstock/environment/installed.sh"
    assert words[0][1] == str(built.packages / "headstock/environment/start_ranks.sh")


def test_a_job_of_the_installed_package_is_started_by_the_python_it_is_installed_in(
    built: Built, tmp_path: Path
) -> None:
    # as pip leaves it: found by one Python without PYTHONPATH, which no job takes along
    own = tmp_path / "own"
    venv.create(own, system_site_packages=True)
    python = own / "bin" / "python"
    (site,) = own.glob("lib/python*/site-packages")
    (site / "installed.pth").write_text(f"{built.packages}\n")
    write_stand_ins(tmp_path / "bin")
    variables = os.environ | {
        "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": "",
        "HEADSTOCK_STORE": str(tmp_path / "store"),
    }
    scene = ROOT / "tests" / "data" / "slide.toml"
    for words, bad in (
        (["sweep", str(scene), "line", "-o", "swept", "--on", "slurm", "--no-wait"], "later"),
        (["run", str(scene), "--no-figures", "-o", "run", "--on", "slurm"], ""),
    ):
        (tmp_path / "bin" / "bad").write_text(bad)
        done = run_process(
            [python, "-P", "-m", "headstock.app.start", *words], cwd=tmp_path, env=variables
        )
        assert done.returncode == 0, done.stdout + done.stderr
    scripts = [
        tmp_path / "swept" / "sweep.sbatch",
        *tmp_path.glob("results/slurm/run-*/job.sbatch"),
    ]
    assert len(scripts) == 2
    for script in scripts:
        assert f"{python} -P -m headstock.app.start " in script.read_text()
        assert str(ROOT / "headstock") + " " not in script.read_text()
    assert (tmp_path / "run" / "summary.json").exists()


def test_an_unpacked_source_archive_runs(built: Built, tmp_path: Path) -> None:
    shutil.unpack_archive(built.sdist, tmp_path, filter="data")
    (tree,) = tmp_path.iterdir()
    done = run_process(
        [tree / "headstock", "--version"],
        env=os.environ | {"HEADSTOCK_PYTHON": sys.executable, "PYTHONPATH": ""},
        check=True,
    )
    assert done.stdout.startswith("headstock 0.")
    linked = {path.name for path in (tree / ".typing" / "headstock").iterdir()}
    assert linked == {path.name for path in (ROOT / ".typing" / "headstock").iterdir()}
