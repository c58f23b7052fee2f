"""Studies, sweeps and comparisons name numbers as a run does: by kind and place, or by a pattern."""

import json
from pathlib import Path

import pytest

import headstock as hs
from common import approx, call
from headstock.app.command_line import main

CANTILEVER = Path(__file__).parents[2] / "machines" / "cantilever.toml"
SLIDE = Path(__file__).parents[1] / "data" / "slide.toml"
LENGTH = "components.head.at[2]"
SCENE = """
name = "Head on a foot"
[components.head]
solid = { point_mass = "1000 kg", inertia = ["20 kg m^2", "30 kg m^2", "40 kg m^2"] }
at = ["0 mm", "0 mm", "1000 mm"]
[joints.foot]
between = ["head.center", "ground"]
at = ["0 mm", "0 mm", "0 mm"]
kind = "spring"
stiffness = { x = "100 N/um", y = "50 N/um", z = "200 N/um", rx = "5 kN m/rad", ry = "20 kN m/rad", rz = "30 kN m/rad" }
[points.tcp]
tool = "head.center"
work = "ground"
[analyses.static]
[analyses.modal]
count = 6
[studies.heights]
vary = { "components.head.at[2]" = ["800 mm", "1000 mm"] }
watch = ["frequency(pose=reference,mode=1)", "compliance(*point=tcp,direction=x)", "modal.frequencies_hz[0]"]
[variants.soft]
"joints.foot.stiffness.x" = "40 N/um"
"""
FIRST, SOFT = "frequency(pose=reference,mode=1)", "compliance(pose=reference,point=tcp,direction=x)"


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_a_study_watches_numbers_by_name_and_keeps_all_of_each_point(scene: Path) -> None:
    table = hs.study(scene, "heights")
    assert table.columns == (FIRST, SOFT, "modal.frequencies_hz[0]")
    first, second = table.rows
    assert first.values[FIRST] == first.values["modal.frequencies_hz[0]"]
    assert first.values[FIRST] != second.values[FIRST]
    assert first.values[SOFT] == approx(1e9 * table.numbers[0][SOFT].value)
    assert (table.unit_of(FIRST), table.unit_of(SOFT)) == ("Hz", "µm/kN")
    frame = table.to_pandas()
    assert f"{SOFT} [µm/kN]" in frame.columns
    assert len(table.numbers[1].select("frequency").to_pandas()) == 6


def test_a_finished_study_reads_its_numbers_again(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (done,) = hs.study(scene, vary={LENGTH: [0.8]}, watch=["frequency"], output=out).rows
    (again,) = hs.study(scene, vary={LENGTH: [0.8]}, watch=["compliance"], output=out).rows
    assert len(done.values) == 6 and len(again.values) == 9
    numbers = again.record.numbers
    assert {str(key): each.summarise() for key, each in numbers.items()} == {
        str(key): each.summarise() for key, each in done.record.numbers.items()
    }


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("frequencys", "did you mean 'frequency'"),
        ("frequency(mod=3)", "did you mean 'mode'"),
        ("compliance(point=tpc,direction=x)", "did you mean 'tcp'"),
        ("frequency(pose=refrence,mode=1)", "did you mean 'reference'"),
    ],
)
@pytest.mark.parametrize(("command", "study"), [("check", []), ("study", ["heights"])])
def test_a_name_that_no_number_can_have_is_refused_with_its_line(
    scene: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    words: str,
    command: str,
    study: list[str],
) -> None:
    scene.write_text(SCENE.replace("compliance(*point=tcp,direction=x)", name))
    line = SCENE.splitlines().index("[studies.heights]") + 3
    told = call(capsys, [command, str(scene), *study], 2).err
    assert words in told and "studies.heights.watch[1]" in told
    assert f"scene.toml:{line}" in told


def test_a_pattern_without_a_number_lists_those_there_are(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(SCENE.replace("mode=1)", "mode=9)"))
    out = scene.parent / "out"
    told = call(capsys, ["study", str(scene), "heights", "-o", str(out)], 2).err
    assert "mode=9" in told and FIRST in told
    rows = json.loads((out / "study.json").read_text())["rows"]
    assert rows and all(FIRST in row["missing"][0] for row in rows)
    assert SOFT not in rows[0]["missing"][0]


def test_variants_and_their_numbers_have_one_name(scene: Path) -> None:
    comparison = hs.compare(scene, ["as written", "soft"])
    written, soft = (comparison.numbers[name] for name in ("as written", "soft"))
    assert soft[SOFT].value > written[SOFT].value
    assert soft[FIRST].value == approx(
        float(hs.run(hs.load(scene, variant="soft")).numbers[FIRST].value)
    )


def test_every_pose_of_a_sweep_has_its_numbers_by_name(scene: Path) -> None:
    numbers = hs.sweep(SLIDE, "named").numbers
    assert len(numbers.select("frequency(*mode=1)")) == 3
    alone = hs.run(SLIDE, analyses=["static", "modal"]).numbers
    for swept, name in (
        ("frequency(pose=X -100 mm,mode=1)", "frequency(pose=left,mode=1)"),
        (
            "compliance(pose=X 150 mm,point=tcp,direction=x)",
            "compliance(pose=right,point=tcp,direction=x)",
        ),
    ):
        assert numbers[swept].value == approx(alone[name].value, rel=1e-6)
        assert numbers[swept].unit == alone[name].unit


@pytest.mark.parametrize(
    ("name", "code", "words"),
    [
        ("frequency(pose=tilted,mode=1)", 2, "poses: reference"),
        ("frequencys", 2, "did you mean 'frequency'"),
    ],
)
def test_converge_refuses_a_name_that_no_number_can_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, code: int, words: str
) -> None:
    out = tmp_path / "out"
    assert main(["converge", str(CANTILEVER), "--watch", name, "-o", str(out)]) == code
    assert words in capsys.readouterr().err and not (out / "points.jsonl").exists()
