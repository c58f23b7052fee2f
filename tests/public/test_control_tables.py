"""Tables for controllers: frequencies to guard with what a notch is worth, and compensation of axes,
read again by other code.
"""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from common import Shell, approx
from fixture_machines import stored_scene

RUN = "run scene.toml -o out --no-figures"
AXES = Path(__file__).parents[1] / "data" / "three_rigid_axes.toml"


def test_frequencies_to_guard_stand_out_of_the_exported_machine(shell: Shell) -> None:
    shell.write(stored_scene("control"))
    printed = shell.prints(RUN)
    shell("export scene.toml --to npz --motors free -o free.npz --state-space", "20 kHz")
    plant = np.load(shell.folder / "free.npz")
    row, column = list(plant["outputs"]).index("X motor"), list(plant["inputs"]).index("X force")

    def respond(hz: float) -> complex:
        inner = np.linalg.solve(
            2j * np.pi * hz * np.eye(len(plant["A"])) - plant["A"], plant["B"][:, column]
        )
        return complex(plant["C"][row] @ inner)

    rows = shell.rows("out/tables/guard_frequencies.csv")
    assert {row["drive"] for row in rows} == {"X"} and len(rows) >= 2
    for row_of_table in rows[:2]:
        hz, height = (
            float(row_of_table[key]) for key in ("frequency [Hz]", "height over rigid machine")
        )
        mass = 1.0 / abs(respond(0.01) * (0.02 * np.pi) ** 2)
        peak = abs(respond(hz)) * mass * (2.0 * np.pi * hz) ** 2
        # other modes and the rigid one add a little beside a resonance
        assert height == approx(peak, rel=0.03, abs=1.2)
    bands = shell.json("out/summary.json")["guards"]["bands"]
    assert [band["lowest_hz"] for band in bands] == approx(
        [float(row["frequency [Hz]"]) for row in rows]
    )
    assert re.search(r'filters = \[\{ notch = "\d+\.?\d* Hz"', printed)


def test_a_notch_at_the_frequency_of_the_table_adds_margin_and_a_wrong_one_takes_it(
    shell: Shell,
) -> None:
    fast = ('velocity_gain = "2e4 N s/m"', 'velocity_gain = "3e5 N s/m"\ndead_time = "100 us"')
    shell.write(stored_scene("control"), fast)
    shell(RUN)
    hz = float(shell.rows("out/tables/guard_frequencies.csv")[0]["frequency [Hz]"])
    margins = {}
    for name, share in (("none", None), ("right", 1.0), ("wrong", 1.1)):
        notch = (
            "" if share is None else f'\nfilters = [{{ notch = "{share * hz} Hz", damping = 0.1 }}]'
        )
        shell.write(stored_scene("control"), (fast[0], fast[1] + notch))
        shell(RUN)
        (control,) = shell.json("out/summary.json")["control"].values()
        margins[name] = control["drives"]["X"]["margins"]["sensitivity"]
    assert margins["right"] < margins["none"] < 0.1 * margins["wrong"]


def read_compensation(path: Path) -> list[tuple[float, float, float]]:
    """Triplets as LinuxCNC takes them: up to the first line that is none, rising."""
    entries: list[tuple[float, float, float]] = []
    for line in path.read_text().splitlines():
        words = line.split()
        if len(words) != 3:
            break
        nominal, forward, reverse = map(float, words)
        assert not entries or nominal > entries[-1][0]
        entries.append((nominal, nominal - forward, nominal - reverse))
    assert 1 < len(entries) <= 256
    return entries


@pytest.mark.parametrize(("axis", "symbol", "sign"), [("X", "EX", -1.0), ("Z", "EZ", 1.0)])
def test_compensation_of_an_axis_takes_off_its_positioning_error(
    shell: Shell, axis: str, symbol: str, sign: float
) -> None:
    shell(f"run {AXES} -o out --analysis volumetric --no-figures")
    line = shell.json("out/summary.json")["volumetric"]["tcp"]["lines"][axis]
    entries = read_compensation(shell.folder / f"out/tables/tcp_{axis}.comp")
    assert [entry[0] for entry in entries] == approx([1e3 * place for place in line["positions"]])
    for (_, forward, reverse), error in zip(entries, line["motions"][symbol], strict=True):
        assert forward == reverse == approx(-sign * 1e-3 * error, abs=2e-7)
    with (shell.folder / "out/tables/compensation_tcp.csv").open(newline="") as file:
        corrections = list(csv.DictReader(file))
    grid = shell.rows("out/tables/volumetric_tcp.csv")
    assert len(corrections) == len(grid) > 10
    for correction, errors in zip(corrections, grid, strict=True):
        assert float(correction["correction EY [um]"]) == approx(-float(errors["total_EY"]))


def test_modes_to_guard_are_followed_over_the_poses_of_a_sweep(shell: Shell) -> None:
    shell.write(
        stored_scene("control"), ("[analyses.control]", '[analyses.control]\nsweep = "travel"')
    )
    shell.change(add='\n[sweeps.travel.axes]\nX = ["0 mm", "10 mm", 3]\n')
    printed = shell.prints(RUN)
    bands = shell.rows("out/tables/guard_bands.csv")
    rows = shell.rows("out/tables/guard_frequencies.csv")
    assert bands and {float(row["X [m or rad]"]) for row in rows} == {0.0, 0.005, 0.01}
    for band in bands:
        followed = [row for row in rows if row["mode"] == band["mode"]]
        hz = [float(row["frequency [Hz]"]) for row in followed]
        assert len(hz) == int(band["poses"]) == 3
        assert [min(hz), max(hz)] == approx(
            [float(band[key]) for key in ("lowest [Hz]", "highest [Hz]")]
        )
    assert "Modes to guard over sweep travel" in printed
    assert shell.json("out/summary.json")["guards"]["over"] == "travel"
