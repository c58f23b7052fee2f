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


PLATES = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"

[components.plate]
solid = {{ box = ["300 mm", "100 mm", "20 mm"] }}
material = "steel"
mesh = {{ size = "20 mm", cells = "hex" }}
free = true
interfaces.top = {{ face = "z+", rect = {{ size = ["{length} mm", "60 mm"] }}, coupling = {coupling} }}

[components.post]
solid = {{ box = ["{length} mm", "60 mm", "20 mm"] }}
material = "steel"
mesh = {{ size = "20 mm", cells = "hex" }}
at = ["0 mm", "0 mm", "20 mm"]
interfaces.foot = {{ face = "z-", coupling = {coupling} }}

[joints.bond]
kind = "rigid"
between = ["plate.top", "post.foot"]

[analyses.modal]
count = 12
"""


@pytest.mark.parametrize(
    ("length", "coupling", "doubted"),
    [(200, '"rigid"', True), (40, '"rigid"', False), (200, "{ flexible = 12 }", False)],
)
def test_rigid_areas_are_doubted_where_they_are_large(
    tmp_path: Path, length: int, coupling: str, doubted: bool
) -> None:
    (tmp_path / "scene.toml").write_text(PLATES.format(length=length, coupling=coupling))
    warnings = [text for text in hs.check(tmp_path / "scene.toml") if "rigid interfaces" in text]
    # of a bar half as thick over a third of its length: 200 / 8 of 200 / 8 + 100
    expected = "component plate: rigid interfaces at bond take about 20% of its compliance"
    assert [text.startswith(expected) for text in warnings] == [True] * doubted


def test_a_plan_says_what_deformation_shapes_cost(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(PLATES.format(length=200, coupling="{ flexible = 90 }"))
    (reason,) = (
        stage.reason
        for stage in hs.plan(tmp_path / "scene.toml").stages
        if (stage.kind, stage.component) == ("reduce", "plate")
    )
    assert "90 deformation shapes of top take " in reason and "times the time of aver" in reason
