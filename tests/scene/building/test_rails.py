"""Scenes with rails: what they build, and every way in which a carriage can be wrong."""

import math
from pathlib import Path

import pytest

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene

GOOD = stored_scene("rails_good")


def load(folder: Path, *changes: tuple[str, str]) -> Scene:
    text = GOOD
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = write_scene(folder, text)
    return load_scene(path)


def test_a_rail_without_stations_gets_them_from_its_length_and_the_shortest_carriage(
    tmp_path: Path,
) -> None:
    machine = load(tmp_path).machine
    rail = machine.components["bed"].interfaces["rail"]
    # 2.5 intervals per 60 mm on 600 mm, and the three more that a cubic takes
    assert rail.rail is not None and (rail.rail.along, rail.rail.control_points, rail.coupling) == (
        "x",
        28,
        "average",
    )
    assert machine.joints["guide"].length == approx(0.06) and machine.joints["screw"].length is None


def refusals(path: Path, key: str) -> str:
    """What is said of a key of a scene that is refused."""
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    return " ".join(problem.message for problem in caught.value.problems if problem.key == key)


@cases
def test_a_carriage_that_cannot_be_is_named_with_its_remedy(
    tmp_path: Path, old: str, new: str, key: str, message: str
) -> None:
    assert GOOD.count(old) == 1
    assert message in refusals(write_scene(tmp_path, GOOD, (old, new)), key)


def test_segments_longer_than_the_carriage_are_warned_of(tmp_path: Path) -> None:
    change = (
        'material = "steel"\ninterfaces = { foot',
        'material = "steel"\nfidelity = "segmented"\nsegments = { count = 8 }\ninterfaces = { foot',
    )
    warnings = load(tmp_path, change).warnings
    assert any(
        "60 mm is shorter than a segment of 75 mm" in warning and "count = 20" in warning
        for warning in warnings
    )
    assert load(tmp_path).warnings == ()


SHAFT = 'screw = { diameter = "20 mm", lead = "5 mm", bearing = "400 N/um", coupling = "10 kN m/rad" }\n'
ENDS = '"bed.foot", "slide.block"]\nkind = "ball_screw"\naxis = "x"\n'


def test_a_screw_with_a_shaft_is_built_of_steel_and_ties_its_bearings_only_on_elastic_parts(
    tmp_path: Path,
) -> None:
    far = SHAFT.replace(" }", ', second_end = "bed.foot", length = "500 mm" }')
    nut_first = ENDS.replace('"bed.foot", "slide.block"', '"slide.block", "bed.foot"')
    machine = load(tmp_path, (ENDS, nut_first + far)).machine
    shaft = machine.joints["screw"].screw
    assert shaft is not None
    area, polar = math.pi * 0.02**2 / 4.0, math.pi * 0.02**4 / 32.0
    assert (shaft.axial, shaft.torsional) == approx((210e9 * area, 210e9 / 2.6 * polar))
    assert machine.joints["screw_shaft"].stiffness[0, 0] == approx(
        1.0 / (1.0 / 4e8 + 0.5 / (210e9 * area))
    )
    rigid = (
        'material = "steel"\ninterfaces = { foot',
        'material = "steel"\nfidelity = "rigid"\ninterfaces = { foot',
    )
    assert "screw_shaft" not in load(tmp_path, (ENDS, nut_first + far), rigid).machine.joints


@cases
def test_a_screw_that_cannot_be_is_named_with_its_remedy(
    tmp_path: Path, old: str, new: str, key: str, message: str
) -> None:
    text = GOOD.replace(
        ENDS, ENDS.replace('"bed.foot", "slide.block"', '"slide.block", "bed.foot"') + SHAFT
    )
    if not new:
        new = old
        text = text.replace('length = "60 mm"\n', 'length = "60 mm"\n' + SHAFT)
    else:
        assert text.count(old) == 1
    assert message in refusals(write_scene(tmp_path, text.replace(old, new)), key)
