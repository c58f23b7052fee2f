"""Test data leave by one command and come back with the same numbers."""

import numpy as np
import pytest

import headstock as hs
from common import Shell, approx

SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.beam]
solid = { box = ["30 mm", "20 mm", "300 mm"] }
material = "steel"
fidelity = "polynomial"
interfaces = { foot = { face = "z-" }, tip = { face = "z+" } }
[joints.foot]
between = ["beam.foot", "ground"]
kind = "rigid"
[points.tcp]
tool = "beam.tip"
work = "ground"
[sensors.middle]
component = "beam"
at = ["0 mm", "10 mm", "150 mm"]
[effects]
damping = { modal = 0.02 }
[analyses.modal]
count = 4
[analyses.frf]
inputs = [["tcp", "x"], ["tcp", "y"]]
outputs = [["tcp", "x"], ["tcp", "y"], ["middle", "y"]]
up_to = "900 Hz"
points = 40
"""


def test_modes_and_responses_leave_as_a_universal_file(shell: Shell) -> None:
    pyuff = pytest.importorskip("pyuff")
    shell.write(SCENE)
    shown = shell.prints("export scene.toml --uff beam.uff")
    assert "4 points, 4 modes (set 55), 6 responses (set 58)" in shown
    sets = pyuff.UFF(str(shell.folder / "beam.uff")).read_sets()
    kinds = [one["type"] for one in sets]
    assert kinds == [151, 164, 2411, *[55] * 4, *[58] * 6]
    run = hs.run(hs.load(shell.folder / "scene.toml"))
    modes, curves = run.modal[0], next(iter(run.frf.values())).curves
    # six digits of a mode, all of a response
    hz = [one["freq"] for one in sets if one["type"] == 55]
    assert hz == approx(modes.frequencies_hz, rel=6e-6)
    assert [one["modal_damp_vis"] for one in sets if one["type"] == 55] == approx(
        [0.02] * 4, rel=6e-6
    )
    node = ("beam.foot", "beam.tip", "tcp", "middle").index("middle")
    assert modes.sensor_shapes is not None
    shape = next(one for one in sets if one["type"] == 55)
    middle = [shape[f"r{axis}"][node] for axis in (1, 2, 3)]
    assert middle == approx(modes.sensor_shapes[0, 0], rel=6e-6, abs=1e-9)
    for one, value in zip(
        (one for one in sets if one["type"] == 58),
        curves.receptance.reshape(len(curves.frequencies_hz), -1).T,
        strict=True,
    ):
        np.testing.assert_array_equal(one["data"], value)
        np.testing.assert_array_equal(one["x"], curves.frequencies_hz)


def test_a_machine_agrees_with_its_own_universal_file(shell: Shell) -> None:
    pytest.importorskip("pyuff")
    shell.write(SCENE)
    shell("export scene.toml --uff beam.uff")
    shell("correlate scene.toml beam.uff -o out")
    found = shell.json("out/correlate.json")
    assert [row["mac"] for row in found["modes"] if row["number"]] == approx([1.0] * 4, abs=1e-6)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--uff beam.txt", "files of uff end in .uff, .unv, .uf"),
        ("beam --uff beam.uff", "uff is of the whole machine"),
        ("--uff beam.uff --pose none", "poses.none there is none of this name"),
    ],
)
def test_what_is_no_universal_file_is_refused(shell: Shell, words: str, message: str) -> None:
    shell.write(SCENE)
    assert message in shell.refuses(f"export scene.toml {words}")
    assert shell.files() == {"scene.toml"}
