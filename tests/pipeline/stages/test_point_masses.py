"""Bodies without a shape: point masses beside boxes of the same mass and inertia, without inertia on
springs, and chains of masses and springs with the frequencies of their closed forms.
"""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from fixture_machines import write_scene
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


BLOCK = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.body]
solid = {{ box = ["120 mm", "80 mm", "50 mm"] }}
material = "steel"
mass = "3 kg"
fidelity = "rigid"
rotate = {{ axis = [1, 2, 3], angle = "40 deg" }}
interfaces = {{ foot = {{ face = "z-" }} }}
[joints.mount]
between = ["ground", "body.foot"]
kind = "spring"
at = {at}
stiffness = {{ x = "3 N/um", y = "2 N/um", z = "1 N/um", rx = "1e4 N m/rad", ry = "2e4 N m/rad", rz = "3e4 N m/rad" }}
[analyses.modal]
count = 6
"""


def test_a_point_mass_with_inertia_vibrates_as_the_box_of_the_same(tmp_path: Path) -> None:
    center = 0.025 * turned([0.0, 0.0, 1.0])
    text = BLOCK.format(at='["30 mm", "-10 mm", "20 mm"]')
    box = compute(tmp_path, text)
    moments = [3.0 / 12.0 * (b**2 + c**2) for b, c in ((0.08, 0.05), (0.12, 0.05), (0.12, 0.08))]
    written = ", ".join(f'"{moment!r} kg m^2"' for moment in moments)
    at = ", ".join(f'"{float(place)!r} m"' for place in center)
    lines = text.splitlines()
    point = "\n".join(
        line
        for line in lines
        if not line.startswith(("solid", "material =", "mass", "fidelity", "interfaces"))
    )
    point = point.replace("body.foot", "body.center").replace(
        "[components.body]",
        f'[components.body]\nsolid = {{ point_mass = "3 kg", inertia = [{written}] }}\nat = [{at}]',
    )
    found = compute(tmp_path, point)
    np.testing.assert_allclose(frequencies(found), frequencies(box), rtol=1e-9)
    assert found.components["body"].fidelity == "rigid"
    assert found.components["body"].mass_kg == approx(3.0)


def turned(vector: list[float]) -> FloatArray:
    """By 40 degrees about [1, 2, 3] (Rodrigues)."""
    axis, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0), np.radians(40.0)
    v = np.array(vector)
    return np.asarray(
        v * np.cos(angle)
        + np.cross(axis, v) * np.sin(angle)
        + axis * (axis @ v) * (1.0 - np.cos(angle))
    )


POINT = """
[components.weight]
solid = { point_mass = "3 kg" }
at = ["10 mm", "20 mm", "30 mm"]
[joints.mount]
between = ["ground", "weight.center"]
kind = "spring"
stiffness = { x = "2 N/um", y = "2 N/um", z = "2 N/um" }
[analyses.modal]
count = 3
[effects]
gravity = true
"""


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


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (('components.weight.mass="2 kg"',), "a point mass has its mass in solid; remove mass"),
        (("components.weight.fidelity=elastic",), "a point mass is always rigid"),
        (('components.weight.interfaces.top={ face = "z+" }',), "has one: center"),
        (
            ('components.weight.solid.inertia=["1 kg m^2", "1 kg m^2", "3 kg m^2"]',),
            "more than the sum of the others",
        ),
        (('loads.push={ face = "weight.center", pressure = "1 MPa" }',), "has no surface"),
        (('supports.hold={ face = "weight.center", fix = ["x"] }',), "is not meshed"),
    ],
)
def test_what_a_point_mass_cannot_have_is_refused(
    tmp_path: Path, settings: tuple[str, ...], words: str
) -> None:
    path = write_scene(tmp_path, POINT)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=settings)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ('chains.row.stiffness=["2 N/um"]', "has 1 entries of stiffness for 3 springs: one before"),
        ('chains.row.damping=["2 N s/m"]', "has 1 entries of damping for 3 springs"),
        ('chains.row.from="bed.screw"', "write where its masses are"),
        (
            'components={ row_2 = { solid = { point_mass = "1 kg" } } }',
            "makes an entry of this name",
        ),
        ('chains.row.masses=["1 kg", "2 m", "3 kg"]', "is a length, not a mass"),
    ],
)
def test_what_is_no_chain_is_refused(tmp_path: Path, setting: str, words: str) -> None:
    path = write_scene(tmp_path, chain(3))
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=(setting,))
