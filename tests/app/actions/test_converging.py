"""The command ``converge``: what it says of a part or a machine, and how it ends."""

from pathlib import Path
from typing import Any

import pytest

from common import Shell
from fixture_machines import machine, stored_scene
from headstock.studies.parameters.records import POINTS_FILE

SUPPORT = Path(__file__).resolve().parents[2] / "data" / "support.step"
SCENE = machine("""
machine = "bar"
names = { bar = "part" }
name = "cantilever"
components.part.mesh = { size = "20 mm" }
analyses.static = { at = "tcp" }
analyses.modal = { count = 5 }
""")

ARM = stored_scene("converging_arm")


CONVERGE = "converge scene.toml -o out"


@pytest.fixture
def part(shell: Shell) -> Shell:
    shell.write(SCENE)
    return shell


def converge(part: Shell, line: str) -> Any:
    part(line)
    return part.json("out/convergence.json")


def frequencies(part: Shell, *settings: str) -> list[float]:
    """Of a run with a mesh of its own [Hz]."""
    part("run scene.toml -o run", *(f"--set=components.{setting}" for setting in settings))
    return [float(hz) for hz in part.json("run/summary.json")["modal"][0]["frequencies_hz"]]


def require_limits(found: Any, finest: list[float]) -> None:
    """The limits cover what a fine mesh finds, which is itself too stiff by a little."""
    numbers = {number["name"]: number for number in found["numbers"]}
    assert finest
    for place, hz in enumerate(finest, 1):
        number = numbers[f"f{place}"]
        assert number["limit_error"] is not None
        assert abs(number["limit"] - hz) <= number["limit_error"] + 1e-3 * hz


@pytest.mark.trials
@pytest.mark.slow
def test_limits_cover_a_fine_mesh_of_another_kind_and_the_needed_mesh_is_as_good_as_asked(
    part: Shell,
) -> None:
    printed = part.prints(CONVERGE)
    found = part.json("out/convergence.json")
    assert found["text"] in printed
    assert "every number is known well enough" in printed
    # hexes of a fifth of the width: a square section, whose bending modes come in pairs
    finest = frequencies(part, "part.mesh.size=6.67 mm", "part.mesh.cells=hex")
    require_limits(found, finest)
    need = found["needs"][0]
    assert need["accuracy"] == 0.01
    tried = frequencies(part, f"part.mesh.size={need['sizes']['part']}")
    assert max(abs(a / b - 1.0) for a, b in zip(tried, finest, strict=True)) <= 0.013


@pytest.mark.trials
def test_meshes_of_several_parts_shrink_together_and_limits_cover_a_finer_mesh(part: Shell) -> None:
    part.change(("part.tip", "arm.tip"), ("[joints.clamp]", ARM))
    found = converge(part, f"{CONVERGE} --most-dofs 8000")
    sizes = [mesh["sizes"] for mesh in found["meshes"]]
    assert sizes[0] == {"part": "40 mm", "arm": "30 mm"}
    assert sizes[-1] == {"part": "14.1 mm", "arm": "10.6 mm"}
    assert set(found["needs"][0]["sizes"]) == {"part", "arm"}
    require_limits(found, frequencies(part, "part.mesh.size=10 mm", "arm.mesh.size=7.5 mm"))


def test_a_first_mesh_above_the_most_dofs_is_refused_before_anything_is_computed(
    shell: Shell,
) -> None:
    said = shell.refuses(f"converge {SUPPORT} -o out --most-dofs 5000")
    assert "(part 5.14 mm) would have about 40 000 dofs" in said
    assert "--most-dofs is 5000" in said and "write larger sizes" in said
    assert not (shell.folder / "out" / POINTS_FILE).exists()


@pytest.mark.trials
def test_memory_that_the_next_mesh_has_not_ends_the_series_with_what_was_found(part: Shell) -> None:
    limit = "--set 'limits.memory=200 MB' --set 'components.part.mesh.size=10 mm'"
    found = converge(part, f"{CONVERGE} {limit}")
    assert found["meshes"]
    assert "the next mesh does not fit: BudgetError" in found["end"]
    assert "limits.memory allows 200 MB" in found["end"]
    assert len(found["numbers"]) == 8


def test_a_second_call_computes_nothing_again_and_files_hold_what_is_printed(part: Shell) -> None:
    line = f"{CONVERGE} --most-dofs 3000"
    first = converge(part, line)
    points = part.text(f"out/{POINTS_FILE}")
    printed = part(f"{line} --json a.json").out
    again = part.json("out/convergence.json")
    assert printed.count("finished before") == len(first["meshes"])
    assert part.text(f"out/{POINTS_FILE}") == points
    assert again["numbers"] == first["numbers"]
    assert "--most-dofs is 3000" in again["end"]
    assert part.json("a.json")["text"] == again["text"]
    chosen = converge(part, f"{line} --watch 'compliance(*point=tcp,direction=x)'")["numbers"]
    assert chosen == [number for number in first["numbers"] if number["name"] == "tcp x"] != []
    converge(part, line)
    *meshes, limits = part.rows("out/convergence.csv")
    assert [int(row["dofs"]) for row in meshes] == [mesh["dofs"] for mesh in first["meshes"]]
    assert float(limits["f1 [Hz]"]) == first["numbers"][0]["limit"]
    # a looser limit goes on from there
    more = converge(part, f"{CONVERGE} --most-dofs 6000")
    assert more["meshes"][: len(first["meshes"])] == first["meshes"]
    assert len(more["meshes"]) > len(first["meshes"])


@pytest.mark.trials
def test_a_step_part_is_tried_free_and_without_its_small_features(shell: Shell) -> None:
    printed = shell(f"converge {SUPPORT} -o out --free --most-dofs 60000").out
    found = shell.json("out/convergence.json")
    assert "free = true" in shell.text("out/support.toml")
    assert [number["name"] for number in found["numbers"]] == [f"f{n}" for n in range(1, 7)]
    assert {mesh["sizes"]["part"] for mesh in found["meshes"]} >= {"5.14 mm"}
    assert all(trial["dofs"] < trial["dofs_with"] for trial in found["features"])
    assert ("fillets and holes up to" in printed) == bool(found["features"])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (f"{CONVERGE} --set components.part.fidelity=rigid", "part is rigid; try --set components.part"),
        (f"{CONVERGE} --set 'accuracy=1 %'", "take that line out"),
        (f"{CONVERGE} --free", "go with a STEP file"),
        (f"{CONVERGE} --accuracy 200%", "no share"),
        (f"{CONVERGE} --watch 'frequency(pose=tilted,mode=1)'", "poses: reference"),
        (f"{CONVERGE} --watch frequencys", "did you mean 'frequency'"),
        ("converge none.step -o out", "none.step"),
        ("converge part.step -o out", "part.step"),
        ("converge silent.toml -o out", "[analyses.modal] with count = 6"),
    ],
)  # fmt: skip
def test_what_cannot_be_refined_is_refused_with_a_remedy(
    part: Shell, line: str, words: str
) -> None:
    (part.folder / "part.step").write_text("no part")
    part.write(SCENE[: SCENE.index("[analyses.static]")], name="silent")
    assert words in part.refuses(line)
    assert not (part.folder / "out" / POINTS_FILE).exists()
