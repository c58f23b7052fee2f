"""What the terminal shows: one rounding rule for values and their errors, and tables in which
nothing is cut.
"""

import dataclasses
import io
import math
import re

import numpy as np
import pytest
from made_results import make_modes, make_results

from common import approx
from headstock.app.tables.static import shared_budget
from headstock.app.terminal.console import Screen, add_row, make_console, make_table, print_table
from headstock.app.terminal.summary import print_summary
from headstock.app.texts.bounded_values import (
    bound_size,
    show_bound,
    show_bounded,
    show_compliances,
    show_damped,
    show_damping,
)
from headstock.app.views.modal import _describe_position
from headstock.app.views.registry import list_tables
from headstock.geometry.machine.machine import Pose, show_position
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer, compliance_key
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.results.results import Results


@pytest.mark.parametrize(
    ("value", "error", "shown", "bound", "size"),
    [
        (127.6412, 0.0551, "127.64", "± 0.06", 0.06),
        (1026.71, 1.41, "1026.7", "± 1.5", 1.5),
        (1026.71, 2.96, "1027", "± 3", 3.0),  # 2.96 rises to 3.0, which begins with 3
        (779.2, 0.95, "779.2", "± 1.0", 1.0),
        (885.2, 80.0, "890", "± 80", 80.0),
        (0.885, 8.0, "1", "± 8", 8.0),
        (-1225.4, 16.2, "-1225", "± 17", 17.0),
        (1.07900123, 6.0e-8, "1.0790", "± <0.0001", 1e-4),
        (2.5, 0.0, "2.5000", "± <0.0001", 1e-4),
        (0.62393, 0.0000761, "0.62393", "± 0.00008", 0.00008),
        (1.2345e-12, 2.0e-14, "1.234e-12", "± 2.0e-14", 2.0e-14),
        (0.1 + 0.2, 0.3 * 0.1, "0.30", "± 0.03", 0.03),  # roundoff is no reason to round up
        (77.4321, None, "77.4", "± ?", None),
        (77.4321, float("nan"), "77.4", "± ?", None),
    ],
)
def test_a_value_ends_where_its_error_ends_and_the_error_is_never_rounded_down(
    value: float, error: float | None, shown: str, bound: str, size: float | None
) -> None:
    found = (show_bounded(value, error), show_bound(value, error), bound_size(value, error))
    assert found == (shown, bound, size)
    assert size is None or (error is not None and size >= error * (1 - 1e-9))
    assert size is None or bound_size(value, size) == size  # a rounded error stays as it is


@pytest.mark.parametrize(
    ("ratio", "shown"),
    [(0.02, "2.00 %"), (0.96, "96.0 %"), (1.2345e-5, "0.00123 %"), (0.0, "0 %"), (None, "-")],
)
def test_damping_is_shown_in_per_cent_to_three_digits(ratio: float | None, shown: str) -> None:
    assert show_damping(ratio) == shown


@pytest.mark.parametrize(
    ("position", "unit", "shown"),
    [(0.03, "m", "30 mm"), (-0.0, "m", "0 mm"), (math.pi / 6.0, "rad", "30 deg")],
)
def test_positions_are_shown_in_the_units_of_scenes(position: float, unit: str, shown: str) -> None:
    assert show_position(position, unit) == shown


WORDS = (
    "column_left",
    "column_right bend X, B rotation of base",
    "whole machine moves Y on air_spring_1..4",
)


def print_narrow(width: int | None, *, terminal: bool = True) -> str:
    stream = io.StringIO()
    console = Screen(file=stream, width=width, force_terminal=terminal, color_system=None)
    heads = ">no.", ">undamped Hz", "<± Hz", ">damped Hz", ">damping", "mode", "strain energy in"
    table = make_table(*heads)
    for number in range(9, 12):
        cells = (str(number), "16.281234", "± <0.00001", "16.280000", "2.00 %")
        shares = "column_right 66 %, y_carriage_3 19 %, y_base 12 %"
        add_row(table, *cells, WORDS[number % 3], shares)
    print_table(console, "Natural modes", table)
    return stream.getvalue()


@pytest.mark.parametrize("width", [30, 60, 80, 100, 200])
def test_no_number_and_no_word_of_a_table_is_cut(width: int) -> None:
    text = print_narrow(width)
    assert "…" not in text
    for number in ("16.281234", "± <0.00001", "16.280000", "2.00 %"):
        assert len(re.findall(rf"(?<!\S){re.escape(number)}(?!\S)", text)) == 3
    for word in " ".join(WORDS).split():
        assert word in text.split()
    assert ("left out" in text) == ("y_carriage_3" not in text)
    assert ("left out" in text) == (width < 100)


def test_nothing_is_left_out_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    assert "y_carriage_3" in print_narrow(40, terminal=False)
    monkeypatch.setenv("COLUMNS", "40")
    assert "left out at 40 columns: strain energy in" in print_narrow(40, terminal=False)


def make_run(
    energy_share: dict[str, float] | None = None, x: dict[str, float] | None = None
) -> Results:
    """Return two modes and a point.

    Args:
        energy_share: Of both modes.
        x: Budget of the point in x.
    """
    modes = make_modes(
        [100.123456, 7.5],
        ["column bends X", "column bends Y"],
        errors={
            ("frequency", 1): {"discretisation": 0.123},
            ("frequency", 2): {"reduction": None},
            ("damping_ratio", 1): {"discretisation": 0.00031},
            ("damped_frequency", 1): {"discretisation": 0.123},
            ("damped_frequency", 2): {"discretisation": 0.0},
        },
        damping_ratio=(0.02, 1.1),
        damped_hz=(100.103431, 0.0),
        energy_share=(energy_share or {"column": 1.0},) * 2,
        pose_units={"Y": "m", "B": "rad"},
    )
    modes = dataclasses.replace(modes, pose=Pose("left", {"Y": 0.03, "B": 0.1}))
    compliance = np.arange(36).reshape(6, 6).astype(float)
    compliance[:3, :3] = [[429.4771, 0.0, 0.1], [0.0, 64.07, 0.0], [0.1, 0.0, 0.62]]
    compliance[:3, :3] *= 1e-9
    budget = {direction: {"column": 1.0} for direction in "xyz"} | ({"x": x} if x else {})
    errors = {
        compliance_key("reference", "tcp", direction): Estimate({"discretisation": size})
        for direction, size in (("x", 0.2661e-9), ("y", None), ("z", 7e-14))
    }
    points = {"tcp": PointCompliance(compliance, budget)}
    return make_results(StaticAnswer("reference", points, errors=errors), modes)


def printed_of(run: Results, capsys: pytest.CaptureFixture[str]) -> str:
    print_summary(run, seconds=1.0, folder="out")
    return capsys.readouterr().out


def test_terminal_and_csv_have_the_same_errors_and_the_damped_frequencies(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = make_run()
    printed = printed_of(run, capsys)
    tables = {table.name: table for table in list_tables(run)}
    modes = tables["modes_left"]
    heads = "mode, frequency [Hz], ± [Hz], damped frequency [Hz], ± damped [Hz], damping ratio"
    assert ", ".join(modes.headings[:7]) == f"{heads}, ± damping ratio"
    assert modes.rows[0][:7] == (1, 100.123456, 0.13, 100.103431, 0.13, 0.02, 0.0004)
    assert modes.rows[1][:7] == (2, 7.5, None, 0.0, 0.0, 1.1, None)
    assert re.search(r"1 +100\.12 +± 0\.13 +100\.10 +± 0\.13 +2\.00 % +± 0\.04 %", printed)
    assert re.search(r"2 +7\.50 +± \? +overdamped +110 % +± \?", printed)
    assert "± 0.27" in printed
    assert [row[4] for row in tables["compliance_reference_tcp"].rows] == [0.27, None, 7e-5]
    assert "Natural modes in pose left (Y = 30 mm, B = 5.72958 deg)" in printed
    assert _describe_position(run.modal[0]) == "Y = 30 mm, B = 5.72958 deg"
    assert show_damped(0.0, None, rigid=False) == ("overdamped", "")


def test_a_compliance_across_two_directions_is_as_coarse_as_the_coarser_and_symmetric() -> None:
    matrix = [[367.92, 0.0, 0.00051], [0.0, 60.812, 0.9], [0.00051, 0.9, 0.59256]]
    errors = {"x": 0.7, "y": 0.06, "z": 0.00015}
    shown = [show_compliances(matrix, column, errors) for column in range(3)]
    assert shown == [["367.9", "0", "0"], ["0", "60.81", "0.90"], ["0", "0.90", "0.59256"]]
    assert show_compliances(matrix, 0, {}) == ["368", "0", "0"]


def test_the_table_of_the_whole_compliance_has_a_row_per_load_and_units_in_its_head() -> None:
    table = {table.name: table for table in list_tables(make_run())}["compliance_6x6_reference_tcp"]
    motions = tuple(f"motion in {direction} [m]" for direction in "xyz")
    assert table.headings[1:5] == (*motions, "rotation about x [rad]")
    assert table.rows[1] == ("1 N in y", 0.0, approx(64.07e-9), 0.0, 19.0, 25.0, 31.0)
    assert table.rows[3][0] == "1 N m about x"


def test_energy_in_parts_alike_is_told_together(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "160")
    pads = {f"x_pad_{number}": 0.2 for number in range(1, 5)}
    run = make_run(energy_share={"column": 0.15, "x_drive": 0.05} | pads)
    assert "x_pad_1..4 80 %, column 15 %, x_drive 5 %" in printed_of(run, capsys)


def test_what_one_part_alone_gives_is_no_budget(capsys: pytest.CaptureFixture[str]) -> None:
    run = make_run()
    printed = printed_of(run, capsys)
    assert "budget" not in printed and "strain energy" not in printed
    assert shared_budget(run.static["reference"]["tcp"]) == {}
    shared = make_run(x={"column": 0.75, "clamp": 0.25})
    assert "budget x  column                    75.0 %" in printed_of(shared, capsys)


@pytest.mark.parametrize("columns", [40, 41, 42, 43, 80])
def test_a_per_cent_sign_stays_with_its_number(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    console = make_console()
    table = make_table(">no.", "strain energy in")
    shares = ", ".join(f"pad_{number} {20 + number} %" for number in range(12))
    add_row(table, "1", shares)
    print_table(console, "Modes", table)
    console.print(shares, markup=False)
    shown = capsys.readouterr().out
    assert not re.search(r"\d *\n *%", shown)
    assert len(re.findall(r"\d %", shown)) == 24
