"""Variants of a small machine side by side: the same modes in one row, what a variant lacks is
missing, costs are counted.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, present
from fixture_machines import stored_scene, write_scene
from headstock.geometry.parts.components import Fidelity
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.store import Store
from headstock.scene.reading.findings import SceneError
from headstock.studies.comparison import Comparison, compare_variants
from headstock.studies.comparison_summary import summarise_comparison
from headstock.studies.variants import STEPS, VariantSolution, choose_variants, solve_variant

pytestmark = [pytest.mark.fem, pytest.mark.process]

SCENE = stored_scene("comparison")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_scene(tmp_path, SCENE)


def solve(scene: Path, name: str) -> VariantSolution:
    (choice,) = choose_variants(scene, (name,), baseline=False)
    store = Store(scene.parent / "store")
    return present(solve_variant(scene, choice, pose=None, comm=MPI.COMM_SELF, store=store))


def compare(scene: Path, *names: str) -> Comparison:
    return compare_variants([solve(scene, name) for name in names], scene="column")


def test_modes_of_two_fidelities_stand_in_one_row_and_a_rigid_column_lacks_what_bends(
    scene: Path,
) -> None:
    found = compare(scene, "R", "S", "E")
    assert found.reference == "E" and list(found.solutions) == ["R", "S", "E"]
    rows = [row for row in found.rows if row.origin == "E"][:9]
    for row in rows:
        assert row.cells["S"].correlation is not None and row.cells["S"].correlation > 0.95
        assert row.cells["S"].deviation == approx(0.0, abs=0.03)
    bending = [row for row in rows if "column bend" in row.name]
    rigid = [row.cells["R"].correlation or 0.0 for row in bending if "R" in row.cells]
    assert bending and max(rigid, default=0.0) < 0.9
    # two rigid bodies fixed together have six modes and no more
    assert sum("R" not in row.cells for row in rows) >= 3


def test_every_mode_of_every_variant_is_in_one_row_and_in_one_only(scene: Path) -> None:
    found = compare(scene, "E", "S", "R")
    for name, solution in found.solutions.items():
        numbers = [row.cells[name].index for row in found.rows if name in row.cells]
        assert len(numbers) == len(set(numbers))
        assert set(range(solution.wanted)) <= set(numbers)
    frequencies = [row.frequency_hz for row in found.rows]
    assert frequencies == sorted(frequencies)


def test_a_variant_compared_with_itself_deviates_by_nothing(scene: Path) -> None:
    one = solve(scene, "S")
    twin = solve(scene, "as written")
    found = compare_variants([one, twin], scene="column", reference="S")
    rows = [row for row in found.rows if row.cells.get("S") is not None]
    assert len(rows) >= one.wanted and all(row.origin == "S" for row in rows)
    again = compare_variants([one], scene="column")
    assert len(again.rows) == one.wanted
    assert all(list(row.cells) == ["S"] and row.cells["S"].deviation is None for row in again.rows)


def test_the_summary_is_strict_json_with_every_variant_in_every_row(scene: Path) -> None:
    summary = summarise_comparison(compare(scene, "E", "R"))
    dump_json(summary)
    assert all(list(row["variants"]) == ["E", "R"] for row in summary["modes"])
    variant = summary["variants"]["R"]
    assert variant["fidelity"] == {"block": "rigid", "column": "rigid"}
    assert variant["full_dofs"] == 12
    rigid, elastic = (summary["variants"][name]["static"]["tcp"] for name in ("R", "E"))
    # nothing but the mount gives way: there is no weakest part among one
    assert set(rigid["weak_link"].values()) == {None}
    link = present(elastic["weak_link"]["x"])
    # the larger of two shares
    assert link["name"] in ("mount", "column") and 0.5 < link["share"] < 1.0
    soft, softer = (present(point["compliance_um_per_kN"][0][0]) for point in (rigid, elastic))
    assert softer > soft


def test_effort_counts_every_step_and_says_what_came_from_the_store(scene: Path) -> None:
    cold, warm = solve(scene, "E").effort, solve(scene, "E").effort
    assert tuple(cold.seconds) == tuple(cold.cpu_seconds) == STEPS
    assert (cold.reduced, cold.stored) == (1, 0) and (warm.reduced, warm.stored) == (1, 1)
    assert warm.import_seconds == 0.0 and warm.total == approx(sum(warm.seconds.values()))


def test_modes_beyond_the_limit_are_shown_only_as_partners(scene: Path) -> None:
    scene.write_text(SCENE.replace("count = 9", 'up_to = "150 Hz"'))
    found = compare(scene, "E", "R")
    assert set(found.solutions) == {"E", "R"} and found.rows
    for name, solution in found.solutions.items():
        assert solution.modal is not None
        assert solution.wanted == np.count_nonzero(solution.modal.frequencies_hz <= 150.0)
        assert solution.wanted < len(solution.modal.frequencies_hz), name
    for row in found.rows:
        assert min(cell.frequency_hz for cell in row.cells.values()) <= 150.0


def test_a_mechanism_is_told_and_its_modes_are_compared_all_the_same(scene: Path) -> None:
    scene.write_text(SCENE.replace('horizontal = "60 N/um"', 'horizontal = "0 N/um"'))
    solution = solve(scene, "R")
    compliance = solution.points["tcp"].compliance
    # loads along the free motions have no answer, others have theirs
    assert np.isnan(compliance[0, 0]) and compliance[2, 2] > 0.0
    assert compare_variants([solution], scene="column").rows


ELASTIC = ('mesh = { size = "40 mm", cells = "hex" }', 'fidelity = "elastic"')


def test_the_baseline_stands_beside_the_variants_that_are_named_unless_one_is_the_same(
    scene: Path,
) -> None:
    def columns(*names: str, baseline: bool = True) -> list[str]:
        return [choice.name for choice in choose_variants(scene, names, baseline=baseline)]

    assert columns() == ["as written", "E", "S", "R"]
    assert columns("R") == ["as written", "R"]
    assert columns("R", "E") == ["as written", "R", "E"]
    assert columns("R", baseline=False) == ["R"]
    assert columns(baseline=False) == ["E", "S", "R"]
    # named, it is where it is named, and once
    assert columns("R", "as written") == ["R", "as written"]
    assert columns("as written", "R", baseline=False) == ["as written", "R"]
    write_scene(scene.parent, SCENE, ELASTIC)
    assert columns() == ["E", "S", "R"]
    assert columns("E", "R") == ["E", "R"]
    assert columns("R") == ["as written", "R"]


def test_each_variant_is_taken_with_every_fidelity_asked_for(scene: Path) -> None:
    fidelities: list[Fidelity] = ["segmented", "elastic"]
    choices = choose_variants(scene, ("E", "R", "S+E"), fidelities=fidelities)
    names = [choice.name for choice in choices]
    assert names == ["E segmented", "E elastic", "R", "S+E segmented", "S+E elastic"]
    assert choices[0].overrides == ("components.column.fidelity=segmented",)


def test_the_problems_of_all_variants_are_told_at_once_before_anything_is_computed(
    scene: Path,
) -> None:
    hollow = (
        'solid = { column = { size = ["40 mm", "60 mm", "500 mm"], wall = "4 mm", cap = "4 mm" } }'
    )
    solid = 'solid = { box = ["40 mm", "60 mm", "500 mm"] }'
    scene.write_text(SCENE.replace(solid, hollow).replace(', cells = "hex"', ""))
    with pytest.raises(SceneError) as caught:
        choose_variants(scene, ("S", "Q"))
    reported = str(caught.value)
    assert "cannot be segmented" in reported and "unknown variant 'Q'" in reported
