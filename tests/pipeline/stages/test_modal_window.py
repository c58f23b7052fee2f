"""Modes in a window of frequencies: those of the whole run with their numbers, as many as the
inertia of the shifted stiffness counts, and what is said of those below and of an empty window.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from cases import cases
from common import approx
from headstock.app.views.modal import list_modes
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.mode_files import write_mode_files
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.solvers.second_order import SecondOrderSystem
from scene_runs import compute

SCENE = (Path(__file__).resolve().parents[2] / "data" / "segmented_column.toml").read_text()
LOOSE = SCENE.replace('kind = "rigid"', 'kind = "prismatic"\naxis = "x"') + "[analyses.modal]\n"


def build_system(folder: Path) -> SecondOrderSystem:
    scene = load_scene(folder / "scene.toml")
    plan = plan_scene(scene)
    state = start_run(scene, MPI.COMM_SELF, Store(folder / "store"), plan=plan)
    make_superelements(state)
    return couple_pose(state.parts, plan.poses["reference"]).system


def count_below(system: SecondOrderSystem, hz: float) -> int:
    """Negative pivots of ``K - omega^2 M`` (Sylvester's law of inertia)."""
    shifted = system.stiffness - (2.0 * np.pi * hz) ** 2 * system.mass
    _, pivots, _ = scipy.linalg.ldl(shifted)
    return int((np.linalg.eigvalsh(pivots) < 0.0).sum())


def test_a_window_lists_the_modes_inside_it_under_their_own_numbers(tmp_path: Path) -> None:
    damping = "effects.damping={ modal = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06] }"
    whole = compute(tmp_path, LOOSE, "analyses.modal.count=12", damping).modal[0]
    hz = whole.frequencies_hz
    low, high = 0.5 * float(hz[3] + hz[4]), 0.5 * float(hz[8] + hz[9])
    window = (f'analyses.modal.from="{low} Hz"', f'analyses.modal.up_to="{high} Hz"')
    results = compute(tmp_path, LOOSE, *window, damping)
    found = results.modal[0]
    system = build_system(tmp_path)
    assert (found.below, found.below + len(found.frequencies_hz)) == (
        count_below(system, low),
        count_below(system, high),
    )
    assert found.below == 4 and found.rigid_count == 0 and whole.rigid_count == 1
    inside = slice(4, 9)
    np.testing.assert_allclose(found.frequencies_hz, hz[inside], rtol=1e-12)
    np.testing.assert_allclose(found.shapes, whole.shapes[:, inside], atol=1e-9)
    assert found.mode_names == whole.mode_names[inside]
    assert found.damping_ratio == approx(whole.damping_ratio[inside])
    # the ratios of the list belong to the elastic modes of the machine, not of the window
    assert found.damping_ratio == approx([0.04, 0.05, 0.06, 0.06, 0.06])
    assert [row.number for row in list_modes(found)] == [5, 6, 7, 8, 9]
    write_mode_files(tmp_path, [found], results.view)
    models = sorted(path.name for path in (tmp_path / "modes").glob("*.glb"))
    assert models == [f"reference_0{number}.glb" for number in range(5, 10)]
    shapes = [name for name in results.mesh("column").point_data if "shape" in name]
    assert [name[:7] for name in sorted(shapes)] == [f"mode 0{number}" for number in range(5, 10)]


def test_an_empty_window_names_the_modes_next_to_it(tmp_path: Path) -> None:
    window = ('analyses.modal.from="1 Hz"', 'analyses.modal.up_to="2 Hz"')
    results = compute(tmp_path, LOOSE, *window)
    assert not len(results.modal[0].frequencies_hz) and results.modal[0].below == 1
    (words,) = [text for text in results.warnings if "no mode lies between 1 and 2 Hz" in text]
    assert "mode 1 is at 0 Hz, mode 2 is at " in words


@cases
def test_half_a_window_is_refused(tmp_path: Path, settings: tuple[str, ...], words: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(LOOSE)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=settings)
