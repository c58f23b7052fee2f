"""Machines that nothing holds, or that are held in some directions only: what is free has 0 Hz, and
everything above is right.
"""

from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from common import approx
from fixture_machines import machine, write_scene

YOUNG, DENSITY, THICK, LONG = 210e9, 7850.0, 0.02, 1.0
MASS = DENSITY * THICK**2 * LONG
# of a beam, Hz times (beta L)^2: Euler and Bernoulli
BEAM_HZ = THICK / np.sqrt(12.0) / LONG**2 * np.sqrt(YOUNG / DENSITY) / (2.0 * np.pi)
FREE_FREE, PINNED_FREE = 22.3733, 15.4182
BAR = machine("""
machine = "bar"
names = { bar = "beam", foot = "end", tip = "other" }
without = ["joints", "points"]
free = true
materials.steel.LOSS = "LOSS"
components.beam.solid = { box = ["20 mm", "20 mm", "1000 mm"] }
components.beam.interfaces = { end = { face = "z+" }, other = { face = "z-", coupling = "average" } }
components.beam.COMPONENT = "COMPONENT"
effects.damping = "DAMPING"
[analyses]
modal = { count = 9 }
frf = { inputs = [["beam.end", "x"]], from = "1 Hz", up_to = "350 Hz" }
""")
ONE_END = 'interfaces = { end = { face = "z+" } }'
TWO_ENDS = 'interfaces = { end = { face = "z+" }, other = { face = "z-", coupling = "average" } }'


def run(folder: Path, text: str) -> hs.Results:
    scene = write_scene(folder, text)
    return hs.run(scene)


def bar(
    component: str = "", loss: str = "", damping: str = '{ modal = "1 %" }', ends: str = ONE_END
) -> str:
    return (
        BAR.replace('COMPONENT = "COMPONENT"', f"free = true\n{component}")
        .replace('LOSS = "LOSS"', loss)
        .replace('"DAMPING"', damping)
        .replace(TWO_ENDS, ends)
    )


@pytest.mark.parametrize(
    ("scene", "damping_ratio"),
    [
        (bar(), 0.01),
        (bar(ends=TWO_ENDS), 0.01),
        (bar('mesh = { size = "20 mm", cells = "hex" }'), 0.01),
        (bar('fidelity = "polynomial"'), 0.01),
        (bar('fidelity = "segmented"'), 0.01),
        (bar(loss="loss_factor = 0.02", damping="true"), 0.01),
        (bar('rayleigh = { beta = "3e-5 s" }', damping="true"), 0.01),
    ],
    ids=["tet", "two ends", "hex", "polynomial", "segmented", "loss factor", "rayleigh"],
)
def test_a_free_slender_bar_has_the_response_of_its_closed_form(
    tmp_path: Path, scene: str, damping_ratio: float
) -> None:
    results = run(tmp_path, scene)
    modes = results.modal[0]
    np.testing.assert_array_equal(modes.frequencies_hz[:6], 0.0)
    np.testing.assert_allclose(modes.frequencies_hz[6:8], FREE_FREE * BEAM_HZ, rtol=8e-3)
    response = results.frf["reference"]
    first = np.abs(response.curves.receptance[0, 0, 0])
    omega = 2.0 * np.pi * response.curves.frequencies_hz[0]
    # force at an end: mass and turn about the middle
    turned = 0.25 * LONG**2 / (MASS * (LONG**2 + THICK**2) / 12.0)
    assert first == approx((1.0 / MASS + turned) / omega**2, rel=3e-4)
    peak = response.peaks[0]
    ratio = damping_ratio * (2.0 * np.pi * 3e-5 * peak.hz / 0.02 if "3e-5" in scene else 1.0)
    highest = 4.0 / MASS / (2.0 * ratio * (2.0 * np.pi * peak.hz) ** 2)
    assert peak.height == approx(highest, rel=0.01)
    assert not any("no damping" in warning for warning in results.warnings)


def test_a_very_soft_mount_leaves_the_modes_above_it_alone(tmp_path: Path) -> None:
    held = bar().replace("free = true\n", "") + (
        '[joints.mount]\nbetween = ["beam.end", "ground"]\nkind = "spring"\n'
        'stiffness = { x = "1e-6 N/m", y = "1e-6 N/m", z = "1e-6 N/m", rx = "1e-6 N m/rad",'
        ' ry = "1e-6 N m/rad", rz = "1e-6 N m/rad" }\n'
    )
    results = run(tmp_path, held)
    modes = results.modal[0].frequencies_hz
    along = np.sqrt(1e-6 / MASS) / (2.0 * np.pi)
    assert np.abs(modes[:6] / along - 1.0).min() < 1e-6
    np.testing.assert_allclose(modes[6:8], FREE_FREE * BEAM_HZ, rtol=8e-3)


def test_a_bar_on_a_hinge_turns_freely(tmp_path: Path) -> None:
    hinged = bar(ends=TWO_ENDS).replace("free = true\n", "") + (
        '[joints.hinge]\nbetween = ["beam.other", "ground"]\nkind = "revolute"\naxis = "y"\n'
    )
    results = run(tmp_path, hinged)
    modes, curves = results.modal[0], results.frf["reference"].curves
    assert modes.rigid_count == 1 and modes.frequencies_hz[0] == 0.0
    assert np.abs(modes.frequencies_hz / (PINNED_FREE * BEAM_HZ) - 1.0).min() < 8e-3
    omega = 2.0 * np.pi * curves.frequencies_hz[0]
    assert np.abs(curves.receptance[0, 0, 0]) == approx(3.0 / MASS / omega**2, rel=2e-3)


@pytest.mark.parametrize(
    ("body", "joint", "free"),
    [
        ('solid = { point_mass = "2 kg" }\nfree = true', "", 3),
        ('solid = { box = ["20 mm", "20 mm", "100 mm"] }\nfidelity = "rigid"\nfree = true', "", 6),
        (
            'solid = { tube = { outer = "100 mm", length = "50 mm" } }\nfidelity = "rigid"\n'
            'interfaces = { bottom = { face = "z-" } }',
            '[joints.bearing]\nbetween = ["ground", "body.bottom"]\nkind = "revolute"\naxis = "z"',
            1,
        ),
    ],
    ids=["point mass", "rigid body", "rotor"],
)
def test_machines_without_any_elastic_mode_take_modal_damping(
    tmp_path: Path, body: str, joint: str, free: int
) -> None:
    steel = '[materials.steel]\nE = "210 GPa"\nnu = 0.3\nrho = "7850 kg/m^3"\n'
    material = "" if "point_mass" in body else 'material = "steel"\n'
    results = run(
        tmp_path,
        f"{'' if joint else 'free = true'}\n{steel}[components.body]\n{material}{body}\n{joint}\n"
        '[effects]\ndamping = { modal = "1 %" }\n[analyses.modal]\n',
    )
    np.testing.assert_array_equal(results.modal[0].frequencies_hz, np.zeros(free))


def test_a_polynomial_body_stands_on_one_interface(tmp_path: Path) -> None:
    results = run(
        tmp_path,
        '[materials.steel]\nE = "210 GPa"\nnu = 0.3\nrho = "7850 kg/m^3"\n[components.block]\n'
        'solid = { box = ["20 mm", "20 mm", "400 mm"] }\nmaterial = "steel"\n'
        'fidelity = "polynomial"\ninterfaces = { foot = { face = "z-" } }\n'
        '[joints.clamp]\nbetween = ["ground", "block.foot"]\nkind = "rigid"\n[analyses.modal]\n',
    )
    clamped = 3.51602 * BEAM_HZ / 0.4**2
    np.testing.assert_allclose(results.modal[0].frequencies_hz[:2], clamped, rtol=5e-3)


def test_three_legs_that_meet_in_a_point_leave_its_rotation_free(tmp_path: Path) -> None:
    legs = "\n".join(
        f"""[joints.leg{number}]
between = ["platform.center", "ground"]
kind = "spring"
at = ["{-0.1 * np.sin(angle):.15f} m", "{0.1 * np.cos(angle):.15f} m", "0 m"]
axis = [{np.sin(angle):.16f}, {-np.cos(angle):.16f}, 0.0]
normal = "z"
stiffness = {{ x = "1e7 N/m" }}"""
        for number, angle in enumerate(np.radians([7.0, 127.0, 247.0]))
    )
    results = run(
        tmp_path,
        '[components.platform]\nsolid = { point_mass = "10 kg", inertia = ["0.1 kg m^2",'
        ' "0.1 kg m^2", "0.1 kg m^2"] }\n[joints.plane]\nbetween = ["platform.center", "ground"]\n'
        'kind = "spring"\nstiffness = { z = "rigid", rx = "rigid", ry = "rigid" }\n'
        '[points]\ntcp = { tool = "platform.center", work = "ground" }\n'
        f"[analyses.modal]\n[analyses.static]\n{legs}\n",
    )
    modes = results.modal[0]
    assert modes.rigid_count == 1 and modes.energy_share[0] == {}
    hz = np.sqrt(1.5e7 / 10.0) / (2.0 * np.pi)
    np.testing.assert_allclose(modes.frequencies_hz, [0.0, hz, hz], rtol=1e-9)
    compliance = np.asarray(results.static["reference"]["tcp"].compliance)
    np.testing.assert_allclose(compliance[:2, :2], np.eye(2) / 1.5e7, atol=1e-16)


def test_figures_of_a_free_machine_are_those_of_a_line_that_has_a_value(tmp_path: Path) -> None:
    results = run(tmp_path, bar('fidelity = "rigid"').replace('from = "1 Hz"\n', ""))
    figures = results.frf["reference"].figures[0]
    lines = results.frf["reference"].curves.frequencies_hz
    assert figures.static is None
    assert figures.most_negative_real_hz == approx(lines[1])


def test_bodies_that_nothing_connects_do_not_move_each_other(tmp_path: Path) -> None:
    """Roundoff between twelve free motions is no peak, and none of them is a mode near a minimum."""
    beam = bar('fidelity = "polynomial"').replace("count = 9", "count = 20")
    start, end = beam.index("[components.beam]"), beam.index("[effects]")
    other = beam[start:end].replace("beam]", "other]").replace("1000 mm", "900 mm")
    text = beam[:end] + other + 'at = ["1 m", "0 mm", "0 mm"]\n' + beam[end:]
    text = text.replace('[["beam.end", "x"]]', '[["beam.end", "x"], ["other.end", "x"]]')
    results = run(tmp_path, text)
    response = results.frf["reference"]
    receptance = response.curves.receptance
    assert not receptance[:, 0, 1].any() and not receptance[:, 1, 0].any()
    assert np.abs(receptance[:, [0, 1], [0, 1]]).min() > 0.0
    assert len(response.heights) >= 2
    assert all(height.output == height.given for height in response.heights)
    assert [figures.minimum_dynamic_stiffness_mode for figures in response.figures] == ["", ""]
    assert any("nothing connects" in warning for warning in results.warnings)
