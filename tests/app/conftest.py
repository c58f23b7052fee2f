"""The scene that tests of commands share: a rigid block on springs, solved in no time, with every
kind of table a command asks for.
"""

from pathlib import Path

import pytest

from fixture_machines import machine, write_scene
from headstock.app.command_line import main

BLOCK = machine("""
machine = "block"
name = "A block on springs"
axes.X = { joints = ["mount"], direction = "x", limits = ["-50 mm", "50 mm"] }
variants.heavy = { "materials.steel.rho" = "8000 kg/m^3" }
sweeps.line = { axes = { X = ["0 mm", "10 mm", 2] } }
[studies.E]
vary = { "materials.steel.rho" = ["7000 kg/m^3", "8000 kg/m^3"] }
watch = ["modal.frequencies_hz[0:3]"]
""")

TARGETS = """
[cases.measured]
frequencies = ["170 Hz", "179 Hz"]
[parameters.mount]
keys = ["joints.mount.stiffness.x"]
bounds = ["5 N/um", "20 N/um"]
"""


@pytest.fixture
def scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The block as ``block.toml``, ``targets.toml`` beside it for an identification, and a store of
    its own.
    """
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path = write_scene(tmp_path, BLOCK, name="block")
    path.with_name("targets.toml").write_text(TARGETS)
    return path


@pytest.fixture(scope="session")
def block_results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of the block, to be copied."""
    folder = tmp_path_factory.mktemp("block")
    (folder / "block.toml").write_text(BLOCK)
    assert main(["run", str(folder / "block.toml"), "--no-figures", "-o", str(folder / "out")]) == 0
    return folder / "out"
