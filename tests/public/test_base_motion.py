"""A ground that moves: transmissibility of one degree of freedom, a beam on a shaken table."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from common import Shell, approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

STEEL = '[materials.steel]\nE = "210 GPa"\nnu = 0.3\nrho = "7850 kg/m^3"\n'
MASS, STIFFNESS, DAMPER = 40.0, 5e6, 800.0
HEAD = f"""{STEEL}
[components.head]
material = "steel"
solid = {{ box = ["100 mm", "80 mm", "60 mm"] }}
mass = "{MASS:g} kg"
fidelity = "rigid"
interfaces = {{ foot = {{ face = "z-" }}, tip = {{ face = "z+" }} }}
[joints.foot]
between = ["head.foot", "ground"]
kind = "spring"
stiffness = {{ x = "5 N/um", y = "rigid", z = "rigid", rx = "rigid", ry = "rigid", rz = "rigid" }}
damping = {{ x = "{DAMPER:g} N s/m" }}
[points.tcp]
tool = "head.tip"
work = "ground"
[loads.shake]
base = ["2 m/s^2", "0 m/s^2", "0 m/s^2"]
[effects]
damping = true
[analyses.frf]
inputs = ["shake"]
outputs = [["tcp", "x"]]
from = "20 Hz"
up_to = "200 Hz"
points = 10
adaptive = false
motion = "accelerance"
[analyses.transient]
duration = "40 ms"
up_to = "500 Hz"
outputs = [["tcp", "x"]]
loads = {{ shake = {{ load = "shake", shape = "sine", frequency = "35 Hz", factor = 0.5 }} }}
"""
LENGTH, HEIGHT, MODULUS, DENSITY = 0.3, 0.01, 210e9, 7850.0
BEAM = f"""{STEEL.replace("0.3", "0")}
[components.beam]
solid = {{ box = ["20 mm", "10 mm", "300 mm"] }}
material = "steel"
fidelity = "polynomial"
interfaces = {{ foot = {{ face = "z-" }}, tip = {{ face = "z+" }} }}
[joints.foot]
between = ["beam.foot", "ground"]
kind = "rigid"
[points.tip]
tool = "beam.tip"
work = "ground"
[loads.shake]
base = ["0 m/s^2", "1 m/s^2", "0 m/s^2"]
[analyses.frf]
inputs = ["shake"]
outputs = [["tip", "y"]]
from = "20 Hz"
up_to = "200 Hz"
points = 10
adaptive = false
motion = "accelerance"
"""


def read_response(shell: Shell) -> tuple[FloatArray, ComplexArray]:
    """Frequencies and acceleration relative to the ground per load."""
    shell("run scene.toml -o out --no-figures")
    rows = shell.rows("out/tables/frf_reference.csv")
    keys = [key for key in rows[0] if "shake" in key]
    real, imaginary = ([float(row[key]) for row in rows] for key in keys[:2])
    return np.array([float(row["frequency [Hz]"]) for row in rows]), np.array(real) + 1j * np.array(
        imaginary
    )


def test_one_degree_of_freedom_on_a_moving_ground_has_its_transmissibility(shell: Shell) -> None:
    shell.write(HEAD)
    frequencies, relative = read_response(shell)
    s = 2j * np.pi * frequencies
    passed = (DAMPER * s + STIFFNESS) / (MASS * s**2 + DAMPER * s + STIFFNESS)
    # absolute acceleration is that relative to the ground and the ground's own
    np.testing.assert_allclose(1.0 + relative / 2.0, passed, rtol=1e-6)
    rows = shell.rows("out/tables/transient_reference.csv")
    times, moved = (
        np.array([float(row[key]) for row in rows]) for key in ("time [s]", "tcp x [um]")
    )
    omega, own = 2.0 * np.pi * 35.0, np.sqrt(STIFFNESS / MASS)
    zeta = DAMPER / (2.0 * np.sqrt(STIFFNESS * MASS))
    steady = -1.0 / (own**2 - omega**2 + 2j * zeta * own * omega)
    damped = own * np.sqrt(1.0 - zeta**2)
    at_rest = np.array([-steady.imag, -omega * steady.real])  # of the steady state, taken off
    decay = np.exp(-zeta * own * times)
    free = at_rest[0] * np.cos(damped * times)
    free += (at_rest[1] + zeta * own * at_rest[0]) / damped * np.sin(damped * times)
    expected = (steady * np.exp(1j * omega * times)).imag + decay * free
    np.testing.assert_allclose(1e-6 * moved, expected, atol=1e-6 * np.abs(expected).max())


def test_a_beam_on_a_shaken_table_moves_as_euler_and_bernoulli_say(shell: Shell) -> None:
    shell.write(BEAM)
    frequencies, relative = read_response(shell)
    inertia, area = HEIGHT**2 / 12.0, 1.0
    wave = (
        DENSITY * area / (MODULUS * inertia) * (2.0 * np.pi * frequencies) ** 2
    ) ** 0.25 * LENGTH
    absolute = (np.cos(wave) + np.cosh(wave)) / (1.0 + np.cos(wave) * np.cosh(wave))
    missed = np.abs((1.0 + relative) / absolute - 1.0)
    # shear moves its resonance at 93 Hz by a part in a thousand
    assert np.median(missed) < 4e-3
    assert missed.max() < 0.06
    assert relative[-1].real == approx(absolute[-1] - 1.0, rel=3e-3)


def test_a_ground_that_moves_takes_no_place(shell: Shell) -> None:
    shell.write(HEAD, ('base = ["2', 'at = "head.tip"\nbase = ["2'))
    assert "base moves the whole ground; remove at" in shell.refuses("check scene.toml")


OMEGA = 2.0 * np.pi * 35.0
PLATE = """
[components.plate]
material = "steel"
solid = { box = ["100 mm", "80 mm", "20 mm"] }
at = ["0 mm", "0 mm", "-20 mm"]
fidelity = "rigid"
interfaces = { foot = { face = "z-" }, top = { face = "z+" } }
[joints.floor]
between = ["plate.foot", "ground"]
kind = "rigid"
"""
SHAKE = (
    'base = ["2 m/s^2", "0 m/s^2", "0 m/s^2"]',
    'joint = "{joint}"\ndisplacement = ["20 um", "0 um", "0 um"]',
)
SHAPE = ('shape = "sine", frequency = "35 Hz", factor = 0.5', 'shape = "{shape}"')
STATIC = ('[analyses.frf]\ninputs = ["shake"]', "[analyses.frf]\ninputs = ['tcp']")


def follow(moved: Callable[[float], tuple[float, float]], times: FloatArray) -> FloatArray:
    """Motion of the head on its spring and damper, whose ground moves, by an integrator of SciPy."""

    def rate(time: float, state: FloatArray) -> list[float]:
        place, speed = moved(time)
        pull = STIFFNESS * (place - state[0]) + DAMPER * (speed - state[1])
        return [state[1], pull / MASS]

    return solve_ivp(
        rate, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-16, max_step=2e-4
    ).y[0]


@pytest.mark.parametrize("joint", ["foot", "floor"])
@pytest.mark.parametrize(
    ("shape", "moved"),
    [
        ('sine", frequency = "35 Hz', lambda t: (np.sin(OMEGA * t), OMEGA * np.cos(OMEGA * t))),
        ('ramp", time = "10 ms', lambda t: (min(100.0 * t, 1.0), 100.0 * (t < 0.01))),
    ],
)
def test_a_displacement_over_time_moves_what_stands_on_the_joint(
    shell: Shell, joint: str, shape: str, moved: Callable[[float], tuple[float, float]]
) -> None:
    changes = [
        (SHAKE[0], SHAKE[1].format(joint=joint)),
        (SHAPE[0], SHAPE[1].format(shape=shape)),
        STATIC,
    ]
    if joint == "floor":
        changes += [
            ("[points.tcp]", PLATE + "[points.tcp]"),
            ('"head.foot", "ground"', '"head.foot", "plate.top"'),
        ]
    shell.write(HEAD, *changes)
    shell("run scene.toml -o out --no-figures --analysis transient")
    rows = shell.rows("out/tables/transient_reference.csv")
    times, found = (
        np.array([float(row[key]) for row in rows]) for key in ("time [s]", "tcp x [um]")
    )
    expected = 20.0 * follow(moved, times)
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("joint", ["foot", "floor"])
def test_a_harmonic_displacement_moves_what_stands_on_the_joint(shell: Shell, joint: str) -> None:
    changes = [(SHAKE[0], SHAKE[1].format(joint=joint)), ('motion = "accelerance"', "")]
    if joint == "floor":  # a rigid one, whose plate goes along with its inertia
        changes += [
            ("[points.tcp]", PLATE + "[points.tcp]"),
            ('"head.foot", "ground"', '"head.foot", "plate.top"'),
        ]
    shell.write(HEAD, *changes)
    frequencies, moved = read_response(shell)
    s = 2j * np.pi * frequencies
    passed = (DAMPER * s + STIFFNESS) / (MASS * s**2 + DAMPER * s + STIFFNESS)
    np.testing.assert_allclose(moved, 20e-6 * passed, rtol=1e-6)
    assert "is a displacement" in shell.refuses("export scene.toml --to npz --hz", "1 kHz")


def test_a_step_that_no_mass_can_follow_is_refused_with_what_would(shell: Shell) -> None:
    transient = "[analyses.transient]\nduration = '20 ms'\nloads.jump = { load = 'shake', shape = 'step' }\n"
    moved = 'joint = "foot"\ndisplacement = ["0 um", "20 um", "0 um"]'
    shell.write(
        BEAM,
        ('base = ["0 m/s^2", "1 m/s^2", "0 m/s^2"]', moved),
        ('[analyses.frf]\ninputs = ["shake"]', f"{transient}[analyses.frf]\ninputs = ['tip']"),
    )
    message = shell.prints("run scene.toml -o out --no-figures --analysis transient", code=1)
    assert "let it rise by a ramp" in message
