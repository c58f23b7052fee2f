"""The command ``study``: its table, its files, and how it ends."""

from pathlib import Path

import pytest

from common import Shell, approx

COLUMN = Path(__file__).resolve().parents[2] / "data" / "segmented_column.toml"
SCENE = (
    COLUMN.read_text()
    + """
[studies.rows]
vary = { "components.column.segments.count" = [2, 4] }
watch = ["modal.frequencies_hz[0:2]", "seconds"]
repeats = 2
[studies.broken]
vary = { "joints.clamp.kind" = ["rigid", "mount"] }
watch = "status"
[studies.cost]
reference_run = { "components.column.segments.count" = 40 }
vary = { "components.column.segments.count" = [2, 4, 8] }
watch = ["modal.frequencies_hz[0:2]"]
store = "cold"
[studies.sizes]
vary = { "components.column.mesh.size" = ["40 mm", "20 mm", "10 mm"] }
watch = "totals.mass_kg"
[analyses.static]
[analyses.modal]
"""
)
REFINEMENT = """
[studies.refinement]
reference = "kono-cantilever"
[studies.refinement.families.static_segmented]
analyses = "static"
set = { "components.column.fidelity" = "segmented" }
vary = { "components.column.segments.count" = [5, 15] }
[studies.refinement.families.modal_segmented]
analyses = "modal"
set = { "components.column.fidelity" = "segmented" }
vary = { "components.column.segments.count" = [10, 35] }
"""


SET = "components.column.segments.count"


@pytest.fixture
def column(shell: Shell) -> Shell:
    shell.write(SCENE)
    return shell


def test_a_study_prints_its_table_and_writes_it_as_csv_json_and_png(column: Shell) -> None:
    mass = "--set 'components.column.mass=20 kg'"
    printed = column.prints(f"study scene.toml rows -o out --json rows.json {mass}")
    for text in ("2 of 2 points done", "median of 2 runs", "BLAS threads"):
        assert text in printed
    rows, listed = column.rows("out/study.csv"), column.json("rows.json")["rows"]
    watched = "modal.frequencies_hz[1]"
    assert [float(row[watched]) for row in rows] == [row["values"][watched] for row in listed]
    assert [row[SET] for row in rows] == ["2", "4"]
    assert [len(row["seconds"]) for row in listed] == [2, 2]
    assert (column.folder / "out" / "study.png").read_bytes().startswith(b"\x89PNG")


def test_a_mesh_size_that_is_varied_gives_orders_of_convergence(column: Shell) -> None:
    assert "Order of convergence" in column("study scene.toml sizes -o out").out
    (series,) = column.json("out/study.json")["orders"]
    # segments have no mesh: a value that ignores the size is said to
    assert series["order"] is None
    assert "does not depend" in series["remark"]
    assert series["sizes_m"] == approx([0.04, 0.02, 0.01])
    sizes = [row["components.column.mesh.size [m]"] for row in column.rows("out/study.csv")]
    assert [float(size) for size in sizes] == [0.04, 0.02, 0.01]


@pytest.mark.parametrize(("name", "said"), [("broken", "mount"), ("row", "did you mean 'rows'?")])
def test_a_bad_value_or_an_unknown_study_is_refused_before_anything_is_computed(
    column: Shell, name: str, said: str
) -> None:
    assert said in column(f"study scene.toml {name} -o out", code=2).err
    assert not (column.folder / "out" / "points.jsonl").exists()


def test_a_refinement_study_draws_the_paper_s_figures_and_lists_its_claims(shell: Shell) -> None:
    shipped = (Path(__file__).resolve().parents[3] / "machines" / "cantilever.toml").read_text()
    shell.write(shipped[: shipped.index("# the paper's section")] + REFINEMENT)
    printed = shell.prints("study scene.toml refinement -o out --json refinement.json")
    assert "every deviation < 10 % from nDOF 30 dy(Fy) +3.06 %" in printed
    # of the finite elements there are only the paper's own, which have no time
    figures = {f"figure_{name}.png" for name in ("06_ndof", "06_time", "07_ndof", "08_ndof")}
    figures |= {"figure_08_time.png", "figure_09_ndof.png", "overview.png"}
    assert {name for name in shell.files("out") if name.endswith(".png")} == figures
    wanted = ("segmented", "30", "dx(Fx)")
    rows = shell.rows("out/refinement.csv")
    (row,) = [row for row in rows if (row["model"], row["nDOF"], row["quantity"]) == wanted]
    assert float(row["deviation"]) == approx(435.8276 / 433.91 - 1.0, abs=1e-4)
    claims = shell.json("refinement.json")["claims"]
    assert {claim["figure"] for claim in claims} == {6, 7, 8, 9}
    verdicts = [row["verdict"] == "confirmed" for row in shell.rows("out/claims.csv")]
    assert verdicts[: len(claims)] == [claim["confirmed"] for claim in claims]


def test_a_study_with_a_truth_shows_what_accuracy_costs(column: Shell) -> None:
    printed = column("study scene.toml cost -o out").out
    assert "What accuracy costs" in printed and "of processor time" in printed
    errors = [float(row["error"]) for row in column.rows("out/cost.csv")]
    assert errors == sorted(errors, reverse=True) and errors[-1] > 0.0
    cheapest = column.json("out/study.json")["costs"][0]
    assert cheapest["settings"] == "column.segments.count = 2"
    assert (column.folder / "out" / "cost.png").stat().st_size > 10_000
