"""Parameters and repeated entries: what they become, what overrides reach, where faults are."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cases import cases
from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.expansion import expand_scene
from headstock.scene.reading.findings import Findings, SceneError
from headstock.scene.reading.keys import read_entries
from headstock.scene.scene import Scene

SHORT = stored_scene("expansion_short")
LONG = stored_scene("expansion_long")
Load = Callable[..., Scene]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    (tmp_path / "short.toml").write_text(SHORT)
    (tmp_path / "long.toml").write_text(LONG)

    def read(name: str = "short", variant: str | None = None, *settings: str) -> Scene:
        return load_scene(tmp_path / f"{name}.toml", variant=variant, overrides=settings)

    return read


def point(joint: Joint) -> FloatArray:
    assert joint.point is not None
    return joint.point


def fault(load: Load, *settings: str) -> str:
    with pytest.raises(SceneError) as caught:
        load("short", None, *settings)
    return str(caught.value)


def stiffness(scene: Scene) -> list[tuple[float, ...]]:
    """Of the blocks, in x, y and z [N/um]."""
    joints = scene.machine.joints
    return [
        tuple(round(1e-6 * float(joint.stiffness[axis, axis]), 9) for axis in range(3))
        for name, joint in joints.items()
        if name.startswith("block")
    ]


def test_a_scene_written_in_short_is_the_one_written_in_full(load: Load) -> None:
    short, full = load(), load("long")
    assert list(short.machine.joints) == list(full.machine.joints)
    assert repr(short.machine.joints) == repr(full.machine.joints)
    assert list(short.machine.components) == list(full.machine.components)
    for name, component in short.machine.components.items():
        other = full.machine.components[name]
        np.testing.assert_array_equal(component.placement.origin, other.placement.origin)
        assert repr(component.interfaces) == repr(other.interfaces)
        assert repr(component.solid) == repr(other.solid)
        assert (component.fidelity, component.segments) == (other.fidelity, other.segments)


def test_overrides_reach_all_places_by_the_name_written_and_one_by_its_own(load: Load) -> None:
    assert stiffness(load()) == [(54, 54, 108), (54, 7, 108)]
    assert stiffness(load("short", "soft")) == [(10, 54, 108), (10, 7, 20)]
    # what is set later for all wins over what one had of its own
    assert stiffness(load("short", "soft+even")) == [(1, 1, 1), (1, 1, 1)]
    later = load("short", "even", 'joints.block_1.stiffness.y="3 N/um"')
    assert stiffness(later) == [(1, 3, 1), (1, 1, 1)]
    assert stiffness(load("short", "three")) == [(54, 54, 108), (54, 7, 108), (54, 54, 108)]
    moved = load("short", None, 'joints.block_1.at=["1 mm", "2 mm", "3 mm"]').machine.joints
    np.testing.assert_allclose(point(moved["block_1"]), np.array([0.001, 0.002, 0.003]))
    wide = load("short", None, 'components.column.interfaces.pad.rect.size=["9 mm", "9 mm"]')
    for name in ("pad_1", "pad_2"):
        assert "0.009" in repr(wide.machine.components["column"].interfaces[name])


def test_parameters_are_set_by_variants_and_on_the_command_line(load: Load) -> None:
    thick = load("short", "thick").machine
    assert thick.components["column"].solid.size[0] == 0.045  # type: ignore[union-attr]
    assert point(thick.joints["block_1"])[0] == 0.0225
    assert thick.components["slide_near"].placement.origin[0] == 0.0475
    tall = load("short", None, 'parameters.height="600 mm"').machine
    assert tall.components["column"].solid.size[2] == 0.6  # type: ignore[union-attr]
    assert (
        load("short", None, "parameters.kind=rigid").machine.components["column"].fidelity
        == "rigid"
    )


@cases
def test_a_fault_is_told_where_it_is_written(
    load: Load, setting: str, expected: tuple[str, ...]
) -> None:
    said = fault(load, setting)
    assert [text for text in expected if text not in said] == [], said


def test_what_the_manual_shows_becomes_what_it_says() -> None:
    manual = Path(__file__).parents[3] / "docs" / "short_scenes.md"
    wall, pads, carriages = re.findall(r"```toml\n(.*?)```", manual.read_text(), re.DOTALL)[:3]
    findings = Findings("")
    full = expand_scene(tomllib.loads(wall), findings)
    assert read_entries(full, "components")["column"]["solid"] == {
        "box": ["0.038 m", "100 mm", "500 mm"]
    }
    full = expand_scene(tomllib.loads(pads), findings)
    joints = read_entries(full, "joints")
    assert list(joints) == ["x_pad_1", "x_pad_2", "x_pad_3", "x_pad_4"]
    assert joints["x_pad_3"]["between"] == ["slider.bottom", "base.pad_3"]
    full = expand_scene(tomllib.loads(carriages), findings)
    assert read_entries(full, "joints")["y_carriage_4"]["at"] == ["0.064 m", "-0.0465 m", "0.380 m"]
    assert findings.problems == []


def test_carriages_stand_rail_by_rail_from_the_positive_side(tmp_path: Path) -> None:
    text = SHORT.replace(
        'kind = "spring"\nstiffness = { x = "= pad", y = "= pad", z = "= 2 * pad" }',
        'kind = "linear_guide"\naxis = "z"\nnormal = "-x"\nstiffness = { lateral = "= pad", normal = "= pad" }',
    )
    start = text.index('places = [["= wall / 2"')
    end = text.index("[points]")
    text = (
        text[:start]
        + 'carriages = { middle = ["19 mm", "0 mm", "100 mm"], along = "40 mm", across = "= 60 mm", per_rail = 3 }\n'
        + text[end:]
    ).replace("column.pad_{n}", "column.pad_{rail}")
    text = text[: text.index("[variants.soft]")] + "[analyses.modal]\ncount = 6\n"
    (tmp_path / "rails.toml").write_text(text)
    joints = load_scene(tmp_path / "rails.toml").machine.joints
    blocks = {name: joint for name, joint in joints.items() if name.startswith("block")}
    np.testing.assert_allclose(
        np.array([point(joint) for joint in blocks.values()]),
        np.array([[0.019, y, z] for y in (0.03, -0.03) for z in (0.14, 0.10, 0.06)]),
        atol=1e-15,
    )
    assert [joint.ends[1].interface for joint in blocks.values()] == ["pad_1"] * 3 + ["pad_2"] * 3
    assert list(blocks) == [f"block_{number}" for number in range(1, 7)]
