"""The same machine turned as a whole gives the same answers."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from fixture_machines import stored_scene
from headstock.geometry.frames import rotate_dofs, rotation_about
from headstock.pipeline.results.results import Results
from scene_runs import compute

pytestmark = pytest.mark.fem

SCENE = stored_scene("invariance")


def _run(folder: Path, text: str) -> Results:
    folder.mkdir()
    return compute(folder, text)


@pytest.fixture(scope="module")
def upright(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return _run(tmp_path_factory.mktemp("upright") / "run", SCENE)


@pytest.mark.parametrize(
    ("axis", "degrees"),
    [((1.0, 0.0, 0.0), 90.0), ((0.3, -0.8, 0.5), 37.0), ((1.0, 1.0, 1.0), 251.0)],
)
def test_a_machine_turned_as_a_whole_keeps_its_frequencies_and_turns_its_compliance(
    tmp_path: Path, upright: Results, axis: tuple[float, float, float], degrees: float
) -> None:
    turn = f'orientation = {{ at = ["1 m", "-2 m", "0.5 m"], rotate = {{ axis = {list(axis)}, angle = "{degrees} deg" }} }}'
    turned = _run(tmp_path / "turned", f"{turn}\n{SCENE}")
    assert turned.modal[0].frequencies_hz == approx(upright.modal[0].frequencies_hz, rel=1e-9)
    rotation = rotate_dofs(rotation_about(np.array(axis), np.radians(degrees)))
    expected = rotation @ upright.static["reference"]["tcp"].compliance @ rotation.T
    found = turned.static["reference"]["tcp"].compliance
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()
