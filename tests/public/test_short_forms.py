"""What Python and notebooks show of results is short; warnings of one joint are one line."""

from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from fixture_machines import stored_scene, write_scene

ROOT = Path(__file__).resolve().parents[2]
SCENE = stored_scene("short_forms")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("short") / "scene.toml"
    path.write_text(SCENE)
    return path


def test_results_say_in_a_few_lines_what_they_hold(scene: Path) -> None:
    result = hs.run(scene)
    text = repr(result)
    assert len(text) < 600
    assert text == str(result)
    for words in ("Two <masses>", "low, high", "modes['reference']", "compliance at tcp"):
        assert words in text
    page = result._repr_html_()
    assert "Two &lt;masses&gt;" in page
    assert page.count("<tr>") == 1 + len(result.modes["reference"].frequencies_hz)


def test_warnings_of_one_joint_are_one(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, SCENE, ("soft = true", "soft = false"))
    stiff = [text for text in hs.run(scene).warnings if "times as stiff" in text]
    assert len(stiff) == 1
    assert "more of its directions" in stiff[0]


def test_what_is_meant_to_be_soft_makes_no_joint_stiff(scene: Path) -> None:
    assert not [text for text in hs.run(scene).warnings if "times as stiff" in text]


def test_a_study_is_a_frame_of_floats_with_units_in_its_heads(scene: Path) -> None:
    table = hs.study(
        scene,
        vary={"joints.foot.stiffness.x": ["1 N/mm", "2 N/um"], "name": ["a", "b"]},
        watch=["modal.frequencies_hz[0]", "static.tcp.compliance_um_per_kN[0][0]", "seconds"],
    )
    frame = table.to_pandas()
    stiffness, frequency = "joints.foot.stiffness.x [N/m]", "modal.frequencies_hz[0] [Hz]"
    compliance = "static.tcp.compliance_um_per_kN[0][0] [um/kN]"
    assert list(frame) == [stiffness, "name", frequency, compliance, "seconds [s]", "status"]
    numbers = (stiffness, frequency, compliance)
    assert [str(frame[name].dtype) for name in numbers] == ["float64"] * 3
    assert frame[stiffness].tolist() == [1e3, 1e3, 2e6, 2e6]
    assert frame["name"].tolist() == ["a", "b", "a", "b"]
    assert np.isfinite(frame[frequency]).all()
    assert len(repr(table)) < 400
    assert "4" in repr(table)
    assert table._repr_html_().count("<tr>") == 5


def test_a_point_that_failed_is_a_row_without_numbers(scene: Path) -> None:
    table = hs.study(
        hs.load(scene, set={"joints.foot.allow_negative": True}),
        vary={"joints.foot.stiffness.x": ["1 N/mm", "-1 N/mm"]},
        watch=["static.tcp.compliance_um_per_kN[0][0]"],
    )
    frame = table.to_pandas()
    assert str(frame["static.tcp.compliance_um_per_kN[0][0] [um/kN]"].dtype) == "float64"
    assert "failed" in frame["status"].tolist()
    assert frame.loc[frame["status"] == "failed", "error"].str.len().min() > 0


def test_sweeps_and_comparisons_are_short_too() -> None:
    swept = hs.sweep(ROOT / "tests" / "data" / "slide.toml", "line")
    assert len(repr(swept)) < 400
    assert "9 done" in repr(swept)
    assert swept._repr_html_().count("<tr>") == 10
    column = ROOT / "tests" / "data" / "segmented_column.toml"
    found = hs.compare(column, fidelities=["rigid", "segmented"])
    assert len(repr(found)) < 400
    assert "rigid, segmented" in repr(found)
