"""Flexible interfaces in scenes: what they build, and every way in which one can be wrong."""

from pathlib import Path

import pytest

from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

SCENE = """\
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.post]
solid = { tube = { outer = "100 mm", inner = "0 mm", length = "300 mm" } }
material = "steel"
[components.post.interfaces]
foot = { face = "z-" }
top = { face = "z+", COUPLING }
[joints.clamp]
between = ["ground", "post.foot"]
kind = "rigid"
[analyses.modal]
count = 3
"""
FLEXIBLE = "coupling = { flexible = 12 }"


def write(folder: Path, coupling: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(SCENE.replace('face = "z+", COUPLING', coupling))
    return path


@pytest.mark.parametrize(
    ("written", "coupling"),
    [("", "rigid"), (', form = "strong"', "rigid"), (', form = "weak"', "average")],
)
def test_the_strong_form_fixes_points_and_the_weak_one_means(
    tmp_path: Path, written: str, coupling: str
) -> None:
    path = write(tmp_path, f'face = "z+", coupling = {{ flexible = 12{written} }}')
    top = load_scene(path).machine.components["post"].interfaces["top"]
    assert (top.coupling, top.flexible) == (coupling, 12)


@pytest.mark.parametrize(
    ("entry", "key", "message"),
    [
        ('face = "z+", coupling = { flexible = 2 }', "coupling", "3"),
        ('face = "z+", coupling = { flexible = 301 }', "coupling", "300"),
        ('face = "z+", coupling = { flexibel = 12 }', "coupling", "flexible"),
        ('face = "z+", coupling = { flexible = 12, form = "soft" }', "coupling", "weak"),
        ('face = "z+", coupling = "soft"', "coupling", "average"),
        (f'face = "outer", {FLEXIBLE}', "coupling", "one flat patch"),
        (
            f'patches = [{{ face = "z+" }}, {{ face = "z-" }}], {FLEXIBLE}',
            "coupling",
            "one interface for each patch",
        ),
        (f'face = "z+", rail = {{ along = "x" }}, {FLEXIBLE}', "", "is a rail"),
    ],
)
def test_a_flexible_interface_that_cannot_be_is_named_with_its_remedy(
    tmp_path: Path, entry: str, key: str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, entry))
    place = ".".join(["components.post.interfaces.top", *filter(None, [key])])
    found = [item for item in caught.value.problems if item.key.startswith(place)]
    assert any(message in item.message for item in found), str(caught.value)
