"""The range of frequencies between averaging and rigid interfaces, computed only where a scene
names it.
"""

from pathlib import Path

import numpy as np
import pytest

from fixture_machines import stored_scene, write_scene
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

SCENE = stored_scene("spread")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("spread")


def load(folder: Path, *overrides: str) -> Scene:
    path = write_scene(folder, SCENE)
    return load_scene(path, overrides=overrides)


def run(folder: Path, *overrides: str) -> Results:
    return compute(folder, SCENE, *overrides)


def test_the_range_reaches_from_all_averaging_to_all_rigid(folder: Path) -> None:
    results = run(folder, "analyses.modal.spread=true")
    both = {
        kind: run(
            folder,
            *(f"components.arm.interfaces.{name}.coupling={kind}" for name in ("root", "bolt")),
        ).modal[0]
        for kind in ("average", "rigid")
    }
    spans = np.array(results.modal[0].spread_hz)
    np.testing.assert_allclose(spans[:, 0], both["average"].frequencies_hz, rtol=1e-9)
    np.testing.assert_allclose(spans[:, 1], both["rigid"].frequencies_hz, rtol=1e-9)
    assert (spans[:, 1] > 1.005 * spans[:, 0]).any()
    own = results.modal[0].frequencies_hz
    assert ((spans[:, 0] < own) & (own < spans[:, 1])).all()
    np.testing.assert_array_equal(
        np.array(summarise(results)["modal"][0]["interface_spread_hz"]), spans
    )


def test_it_is_planned_and_summarised_only_where_it_is_named(folder: Path) -> None:
    assert not [stage for stage in plan_scene(load(folder)).stages if stage.kind == "spread"]
    (stage,) = [
        stage
        for stage in plan_scene(load(folder, "analyses.modal.spread=true")).stages
        if stage.kind == "spread"
    ]
    assert "arm" in stage.reason
    assert "interface_spread_hz" not in summarise(run(folder))["modal"][0]


def test_a_machine_without_a_choice_says_so(folder: Path) -> None:
    plan = plan_scene(load(folder, "analyses.modal.spread=true", "components.arm.fidelity=rigid"))
    assert not [stage for stage in plan.stages if stage.kind == "spread"]
    assert any("nothing to vary" in warning for warning in plan.warnings)
