"""Lobes over poses: each pose has the limits of a run in it, and a depth that is stable in all of
them.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.app.charts.sweep import draw_sweep
from headstock.app.tables.sweep_quantities import limit_words
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.lobes import MM, RPM, PoseLobes
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.studies.sweeps.files import summarise_sweep, write_sweep
from headstock.studies.sweeps.runs import SweepJob, gather_sweep, run_sweep, select_analyses

DATA = Path(__file__).parents[2] / "data"
LOBES = """
[effects]
damping = { modal = "3 %" }
[analyses.lobes]
speeds = ["3000 rpm", "12000 rpm", 12]
mill = { diameter = "16 mm", teeth = 4 }
material = "al7075-t6"
radial_depth = "16 mm"
"""


@pytest.fixture(autouse=True)
def _own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_every_pose_of_a_sweep_has_the_limits_of_a_run_in_it(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text((DATA / "slide.toml").read_text() + LOBES)
    scene = load_scene(path)
    scene = dataclasses.replace(scene, analyses=scene.analyses.keep(["lobes"]))
    (tmp_path / "sweep").mkdir()
    job = SweepJob(select_analyses(scene), scene.sweeps["named"], tmp_path / "sweep")
    outcome = run_sweep(job, comm=MPI.COMM_SELF)
    results = gather_sweep(job, outcome)
    write_sweep(tmp_path, results)
    run = run_scene(scene, tmp_path / "run", comm=MPI.COMM_SELF)
    found = {answer.pose: answer for answer in find_answers(run.answers, PoseLobes)}
    assert set(found) == {"left", "right"}
    for number, pose in enumerate(("left", "right")):
        for own, (name, limits) in zip(found[pose].directions, results.limits.items(), strict=True):
            np.testing.assert_allclose(limits.depths[number], own.depths, rtol=1e-9)
            assert own.lowest is not None
            assert limits.modes[number] == own.lowest.mode
            assert (limits.everywhere <= own.depths + 1e-12).all(), name
    assert results.limits_confirmed
    assert "stable in every pose" in limit_words(results)[0]
    name, limits = next(iter(results.limits.items()))
    for place, at_end in ((0, True), (1, False), (-1, True)):
        depths = limits.depths.copy()
        depths[:, place] = 1.1 * depths.max()
        deepest = {name: dataclasses.replace(limits, depths=depths)}
        words = limit_words(dataclasses.replace(results, limits=deepest))[0]
        assert ("a deeper cut may be stable beyond" in words) == at_end
    summary = summarise_sweep(results)
    assert {"lobes", "limits", "common_limits"} <= set(draw_sweep(results))
    for name, limits in results.limits.items():
        mapped = summary["lobes"][name]
        at = int(np.argmax(limits.depths.min(axis=0)))
        assert mapped["common_best_rpm"] == approx(RPM * limits.speeds[at])
        depths = MM * limits.depths[:, at]
        found_mm = np.array(mapped["at_common_best_mm"], dtype=float)
        np.testing.assert_allclose(found_mm, depths, rtol=1e-12)
        assert float(depths.min()) == mapped["common_best_mm"]
        for number, best in enumerate(limits.depths.argmax(axis=1)):
            assert np.array(mapped["best_rpm"])[number] == approx(RPM * limits.speeds[best])
