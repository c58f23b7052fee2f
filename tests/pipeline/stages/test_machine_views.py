"""What is drawn of a machine of many fine parts: coarser surfaces that move as the fine ones do,
made once.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from headstock.meshing.components import skins
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages import machine
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene

pytestmark = [pytest.mark.process, pytest.mark.fem]

SCENE = """
name = "tower"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.low]
solid = { tube = { outer = "100 mm", inner = "60 mm", length = "200 mm" } }
material = "steel"
mesh = { size = "16 mm" }
[components.low.interfaces]
foot = { face = "z-" }
top = { face = "z+" }
[components.high]
solid = { tube = { outer = "100 mm", inner = "60 mm", length = "200 mm" } }
material = "steel"
mesh = { size = "16 mm" }
at = ["0 mm", "0 mm", "200 mm"]
[components.high.interfaces]
foot = { face = "z-" }
top = { face = "z+" }
[joints.ground]
between = ["ground", "low.foot"]
kind = "rigid"
[joints.middle]
between = ["low.top", "high.foot"]
kind = "rigid"
[points]
tip = { tool = "high.top", work = "ground" }
[analyses]
static = {}
modal = { count = 4 }
"""


def run(folder: Path) -> Results:
    (folder / "scene.toml").write_text(SCENE)
    return run_scene(
        load_scene(folder / "scene.toml"),
        folder / "out",
        comm=MPI.COMM_SELF,
        store=Store(folder / "store"),
    )


def test_fine_parts_are_drawn_coarser_once_and_move_as_the_fine_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(tmp_path)
    count = sum(len(skin.triangles) for skin in whole.view.skins.values())
    assert all(skin.thinned_from is None for skin in whole.view.skins.values())
    monkeypatch.setattr(machine, "MOST_TRIANGLES", count // 2)
    thin = run(tmp_path)
    fine, coarse = (results.view.poses["reference"] for results in (whole, thin))
    for name, skin in thin.view.skins.items():
        before = whole.view.skins[name]
        assert len(skin.triangles) < 0.8 * len(before.triangles)
        assert skin.thinned_from == len(before.triangles)
        assert before.nodes is not None and skin.nodes is not None and skin.weights is not None
        places = np.argsort(np.argsort(before.nodes[:, 0]))
        number = {int(node): int(k) for node, k in zip(before.nodes[:, 0], places, strict=True)}
        around = np.vectorize(number.__getitem__)(skin.nodes)
        for old, new in (
            (fine.shifts[name], coarse.shifts[name]),
            (fine.pushes["tip x"][name][None], coarse.pushes["tip x"][name][None]),
        ):
            wanted = np.einsum("pk,mpkd->mpd", skin.weights, old[:, around])
            np.testing.assert_allclose(new, wanted, rtol=0.0, atol=1e-6 * np.abs(old).max())
    # made once: VTK could not be loaded now
    monkeypatch.setitem(sys.modules, skins.REDUCER, None)
    again = run(tmp_path)
    for name, skin in again.view.skins.items():
        np.testing.assert_array_equal(skin.triangles, thin.view.skins[name].triangles)
        np.testing.assert_array_equal(skin.points, thin.view.skins[name].points)
