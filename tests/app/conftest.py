"""The scene that tests of commands share: a rigid block on springs, solved in no time, with every
kind of table a command asks for.
"""

from pathlib import Path

import pytest

from common import Shell, run_once
from fixture_machines import machine, targets

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

TARGETS = targets(170, 179, mount="joints.mount.stiffness.x: 5 N/um, 20 N/um")


@pytest.fixture
def block(shell: Shell) -> Shell:
    """The block as ``scene.toml``, and ``targets.toml`` for an identification."""
    shell.write(BLOCK)
    shell.write(TARGETS, name="targets")
    return shell


@pytest.fixture(scope="session")
def block_results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of the block, to be copied."""
    return run_once(tmp_path_factory.mktemp("block"), BLOCK)
