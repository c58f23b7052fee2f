"""Bodies without a shape: point masses beside boxes of the same mass and inertia, without inertia on
springs, and chains of masses and springs with the frequencies of their closed forms.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene, write_value
from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.results import Results
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

MASS, STIFFNESS = 3.0, 2e6
NATURAL = np.sqrt(STIFFNESS / MASS) / (2.0 * np.pi)


def chain(count: int, *, closed: bool = False, more: str = "") -> str:
    springs = ['"2 N/um"'] * (count + closed)
    return f"""
[chains.row]
from = "ground"
axis = [1, 1, 0]
masses = [{", ".join(['"3 kg"'] * count)}]
stiffness = [{", ".join(springs)}]
{'to = "ground"' if closed else ""}
{more}
[analyses.modal]
count = {count}
"""


def frequencies(results: Results) -> FloatArray:
    return results.modal[0].frequencies_hz


@pytest.mark.parametrize("count", [1, 7])
def test_a_chain_that_ends_with_a_mass_has_its_closed_form_frequencies(
    tmp_path: Path, count: int
) -> None:
    """2 omega_0 sin((2 j - 1) pi / (2 (2 n + 1)))."""
    found = compute(tmp_path, chain(count))
    j = np.arange(1, count + 1)
    expected = 2.0 * NATURAL * np.sin((2 * j - 1) * np.pi / (2.0 * (2.0 * count + 1.0)))
    np.testing.assert_allclose(frequencies(found), expected, rtol=1e-10)
    assert found.modal[0].rigid_count == 0
    # each joint takes all of the strain energy, and the shares have the names of the parts
    assert set(found.modal[0].energy_share[0]) == {f"row_spring_{i}" for i in j}


def test_a_chain_between_two_walls_has_its_closed_form_frequencies_and_damping(
    tmp_path: Path,
) -> None:
    """2 omega_0 sin(j pi / (2 (n + 1))); equal dashpots beside equal springs give c omega / (2 k)."""
    count = 6
    more = f"damping = [{', '.join(['"20 N s/m"'] * (count + 1))}]\n"
    found = compute(tmp_path, chain(count, closed=True, more=more), "effects.damping=true")
    j = np.arange(1, count + 1)
    expected = 2.0 * NATURAL * np.sin(j * np.pi / (2.0 * (count + 1.0)))
    np.testing.assert_allclose(frequencies(found), expected, rtol=1e-10)
    ratios = 20.0 * 2.0 * np.pi * expected / (2.0 * STIFFNESS)
    assert found.modal[0].damping_ratio == approx(ratios, rel=1e-8)


def test_a_point_mass_with_inertia_vibrates_as_the_box_of_the_same(tmp_path: Path) -> None:
    text = stored_scene("point_masses_block")
    box = compute(tmp_path, text)
    turn = Rotation.from_rotvec(np.radians(40.0) * np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0))
    at = [f"{float(place)!r} m" for place in turn.apply([0.0, 0.0, 0.025])]
    moments = [3.0 / 12.0 * (b**2 + c**2) for b, c in ((0.08, 0.05), (0.12, 0.05), (0.12, 0.08))]
    solid = {"point_mass": "3 kg", "inertia": [f"{moment!r} kg m^2" for moment in moments]}
    body = {"solid": solid, "at": at, "rotate": {"axis": [1, 2, 3], "angle": "40 deg"}}
    settings = (f"components.body={write_value(body)}", 'joints.mount.between.1="body.center"')
    found = compute(tmp_path, text, *settings)
    np.testing.assert_allclose(frequencies(found), frequencies(box), rtol=1e-9)
    assert found.components["body"].fidelity == "rigid"
    assert found.components["body"].mass_kg == approx(3.0)


POINT = stored_scene("point_masses_point")


def test_a_point_mass_without_inertia_does_not_feel_rotations(tmp_path: Path) -> None:
    found = compute(tmp_path, POINT)
    np.testing.assert_allclose(frequencies(found), [NATURAL] * 3, rtol=1e-10)


def test_a_point_mass_on_a_lever_without_inertia_swings_freely_about_the_springs(
    tmp_path: Path,
) -> None:
    """Springs at the end of a massless lever feel the mass along the lever alone; turns about it
    move nothing at all.
    """
    text = POINT.replace('kind = "spring"', 'kind = "spring"\nat = ["0 mm", "0 mm", "0 mm"]')
    found = compute(tmp_path, text.replace("gravity = true", ""), "free=true")
    assert found.modal[0].rigid_count == 2
    assert frequencies(found)[2] == approx(NATURAL, rel=1e-9)
    assert (frequencies(found)[:2] < 1e-3).all()


def test_a_chain_of_an_included_file_gets_its_prefix(tmp_path: Path) -> None:
    point = '[points]\ntip = { tool = "row_2.center", work = "row_1.center" }\n'
    (tmp_path / "part.toml").write_text(chain(2).partition("[analyses")[0] + point)
    path = write_scene(
        tmp_path, 'include = { file = "part.toml", prefix = "left_" }\n[analyses.modal]\n'
    )
    machine = load_scene(path).machine
    assert list(machine.components) == ["left_row_1", "left_row_2"]
    assert list(machine.joints) == ["left_row_spring_1", "left_row_spring_2"]
    assert machine.points["left_tip"].tool.component == "left_row_2"


@cases
def test_what_a_point_mass_cannot_have_is_refused(
    tmp_path: Path, settings: tuple[str, ...], words: str
) -> None:
    path = write_scene(tmp_path, POINT)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=settings)


@cases
def test_what_is_no_chain_is_refused(tmp_path: Path, setting: str, words: str) -> None:
    path = write_scene(tmp_path, chain(3))
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=(setting,))
