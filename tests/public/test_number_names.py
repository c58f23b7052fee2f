"""Studies, sweeps and comparisons name numbers as a run does: by kind and place, or by a pattern."""

from pathlib import Path

import pytest

import headstock as hs
from common import Shell, approx
from fixture_machines import machine

SLIDE = Path(__file__).parents[1] / "data" / "slide.toml"
LENGTH = "components.head.at[2]"
SCENE_FILE = "scene.toml"
SCENE = machine("""
machine = "head"
variants.soft = { "joints.foot.stiffness.x" = "40 N/um" }
[studies.heights]
vary = { "components.head.at[2]" = ["800 mm", "1000 mm"] }
watch = ["frequency(pose=reference,mode=1)", "compliance(*point=tcp,direction=x)", "modal.frequencies_hz[0]"]
""")
FIRST, SOFT = "frequency(pose=reference,mode=1)", "compliance(pose=reference,point=tcp,direction=x)"


@pytest.fixture
def head(shell: Shell) -> Shell:
    shell.write(SCENE)
    return shell


def test_a_study_watches_numbers_by_name_and_keeps_all_of_each_point(head: Shell) -> None:
    table = hs.study(SCENE_FILE, "heights")
    assert table.columns == (FIRST, SOFT, "modal.frequencies_hz[0]")
    first, second = table.rows
    assert first.values[FIRST] == first.values["modal.frequencies_hz[0]"]
    assert first.values[FIRST] != second.values[FIRST]
    assert first.values[SOFT] == approx(1e9 * table.numbers[0][SOFT].value)
    assert (table.unit_of(FIRST), table.unit_of(SOFT)) == ("Hz", "µm/kN")
    frame = table.to_pandas()
    assert f"{SOFT} [µm/kN]" in frame.columns
    assert len(table.numbers[1].select("frequency").to_pandas()) == 6


def test_a_finished_study_reads_its_numbers_again(head: Shell) -> None:
    out = head.folder / "out"
    (done,) = hs.study(SCENE_FILE, vary={LENGTH: [0.8]}, watch=["frequency"], output=out).rows
    (again,) = hs.study(SCENE_FILE, vary={LENGTH: [0.8]}, watch=["compliance"], output=out).rows
    assert len(done.values) == 6 and len(again.values) == 9
    first, second = (
        {str(key): each.summarise() for key, each in numbers.items()}
        for numbers in (done.record.numbers, again.record.numbers)
    )
    assert first == second


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("frequencys", "did you mean 'frequency'"),
        ("frequency(mod=3)", "did you mean 'mode'"),
        ("compliance(point=tpc,direction=x)", "did you mean 'tcp'"),
        ("frequency(pose=refrence,mode=1)", "did you mean 'reference'"),
    ],
)
@pytest.mark.parametrize("line", ["check scene.toml", "study scene.toml heights"])
def test_a_name_that_no_number_can_have_is_refused_with_its_line(
    head: Shell, name: str, words: str, line: str
) -> None:
    head.change(("compliance(*point=tcp,direction=x)", name))
    number = SCENE.splitlines().index("[studies.heights]") + 3
    told = head(line, code=2).err
    assert words in told and "studies.heights.watch[1]" in told
    assert f"scene.toml:{number}" in told


def test_a_pattern_without_a_number_lists_those_there_are(head: Shell) -> None:
    head.change(("mode=1)", "mode=9)"))
    told = head("study scene.toml heights -o out", code=2).err
    assert "mode=9" in told and FIRST in told
    rows = head.json("out/study.json")["rows"]
    assert rows and all(FIRST in row["missing"][0] for row in rows)
    assert SOFT not in rows[0]["missing"][0]


def test_variants_and_their_numbers_have_one_name(head: Shell) -> None:
    comparison = hs.compare(SCENE_FILE, ["as written", "soft"])
    written, soft = (comparison.numbers[name] for name in ("as written", "soft"))
    assert soft[SOFT].value > written[SOFT].value
    alone = hs.run(hs.load(SCENE_FILE, variant="soft")).numbers[FIRST].value
    assert soft[FIRST].value == approx(float(alone))


def test_every_pose_of_a_sweep_has_its_numbers_by_name(head: Shell) -> None:
    numbers = hs.sweep(SLIDE, "named").numbers
    assert len(numbers.select("frequency(*mode=1)")) == 3
    alone = hs.run(SLIDE, analyses=["static", "modal"]).numbers
    for kind, swept, pose, place in (
        ("frequency", "X -100 mm", "left", "mode=1"),
        ("compliance", "X 150 mm", "right", "point=tcp,direction=x"),
    ):
        swept, name = (f"{kind}(pose={each},{place})" for each in (swept, pose))
        assert numbers[swept].value == approx(alone[name].value, rel=1e-6)
        assert numbers[swept].unit == alone[name].unit
