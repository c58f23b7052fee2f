"""The mill that ships: nothing in its scene is doubtful, as rigid bodies on springs it is as stiff as
its springs by hand, and its castings take away what a mill loses by them.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import headstock as hs
from common import approx

MILL = Path(__file__).resolve().parents[2] / "machines" / "mill.toml"
RIGID: dict[str, Any] = {"parameters.castings": "rigid", "components.spindle.fidelity": "rigid"}
POSE = {f"analyses.{name}.poses": ["reference"] for name in ("static", "modal")}


def stiffness_of_screw(nut: float, distance: float, diameter: float, bearing: float) -> float:
    """Stiffness along the thread of a steel shaft of 10 mm lead that is held at one end [N/m]."""
    area, polar = np.pi * diameter**2 / 4.0, np.pi * diameter**4 / 32.0
    lead = 0.01 / (2.0 * np.pi)
    shaft = distance / (210e9 * area) + lead**2 * distance / (210e9 / 2.6 * polar)
    return 1.0 / (1.0 / nut + 1.0 / bearing + shaft)


@pytest.fixture(scope="module")
def rigid() -> hs.Results:
    return hs.run(hs.load(MILL, set=RIGID | POSE), analyses=["static", "modal"])


def test_its_scene_has_no_warnings_and_says_what_is_assumed() -> None:
    mill = hs.load(MILL)
    assert not hs.check(mill)
    assert len(MILL.read_text().splitlines()) <= 250
    elastic = [
        name for name, part in mill.scene.machine.components.items() if part.fidelity == "elastic"
    ]
    assert sorted(elastic) == ["column", "head", "saddle", "table"]


def test_along_the_spindle_rigid_bodies_give_the_sum_of_compliances_by_hand(
    rigid: hs.Results,
) -> None:
    """Numbers of the catalogue; tool and work are pushed apart along one line, so that the shoes
    have nothing to carry.
    """
    arm = 0.405  # from the carriages of Z to the spindle
    tilt = 4.0 * 490e6 * 0.13**2 + 4.0 * 240e3  # carriages 260 mm apart, and their own pitch
    screw = stiffness_of_screw(720e6, 1.1 - 0.79, 0.0355, 750e6)
    tables = 1.0 / (4.0 * 420e6) + 1.0 / (4.0 * 490e6)
    expected = 1.0 / screw + arm**2 / tilt + 1.0 / (190e6 + 90e6) + tables
    assert rigid.compliance["tcp"][2, 2] == approx(expected, rel=1e-3)


def test_the_whole_rigid_machine_on_its_shoes_bounds_the_first_mode(rigid: hs.Results) -> None:
    """Whatever else gives way lowers it (Rayleigh); sideways and rolling about y, by hand."""
    steel, iron = 7850.0, 7150.0

    def casting(x: float, y: float, z: float, wall: float, cap: float) -> float:
        """Mass of a hollow box, its ribs left out [kg]."""
        return iron * (x * y * z - (x - 2 * wall) * (y - 2 * wall) * (z - 2 * cap))

    bodies = [  # masses [kg] and heights above the shoes [m]
        (1000.0, 0.2),
        (casting(0.4, 0.38, 1.16, 0.022, 0.025), 0.98),
        (casting(0.4, 0.29, 0.38, 0.016, 0.016), 1.19),
        (casting(0.66, 0.34, 0.13, 0.016, 0.016), 0.513),
        (casting(0.6, 0.36, 0.1, 0.016, 0.02), 0.67),
        (steel * np.pi / 4.0 * (0.18**2 - 0.11**2) * 0.34, 1.18),
        (steel * np.pi / 4.0 * (0.06**2 - 0.022**2) * 0.43, 1.165),
    ]
    mass = np.sum([m * np.array([[1.0, h], [h, h**2]]) for m, h in bodies], axis=0)
    stiffness = np.diag([6.0 * 60e6, 6.0 * 200e6 * 0.33**2])
    bound = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).min()) / (2.0 * np.pi)
    assert 0.8 * bound < rigid.modes["reference"].frequencies_hz[0] < bound


@pytest.mark.slow
def test_its_castings_take_a_mill_s_share_of_the_stiffness(rigid: hs.Results) -> None:
    coarse = hs.run(hs.load(MILL, variant="coarse", set=POSE), analyses=["static", "modal"])
    elastic, stiff = (1e9 * np.diag(r.compliance["tcp"])[:3] for r in (coarse, rigid))
    assert (elastic > 1.2 * stiff).all() and (elastic < 2.5 * stiff).all()
    per_um = 1e3 / elastic
    assert ((per_um > 15.0) & (per_um < 60.0)).all()  # N/um, of a small machining centre
    first = coarse.modes["reference"].frequencies_hz
    assert 40.0 < first[0] < rigid.modes["reference"].frequencies_hz[0]
    assert (first[:6] < 1.02 * rigid.modes["reference"].frequencies_hz[:6]).all()
