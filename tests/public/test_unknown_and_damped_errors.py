"""What stands behind ± where nobody knows the error of a mesh, and where meshes change damping."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import headstock as hs
from fixture_machines import machine

SHEET = machine("""
machine = "bar"
names = { bar = "sheet", tcp = "tip" }
materials.steel = { E = "200 GPa", rho = "8000 kg/m^3" }
components.sheet.solid = { box = ["400 mm", "20 mm", "20 mm"] }
components.sheet.mesh = "MESH"
components.sheet.interfaces = { foot = { face = "x-" }, tip = { face = "x+" } }
joints.clamp.between = ["sheet.foot", "ground"]
probes.top = { component = "sheet", at = ["0 mm", "0 mm", "20 mm"] }
effects.damping = { modal = "2 %" }
[analyses]
static = {}
modal = { count = 3 }
frf = { inputs = [["tip", "z"]], up_to = "100 Hz", points = 21 }
[analyses.transient]
duration = "0.05 s"
up_to = "400 Hz"
outputs = [["tip", "z"], "top"]
loads.push = { at = ["tip", "z"], size = "100 N", shape = "step" }
""")
ROD = """
[materials.soft]
E = "10 GPa"
nu = 0.3
rho = "10000 kg/m^3"
[components.rod]
solid = { tube = { outer = "200 mm", length = "800 mm" } }
material = "soft"
mesh = { size = "SIZE" }
rayleigh = { alpha = "ALPHA 1/s", beta = "BETA s" }
interfaces = { foot = { face = "z-" }, top = { face = "z+" } }
[joints.clamp]
between = ["rod.foot", "ground"]
kind = "rigid"
[points]
tip = { tool = "rod.top", work = "ground" }
[effects]
damping = true
[analyses.frf]
inputs = [["tip", "x"]]
from = "0 Hz"
up_to = "150 Hz"
points = 16
adaptive = false
[analyses.transient]
duration = "0.06 s"
up_to = "600 Hz"
outputs = [["tip", "x"]]
[analyses.transient.loads]
push = { at = ["tip", "x"], size = "100 N", shape = "step" }
"""


def run(folder: Path, text: str, name: str = "scene") -> tuple[hs.Results, dict[str, Any]]:
    """What a run found, and its summary."""
    scene = folder / f"{name}.toml"
    scene.write_text(text)
    results = hs.run(scene, output=folder / name)
    return results, json.loads((folder / name / "summary.json").read_text())


def test_a_mesh_that_shows_no_error_leaves_no_number_with_an_error(tmp_path: Path) -> None:
    _, summary = run(tmp_path, SHEET.replace('"MESH"', '{ size = "20 mm", cells = "hex" }'))
    moved = summary["transient"]["reference"]["outputs"]["tip z"]
    assert moved["error"] is None
    assert moved["error_share"]["discretisation"] is None
    assert moved["error_share"]["reduction"] is not None
    seen = summary["transient"]["reference"]["probes"]["top"]
    assert seen["peak_displacement_error_um"] is None
    modes = summary["modal"][0]
    assert all(share["discretisation"] is None for share in modes["error_share"])
    response = summary["frf"]["reference"]
    assert response["error"]["discretisation"] is None
    assert response["error"]["reduction"] is not None
    for found in (summary["transient"]["reference"], modes, response):
        assert any("the mesh of sheet" in words for words in found["error_left_out"])


def test_a_mesh_with_an_error_keeps_it(tmp_path: Path) -> None:
    _, summary = run(tmp_path, SHEET.replace('"MESH"', '{ size = "10 mm" }'))
    moved = summary["transient"]["reference"]["outputs"]["tip z"]
    assert moved["error_share"]["discretisation"] > 0.0
    assert not any("shows no error" in words for words in summary["modal"][0]["error_left_out"])


@pytest.mark.parametrize(("alpha", "beta"), [("0.1", "0.1"), ("50", "0.001"), ("500", "0")])
def test_errors_of_meshes_count_what_they_change_in_rayleigh_damping(
    tmp_path: Path, alpha: str, beta: str
) -> None:
    scene = ROD.replace("ALPHA", alpha).replace("BETA", beta)
    coarse, fine = (
        run(tmp_path, scene.replace("SIZE", size), f"rod{number}")
        for number, size in enumerate(("100 mm", "33 mm"))
    )
    own, true = (each.frf["reference"].curves for each, _ in (coarse, fine))
    errors = np.abs(own.receptance - true.receptance)[:, 0, 0]
    bounds = np.sum([share[:, 0, 0] for share in own.error_share.values()], axis=0)
    assert (bounds > errors).all()
    assert np.median(bounds / errors) < 4.0
    moved, better = (
        each["transient"]["reference"]["outputs"]["tip x"] for _, each in (coarse, fine)
    )
    of_mesh = moved["error_share"]["discretisation"] + moved["error_share"]["curved faces"]
    assert of_mesh > abs(moved["peak"] - better["peak"])
