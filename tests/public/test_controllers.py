"""Controllers that are written as transfer functions and state spaces move the machine as the cascade
does, and as they do outside.
"""

import re
import zipfile
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.signal

from common import Shell, approx
from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

CASCADE = 'velocity_gain = "2e4 N s/m"\nintegral_time = "20 ms"'
GAIN = 'kv = "50 1/s"\n'
RUN = "run scene.toml -o out --no-figures"
FREE = 'export scene.toml --to npz --state-space "2 kHz" --motors'


def write(shell: Shell, *changes: tuple[str, str], add: str = "") -> None:
    shell.write(stored_scene("control"), *changes)
    shell.change(add=add)


def read_control(shell: Shell) -> Any:
    shell(RUN)
    (control,) = shell.json("out/summary.json")["control"].values()
    return control


@pytest.mark.parametrize(
    "controller",
    [
        "{ num = [2e4, 1e6], den = [1, 0] }",
        "{ a = [[0]], b = [[1e6]], c = [[1]], d = [[2e4]] }",
        "{ inputs = ['position_error', 'motor_velocity'], a = [[0]], b = [[50, -1]], c = [[1e6]], d = [[1e6, -2e4]] }",
    ],
)
def test_a_controller_with_the_numbers_of_the_cascade_is_the_cascade(
    shell: Shell, controller: str
) -> None:
    write(shell)
    cascade = read_control(shell)
    gain = "" if "position" in controller else GAIN
    write(shell, (GAIN, gain), (CASCADE, f"controller = {controller}"))
    other = read_control(shell)
    for name in ("frequency_hz", "damping_ratio", "real"):
        values = [[pole[name] for pole in one["poles"]] for one in (cascade, other)]
        assert len(values[0]) > 2
        np.testing.assert_allclose(values[1], values[0], rtol=1e-6, atol=1e-9)
    expected, found = (one["drives"]["X"] for one in (cascade, other))
    assert found["velocity_lag_um"] == approx(expected["velocity_lag_um"], rel=1e-9)
    for name, value in expected["margins"].items():
        assert found["margins"][name] == (None if value is None else approx(value, rel=1e-9))


def close_outside(plant: Any, num: list[float], den: list[float], up_to: float) -> ComplexArray:
    """The poles of a loop of position errors around an exported machine, by matrices of SciPy."""
    a, b, c, d = scipy.signal.tf2ss(num, den)
    force = plant["B"][:, [list(plant["inputs"]).index("X force")]]
    row = list(plant["outputs"]).index("X motor")
    moved = plant["C"][[row]]
    assert not plant["D"][row].any()
    whole = np.block([[plant["A"] - force @ d @ moved, force @ c], [-b @ moved, a]])
    poles = np.linalg.eigvals(whole)
    return np.sort_complex(poles[(np.abs(poles) < 2.0 * np.pi * up_to) & (poles.imag >= 0.0)])


def test_a_loop_closed_around_the_exported_machine_has_the_poles_of_the_scene(
    shell: Shell,
) -> None:
    num, den = [3e4, 2e6, 2e7], [1e-4, 1.0, 0.0]
    controller = f"controller = {{ num = {num}, den = {den} }}"
    write(shell, (GAIN, ""), (CASCADE, controller), ("\ncoupling", "\n#"))
    scene = read_control(shell)
    shell("export scene.toml --to npz --motors free -o free.npz --state-space", "20 kHz")
    outside = close_outside(np.load(shell.folder / "free.npz"), num, den, 500.0)
    inside = [complex(pole["real"], pole["imag"]) for pole in scene["poles"]]
    assert len(outside) > 3
    np.testing.assert_allclose(np.sort_complex(inside), outside, rtol=1e-6)


def test_a_notch_takes_its_frequency_out_of_the_exported_loop(shell: Shell) -> None:
    write(shell, (CASCADE, CASCADE + '\nfilters = [{ notch = "90 Hz", depth = "10 %" }]'))
    shell("export scene.toml --to npz --motors controlled -o closed.npz --state-space", "20 kHz")
    loop = np.load(shell.folder / "closed.npz")
    write(shell)
    shell("export scene.toml --to npz --motors controlled -o plain.npz --state-space", "20 kHz")
    plain = np.load(shell.folder / "plain.npz")

    def respond(space: Any, output: str, hz: float) -> complex:
        row, column = (
            list(space[key]).index(name) for key, name in (("outputs", output), ("inputs", "tcp x"))
        )
        inner = np.linalg.solve(2j * np.pi * hz * np.eye(len(space["A"])) - space["A"], space["B"])
        return complex((space["C"] @ inner + space["D"])[row, column])

    # what the controller makes of the motion of its motor
    through = [
        respond(one, "X force", 90.0) / respond(one, "X motor", 90.0) for one in (loop, plain)
    ]
    assert abs(through[0] / through[1]) == approx(0.1, rel=1e-6)


def test_a_discrete_controller_acts_as_the_continuous_one_it_was_made_of(shell: Shell) -> None:
    num, den = [3e4, 2e6, 2e7], [1e-4, 1.0, 0.0]
    step = 1e-4
    zeros, poles, _ = scipy.signal.cont2discrete((num, den), step, method="bilinear")
    lists = [part.ravel().tolist() for part in (zeros, poles)]
    write(
        shell,
        (GAIN, ""),
        (CASCADE, f"controller = {{ num = {num}, den = {den} }}\ndead_time = '50 us'"),
    )
    continuous = read_control(shell)
    write(
        shell,
        (GAIN, ""),
        (CASCADE, f"controller = {{ num = {lists[0]}, den = {lists[1]}, step = '100 us' }}"),
    )
    discrete = read_control(shell)
    values = [[pole["real"] for pole in one["poles"]] for one in (continuous, discrete)]
    assert len(values[0]) > 3
    np.testing.assert_allclose(values[1], values[0], rtol=1e-6)


def test_a_slow_step_says_how_far_the_continuous_loop_is_from_the_sampled_one(shell: Shell) -> None:
    step, kp, kv, tn = 2.5e-3, 2e4, 50.0, 0.02
    law = (
        f"controller = {{ num = [{kp}, {kp * (step / tn - 1.0)}], den = [1, -1], step = '2.5 ms' }}"
    )
    write(shell, (CASCADE, law), ("\ncoupling", "\n#"))
    shell.change(("[analyses.control]", "[analyses.control]\nup_to = '100 Hz'"))
    control = read_control(shell)
    shell("export scene.toml --to npz --motors free -o free.npz --state-space", "20 kHz")
    plant = np.load(shell.folder / "free.npz")
    rows = plant["C"][[list(plant["outputs"]).index("X motor")]]
    column = plant["B"][:, [list(plant["inputs"]).index("X force")]]
    read = np.vstack([rows, rows @ plant["A"]])
    a, b, *_ = scipy.signal.cont2discrete((plant["A"], column, read, np.zeros((2, 1))), step)
    gains = np.array([[kv, 1.0]])
    force = kp * np.array([[step / tn]])
    whole = np.block([[a - kp * b @ gains @ read, b @ force], [-gains @ read, np.eye(1)]])
    sampled = np.log(np.linalg.eigvals(whole) + 0j) / step
    poles = np.array([complex(pole["real"], pole["imag"]) for pole in control["poles"]])
    near = poles[np.abs(poles) < 2.0 * np.pi * 40.0]
    distances = np.abs(near[:, None] - sampled).min(axis=1) / np.abs(near)
    assert len(near) and control["sampled"]["share"] == approx(float(distances.max()), rel=1e-4)
    assert control["sampled"]["share"] > 0.01
    assert control["sampled"]["up_to_hz"] == approx(40.0)
    assert "poles of the sampled loops differ" in shell.prints(RUN)
    # loads over time sample and hold as it does, where samples of the motion divide its step
    push = 'loads.push = { at = ["tcp", "x"], shape = "step", size = "10 N" }'
    table = f"duration = '20 ms'\nup_to = '200 Hz'\nmotors = 'controlled'\noutputs = [['tcp', 'x']]\n{push}\n"
    shell.change(add=f"\n[analyses.transient]\nsampling = '4 kHz'\n{table}")
    assert "act in continuous time here" not in shell.prints(f"{RUN} --analysis transient")
    rows = shell.rows("out/tables/transient_reference.csv")[:-1:10]
    shell("export scene.toml --to npz --motors free -o low.npz --state-space", "200 Hz")
    expected = hold_outside(np.load(shell.folder / "low.npz"), (kp, kv, tn), step, 10.0, len(rows))
    found = [float(row["tcp x [um]"]) for row in rows]
    np.testing.assert_allclose(found, 1e6 * expected, atol=1e-5 * 1e6 * np.abs(expected).max())
    shell.change(("'4 kHz'", "'4.1 kHz'"))
    assert "act in continuous time here" in shell.prints(f"{RUN} --analysis transient")


def hold_outside(
    plant: Any, law: tuple[float, float, float], step: float, load: float, count: int
) -> FloatArray:
    """Motion of the tool at samples under a load from time zero on, a PI controller sampled around an
    exported machine, by matrices of SciPy.
    """
    (kp, kv, tn), outputs, inputs = law, list(plant["outputs"]), list(plant["inputs"])
    columns = [inputs.index(name) for name in ("X force", "tcp x")]
    motor, tool = (outputs.index(name) for name in ("X motor", "tcp x"))
    whole = (plant["A"], plant["B"][:, columns], plant["C"], plant["D"][:, columns])
    a, b, c, d, _ = scipy.signal.cont2discrete(whole, step)
    states, given, summed = np.zeros(len(a)), np.array([0.0, load]), 0.0
    moved = [c[tool] @ states + d[tool] @ given]
    while len(moved) < count:
        states = a @ states + b @ given
        place = c[motor] @ states + d[motor] @ given
        error = -kv * place - c[motor] @ plant["A"] @ states
        given[0] = kp * (error + step / tn * summed)
        summed += error
        moved.append(c[tool] @ states + d[tool] @ given)
    return np.array(moved)


@pytest.mark.parametrize(
    ("controller", "words"),
    [
        ("{ num = [1, 0, 0], den = [1, 0] }", "not proper: num has degree 2 and den 1"),
        ("{ num = [1], den = [0, 1] }", "den begins with zero"),
        ("{ num = [1] }", "has num, but no den"),
        ("{ a = [[0]], b = [[1, 2]], c = [[1]] }", "b has 1 rows of 2 numbers"),
        ("{ num = [1], den = [1, 1], step = '1 ms' }", "pole at z = -1"),
        ("{ num = [1], den = [1, 0], inputs = ['set_velocity', 'motor_velocity'] }", "2 inputs"),
        ("{ }", "is empty"),
    ],
)
def test_a_controller_that_cannot_be_is_named_with_file_and_line(
    shell: Shell, controller: str, words: str
) -> None:
    write(shell, (CASCADE, f"controller = {controller}"))
    message = shell.refuses("check scene.toml")
    assert re.search(r"scene\.toml:\d+: drives\.X\.controller", message)
    assert words in message


def test_an_unstable_controller_is_named_with_its_axis_and_no_key_that_it_lacks(
    shell: Shell,
) -> None:
    write(
        shell, (GAIN, ""), (CASCADE, "controller = { num = [1e8], den = [1] }\ndead_time = '1 ms'")
    )
    message = " ".join(shell.prints(RUN, code=1).split())
    assert "the control of axis X is unstable" in message
    assert "no smaller gain of its controller is stable either" in message
    assert "velocity_gain" not in message


def test_frequency_responses_take_motors_as_inputs_and_encoders_as_outputs(shell: Shell) -> None:
    frf = (
        "\n[analyses.frf]\ninputs = [['X', 'force'], ['tcp', 'x']]\noutputs = [['X', 'motor'], ['X', 'scale']]\n"
        "from = '10 Hz'\nup_to = '500 Hz'\npoints = 5\nadaptive = false\nmotors = 'free'\n"
    )
    write(shell, add=frf)
    shell(f"{RUN} --analysis frf")
    shell("export scene.toml --to npz --motors free -o free.npz --state-space", "20 kHz")
    plant = np.load(shell.folder / "free.npz")
    rows = shell.rows("out/tables/frf_reference.csv")
    assert len(rows) == 5
    inputs, outputs = list(plant["inputs"]), list(plant["outputs"])
    for row in rows:
        s = 2j * np.pi * float(row["frequency [Hz]"])
        moved = plant["C"] @ np.linalg.solve(s * np.eye(len(plant["A"])) - plant["A"], plant["B"])
        for output in ("X motor", "X scale"):
            keys = [key for key in row if output in key and "X force" in key]
            real, imaginary = (float(row[key]) for key in keys[:2])
            found = complex(real, imaginary)
            expected = moved[outputs.index(output), inputs.index("X force")]
            assert found == approx(complex(expected), rel=1e-3)


def test_a_set_point_moves_encoder_and_tool_as_the_exported_machine_in_an_outside_loop(
    shell: Shell,
) -> None:
    frf = (
        "\n[analyses.frf]\ninputs = [['X', 'command']]\noutputs = [['X', 'motor'], ['tcp', 'x']]\n"
        "up_to = '500 Hz'\npoints = 6\nadaptive = false\nmotors = 'controlled'\n"
    )
    late, share, kv, kp, tn = 2e-4, 0.5, 50.0, 2e4, 0.02
    write(
        shell,
        (CASCADE, CASCADE + "\nfeed_forward = { velocity = '50 %' }\ndead_time = '200 us'"),
        add=frf,
    )
    shell(f"{RUN} --analysis frf")
    rows = shell.rows("out/tables/frf_reference.csv")
    write(shell)
    shell("export scene.toml --to npz --motors free -o free.npz --state-space", "20 kHz")
    plant = np.load(shell.folder / "free.npz")
    column = list(plant["inputs"]).index("X force")
    names = ["X motor", "tcp x"]
    wanted = [list(plant["outputs"]).index(name) for name in names]
    assert len(rows) == 6
    for row in rows:
        entries = [
            complex(*(float(row[f"{part} {name} / X command [m per m]"]) for part in ("Re", "Im")))
            for name in names
        ]
        s = 2j * np.pi * float(row["frequency [Hz]"])
        if s == 0.0:  # the integrator leaves no error of the motor
            assert entries[0] == approx(1.0, rel=1e-9)
            continue
        inner = np.linalg.solve(s * np.eye(len(plant["A"])) - plant["A"], plant["B"][:, column])
        motor, tool = (plant["C"] @ inner + plant["D"][:, column])[wanted]
        law = kp * (1.0 + 1.0 / (tn * s)) * np.exp(-late * s)
        force = law * (kv + share * s) / (1.0 + law * (kv + s) * motor)
        assert entries == approx([motor * force, tool * force], rel=1e-5)


def test_channels_of_drives_belong_to_motors_that_move(shell: Shell) -> None:
    frf = "\n[analyses.frf]\ninputs = [['X', 'force']]\noutputs = [['X', 'motor']]\nup_to = '500 Hz'\n"
    write(shell, add=frf)
    assert 'write motors = "free"' in shell.refuses("check scene.toml")
    write(shell, add=frf.replace("'motor'", "'force'") + "motors = 'free'\n")
    assert "motor and scale are outputs" in shell.refuses("check scene.toml")


def test_an_fmu_under_control_takes_set_points(shell: Shell) -> None:
    write(shell)
    shell(
        "export scene.toml --to fmu3 --motors controlled --step 100us -o x.fmu --state-space",
        "2 kHz",
    )
    with zipfile.ZipFile(shell.folder / "x.fmu") as archive:
        description = ElementTree.fromstring(archive.read("modelDescription.xml"))
    units = {entry.attrib["name"]: entry.attrib["unit"] for entry in description.iter("Float64")}
    assert units["set.X.position"] == "m" and units["set.X.velocity"] == "m/s"
    assert units["drive.X.force"] == "N" and units["drive.X.encoder"] == "m"
