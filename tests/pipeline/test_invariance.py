"""The same machine in other units, turned as a whole, or with another store gives the same
answers.
"""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import rotate_dofs, rotation_about
from headstock.pipeline.results.results import Results
from scene_runs import compute

pytestmark = pytest.mark.fem

SI = """
ORIENTATION
[materials.steel]
E = "210e9 Pa"
nu = 0.3
rho = "7850 kg/m^3"
[components.base]
solid = { box = ["0.6 m", "0.5 m", "0.2 m"] }
material = "steel"
fidelity = "rigid"
at = ["0 m", "0 m", "-0.2 m"]
[components.base.interfaces]
top = { face = "z+", rect = { center = ["0.1 m", "0.05 m"], size = ["0.038 m", "0.1 m"] } }
bottom = { face = "z-" }
[components.column]
solid = { box = ["0.038 m", "0.1 m", "0.5 m"] }
material = "steel"
mesh = { size = "0.03 m" }
reduction = { modes = 8 }
at = ["0.1 m", "0.05 m", "0 m"]
[components.column.interfaces]
foot = { face = "z-" }
tip = { face = "z+", coupling = "average" }
[joints.mount]
between = ["base.bottom", "ground"]
kind = "mount"
stiffness = { vertical = "2e7 N/m", horizontal = "1e7 N/m", tilt = "3e5 N m/rad", torsion = "4e5 N m/rad" }
[joints.bolts]
between = ["column.foot", "base.top"]
kind = "bolted"
axis = "z"
stiffness = { normal = "8e8 N/m", shear = "6e8 N/m", tilt = "5e5 N m/rad", torsion = "4e5 N m/rad" }
[points]
tcp = { tool = "column.tip", work = "ground" }
[analyses.static]
at = "tcp"
[analyses.modal]
count = 12
"""
MM_T_S = {
    "210e9 Pa": "210000 MPa",
    "7850 kg/m^3": "7.85e-9 t/mm^3",
    "0.038 m": "38 mm",
    "0.05 m": "50 mm",
    "0.03 m": "30 mm",
    "0.6 m": "600 mm",
    "0.5 m": "500 mm",
    "-0.2 m": "-200 mm",
    "0.2 m": "200 mm",
    "0.1 m": "100 mm",
    "0 m": "0 mm",
    "2e7 N/m": "2e4 N/mm",
    "1e7 N/m": "1e4 N/mm",
    "8e8 N/m": "8e5 N/mm",
    "6e8 N/m": "6e5 N/mm",
    "3e5 N m/rad": "3e8 N mm/rad",
    "4e5 N m/rad": "4e8 N mm/rad",
    "5e5 N m/rad": "5e8 N mm/rad",
}


def _run(folder: Path, text: str) -> Results:
    folder.mkdir()
    return compute(folder, text)


@pytest.fixture(scope="module")
def upright(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return _run(tmp_path_factory.mktemp("si") / "run", SI.replace("ORIENTATION", ""))


def test_mm_t_s_gives_the_same_answers_to_1e_9(tmp_path: Path, upright: Results) -> None:
    text = SI.replace("ORIENTATION", "")
    for metre, millimetre in MM_T_S.items():
        text = text.replace(f'"{metre}"', f'"{millimetre}"')
    assert not any(f'"{metre}"' in text for metre in MM_T_S)
    other = _run(tmp_path / "mm", text)
    assert other.modal[0].frequencies_hz == approx(upright.modal[0].frequencies_hz, rel=1e-9)
    given, found = (results.static["reference"]["tcp"].compliance for results in (upright, other))
    assert np.abs(found - given).max() <= 1e-9 * np.abs(given).max()


@pytest.mark.parametrize(
    ("axis", "degrees"),
    [((1.0, 0.0, 0.0), 90.0), ((0.3, -0.8, 0.5), 37.0), ((1.0, 1.0, 1.0), 251.0)],
)
def test_a_machine_turned_as_a_whole_keeps_its_frequencies_and_turns_its_compliance(
    tmp_path: Path, upright: Results, axis: tuple[float, float, float], degrees: float
) -> None:
    turn = f'orientation = {{ at = ["1 m", "-2 m", "0.5 m"], rotate = {{ axis = {list(axis)}, angle = "{degrees} deg" }} }}'
    turned = _run(tmp_path / "turned", SI.replace("ORIENTATION", turn))
    assert turned.modal[0].frequencies_hz == approx(upright.modal[0].frequencies_hz, rel=1e-9)
    rotation = rotate_dofs(rotation_about(np.array(axis), np.radians(degrees)))
    expected = rotation @ upright.static["reference"]["tcp"].compliance @ rotation.T
    found = turned.static["reference"]["tcp"].compliance
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()
