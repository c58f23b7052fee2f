"""Parts that are bonded over an area, against the same body in one piece."""

from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from headstock.geometry.frames import FloatArray

PART = """
[components.{name}]
solid = {{ box = ["{length} mm", "60 mm", "40 mm"] }}
material = "steel"
mesh = {{ size = "20 mm", cells = "hex" }}
at = ["{place} mm", "0 mm", "0 mm"]
free = true
reduction = {{ modes = {modes} }}
"""
SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"

[analyses.modal]
count = 12
"""


def find_frequencies(folder: Path, coupling: str | None) -> FloatArray:
    """Six elastic frequencies [Hz] of a bar in two pieces with a coupling, or in one."""
    text = SCENE
    if coupling is None:
        text += PART.format(name="whole", length=160, place=0, modes=12)
    else:
        for name, place, face in (("left", -40, "x+"), ("right", 40, "x-")):
            text += PART.format(name=name, length=80, place=place, modes=30)
            text += f'interfaces.end = {{ face = "{face}", coupling = {coupling} }}\n'
        text += '[joints.bond]\nkind = "rigid"\nbetween = ["left.end", "right.end"]\n'
    (folder / "scene.toml").write_text(text)
    modes = hs.run(folder / "scene.toml").modal[0]
    return modes.frequencies_hz[modes.rigid_count :][:6]


@pytest.mark.scenes
def test_two_bonded_boxes_with_a_flexible_patch_are_one_box(tmp_path: Path) -> None:
    whole = find_frequencies(tmp_path, None)
    flexible = find_frequencies(tmp_path, '{ flexible = 24, form = "weak" }')
    assert np.abs(flexible / whole - 1.0).max() < 0.005
    rigid = find_frequencies(tmp_path, '"rigid"')
    assert (rigid / whole - 1.0).max() > 0.01
