"""What is wrong with a mechanism in a scene is said before anything is computed."""

from pathlib import Path

import pytest

from cases import cases
from headstock.pipeline.planning.planner import plan_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"


@cases
def test_a_wrong_mechanism_is_refused_by_name(
    variant: str, settings: tuple[str, ...], key: str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, variant=variant, overrides=settings)
    assert any(
        problem.key == key and message in problem.message for problem in caught.value.problems
    ), str(caught.value)


def test_components_on_a_mechanism_are_coupled_in_its_poses() -> None:
    stages = plan_scene(load_scene(SCENE, variant="components")).stages
    assert [stage.pose for stage in stages if stage.kind == "couple"] == [
        "config_1",
        "config_2",
        "config_3",
    ]
    assert {"place", "map", "contour"}.isdisjoint(stage.kind for stage in stages)


def test_a_lumped_mechanism_is_placed_and_neither_meshed_nor_coupled() -> None:
    kinds = [stage.kind for stage in plan_scene(load_scene(SCENE, variant="lumped")).stages]
    assert set(kinds) == {"rigid", "place", "static", "modal", "map", "contour", "write"}
    assert kinds.count("place") == 3
