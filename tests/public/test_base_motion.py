"""A ground that moves: transmissibility of one degree of freedom, a beam on a shaken table."""

import numpy as np

from common import Shell, approx

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


def read_response(shell: Shell) -> tuple[np.ndarray, np.ndarray]:
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
