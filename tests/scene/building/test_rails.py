"""Scenes with rails: what they build, and every way in which a carriage can be wrong."""

import math
from pathlib import Path

import pytest

from common import approx
from fixture_machines import machine, write_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene

GOOD = machine("""
machine = "axis"
names = { slider = "slide", feet = "clamp", bottom = "foot", top = "rail", foot = "block" }
without = ["components.bed.fidelity", "axes.X.limits"]
components.bed.solid = { box = ["600 mm", "200 mm", "80 mm"] }
components.bed.interfaces = { foot = { face = "z-" }, rail = { face = "z+", strip = { along = "x", width = "20 mm" }, rail = { along = "x" } } }
components.slide.solid = { box = ["100 mm", "100 mm", "40 mm"] }
components.slide.at = ["0 mm", "0 mm", "90 mm"]
components.slide.interfaces = { block = { face = "z-" }, top = { face = "z+" } }
joints.clamp.between = ["ground", "bed.foot"]
joints.guide.between = ["bed.rail", "slide.block"]
joints.guide.length = "60 mm"
joints.guide.stiffness = { lateral = "300 N/um", normal = "400 N/um", roll = "1 kN m/mrad", pitch = "2 kN m/mrad", yaw = "2 kN m/mrad" }
joints.screw.between = ["bed.foot", "slide.block"]
points.tcp.tool = "slide.top"
poses.home = {}
poses.far = { X = "270 mm" }
analyses.static = { at = "tcp" }
""")


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


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        ('X = "270 mm"', 'X = "280 mm"', "poses.far", "guide (60 mm long) hangs 10 mm over the end of rail bed.rail"),
        ('at = ["0 mm", "0 mm", "90 mm"]', 'at = ["-290 mm", "0 mm", "90 mm"]', "joints.guide", "hangs 20 mm over the end"),
        ('length = "60 mm"', 'length = "700 mm"', "joints.guide.length", "the carriage (700 mm) is longer than rail bed.rail (600 mm)"),
        ('length = "60 mm"\n', "", "joints.guide", 'needs its length; write length = "80 mm"'),
        (
            'rail = { along = "x" }', 'rail = { along = "x", control_points = 12 }', "components.bed.interfaces.rail.rail.control_points",
            "write at least 18, better 28",
        ),
        ('rail = { along = "x" }', 'rail = { along = "x", control_points = 3 }', "components.bed.interfaces.rail.rail.control_points", "4"),
        ('rail = { along = "x" }', 'rail = { along = "z" }', "components.bed.interfaces.rail.rail", "face z+ is square to z"),
        ('rail = { along = "x" }', 'rail = { along = "x" }, coupling = "rigid"', "components.bed.interfaces.rail", "coupling"),
        ('axis = "x"\nstiffness = { axial', 'axis = "x"\nlength = "10 mm"\nstiffness = { axial', "joints.screw.length", "only a carriage"),
        ('"bed.rail", "slide.block"', '"bed.rail", "ground"', "joints.guide", "ground has no place of its own"),
        ('block = { face = "z-" }', 'block = { face = "z-", rail = { along = "x" } }', "joints.guide.between", "both ends are rails"),
    ],
)  # fmt: skip
def test_a_carriage_that_cannot_be_is_named_with_its_remedy(
    tmp_path: Path, old: str, new: str, key: str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load(tmp_path, (old, new))
    matching = [
        problem
        for problem in caught.value.problems
        if problem.key == key and message in problem.message
    ]
    assert matching, str(caught.value)


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


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        (
            SHAFT,
            SHAFT.replace('"20 mm"', '"20 mm", bore = "25 mm"'),
            "joints.screw.screw",
            "bore of 25 mm",
        ),
        (
            SHAFT,
            SHAFT.replace('lead = "5 mm", ', ""),
            "joints.screw.screw",
            "a coupling deflects along the thread only",
        ),
        (
            SHAFT,
            SHAFT.replace(" }", ', second_end = "bed.foot" }'),
            "joints.screw.screw",
            "needs the shaft's length",
        ),
        (
            SHAFT,
            SHAFT.replace(" }", ', second_end = "bed.end", length = "1 m" }'),
            "joints.screw.screw.second_end",
            "no interface 'end'",
        ),
        (
            SHAFT,
            SHAFT.replace(" }", ', second_end = "slide.top", length = "1 m" }'),
            "joints.screw.screw.second_end",
            "which is the nut's",
        ),
        (SHAFT, SHAFT + 'length = "20 mm"\n', "joints.screw.length", "slides on no rail"),
        (
            SHAFT,
            SHAFT.replace('"400 N/um"', '"400 N/um", nu = 0.7'),
            "joints.screw.screw.nu",
            "is 0.7 but a Poisson ratio",
        ),
        (
            'axial = "100 N/um"',
            'axial = "rigid"',
            "joints.screw.stiffness.axial",
            "the nut of a screw with a shaft has a compliance of its own",
        ),
        (
            '"slide.block", "bed.foot"',
            '"slide.block", "ground"',
            "joints.screw.between",
            "not ground",
        ),
        (SHAFT, "", "joints.guide.screw", "a linear_guide has no screw"),
    ],
)
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
    path = write_scene(tmp_path, text.replace(old, new))
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    matching = [
        problem
        for problem in caught.value.problems
        if problem.key == key and message in problem.message
    ]
    assert matching, str(caught.value)
