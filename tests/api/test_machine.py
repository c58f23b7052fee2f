"""Machines built, changed and saved in Python are the machines of scene files."""

import dataclasses
import inspect
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from common import SHIPPED, find_difference
from headstock.scene.reading.findings import Findings
from headstock.scene.scene import Scene

ROOT = Path(__file__).resolve().parents[2]
COLUMN = ROOT / "tests" / "data" / "segmented_column.toml"
MACHINES = SHIPPED


def scene_difference(one: Scene, other: Scene) -> str:
    # warnings and findings name file and line; tables may be written in another order
    first, second = (
        dataclasses.replace(scene, warnings=(), findings=Findings(""), written={})
        for scene in (one, other)
    )
    # sections may stand in another order; the scene file and its parts are elsewhere
    return find_difference(first, second, loose=(".raw", ".written"), skip=(Path,))


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_a_shipped_machine_that_is_saved_is_the_same_scene(path: Path, tmp_path: Path) -> None:
    machine = hs.load(path)
    again = hs.load(machine.save(tmp_path / "again.toml"))
    assert scene_difference(machine.scene, again.scene) == ""
    assert machine == again
    assert machine.table == again.table
    # the moves of a fit are as long as it has parameters
    lines = (tmp_path / "again.toml").read_text().partition("[fits.")[0].splitlines()
    assert max(map(len, lines)) < 200


def test_the_comparison_of_this_file_sees_a_change_of_one_number() -> None:
    machine = hs.load(ROOT / "machines" / "cantilever.toml")
    key = "components.column.solid.box[2]"
    changed = machine.change(set={key: 0.5 + 1e-15})
    assert "solid" in scene_difference(machine.scene, changed.scene)
    assert machine != changed


def build_column(analyses: Mapping[str, Mapping[str, object]] | None = None) -> hs.Machine:
    column = hs.Component(
        solid=hs.Box("38 mm", 0.1, np.float64(0.5)),
        material="steel",
        fidelity="segmented",
        interfaces={"foot": hs.Interface(face="z-"), "tip": hs.Interface(face="z+")},
    )
    return hs.Machine(
        analyses=analyses or {},
        materials={"steel": hs.Material(E=2.1e11, nu=0.3, rho="7850 kg/m^3")},
        components={"column": column},
        joints={"clamp": hs.Joint(between=["ground", "column.foot"], kind="rigid")},
        points={"tcp": hs.Point(tool="column.tip", work="ground")},
    )


def test_a_machine_of_nouns_is_the_machine_of_the_file(tmp_path: Path) -> None:
    built = build_column()
    assert built == hs.load(COLUMN)
    text = built.save(tmp_path / "column.toml").read_text()
    assert 'box = ["38 mm", "100 mm", "500 mm"]' in text
    assert 'E = "210 GPa"' in text
    assert built == hs.load(tmp_path / "column.toml")


def test_a_machine_without_a_file_runs() -> None:
    built = build_column(analyses={"modal": {"count": 2}})
    from_file = hs.load(COLUMN, set={"analyses.modal": {"count": 2}})
    first, second = (hs.run(each).modes["reference"] for each in (built, from_file))
    assert np.array_equal(first.frequencies_hz, second.frequencies_hz)
    assert 120.0 < first.frequencies_hz[0] < 135.0


def test_a_noun_reads_in_si_units_and_compares_by_value() -> None:
    tube = hs.Tube(outer="60 mm", inner=0.04, length="1 m")
    assert (tube.outer, tube.inner, tube.length) == (0.06, 0.04, 1.0)
    assert tube == hs.Tube(outer=0.06, inner="40 mm", length="1000 mm")
    assert tube != hs.Tube(outer=0.06, length="1000 mm")
    assert repr(tube) == "Tube(outer='60 mm', inner='40 mm', length='1 m')"
    # numbers that are not round keep the usual unit, and their value to the last bit
    third = hs.Tube(outer=0.1 / 3.0, length=1.0)
    assert repr(third).startswith("Tube(outer='33.3333333333333")
    assert eval(repr(third), {"Tube": hs.Tube}).outer == 0.1 / 3.0
    assert "material" in inspect.signature(hs.Component).parameters
    with pytest.raises(AttributeError, match=r"Tube.*'diameter'"):
        tube.diameter  # noqa: B018


def test_a_rotational_stiffness_takes_its_own_si_unit() -> None:
    values = {"lateral": 4e8, "normal": 5e8, "pitch": 4e5}
    joint = hs.Joint(between=["a.b", "c.d"], kind="linear_guide", axis="x", stiffness=values)
    assert str(joint.table["stiffness"]).count("N/um") == 2
    stiffness = joint.stiffness
    assert isinstance(stiffness, dict)
    found = {name: (item.value, item.dimension.unit) for name, item in stiffness.items()}
    assert found == {"lateral": (4e8, "N/m"), "normal": (5e8, "N/m"), "pitch": (4e5, "N m/rad")}


def test_a_fault_of_a_noun_is_told_when_it_is_made() -> None:
    with pytest.raises(hs.SceneError) as caught:
        hs.Material(E="210 mm", nu=0.3, density="7850 kg/m^3")  # type: ignore[call-arg]
    keys = {problem.key for problem in caught.value.problems}
    assert keys == {"E", "density", "rho"}
    with pytest.raises(hs.SceneError, match=r"tube\.inner"):
        hs.Tube(outer="60 mm", inner="40 kg", length="1 m")


def test_a_fault_between_nouns_is_told_when_the_machine_is_made() -> None:
    with pytest.raises(hs.SceneError, match=r"did you mean 'tcp'") as caught:
        build_column(analyses={"static": {"at": "tpc"}})
    assert caught.value.problems[0].key.startswith("analyses.static.at")


def test_files_go_with_a_machine_that_is_saved_and_no_other_file_is_written_over(
    tmp_path: Path,
) -> None:
    machine = hs.load(ROOT / "machines" / "step_column.toml")
    machine.save(tmp_path / "one.toml")
    part = ROOT / "machines" / "step_column.step"
    assert (tmp_path / part.name).read_bytes() == part.read_bytes()
    (tmp_path / part.name).write_text("another")
    with pytest.raises(hs.SceneError, match="another file"):
        machine.save(tmp_path / "two.toml")
    assert not (tmp_path / "two.toml").exists()
    with pytest.raises(hs.SceneError, match=r"ends in \.toml"):
        machine.save(tmp_path / "three.txt")


def test_a_variant_is_applied_before_settings() -> None:
    path = ROOT / "machines" / "three_axis.toml"
    setting = {"components.y_base.fidelity": "segmented"}
    both = hs.load(path, variant="R", set=setting)
    assert both == hs.load(path).change(variant="R", set=setting)
    assert both.scene.variant == "R"
