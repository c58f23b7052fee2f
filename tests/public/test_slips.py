"""What looks like a slip is said with its size and a remedy, and nothing else is."""

import re
from pathlib import Path

import pytest

import headstock as hs
from common import SHIPPED
from fixture_machines import stored_scene, write_scene

ROOT = Path(__file__).resolve().parents[2]
HEAD = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[analyses.modal]
"""
BED = """
[components.bed]
solid = { box = ["1 m", "500 mm", "250 mm"] }
material = "steel"
fidelity = "rigid"
[components.bed.interfaces]
bottom = { face = "z-" }
top = { face = "z+" }
"""
BLOCK = stored_scene("slips_block")
FEET = """
[joints.foot]
between = ["bed.bottom", "ground"]
kind = "mount"
places = [["400 mm", "200 mm", "0 mm"], ["-400 mm", "200 mm", "0 mm"], ["0 mm", "-200 mm", "0 mm"]]
stiffness = { vertical = "STIFFNESS", horizontal = "STIFFNESS" }
"""


SLIP = re.compile("apart|under the weight|beside")


def warnings_of(folder: Path, text: str) -> list[str]:
    return list(hs.check(write_scene(folder, HEAD + text)))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_machines_that_ship_have_no_slips(path: Path) -> None:
    assert [text for text in hs.check(path) if SLIP.search(text)] == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        # rails in the other order: each carriage hangs on the far one
        (
            ('"160 mm", "790 mm"], ["-160 mm"', '"-160 mm", "790 mm"], ["160 mm"'),
            "beside column.rail_1",
        ),
        (
            ('middle = ["0 mm", "-405 mm"', 'middle = ["0 mm", "5 mm"'),
            "435 mm beside column.rail_1",
        ),
    ],
)
def test_carriages_beside_their_rail(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    mill = next(path for path in SHIPPED if path.stem == "mill").read_text()
    found = [each for each in hs.check(write_scene(tmp_path, mill, change)) if "beside" in each]
    assert len(found) == 1 and words in found[0] and "which rail it names" in found[0]


def test_an_axis_whose_travel_ends_beyond_its_rail_has_limits_that_do(tmp_path: Path) -> None:
    mill = next(path for path in SHIPPED if path.stem == "mill").read_text()
    old = 'X = { joints = ["x_carriage", "x_screw"], direction = "x", limits = ["-150 mm", "150 mm"] }'
    wide = old.replace('"-150 mm", "150 mm"', '"-150 mm", "185 mm"')
    (told,) = [
        text
        for text in hs.check(write_scene(tmp_path, mill, (old, wide)))
        if "over the end" in text
    ]
    assert told == (
        "axis X: at 185 mm the carriage of joint x_carriage_1 hangs 35 mm over the end of rail saddle.rail_1; "
        'write limits = ["-150 mm", "150 mm"], or make the rail longer'
    )


def test_a_normal_along_the_axis_of_carriages_is_named(tmp_path: Path) -> None:
    mill = next(path for path in SHIPPED if path.stem == "mill").read_text()
    change = ('axis = "x"\nnormal = "z"\nlength', 'axis = "x"\nnormal = "-x"\nlength')
    with pytest.raises(
        hs.SceneError, match=r"joints\.x_carriage_1\.normal[^:]*parallel to axis[^:]*1 problem"
    ):
        hs.check(write_scene(tmp_path, mill, change))


def test_a_point_mass_has_no_interface_to_be_described(tmp_path: Path) -> None:
    motor = '[components.motor]\nsolid = { point_mass = "2 kg" }\n'
    joint = '[joints.hold]\nkind = "rigid"\nbetween = ["motor.middle", "ground"]\n'
    with pytest.raises(hs.SceneError, match=r"interfaces of motor: center\n1 problem"):
        hs.check(write_scene(tmp_path, HEAD + motor + joint))


RIGID = 'kind = "rigid"\n[joints.floor]'
GUIDE = (
    'kind = "linear_guide"\naxis = "AXIS"\nstiffness = { lateral = "1 N/um", normal = "1 N/um" }\n'
    "[joints.floor]"
)
PAD = ', disk = { center = ["0 mm", "0 mm"], diameter = "40 mm" } }'


@pytest.mark.parametrize(
    ("place", "joint", "words"),
    [
        ("0 mm", RIGID, ""),
        ("540 mm", RIGID, ""),  # over the edge of the bed, but on it
        ("4.6 m", RIGID, "4.6 m apart"),
        # along its travel a carriage may be anywhere, across it not
        ("1.4 m", GUIDE.replace("AXIS", "x"), ""),
        ("1.4 m", GUIDE.replace("AXIS", "y"), "1.4 m apart across its direction of travel"),
    ],
)
def test_ends_of_a_joint_that_lie_apart(tmp_path: Path, place: str, joint: str, words: str) -> None:
    text = BED + BLOCK.replace("PLACE", place).replace(RIGID, joint)
    found = [each for each in warnings_of(tmp_path, text) if "apart" in each]
    assert len(found) == bool(words)
    for each in found:
        assert words in each
        assert all(part in each for part in ("block.foot and bed.top", "measures 1 m", "`at`"))


@pytest.mark.parametrize(
    ("height", "words"), [("0.27 m", ""), ("0.381 m", "131 mm"), ("6.25 m", "6 m")]
)
def test_ends_of_small_interfaces(tmp_path: Path, height: str, words: str) -> None:
    text = (
        (BED + BLOCK)
        .replace('"z+" }', f'"z+"{PAD}')
        .replace('foot = { face = "z-" }', f'foot = {{ face = "z-"{PAD}')
    )
    text = text.replace('"PLACE", "0 mm", "250 mm"', f'"0 mm", "0 mm", "{height}"')
    found = [each for each in warnings_of(tmp_path, text) if "apart" in each]
    assert len(found) == bool(words)
    assert all(f"{words} apart" in each and "40 mm" in each for each in found)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FEET.replace("STIFFNESS", "200 N/m"), "foot_1..3 sinks by 24.1 m"),
        (FEET.replace("STIFFNESS", "200 N/um"), ""),
        (FEET.replace("STIFFNESS", "30 N/mm").replace("kind", "soft = true\nkind"), ""),
        ('[joints.spring]\nfrom = "catalogue:air_spring_5kN"\nbetween = ["bed.bottom", "ground"]\n'
         "places = [['400 mm', '200 mm', '0 m'], ['-400 mm', '200 mm', '0 m'], ['0 m', '-200 mm', '0 m']]\n", ""),
        # on a plate whose own feet are too soft
        (
            '[components.plate]\nsolid = { box = ["1 m", "1 m", "50 mm"] }\nmaterial = "steel"\nfidelity = "rigid"\n'
            'at = ["0 mm", "0 mm", "-50 mm"]\ninterfaces = { low = { face = "z-" }, high = { face = "z+" } }\n'
            '[joints.bolts]\nbetween = ["bed.bottom", "plate.high"]\nkind = "rigid"\n'
            '[joints.pad]\nbetween = ["plate.low", "ground"]\nkind = "mount"\n'
            'stiffness = { vertical = "900 N/mm", horizontal = "1 kN/mm", tilt = "1 kN m/mrad", torsion = "1 kN m/mrad" }\n',
            "pad sinks by 15 mm",
        ),
        # hanging from the ceiling
        (
            '[joints.rope]\nbetween = ["bed.top", "ground"]\nkind = "spring"\n'
            'stiffness = { x = "1 N/um", y = "1 N/um", z = "1 N/um", rx = "1 kN m/mrad", ry = "1 kN m/mrad", rz = "1 kN m/mrad" }\n',
            "rope sinks by 9.62 mm",
        ),
        # masses only
        (
            '[components.mass]\nsolid = { point_mass = "2 t" }\n[joints.hung]\nbetween = ["mass.center", "ground"]\n'
            'kind = "spring"\nstiffness = { x = "1 N/um", y = "1 N/um", z = "4 N/um" }\n'
            '[joints.floor]\nbetween = ["bed.bottom", "ground"]\nkind = "rigid"\n',
            "hung sinks by 4.9 mm",
        ),
    ],
)  # fmt: skip
def test_a_support_that_sinks(tmp_path: Path, text: str, words: str) -> None:
    found = [each for each in warnings_of(tmp_path, BED + text) if "under the weight" in each]
    assert len(found) == bool(words)
    assert all(words in each and "soft = true" in each for each in found)


CORNERS = "000 100 110 010 001 101 111 011".split()  # noqa: SIM905


def cube(size: float) -> str:
    """A mesh of one cell."""
    nodes = [", ".join(str(size * int(one)) for one in corner) for corner in CORNERS]
    lines = [f"{number}, {node}\n" for number, node in enumerate(nodes, 1)]
    return f"*NODE\n{''.join(lines)}*ELEMENT, TYPE=C3D8, ELSET=ALL\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"


MESH = """
[components.part]
solid = { mesh = "part.inp"UNIT }
material = "steel"
fidelity = "rigid"
interfaces = { foot = { face = "z-" } }
[joints.floor]
between = ["part.foot", "ground"]
kind = "bolted"
stiffness = { normal = "1e5 N/um", shear = "1e5 N/um", tilt = "1e9 N m/rad", torsion = "1e9 N m/rad" }
soft = true
"""


@pytest.mark.parametrize(
    ("size", "unit", "words"),
    [
        (300, "", 'unit = "1 mm" (0.3 m)'),
        (12, "", 'unit = "1 inch" (0.305 m)'),
        (300, ', unit = "1 mm"', ""),
        (1.5, "", ""),
        (0.05, ', unit = "1 mm"', 'unit = "1 m" (0.05 m)'),
        (12, ', unit = "1 inch"', ""),
    ],
)
def test_the_unit_of_a_mesh_in_doubt(tmp_path: Path, size: float, unit: str, words: str) -> None:
    (tmp_path / "part.inp").write_text(cube(size))
    checked = warnings_of(tmp_path, MESH.replace("UNIT", unit))
    for warnings in (checked, hs.run(tmp_path / "scene.toml").warnings):
        found = [each for each in warnings if "part.inp" in each]
        assert len(found) == bool(words)
        assert words in "".join(found)


LOBES = {
    "speeds": ["3000 rpm", "6000 rpm", 2],
    "mill": {"diameter": "20 mm", "teeth": 4},
    "material": "al7075-t6",
    "radial_depth": "5 mm",
    "tool_modes": [{"name": "a", "frequency": "900 Hz", "damping": 4, "stiffness": "60 N/um"}],
}


@pytest.mark.parametrize(
    "setting",
    [
        {"effects": {"damping": {"modal": 2}}},
        {"effects": {"damping": {"modal": ["2 %", "100 %"]}}},
        {"materials.steel.loss_factor": 1.0},
        {"joints.foot_1.loss_factor": "150 %"},
        {"analyses.lobes": LOBES},
    ],
)
def test_damping_of_a_hundred_per_cent_is_refused(
    tmp_path: Path, setting: dict[str, object]
) -> None:
    points = '[points]\ntcp = { tool = "bed.top", work = "ground" }\n'
    path = write_scene(tmp_path, HEAD + BED + points + FEET, ("STIFFNESS", "200 N/um"))
    with pytest.raises(hs.SceneError, match=r"lies between 0 and 1 \(100 %\)"):
        hs.load(path, set=setting)


@pytest.mark.parametrize(
    ("mass", "count", "words"),
    [
        ("2e-19", 3, ("2 modes of the 3", "c_2 (2e-19 kg)", "inertia")),
        ("2", None, ()),
        ("2", 9, ("3 modes of the 9", "3 degrees of freedom")),
    ],
)
def test_fewer_modes_than_asked_for_have_a_reason(
    tmp_path: Path, mass: str, count: int | None, words: tuple[str, ...]
) -> None:
    chain = '[chains.c]\nfrom = "ground"\naxis = "x"\nmasses = ["1 kg", "MASS kg", "1 kg"]\n'
    springs = 'stiffness = ["1 N/um", "2 N/um", "1 N/um"]\n'
    path = write_scene(tmp_path, f"[analyses.modal]\n{chain}{springs}", ("MASS", mass))
    machine = hs.load(path, set={"analyses.modal.count": count} if count else {})
    found = [each for each in hs.run(machine).warnings if "modal.count" in each]
    assert len(found) == bool(words)
    assert all(word in found[0] for word in words)
