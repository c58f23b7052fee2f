"""Drives of rotary axes: closed forms of a table that its motor turns, directly, by a gear, along a path."""

import numpy as np
import pytest

from common import Shell, approx

RATIO, ROTOR, GAIN, KV, INTEGRAL = 5.0, 2e-3, 4.0, 30.0, 0.02
WIDTH, DEPTH, MASS, RADIUS = 0.2, 0.1, 50.0, 0.08
GEAR = 4e5
SCENE = f"""
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.table]
material = "steel"
solid = {{ box = ["{WIDTH} m", "{DEPTH} m", "50 mm"] }}
mass = "{MASS} kg"
fidelity = "rigid"
interfaces = {{ foot = {{ face = "z-" }}, top = {{ face = "z+" }} }}
[joints.bearing]
between = ["table.foot", "ground"]
kind = "spring"
stiffness = {{ x = "rigid", y = "rigid", z = "rigid", rx = "rigid", ry = "rigid", rz = "rigid" }}
[axes.C]
kind = "rotary"
joint = "bearing"
direction = "z"
limits = ["-90 deg", "90 deg"]
[points.tcp]
tool = "table.top"
work = "ground"
offset = ["{RADIUS} m", "0 m", "0 m"]
[drives.C]
inertia = "{ROTOR} kg m^2"
ratio = {RATIO}
kv = "{KV} 1/s"
velocity_gain = "{GAIN} N m s/rad"
integral_time = "{INTEGRAL} s"
[effects]
drive_control = true
[analyses.control]
up_to = "5 kHz"
speed = "1 m/s"
"""
PATH = """
[analyses.path]
from = { C = "-10 deg" }
to = { C = "10 deg" }
feeds = ["60 deg/s"]
time_constant = "50 ms"
outputs = [["tcp", "y"]]
sampling = "2 kHz"
pose_model = "frozen"
on_request = true
"""
INERTIA = MASS * (WIDTH**2 + DEPTH**2) / 12.0
WHOLE = INERTIA + ROTOR * RATIO**2
ALONG = GAIN * RATIO**2


def read_poles(shell: Shell) -> list[complex]:
    shell("run scene.toml -o out --no-figures")
    (control,) = shell.json("out/summary.json")["control"].values()
    return [complex(pole["real"], pole["imag"]) for pole in control["poles"]]


def test_a_table_that_its_motor_turns_rigidly_has_the_poles_of_its_inertia(shell: Shell) -> None:
    shell.write(SCENE)
    expected = np.roots([WHOLE, ALONG, ALONG * (KV + 1.0 / INTEGRAL), ALONG * KV / INTEGRAL])
    found = read_poles(shell)
    assert sorted(pole.real for pole in found if pole.imag >= 0.0) == approx(
        sorted(float(root.real) for root in expected if root.imag >= 0.0), rel=1e-6
    )


def test_a_gear_that_twists_adds_its_resonance(shell: Shell) -> None:
    shell.write(SCENE, ('rz = "rigid"', f'rz = "{GEAR} N m/rad"'))
    rotor = ROTOR * RATIO**2
    resonance = np.sqrt(GEAR * (1.0 / INERTIA + 1.0 / rotor)) / (2.0 * np.pi)
    assert len(read_poles(shell)) >= 3
    (band,) = shell.json("out/summary.json")["guards"]["bands"]
    assert band["lowest_hz"] == band["highest_hz"] == approx(resonance, rel=1e-6)


def test_torque_goes_in_and_angles_come_out_of_the_exported_table(shell: Shell) -> None:
    shell.write(SCENE)
    shell("export scene.toml --to npz --motors free -o free.npz --state-space", "100 Hz")
    plant = np.load(shell.folder / "free.npz")
    inputs, outputs = list(plant["inputs"]), list(plant["outputs"])
    column, row = inputs.index("C force"), outputs.index("C motor")
    assert plant["input_units"][column] == "N.m" and plant["output_units"][row] == "rad"
    s = 10j
    inner = np.linalg.solve(s * np.eye(len(plant["A"])) - plant["A"], plant["B"][:, column])
    moved = plant["C"] @ inner
    assert complex(moved[row]) == approx(1.0 / (WHOLE * s**2), rel=1e-9)
    assert complex(moved[outputs.index("tcp y")]) == approx(RADIUS / (WHOLE * s**2), rel=1e-9)


@pytest.mark.parametrize("gear", [None, GEAR])
def test_torque_and_set_angle_move_the_encoder_as_two_inertias(
    shell: Shell, gear: float | None
) -> None:
    changes = [] if gear is None else [('rz = "rigid"', f'rz = "{gear} N m/rad"')]
    rotor = ROTOR * RATIO**2
    for motors, given in (("free", "torque"), ("controlled", "command_angle")):
        frf = (
            f"[analyses.frf]\ninputs = [['C', '{given}']]\noutputs = [['C', 'motor_angle'], ['tcp', 'y']]\n"
            f"from = '5 Hz'\nup_to = '100 Hz'\npoints = 4\nadaptive = false\nmotors = '{motors}'\n"
        )
        shell.write(SCENE + frf, *changes)
        shell("run scene.toml -o out --no-figures --analysis frf")
        rows = shell.rows("out/tables/frf_reference.csv")
        assert len(rows) == 4
        per = "N m" if given == "torque" else "rad"
        for row in rows:
            s = 2j * np.pi * float(row["frequency [Hz]"])
            motor = (
                1.0 / (WHOLE * s**2)
                if gear is None
                else (INERTIA * s**2 + gear)
                / (rotor * INERTIA * s**4 + gear * (rotor + INERTIA) * s**2)
            )
            table = motor if gear is None else motor * gear / (INERTIA * s**2 + gear)
            law = ALONG * (1.0 + 1.0 / (INTEGRAL * s))
            force = law * KV / (1.0 + law * (KV + s) * motor) if given != "torque" else 1.0
            for name, unit, moved in (
                ("C motor_angle", "rad", motor),
                ("tcp y", "m", RADIUS * table),
            ):
                found = (
                    float(row[f"{part} {name} / C {given} [{unit} per {per}]"])
                    for part in ("Re", "Im")
                )
                assert complex(*found) == approx(complex(moved * force), rel=1e-6)
    shell.change(("command_angle", "command"))
    assert 'C turns; write "command_angle"' in shell.refuses("check scene.toml")


def test_a_table_that_turns_at_constant_speed_lags_by_speed_over_kv(shell: Shell) -> None:
    soft = ('x = "rigid", y = "rigid"', 'x = "500 N/um", y = "500 N/um"')
    shell.write(SCENE + PATH, soft)
    shell("run scene.toml -o out --no-figures --analysis path")
    rows = shell.rows("out/tables/path_3600.csv")
    middle = min(rows, key=lambda row: abs(float(row["position [deg]"]) - 15.0))
    lag = np.radians(60.0) / KV
    assert float(middle["position error of C [um]"]) == approx(1e6 * lag, rel=1e-3)
    assert float(middle["deviation tcp y [um]"]) == approx(-1e6 * RADIUS * lag, rel=1e-2)
    # the same controller as a transfer function from the speed error of the axis to the torque of the motor
    numbers = [GAIN * RATIO, GAIN * RATIO / INTEGRAL]  # the motor turns RATIO times as fast
    own = f"controller = {{ num = {numbers}, den = [1, 0], output = 'torque' }}"
    gains = f'velocity_gain = "{GAIN} N m s/rad"\nintegral_time = "{INTEGRAL} s"'
    shell.write(SCENE + PATH, soft, (gains, own))
    shell("run scene.toml -o out --no-figures --analysis path")
    for row, other in zip(rows, shell.rows("out/tables/path_3600.csv"), strict=True):
        for key in ("torque of C [N m]", "deviation tcp y [um]"):
            assert float(other[key]) == approx(float(row[key]), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((f"ratio = {RATIO}", 'lead = "10 mm"'), "is rotary, and its drive has no lead"),
        ((f"{GAIN} N m s/rad", "2e4 N s/m"), "write a torque per speed of the motor"),
    ],
)
def test_keys_of_linear_drives_are_refused(
    shell: Shell, change: tuple[str, str], words: str
) -> None:
    shell.write(SCENE, change)
    assert words in shell.refuses("check scene.toml")
