"""What a command does not need is not loaded: imports are most of the time that short commands take."""

import subprocess
import sys
from pathlib import Path

import pytest

from headstock.app.command_line import main

MACHINES = Path(__file__).parents[2] / "machines"
COARSE = ("components.column.mesh.size=50 mm", "components.column.reduction.modes_to=1 kHz")


def list_loaded(code: str) -> set[str]:
    """Modules that a fresh interpreter has loaded after some code, which prints nothing else there."""
    listing = f"{code}\nimport sys\nprint(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", listing], capture_output=True, text=True, check=True
    )
    return set(done.stderr.split())


def run_code(words: list[str]) -> str:
    return f"from headstock.app.command_line import main\nassert main({words!r}) == 0"


@pytest.mark.parametrize(
    "code",
    [
        "import headstock.app.actions.checking",
        run_code(["check", str(MACHINES / "three_axis.toml")]),
        f"import headstock as hs; hs.load({str(MACHINES / 'three_axis.toml')!r})",
    ],
    ids=["module", "command", "load"],
)
def test_a_check_loads_no_more_than_it_needs(code: str) -> None:
    loaded = list_loaded(code)
    assert "headstock.scene.building.loader" in loaded
    libraries = {"scipy", "pint", "h5py", "matplotlib"}
    ours = {"pipeline.planning.planner", "meshing.components.finishing", "scene.test_data.reading"}
    assert loaded & (libraries | {f"headstock.{module}" for module in ours}) == set()


def test_a_command_line_loads_neither_rich_nor_other_actions() -> None:
    loaded = list_loaded("from headstock.app.command_line import main\nmain(['--help'])")
    assert "typer" in loaded
    assert loaded & {"rich", "numpy", "pydantic"} == set()


@pytest.mark.fem
def test_a_warm_run_loads_no_finite_elements(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    settings = [word for setting in COARSE for word in ("--set", setting)]
    words = ["run", str(MACHINES / "cantilever.toml"), *settings, "--no-figures"]
    words += ["-o", str(tmp_path / "out")]
    assert main(words) == 0
    loaded = list_loaded(run_code(words))
    assert "headstock.pipeline.runner" in loaded
    assert loaded & {"petsc4py", "slepc4py", "dolfinx", "gmsh"} == set()
