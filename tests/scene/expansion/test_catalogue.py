"""Elements of the catalogue in joints: what a scene makes of them, and whether their values can be."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from cases import cases
from common import approx
from fixture_machines import stored_scene
from headstock.scene.building.joints import KINDS
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.catalogue import CatalogueEntry, read_catalogue
from headstock.scene.reading.findings import SceneError
from headstock.scene.reading.units import LENGTH, ROTATIONAL_STIFFNESS, STIFFNESS, parse_quantity
from headstock.scene.scene import Scene

SCENE = stored_scene("catalogue")
ENTRIES = read_catalogue()
Load = Callable[..., Scene]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    path = tmp_path / "slide.toml"
    path.write_text(SCENE)

    def load_it(variant: str | None = None, *overrides: str, old: str = "", new: str = "") -> Scene:
        path.write_text(SCENE.replace(old, new) if old else SCENE)
        return load_scene(path, variant=variant, overrides=overrides)

    return load_it


def value(text: object) -> float:
    return parse_quantity(text, STIFFNESS, ROTATIONAL_STIFFNESS).value


def stiffness(name: str, key: str) -> float:
    table = ENTRIES[name].joint["stiffness"]
    assert isinstance(table, dict)
    return value(table[key])


def normals(scene: Scene) -> list[float]:
    return [scene.machine.joints[f"pad_{place}"].stiffness[2, 2] for place in (1, 2)]


def test_an_element_gives_what_the_joint_does_not_have_itself(load: Load) -> None:
    scene = load()
    for place in (1, 2):
        joint = scene.machine.joints[f"pad_{place}"]
        assert joint.kind == "linear_guide"
        assert joint.stiffness[1, 1] == 200e6  # its own
        for dof, key in ((2, "normal"), (3, "roll"), (4, "pitch"), (5, "yaw")):
            assert joint.stiffness[dof, dof] == stiffness("guide_35", key)
        assert joint.stiffness[0, 0] == 0.0
        assert joint.loss_factor == 0.03
    drive = scene.machine.joints["drive"]
    assert drive.stiffness[0, 0] == stiffness("ball_screw_40x10", "axial")
    assert drive.screw is not None
    assert drive.screw.bearing == stiffness("screw_bearing_30", "axial")
    assert drive.screw.lead == 0.01


def test_variants_and_settings_reach_the_element_and_its_values(load: Load) -> None:
    ball, large, roller = (
        stiffness(name, "normal") for name in ("guide_35", "guide_45", "roller_guide_35")
    )
    assert normals(load()) == [ball, ball]
    assert normals(load("larger")) == [large, large]
    assert normals(load("one")) == [ball, roller]
    assert normals(load(None, 'joints.pad.stiffness.normal="7 N/um"')) == [7e6, 7e6]
    assert normals(load("larger", 'joints.pad_1.stiffness.normal="7 N/um"')) == [7e6, large]
    bearing = load(None, 'joints.drive.screw.bearing="90 N/um"').machine.joints["drive"].screw
    assert bearing is not None and bearing.bearing == 90e6
    text = (
        SCENE.replace('"catalogue:guide_35"', '"= pads"')
        + '[parameters]\npads = "catalogue:guide_45"\n'
    )
    assert normals(load(old=SCENE, new=text)) == [large, large]


def test_a_screw_takes_its_shaft_alone(load: Load) -> None:
    own = """kind = "ball_screw"
stiffness = { axial = "300 N/um" }
screw = { from = "catalogue:ball_screw_40x20", bearing = "100 N/um" }
"""
    start, end = SCENE.index('from = "catalogue:ball_screw'), SCENE.index("[points.tcp]")
    ends = 'between = ["slide.bottom", "bed.far"]\naxis = "x"\n'
    scene = load(old=SCENE[start:end], new=ends + own)
    drive = scene.machine.joints["drive"]
    assert drive.stiffness[0, 0] == 300e6 and drive.screw is not None
    assert (drive.screw.lead, drive.screw.bearing) == (0.02, 100e6)
    assert drive.screw.axial == approx(210e9 * np.pi / 4.0 * 0.0355**2)
    assert any("diameter and lead" in text for text in scene.assumptions)
    with pytest.raises(SceneError, match=r"guide_35.*linear_guide.*ball_screw_40x10") as caught:
        load(old=SCENE[start:end], new=ends + own.replace("ball_screw_40x20", "guide_35"))
    assert len(caught.value.problems) == 1


def test_elements_go_with_carriages_single_places_and_included_files(
    load: Load, tmp_path: Path
) -> None:
    start, end = SCENE.index("[joints.pad]"), SCENE.index("[joints.drive]")
    pads = """\
[joints.pad]
from = "catalogue:guide_25"
between = ["slide.bottom", "bed.top"]
axis = "x"
normal = "z"
carriages = { middle = ["0 mm", "0 mm", "0 mm"], along = "200 mm", across = "160 mm" }
each.3 = { from = "catalogue:guide_30", "stiffness.normal" = "1 N/um" }
"""
    loose = SCENE[: SCENE.index("[variants.larger]")] + '[analyses.static]\nat = "tcp"\n'
    scene = load(old=SCENE, new=loose.replace(SCENE[start:end], pads))
    whole = scene.machine.joints
    assert [text.split(",")[0] for text in scene.assumptions][:2] == [
        "joints.pad: catalogue:guide_25",
        "joints.pad_3: catalogue:guide_30",
    ]
    small = stiffness("guide_25", "normal")
    assert [whole[f"pad_{place}"].stiffness[2, 2] for place in (1, 2, 3, 4)] == [
        *(small, small),
        *(1e6, small),
    ]
    assert whole["pad_3"].stiffness[1, 1] == stiffness("guide_30", "lateral")
    (tmp_path / "pads.toml").write_text(pads.replace("slide.bottom", "slide.bottom"))
    included = 'include = "pads.toml"\n' + loose.replace(SCENE[start:end], "")
    found = load(old=SCENE, new=included).machine.joints
    assert repr(found["pad_3"]) == repr(whole["pad_3"])
    (tmp_path / "pads.toml").write_text(pads.replace("guide_25", "guide_26"))
    with pytest.raises(SceneError, match=r"pads\.toml:2: joints\.pad_1\.from") as caught:
        load(old=SCENE, new=included)
    assert len(caught.value.problems) == 1


def test_a_joint_that_is_made_rigid_keeps_no_damping_of_its_element(load: Load) -> None:
    rigid = ", ".join(f'{key} = "rigid"' for key in ("normal", "lateral", "roll", "pitch", "yaw"))
    scene = load(old='stiffness.lateral = "200 N/um"', new=f"stiffness = {{ {rigid} }}")
    assert scene.machine.joints["pad_1"].fixed == (1, 2, 3, 4, 5)
    assert scene.machine.joints["pad_1"].loss_factor == 0.0


def test_a_scene_says_once_what_it_leaves_to_the_catalogue(load: Load) -> None:
    pads, drive, bearing = load().assumptions
    assert pads.startswith("joints.pad: catalogue:guide_35") and " 1.6" in pads
    assert pads.endswith("own values: stiffness.lateral")
    assert bearing.startswith("joints.drive.screw.bearing: catalogue:screw_bearing_30")
    assert drive.startswith("joints.drive: catalogue:ball_screw_40x10")


@cases
def test_what_is_wrong_is_said_once_with_place_and_remedy(
    load: Load, old: str, new: str, expected: tuple[str, ...]
) -> None:
    with pytest.raises(SceneError) as caught:
        load(old=old, new=new)
    assert len(caught.value.problems) == 1 or "latral" in new
    for text in expected:
        assert text in str(caught.value)


@pytest.mark.parametrize("entry", ENTRIES.values(), ids=list(ENTRIES))
def test_every_element_can_be_and_builds(load: Load, entry: CatalogueEntry) -> None:
    rule, keys = KINDS[entry.family.kind], entry.joint["stiffness"]
    assert isinstance(keys, dict) and set(rule.required) <= set(keys) <= set(rule.keys)
    for key, text in keys.items():
        rotational = rule.keys[key][0] >= 3
        low, high = (1e3, 1e7) if rotational else (1e4, 3e9)
        assert (
            low
            < parse_quantity(text, ROTATIONAL_STIFFNESS if rotational else STIFFNESS).value
            < high
        )
    low, high = entry.family.loss_factor_range
    assert 0.0 < low < entry.family.loss_factor < high < 0.5
    assert 1.0 < entry.family.factor <= (entry.family.rotation_factor or 3.0) <= 3.0
    assert all(len(source) > 20 for source in entry.family.source)
    for text in (entry.family.title, entry.family.preload, entry.family.derived, entry.family.size):
        assert text

    screw = entry.family.kind == "ball_screw"
    scene = load(
        None,
        f'joints.{"drive" if screw else "pad"}.from="catalogue:{entry.name}"',
        old='stiffness.lateral = "200 N/um"\n',
        new="",
    )
    joint = scene.machine.joints["drive" if screw else "pad_1"]
    assert joint.kind == entry.family.kind
    assert {joint.stiffness[dof, dof] for key in keys for dof in rule.keys[key]} == {
        value(text) for text in keys.values()
    }


def ball_stiffness(load: float, diameter: float, conformity: float = 0.52) -> float:
    """Stiffness of a steel ball [m] between two grooves of ``conformity`` times its diameter as
    radius under a load [N], by Hertz: an elliptic contact on each side.
    """
    e_star = 210e9 / (1.0 - 0.3**2) / 2.0
    along = 2.0 / diameter  # curvature along the groove, whose own is small
    across = 2.0 / diameter - 1.0 / (conformity * diameter)

    def excess(eccentricity: float) -> float:
        m = eccentricity**2
        first, second = float(ellipk(m)), float(ellipe(m))
        return (second / (1.0 - m) - first) / (first - second) - along / across

    m = brentq(excess, 0.05, 1.0 - 1e-12) ** 2
    first, second = float(ellipk(m)), float(ellipe(m))
    # semi-axis a along the smaller curvature
    a = (3.0 * load * second / (2.0 * np.pi * e_star * (1.0 - m) * 0.5 * (along + across))) ** (
        1 / 3
    )
    approach = 3.0 * load * first / (2.0 * np.pi * e_star * a)
    return float(1.5 * load / (2.0 * approach))


@pytest.mark.parametrize("load", [50.0, 200.0])
def test_contacts_of_a_ball_agree_with_palmgrens_formula(load: float) -> None:
    palmgren = 4.36e-4 * load ** (2 / 3) / 8.0 ** (1 / 3) * 1e-3
    assert ball_stiffness(load, 8e-3) == approx(1.5 * load / palmgren, rel=0.2)


@pytest.mark.parametrize("name", [name for name in ENTRIES if name.startswith("guide_")])
def test_balls_alone_are_stiffer_than_their_carriage_but_not_by_much(name: str) -> None:
    # 4 rows at 45 deg over 2.2 sizes, a ball of 0.18 sizes every 1.1 diameters, preload 7 % of 40 N/mm^2 times size^2
    size = float(name.rpartition("_")[2])
    balls = 4 * 2.2 / (1.1 * 0.18)
    load = 0.07 * 40.0 * size**2 / (balls / 2.0) / np.sin(np.pi / 4.0)
    contacts = balls * ball_stiffness(load, 0.18e-3 * size) * 0.5
    assert 1.2 < contacts / stiffness(name, "normal") < 2.2


@pytest.mark.parametrize("name", [name for name in ENTRIES if "roller_guide" in name])
def test_rollers_alone_are_about_four_times_as_stiff_as_their_carriage(name: str) -> None:
    # 4 rows at 45 deg over 2.4 sizes, rollers of 0.14 sizes, 0.2 long; preload 10 % of 65 N/mm^2 times size^2
    size = float(name.rpartition("_")[2])
    rollers = 4 * 2.4 / (1.1 * 0.14)
    load = 0.1 * 65.0 * size**2 / (rollers / 2.0) / np.sin(np.pi / 4.0)
    # Palmgren: approach [mm] of a line contact of steel under a load [N] over a length [mm]
    approach = 2.0 * 3.84e-5 * load**0.9 / (0.2 * size) ** 0.8
    contacts = rollers * load / (0.9 * approach * 1e-3) * 0.5
    assert 3.0 < contacts / stiffness(name, "normal") < 5.0


@pytest.mark.parametrize("name", [name for name in ENTRIES if "bearing" in name])
def test_bearings_are_as_stiff_as_their_balls(name: str) -> None:
    entry = ENTRIES[name]
    bore = float(name.rpartition("_")[2])
    # angle, balls in both rows, ball diameter, preload: of usual proportions
    angle, balls, ball, preload = {
        "screw_bearing": (60.0, 40, 0.2 * bore, 3.0 * bore**2),
        "spindle_bearing": (15.0, 40, 0.17 * bore, 0.13 * bore**2),
        "spindle_bearing_25deg": (25.0, 40, 0.17 * bore, 0.2 * bore**2),
    }[entry.stem]
    a = np.radians(angle)
    one = ball_stiffness(preload / (balls / 2) / np.sin(a), ball * 1e-3)
    axial, radial = balls * one * np.sin(a) ** 2, balls * one * np.cos(a) ** 2 / 2.0
    shares = [axial / stiffness(name, "axial"), radial / stiffness(name, "radial")]
    assert 1.0 / entry.family.factor < min(shares) and max(shares) < entry.family.factor


@pytest.mark.parametrize("stem", sorted({entry.stem for entry in ENTRIES.values()}))
def test_stiffness_grows_with_size_as_similar_bodies_have_it(stem: str) -> None:
    family = [entry.name for entry in ENTRIES.values() if entry.stem == stem]
    sizes = [float(re.findall(r"\d+", name.removeprefix(stem))[0]) for name in family]
    keys = ENTRIES[family[0]].joint["stiffness"]
    assert isinstance(keys, dict)
    for key in keys:
        power = 3 if key in ("roll", "pitch", "yaw", "tilt") else 1
        shares = [
            stiffness(name, key) / size**power for name, size in zip(family, sizes, strict=True)
        ]
        assert max(shares) / min(shares) < 1.12  # two figures each


@pytest.mark.parametrize("name", [name for name in ENTRIES if "ball_screw" in name])
def test_a_nut_is_somewhat_less_stiff_than_its_balls_and_a_shaft_thinner_than_its_name(
    name: str,
) -> None:
    # four loaded turns of balls in two halves, preload 7 % of 35 N/mm^2 times diameter^2, contacts at 45 deg
    size, lead = map(float, re.findall(r"\d+", name))
    ball = 3.5 if lead <= 5.0 else 6.5
    balls = 4.0 * np.pi * size / (1.05 * ball)
    load = 0.07 * 35.0 * size**2 / (balls / 2.0) / np.sin(np.pi / 4.0)
    contacts = balls * ball_stiffness(load, ball * 1e-3) * 0.5
    assert 1.0 < contacts / stiffness(name, "axial") < 3.0
    screw = ENTRIES[name].joint["screw"]
    assert isinstance(screw, dict)
    diameter, given = (
        parse_quantity(screw[key], LENGTH).value * 1e3 for key in ("diameter", "lead")
    )
    assert given == lead and 0.75 * size < diameter < size


@pytest.mark.parametrize("name", [name for name in ENTRIES if name.endswith("kN")])
def test_a_mass_on_its_mount_has_the_frequency_that_the_family_states(name: str) -> None:
    entry = ENTRIES[name]
    load = 1e3 * float(re.findall(r"(\d+)kN", name)[0])
    (stated,) = re.findall(r"2 pi (\d+) Hz", entry.family.derived)
    frequency = np.sqrt(stiffness(name, "vertical") * 9.81 / load) / (2.0 * np.pi)
    assert frequency == approx(float(stated), rel=0.03)
    assert stiffness(name, "horizontal") < stiffness(name, "vertical")
