"""A scene in short (a part included with a prefix, parameters, places, carriages, exceptions) is to
every command the machine that is written in full; what is wrong is named in the file it stands in.
"""

from collections.abc import Mapping

import h5py
import numpy as np
import pytest

import headstock as hs
from common import Shell, approx, read_leaves
from fixture_machines import stored_scene

REQUESTS = stored_scene("short_scenes_requests")
SHORT = stored_scene("short_scenes_short")
PART = stored_scene("short_scenes_part")
FULL = stored_scene("short_scenes_full")
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
    "plan {0}.toml",
    "run {0}.toml --no-figures -o {0}",
    "run {0}.toml --no-figures --variant loose+thick -o {0}",
    "sweep {0}.toml line -o {0}",
    "compare {0}.toml -o {0}",
    "effects {0}.toml",
    "identify {0}.toml targets.toml -o {0}",
    "show {0}.toml -o {0}.png",
    "converge {0}.toml --set components.x_slider.fidelity=elastic --accuracy 20% --most-dofs 6000 -o {0}",
)
LONG_COMMANDS = ("effects", "show", "converge", "compare")
# what differs from one run to the next, and names of files
NOT_FOUND = (
    *("second", "time_", "verdict", "over_price", "memory", "rss", "provenance", "files", "scene"),
    *("text", "cached"),
)


@pytest.fixture
def both(shell: Shell) -> Shell:
    """The machine as ``short.toml`` and as ``full.toml``."""
    (shell.folder / "parts").mkdir()
    shell.write(PART, name="parts/slide")
    shell.write(SHORT + REQUESTS, name="short")
    shell.write(FULL + REQUESTS, name="full")
    shell.write(TARGETS, name="targets")
    return shell


def found(shell: Shell, name: str) -> dict[str, object]:
    """What a command found, without what differs from run to run."""
    return read_leaves(shell.json(name), lambda key: any(part in key for part in NOT_FOUND))


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(line, marks=[pytest.mark.trials] * line.startswith(LONG_COMMANDS))
        for line in COMMANDS
    ],
)
def test_a_command_finds_the_same_of_both(both: Shell, line: str) -> None:
    for name in ("short", "full"):
        both(f"{line.format(name)} --json {name}.json")
    short, full = (found(both, f"{name}.json") for name in ("short", "full"))
    assert len(full) > 10
    assert short == full


def test_a_component_is_exported_the_same(both: Shell) -> None:
    arrays = []
    for name in ("short", "full"):
        both(f"export {name}.toml x_slider -o {name}.h5")
        with h5py.File(f"{name}.h5") as file:
            arrays.append((file["stiffness"][()], file["mass"][()]))
    assert all(np.array_equal(*pair) for pair in zip(*arrays, strict=True))


def test_a_study_reaches_what_is_included_by_its_prefixed_names(both: Shell) -> None:
    table = hs.study("short.toml", "guides")
    assert len(table.rows) == 4
    for row in table.rows:
        keys = {key: str(value) for key, value in row.record.varied.items()}
        single = hs.run(hs.load("full.toml", set=in_full(keys)))
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
    "unit": ('rho = "7850 kg/m^3"', 'rho = "7850 kg"', 7, "materials.x_steel.rho"),
    "face": ('bottom = { face = "z-"', 'bottom = { face = "q-"', 13, "components.x_slider.interfaces.bottom"),
    "file": ('box = ["300 mm", "240 mm", "= height"]', 'step = "no.step"', 9, "components.x_slider.solid.step"),
    "parameter": ('"= height"', '"= hight"', 9, "components.x_slider.solid.box[2]"),
    "syntax": ("[points.tcp]", "[points", 28, ""),
}  # fmt: skip


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        *(("check {0}.toml", fault) for fault in FAULTS),
        *((line, "unit") for line in COMMANDS),
        ("study {0}.toml guides", "unit"),
        ("export {0}.toml x_slider -o {0}", "unit"),
    ],
)
def test_what_is_wrong_in_an_included_file_is_named_there(
    both: Shell, line: str, fault: str
) -> None:
    old, new, number, key = FAULTS[fault]
    part = both.write(PART, (old, new), name="parts/slide")
    message = both(line.format("short"), code=2).err
    assert f"{part.relative_to(both.folder)}:{number}" + (f": {key}" if key else "") in message
    assert "short" not in both.files()


def test_a_setting_of_an_included_parameter_is_named_where_its_value_is_wrong(both: Shell) -> None:
    """Once for all carriages that have it."""
    setting = "parameters.x_guide=60kg"
    message = both(f"run short.toml --set {setting}", code=2).err
    place = f"parts/slide.toml:19 (--set {setting}): joints.x_carriage_"
    assert message.count(place) == 3
    assert f"{place}1.stiffness.normal" in message
