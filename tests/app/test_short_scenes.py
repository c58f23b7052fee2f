"""A scene in short (a part included with a prefix, parameters, places, carriages, exceptions) is to
every command the machine that is written in full; what is wrong is named in the file it stands in.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
import pytest

import headstock as hs
from common import approx
from headstock.app.command_line import main

REQUESTS = """
[poses.middle]
[poses.out]
X = "60 mm"
[sweeps.line]
axes = { X = ["-100 mm", "100 mm", 3] }
[analyses.static]
at = "x_tcp"
[analyses.modal]
count = 6
[analyses.frf]
up_to = "500 Hz"
points = 20
[effects]
damping = { modal = 0.02 }
"""
SHORT = """
include = [{ file = "parts/slide.toml", prefix = "x_" }]
name = "A slide"
[parameters]
wall = "60 mm"
foot = "200 N/um"
[materials.iron]
E = "110 GPa"
nu = 0.25
rho = "7200 kg/m^3"
[components.base]
solid = { box = ["600 mm", "400 mm", "= 2 * wall"] }
material = "iron"
fidelity = "rigid"
[components.base.interfaces.bottom]
face = "z-"
[components.base.interfaces.rail]
face = "z+"
rect = { size = ["500 mm", "30 mm"] }
places = [["0 mm", "90 mm"], ["0 mm", "-90 mm"]]
[joints.foot]
between = ["ground", "base.bottom"]
kind = "mount"
stiffness = { vertical = "= foot", horizontal = "= 0.4 * foot" }
places = [["250 mm", "150 mm", "0 mm"], ["-250 mm", "150 mm", "0 mm"], ["0 mm", "-150 mm", "0 mm"]]
each.2 = { "stiffness.vertical" = "= 0.8 * foot" }
[axes.X]
joints = ["x_carriage", "x_drive"]
direction = "x"
limits = ["-120 mm", "= 2 * wall"]
[variants.loose]
"joints.x_carriage.stiffness.normal" = "= 0.5 * x_guide"
[variants.thick]
"parameters.x_height" = "120 mm"
[studies.guides.vary]
"parameters.x_guide" = ["60 N/um", "90 N/um"]
"joints.x_carriage_3.stiffness.normal" = ["50 N/um", "80 N/um"]
[studies.guides]
set = { "parameters.x_height" = "90 mm" }
watch = ["modal.frequencies_hz[0:6]", "static.x_tcp.compliance_um_per_kN[2][2]"]
"""
PART = """
[parameters]
guide = "90 N/um"
height = "100 mm"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.slider]
solid = { box = ["300 mm", "240 mm", "= height"] }
material = "steel"
at = ["0 mm", "0 mm", "150 mm"]
fidelity = "rigid"
interfaces = { bottom = { face = "z-" }, tool = { face = "z+" } }
[joints.carriage]
between = ["slider.bottom", "base.rail_{rail}"]
kind = "linear_guide"
axis = "x"
normal = "z"
stiffness = { normal = "= guide", lateral = "= 0.7 * guide" }
carriages = { middle = ["0 mm", "0 mm", "135 mm"], along = "200 mm", across = "180 mm" }
each.4 = { "stiffness.lateral" = "= 0.6 * guide" }
[joints.drive]
between = ["slider.bottom", "base.rail_1"]
kind = "ball_screw"
axis = "x"
at = ["0 mm", "0 mm", "135 mm"]
stiffness = { axial = "70 N/um" }
[points.tcp]
tool = "slider.tool"
work = "ground"
"""
FULL = """
name = "A slide"
[materials]
iron = { E = "110 GPa", nu = 0.25, rho = "7200 kg/m^3" }
x_steel = { E = "210 GPa", nu = 0.3, rho = "7850 kg/m^3" }
[components.base]
solid = { box = ["600 mm", "400 mm", "120 mm"] }
material = "iron"
fidelity = "rigid"
[components.base.interfaces]
bottom = { face = "z-" }
rail_1 = { face = "z+", rect = { size = ["500 mm", "30 mm"], center = ["0 mm", "90 mm"] } }
rail_2 = { face = "z+", rect = { size = ["500 mm", "30 mm"], center = ["0 mm", "-90 mm"] } }
[components.x_slider]
solid = { box = ["300 mm", "240 mm", "100 mm"] }
material = "x_steel"
at = ["0 mm", "0 mm", "150 mm"]
fidelity = "rigid"
interfaces = { bottom = { face = "z-" }, tool = { face = "z+" } }
[points.x_tcp]
tool = "x_slider.tool"
work = "ground"
[axes.X]
joints = ["x_carriage_1", "x_carriage_2", "x_carriage_3", "x_carriage_4", "x_drive"]
direction = "x"
limits = ["-120 mm", "120 mm"]
[variants.loose]
"joints.x_carriage_1.stiffness.normal" = "45 N/um"
"joints.x_carriage_2.stiffness.normal" = "45 N/um"
"joints.x_carriage_3.stiffness.normal" = "45 N/um"
"joints.x_carriage_4.stiffness.normal" = "45 N/um"
[variants.thick]
"components.x_slider.solid.box[2]" = "120 mm"
"""
FOOT = """[joints.foot_{0}]
between = ["ground", "base.bottom"]
kind = "mount"
at = ["{1} mm", "{2} mm", "0 mm"]
stiffness = {{ vertical = "{3} N/um", horizontal = "80 N/um" }}
"""
CARRIAGE = """[joints.x_carriage_{0}]
between = ["x_slider.bottom", "base.rail_{1}"]
kind = "linear_guide"
axis = "x"
normal = "z"
at = ["{2} mm", "{3} mm", "135 mm"]
stiffness = {{ normal = "90 N/um", lateral = "{4} N/um" }}
"""
FULL += "".join(
    FOOT.format(*entry) for entry in ((1, 250, 150, 200), (2, -250, 150, 160), (3, 0, -150, 200))
)
FULL += "".join(
    CARRIAGE.format(*entry)
    for entry in (
        (1, 1, 100, 90, 63), (2, 1, -100, 90, 63), (3, 2, 100, -90, 63), (4, 2, -100, -90, 54),
    )
)  # fmt: skip
FULL += """[joints.x_drive]
between = ["x_slider.bottom", "base.rail_1"]
kind = "ball_screw"
axis = "x"
at = ["0 mm", "0 mm", "135 mm"]
stiffness = { axial = "70 N/um" }
"""
TARGETS = """
[cases.loose]
variant = "loose"
pose = "out"
frequencies = ["90 Hz", "120 Hz", "150 Hz", "190 Hz"]
[parameters.feet]
keys = ["joints.foot_*.stiffness.horizontal"]
bounds = ["20 N/um", "400 N/um"]
[parameters.height]
keys = ["components.x_slider.solid.box[2]"]
bounds = ["50 mm", "200 mm"]
prior_sigma = 0.1
"""
# what a command finds of the machine, as JSON
COMMANDS = (
    "plan {scene} --json {json}",
    "run {scene} --no-figures -o {out} --json {json}",
    "run {scene} --no-figures --variant loose+thick -o {out} --json {json}",
    "sweep {scene} line -o {out} --json {json}",
    "compare {scene} -o {out} --json {json}",
    "effects {scene} --json {json}",
    "identify {scene} {targets} -o {out} --json {json}",
    "show {scene} -o {out}.png --json {json}",
    "converge {scene} --set components.x_slider.fidelity=elastic --accuracy 20% --most-dofs 6000 -o {out} --json {json}",
)
LONG_COMMANDS = ("effects", "show", "converge", "compare")
# what differs from one run to the next, and names of files
NOT_FOUND = (
    "second",
    "time_",
    "verdict",
    "over_price",
    "memory",
    "rss",
    "provenance",
    "files",
    "scene",
    "text",
    "cached",
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "slide.toml").write_text(PART)
    (tmp_path / "short.toml").write_text(SHORT + REQUESTS)
    (tmp_path / "full.toml").write_text(FULL + REQUESTS)
    (tmp_path / "targets.toml").write_text(TARGETS)
    return tmp_path


def call(text: str, folder: Path, name: str) -> int:
    """Run a command on one of the scenes."""
    places = {
        "scene": folder / f"{name}.toml",
        "targets": folder / "targets.toml",
        "out": folder / f"out_{name}",
        "json": folder / f"{name}.json",
    }
    return main([word.format(**places) for word in text.split()])


def found(value: object) -> object:
    """What a command found, without what differs from run to run."""
    if isinstance(value, Mapping):
        return {
            key: found(item)
            for key, item in value.items()
            if not any(part in key for part in NOT_FOUND)
        }
    return [found(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, marks=[pytest.mark.trials] * text.startswith(LONG_COMMANDS))
        for text in COMMANDS
    ],
)
def test_a_command_finds_the_same_of_both(folder: Path, text: str) -> None:
    assert [call(text, folder, name) for name in ("short", "full")] == [0, 0]
    short, full = (
        found(json.loads((folder / f"{name}.json").read_text())) for name in ("short", "full")
    )
    assert len(json.dumps(full)) > 300
    assert short == full


def test_a_component_is_exported_the_same(folder: Path) -> None:
    arrays = []
    for name in ("short", "full"):
        assert call("export {scene} x_slider -o {out}.h5", folder, name) == 0
        with h5py.File(folder / f"out_{name}.h5") as file:
            arrays.append((file["stiffness"][()], file["mass"][()]))
    assert all(np.array_equal(*pair) for pair in zip(*arrays, strict=True))


def test_a_study_reaches_what_is_included_by_its_prefixed_names(folder: Path) -> None:
    table = hs.study(folder / "short.toml", "guides")
    assert len(table.rows) == 4
    for row in table.rows:
        keys = {key: str(value) for key, value in row.record.varied.items()}
        machine = hs.load(folder / "full.toml", set=in_full(keys))
        single = hs.run(machine)
        watched = [row.values[f"modal.frequencies_hz[{number}]"] for number in range(6)]
        assert watched == approx(single.modes["middle"].frequencies_hz[:6], rel=1e-12)


def in_full(keys: Mapping[str, str]) -> dict[str, str]:
    """What a point of the study sets, for the scene in full."""
    guide = float(keys["parameters.x_guide"].split()[0])
    lateral = {n: f"{(0.6 if n == 4 else 0.7) * guide} N/um" for n in (1, 2, 3, 4)}
    return (
        {"components.x_slider.solid.box[2]": "90 mm"}
        | {f"joints.x_carriage_{n}.stiffness.normal": f"{guide} N/um" for n in (1, 2, 4)}
        | {f"joints.x_carriage_{n}.stiffness.lateral": text for n, text in lateral.items()}
        | {"joints.x_carriage_3.stiffness.normal": keys["joints.x_carriage_3.stiffness.normal"]}
    )


FAULTS = {
    "unit": ('rho = "7850 kg/m^3"', 'rho = "7850 kg"', 8, "materials.x_steel.rho"),
    "face": ('face = "z-"', 'face = "q-"', 14, "components.x_slider.interfaces.bottom"),
    "file": ('box = ["300 mm", "240 mm", "= height"]', 'step = "no.step"', 10, "components.x_slider.solid.step"),
    "parameter": ('"= height"', '"= hight"', 10, "components.x_slider.solid.box[2]"),
    "syntax": ("[points.tcp]", "[points", 29, ""),
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        *(("check {scene}", fault) for fault in FAULTS),
        *(
            (text.partition(" --json")[0], "unit")
            for text in ("study {scene} guides", "export {scene} x_slider -o {out}", *COMMANDS)
        ),
    ],
)
def test_what_is_wrong_in_an_included_file_is_named_there(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str, fault: str
) -> None:
    old, new, line, key = FAULTS[fault]
    assert old in PART
    part = folder / "parts" / "slide.toml"
    part.write_text(PART.replace(old, new, 1))
    assert call(text, folder, "short") == 2
    message = capsys.readouterr().err
    assert f"{part}:{line}" + (f": {key}" if key else "") in message
    assert not (folder / "out_short").exists()


def test_a_setting_of_an_included_parameter_is_named_where_its_value_is_wrong(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once for all carriages that have it."""
    setting = "parameters.x_guide=60kg"
    assert main(["run", str(folder / "short.toml"), "--set", setting]) == 2
    message = capsys.readouterr().err
    place = f"{folder / 'parts' / 'slide.toml'}:20 (--set {setting}): joints.x_carriage_"
    assert message.count(place) == 3
    assert f"{place}1.stiffness.normal" in message
