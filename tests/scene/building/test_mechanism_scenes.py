"""What is wrong with a mechanism in a scene is said before anything is computed."""

from pathlib import Path

import pytest

from headstock.pipeline.planning.planner import plan_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"


@pytest.mark.parametrize(("override", "key", "message"), [
    ('poses.config_1.Z="3 m"', "poses.config_1", "outside 600 to 1600 mm"),
    ('poses.config_1={ X = "-990 mm", Z = "985 mm" }', "poses.config_1", "common axis"),
    ('poses.config_1={ Z = "30 deg" }', "poses.config_1.Z", "measured as length"),
    ('poses.config_1={ Q = "30 mm" }', "poses.config_1.Q", "unknown axis 'Q'"),
    ('mechanism.carries.tip_9="beam_1"', "mechanism.carries.tip_9", "did you mean 'tip_"),
    ('mechanism.carries.platform="plattform"', "mechanism.carries.platform[0]", "did you mean 'platform'?"),
    ('mechanism.carries.joint_1="wrist"', "mechanism.carries.joint_1[0]", "carried by wrist_4"),
    ('mechanism.limits.q9=["1 m", "2 m"]', "mechanism.limits.q9", "unknown coordinate 'q9'"),
    ('mechanism.limits.q1=["1 deg", "2 deg"]', "mechanism.limits.q1", "measured as length"),
    ('mechanism.limits.q1=["2 m", "1 m"]', "mechanism.limits.q1", "below the upper"),
    ('mechanism.dimensions.base=["1 m"]', "mechanism.dimensions.base", "needs at least 3"),
    ('mechanism.springs.joint="0 N/um"', "mechanism.springs.joint", "above zero"),
    ('points.tcp.work="platform.top"', "points.tcp", "relative to ground only"),
    ('analyses.contouring.radial_depth="21 mm"', "analyses.contouring.radial_depth", "at most its diameter"),
    ('analyses.contouring.forces="missing.csv"', "analyses.contouring", "either the material"),
    ('effects.regeneration="yes"', "effects.regeneration", "neither true nor false"),
    ('effects={ gravity_stiffening = true }', "effects.gravity_stiffening", "gravity = true as well"),
    ('effects={ regeneration = true }', "effects.regeneration", "cutting_force = true"),
    ('mechanism.screw_lead="0 mm"', "mechanism.screw_lead", "above zero"),
    ('analyses.contouring.material="steel"', "analyses.contouring.material", "write [cutting.steel]"),
])  # fmt: skip
def test_a_wrong_mechanism_is_refused_by_name(override: str, key: str, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, variant="lumped", overrides=[override])
    assert any(
        problem.key == key and message in problem.message for problem in caught.value.problems
    ), str(caught.value)


@pytest.mark.parametrize(("override", "key", "message"), [
    ('orientation.at=["1 m", "0 m", "0 m"]', "orientation", "its own `at` and `rotate`"),
    ('analyses.map={ sweep = "plane" }', "analyses.map", "lumped mechanism"),
    ('joints.screw_1.screw.floating_end="sleeve_1.hob"', "joints.screw_1.screw.floating_end", "did you mean 'hub'?"),
    ('joints.slide_1.length="2 m"', "joints.slide_1.length", "longer than rail beam_1.side"),
    ('mechanism.limits.q1=["0.6 m", "0.9 m"]', "poses.config_1", "outside 600 to 900 mm"),
    ('components.beam_1.at[2]="-1100 mm"', "poses.config_3", "hangs"),
    ('joints.base_1.normal="x"', "joints.base_1.normal", "parallel"),
])  # fmt: skip
def test_wrong_components_on_a_mechanism_are_refused_by_name(
    override: str, key: str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, variant="components", overrides=[override])
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


@pytest.mark.parametrize(("override", "key", "message"), [
    ('analyses.contouring.steps_per_turn=98', "analyses.contouring.steps_per_turn", "multiple of the 4 teeth; write for example 96"),
    ('analyses.contouring.material=""', "analyses.contouring.material", "there is no ''"),
])  # fmt: skip
def test_regeneration_says_what_it_needs(override: str, key: str, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, variant="lumped", overrides=["effects.regeneration=true", override])
    assert any(
        problem.key == key and message in problem.message for problem in caught.value.problems
    ), str(caught.value)


def test_a_lumped_mechanism_is_placed_and_neither_meshed_nor_coupled() -> None:
    kinds = [stage.kind for stage in plan_scene(load_scene(SCENE, variant="lumped")).stages]
    assert set(kinds) == {"rigid", "place", "static", "modal", "map", "contour", "write"}
    assert kinds.count("place") == 3
