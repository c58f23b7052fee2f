"""what would not fit into time or memory is refused in under a second of processor time, with
the numbers, before anything is meshed.
"""

import time
from pathlib import Path

import pytest

from cases import cases
from faults.runs import SCENE, finish_run, make_places
from headstock.pipeline.planning.budgets import BudgetError
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

pytestmark = [pytest.mark.hard("H51"), pytest.mark.workers]

AXIS = '\n[axes.X]\njoints = ["slide"]\ndirection = "x"\n[joints.slide]\nbetween = ["ground", "column.tip"]\nkind = "prismatic"\naxis = "x"\n'


def plan(folder: Path, text: str) -> Plan:
    path = folder / "scene.toml"
    path.write_text(text)
    return plan_scene(load_scene(path))


@cases
def test_a_billion_elements_are_refused_within_a_second_of_processor_time_with_their_number(
    tmp_path: Path, size: str, cells: str, fragment: str
) -> None:
    text = SCENE.replace(
        'mesh = { size = "20 mm" }', f'mesh = {{ size = "{size}", cells = "{cells}" }}'
    )
    start = time.process_time()
    with pytest.raises(BudgetError, match=fragment) as caught:
        plan(tmp_path, text)
    assert time.process_time() - start < 1.0
    assert "'column'" in str(caught.value) and "larger mesh size" in str(caught.value)


@pytest.mark.process
def test_a_run_of_a_billion_elements_ends_with_1_and_leaves_nothing(tmp_path: Path) -> None:
    places = make_places(tmp_path)
    places.scene.write_text(SCENE.replace("20 mm", "0.136 mm"))
    code, said = finish_run(places, "steel")
    assert code == 1
    assert said.startswith("BudgetError: component 'column'")
    assert not (places.results / "results.h5").exists()


@pytest.mark.parametrize("count", [10**9, 10**12, 2**63 - 1])
@pytest.mark.parametrize("line", ["modes = 8", "count = 4"])
def test_a_billion_modes_are_refused_by_the_schema(tmp_path: Path, line: str, count: int) -> None:
    with pytest.raises(SceneError, match="10000000"):
        plan(tmp_path, SCENE.replace(line, f"{line.split()[0]} = {count}"))


@pytest.mark.parametrize("line", ["modes = 8", "count = 4"])
def test_ten_million_modes_are_refused_by_the_memory_they_would_take(
    tmp_path: Path, line: str
) -> None:
    text = SCENE.replace(line, f"{line.split()[0]} = 10000000")
    if line.startswith("count"):
        text = text.replace("reduction = { modes = 8 }", "")
    with pytest.raises(BudgetError, match=r"would need about .* MB; this machine has"):
        plan(tmp_path, text)


def test_a_billion_positions_of_a_sweep_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="10000000"):
        plan(
            tmp_path, f'{SCENE}{AXIS}[sweeps.all]\naxes = {{ X = ["0 mm", "1 mm", 1000000000] }}\n'
        )


def test_limits_of_the_scene_come_first(tmp_path: Path) -> None:
    fine = SCENE.replace("20 mm", "3 mm")
    for limit, fragment in {
        "elements = 1000": "limits.elements allows 1000",
        'memory = "500 MB"': "limits.memory allows 500 MB",
        'time = "1 s"': r"this run would take about .* s, .* limits\.time allows 1 s",
    }.items():
        with pytest.raises(BudgetError, match=fragment):
            plan(tmp_path, f"{fine}[limits]\n{limit}\n")
