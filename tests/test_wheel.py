"""The distribution: every room is in the wheel, and a scene runs from it."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PARTS = (
    "pyproject.toml",
    "setup.py",
    "MANIFEST.in",
    "README.md",
    "LICENSE",
    "CHANGELOG.md",
    "CITATION.cff",
)
ASSETS = {".py", ".pyi", ".toml", ".yaml", ".html", ".css", ".js"}
# `api` is the package itself
LAYERS = [
    "api",
    *(
        link.name
        for link in (ROOT / ".typing" / "headstock").iterdir()
        if (ROOT / link.name).is_dir()
    ),
]
COLUMN = ROOT / "tests" / "data" / "segmented_column.toml"


def build_wheel(folder: Path) -> Path:
    """The wheel of this tree, built from a copy: setuptools leaves folders beside what it
    builds.
    """
    for layer in LAYERS:
        shutil.copytree(
            ROOT / layer, folder / "tree" / layer, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in PARTS:
        shutil.copy(ROOT / name, folder / "tree" / name)
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--no-build-isolation",
        "--no-deps",
        "--no-index",
        "-q",
        "-w",
        str(folder),
        ".",
    ]
    subprocess.run(command, cwd=folder / "tree", check=True, capture_output=True, text=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def run(folder: Path, packages: Path, name: str) -> list[float]:
    """Frequencies that the program in a folder of packages finds."""
    command = [
        sys.executable,
        "-P",
        "-m",
        "headstock.app.command_line",
        "run",
        "scene.toml",
        "-o",
        name,
    ]
    subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(packages)},
        check=True,
        capture_output=True,
        text=True,
    )
    summary = json.loads((folder / name / "summary.json").read_text())
    (pose,) = summary["modal"]
    found: list[float] = pose["frequencies_hz"]
    return found


def test_a_scene_runs_from_the_wheel_which_holds_every_module_and_asset(tmp_path: Path) -> None:
    wheel, installed = build_wheel(tmp_path), tmp_path / "installed"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(installed)
    # the rest of app/report/viewer is what its script was packed from
    files = {
        path.relative_to(ROOT if layer != "api" else ROOT / layer)
        for layer in LAYERS
        for path in (ROOT / layer).rglob("*")
        if path.suffix in ASSETS or path.name == "py.typed"
    }
    assert {path for path in files if not (installed / "headstock" / path).is_file()} == set()

    (tmp_path / "scene.toml").write_text(COLUMN.read_text() + "[analyses.modal]\ncount = 3\n")
    frequencies = [
        run(tmp_path, path, name)
        for path, name in ((installed, "wheel"), (ROOT / ".typing", "checkout"))
    ]
    assert frequencies[0] == frequencies[1]
    assert len(frequencies[0]) == 3
