"""What is drawn of a machine of many fine parts: coarser surfaces that move as the fine ones do,
made once.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from fixture_machines import stored_scene
from headstock.meshing.components import skins
from headstock.pipeline.results.results import Results
from headstock.pipeline.stages import machine as machine_stage
from scene_runs import compute

pytestmark = [pytest.mark.process, pytest.mark.fem]

SCENE = stored_scene("machine_views")


def run(folder: Path) -> Results:
    return compute(folder, SCENE)


def test_fine_parts_are_drawn_coarser_once_and_move_as_the_fine_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(tmp_path)
    count = sum(len(skin.triangles) for skin in whole.view.skins.values())
    assert all(skin.thinned_from is None for skin in whole.view.skins.values())
    monkeypatch.setattr(machine_stage, "MOST_TRIANGLES", count // 2)
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
