"""Variants and settings change what they name, and say so when they are wrong."""

from pathlib import Path

import pytest

from cases import cases
from fixture_machines import stored_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

TEXT = stored_scene("overrides")


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "bar.toml"
    path.write_text(TEXT)
    return path


def test_without_a_variant_the_scene_is_as_written(scene_file: Path) -> None:
    scene = load_scene(scene_file)
    assert scene.machine.components["bar"].fidelity == "elastic"
    assert scene.variants == ("stiff", "sprung", "nested", "wrong")
    assert scene.name == "bar"
    assert list(scene.poses) == ["reference"]


def test_a_variant_changes_what_it_names_and_nothing_else(scene_file: Path) -> None:
    scene = load_scene(scene_file, variant="stiff")
    assert scene.machine.components["bar"].fidelity == "rigid"
    assert (
        scene.machine.components["bar"].solid
        == load_scene(scene_file).machine.components["bar"].solid
    )
    sprung = load_scene(scene_file, variant="sprung").machine.joints["clamp"]
    assert sprung.stiffness.diagonal().tolist() == [2e6, 2e6, 1e6, 1.0, 1.0, 0.0]
    assert load_scene(scene_file, variant="nested").machine.components["bar"].mesh.size == 0.005


def test_joined_variants_are_applied_in_order(scene_file: Path) -> None:
    bar = load_scene(scene_file, variant="nested+stiff").machine.components["bar"]
    assert (bar.mesh.size, bar.fidelity) == (0.005, "rigid")
    with scene_file.open("a") as stream:
        stream.write('[variants.fine]\n"components.bar.mesh.size" = "2 mm"\n')
    assert (
        load_scene(scene_file, variant="nested+fine").machine.components["bar"].mesh.size == 0.002
    )
    assert (
        load_scene(scene_file, variant="fine+nested").machine.components["bar"].mesh.size == 0.005
    )


def test_every_unknown_part_of_a_joined_variant_is_named(scene_file: Path) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(scene_file, variant="stif+nested+spring")
    message = str(caught.value)
    assert "unknown variant 'stif'" in message
    assert "unknown variant 'spring'" in message


@cases
def test_a_setting_is_toml_or_else_text(scene_file: Path, setting: str, value: float) -> None:
    assert load_scene(scene_file, overrides=[setting]).machine.components["bar"].mesh.size == value


def test_settings_come_after_the_variant_and_in_order(scene_file: Path) -> None:
    settings = [
        "components.bar.fidelity=rigid",
        "components.bar.fidelity=elastic",
        "components.bar.solid.box.2=400 mm",
    ]
    bar = load_scene(scene_file, variant="stiff", overrides=settings).machine.components["bar"]
    assert bar.fidelity == "elastic"
    assert bar.solid.size == (0.01, 0.02, 0.4)  # type: ignore[union-attr]


@cases
def test_a_wrong_setting_is_named_in_its_problem(
    scene_file: Path, setting: str, fragment: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(scene_file, overrides=[setting])
    (problem,) = caught.value.problems
    assert problem.place.startswith("--set ")
    assert fragment in problem.message


def test_a_wrong_value_of_a_variant_is_reported_at_its_line_with_its_name(scene_file: Path) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(scene_file, variant="wrong")
    (problem,) = caught.value.problems
    assert problem.place == f"{scene_file}:24 (variant wrong)"
    assert problem.source == '"materials.steel.nu" = 0.7'


def test_an_unknown_variant_lists_those_that_exist(scene_file: Path) -> None:
    with pytest.raises(
        SceneError, match=r"did you mean 'stiff'\? variants: nested, sprung, stiff, wrong"
    ):
        load_scene(scene_file, variant="stif")
