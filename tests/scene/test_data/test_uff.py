"""Universal files: what they say in SI, and that no damage passes without a word."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from built_uff import (
    HZ,
    NEWTON,
    SPECTRUM,
    binary_58,
    columns,
    mode_2414,
    points_15,
    points_2411,
    qualifiers_1858,
    shape_55,
    text_58,
    uff_set,
    units,
)
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import ComplexArray, TestChannel, TestData

pytest.importorskip("pyuff")


def read(folder: Path, *content: bytes) -> TestData:
    path = folder / "test.uff"
    path.write_bytes(b"".join(content))
    return read_test_data(path)


def over_motion(values: ComplexArray, order: int) -> ComplexArray:
    return values / (2j * np.pi * HZ) ** order


@pytest.mark.parametrize(
    "form", ["text", "columns of 13", "uneven", "binary", "big endian", "line end"]
)
def test_every_form_of_a_response_is_the_same_receptance(tmp_path: Path, form: str) -> None:
    sets = {
        "text": text_58(),
        "columns of 13": text_58(ordinate=5),
        "uneven": text_58(even=0),
        "binary": binary_58(),
        "big endian": binary_58(order=">", even=0),
        "line end": binary_58(end="\r\n"),
    }
    responses = read(tmp_path, units(1, 1, 1), sets[form]).responses
    assert responses is not None
    assert responses.motions == (TestChannel("12", (1.0, 0.0, 0.0)),)
    assert responses.forces == (TestChannel("3", (0.0, 0.0, -1.0)),)
    exact = 0.0 if "binary" in form or form in ("big endian", "line end") else 2e-12
    np.testing.assert_allclose(responses.frequencies_hz, HZ, rtol=0.0)
    np.testing.assert_allclose(
        responses.values[:, 0, 0],
        over_motion(SPECTRUM, 2),
        rtol=1e-5 if form == "columns of 13" else max(exact, 1e-15),
    )


def test_units_and_kinds_lead_to_metres_per_newton(tmp_path: Path) -> None:
    data = read(
        tmp_path,
        units(5, 1000, 1000),
        points_15((3, 0, 0, 0, 100, 0, 0), (12, 0, 0, 0, 0, -250, 0)),
        text_58(kinds=(8, 13), motion=(12, 2)),
        text_58(kinds=(11, 13), motion=(12, -3)),
    )
    assert data.points["12"].position == (0.0, -0.25, 0.0)
    assert data.responses is not None
    np.testing.assert_allclose(data.responses.values[:, 0, 0], SPECTRUM, rtol=1e-11)
    np.testing.assert_allclose(data.responses.values[:, 1, 0], over_motion(SPECTRUM, 1), rtol=1e-11)
    assert data.responses.motions[1].direction == (0.0, 0.0, -1.0)
    text = "\n".join(data.remarks)
    assert "1000 to the metre (mm), 1000 to the newton (mN)" in text
    assert "1 frequency responses are velocity over force, divided by (i omega)" in text


def test_without_units_the_label_of_an_axis_counts(tmp_path: Path) -> None:
    data = read(tmp_path, text_58(labels=("g", "N")))
    assert data.responses is not None
    np.testing.assert_allclose(
        data.responses.values[:, 0, 0], 9.80665 * over_motion(SPECTRUM, 2), rtol=1e-11
    )
    untyped = read(tmp_path, text_58(kinds=(1, 0), labels=("(m/s^2)", "N")))
    assert untyped.responses is not None
    np.testing.assert_allclose(
        untyped.responses.values[:, 0, 0], over_motion(SPECTRUM, 2), rtol=1e-11
    )


def test_local_axes_turn_channels_and_places(tmp_path: Path) -> None:
    system = uff_set(
        "18",
        columns("10d", 7, 0, 0, 8, 1),
        "local",
        columns("13.5e", 1, 0, 0, 1, 1, 0),
        columns("13.5e", 1, 0, 1),
    )
    data = read(
        tmp_path, system, points_2411((12, 7, 7, 0, 0.5, 0, 0.25), (3, 0, 0, 0, 0, 0, 0)), text_58()
    )
    assert data.points["12"].position == (1.0, 0.5, 0.25)
    assert data.responses is not None
    assert data.responses.motions[0].direction == (0.0, 1.0, 0.0)
    assert data.responses.forces[0].direction == (0.0, 0.0, -1.0)
    np.testing.assert_allclose(np.linalg.det(data.points["12"].axes), 1.0)


def test_the_line_at_0_hz_is_left_out_where_it_says_nothing(tmp_path: Path) -> None:
    hz = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    data = read(tmp_path, text_58(hz=hz))
    assert data.responses is not None
    np.testing.assert_allclose(data.responses.frequencies_hz, hz[1:])
    np.testing.assert_allclose(
        data.responses.values[:, 0, 0], SPECTRUM[1:] / (2j * np.pi * hz[1:]) ** 2, rtol=1e-11
    )
    kept = read(tmp_path, text_58(hz=hz, kinds=(8, 13))).responses
    assert kept is not None
    np.testing.assert_allclose(kept.values[:, 0, 0], SPECTRUM, rtol=1e-11)


def test_what_is_no_response_is_named_and_skipped(tmp_path: Path) -> None:
    data = read(
        tmp_path,
        units(1, 1, 1),
        text_58(),
        text_58(function=6, motion=(77, 1), ordinate=4, values=np.ones(5)),
        text_58(function=1, ordinate=4, values=SPECTRUM.real),
        text_58(motion=(12, 4)),
        text_58(kinds=(15, 13)),
        text_58(),
        mode_2414({1: (1.0, 0.0, 0.0)}, hz=80.0, where=2),
        qualifiers_1858(rotates=1),
        text_58(motion=(13, 1)),
    )
    assert data.responses is not None
    assert data.responses.values.shape == (5, 1, 1)
    text = "\n".join(data.remarks)
    assert "1 coherences skipped" in text
    assert "1 time records skipped" in text
    assert "rotations or moments" in text
    assert "no displacement, velocity or acceleration (type 15" in text
    assert "repeat a pair of channels and are left out: 12:+x/3:-z" in text
    assert "1 sets 2414 that are no modes at nodes skipped" in text
    assert "1 frequency responses skipped (set 10 in line" in text
    assert "rotations or moments (set 1858)" in text


def test_pairs_that_were_not_measured_are_not_a_number(tmp_path: Path) -> None:
    data = read(tmp_path, text_58(), text_58(motion=(4, 1), force=(5, 1)))
    assert data.responses is not None
    assert np.isnan(data.responses.values).sum() == 2 * len(HZ)


def test_lines_join_points_of_traces_and_elements(tmp_path: Path) -> None:
    places = points_2411(*((number, 0, 0, 0, number, 0, 0) for number in range(1, 6)))
    trace = uff_set("82", columns("10d", 1, 6, 0), "NONE", columns("10d", 1, 2, 0, 3, 4, 5))
    quad = uff_set("2412", columns("10d", 1, 44, 1, 1, 7, 4), columns("10d", 1, 2, 3, 4))
    beam = uff_set(
        "2412", columns("10d", 1, 21, 1, 1, 7, 2), columns("10d", 0, 1, 1), columns("10d", 4, 5)
    )
    data = read(tmp_path, places, trace, quad, beam)
    assert data.lines == (("1", "2"), ("3", "4", "5"), ("1", "2", "3", "4", "1"), ("4", "5"))


def test_real_and_complex_shapes_have_unit_modal_mass(tmp_path: Path) -> None:
    omega, zeta = 2 * np.pi * 50.0, 0.02
    pole = complex(-zeta * omega, omega * np.sqrt(1 - zeta**2))
    data = read(
        tmp_path,
        shape_55(80.0, {1: (3.0, 0.0, 0.0), 2: (0.0, 1.0, 0.0)}, mass=4.0, damping=0.01),
        shape_55(0.0, {1: (1 + 1j, 0, 0), 2: (0, 2j, 0)}, pole=pole, a=2j * pole.imag),
    )
    assert data.modes is not None
    np.testing.assert_allclose(data.modes.frequencies_hz, [50.0, 80.0], rtol=2e-5)
    np.testing.assert_allclose(data.modes.damping, [0.02, 0.01], rtol=2e-5)
    assert [(channel.point, channel.direction) for channel in data.modes.channels] == [
        ("1", (1.0, 0.0, 0.0)),
        ("2", (0.0, 1.0, 0.0)),
    ]
    assert data.modes.scaled
    np.testing.assert_allclose(data.modes.shapes, [[1 + 1j, 1.5], [2j, 0.5]], rtol=2e-5)
    assert "4 directions of points are zero in all shapes: taken as not measured" in data.remarks


def test_modes_of_sets_2414_are_those_of_sets_55(tmp_path: Path) -> None:
    omega, zeta = 2 * np.pi * 50.0, 0.02
    pole = complex(-zeta * omega, omega * np.sqrt(1 - zeta**2))
    rows: dict[int, Sequence[complex]] = {1: (1 + 1j, 0, 0), 2: (0, 2j, 0)}
    real: dict[int, Sequence[complex]] = {1: (3.0, 0.0, 0.0), 2: (0.0, 1.0, 0.0)}
    new = read(
        tmp_path, mode_2414(rows, pole=pole, a=2j * pole.imag), mode_2414(real, hz=80.0)
    ).modes
    old = read(
        tmp_path,
        shape_55(0.0, rows, pole=pole, a=2j * pole.imag),
        shape_55(80.0, real, mass=4.0, damping=0.01),
    ).modes
    assert new is not None
    assert old is not None
    assert new.scaled
    assert new.channels == old.channels
    for name in ("frequencies_hz", "damping", "shapes"):
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name))


def test_coherence_gives_responses_their_noise(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    hz = np.asarray(np.linspace(10.0, 30.0, 400), dtype=np.float64)
    clean, averages = 1e-6 / (1.0 - (hz / 20.0) ** 2 + 0.1j), 16
    # of one measurement: twenty times more below 15 Hz
    sigma = np.where(hz < 15.0, 4e-8, 2e-9) * np.sqrt(averages)
    noise = (random.standard_normal((2, len(hz))) * [[1.0], [1.0]]).T @ [1.0, 1j]
    values = clean + sigma * noise / np.sqrt(2.0 * averages)
    coherence = 1.0 / (1.0 + (sigma / np.abs(clean)) ** 2)
    sets = [
        text_58(values, hz=hz, kinds=(8, NEWTON)),
        text_58(coherence, hz=hz, function=6, ordinate=4, motion=(12, -1)),
        qualifiers_1858(window=2.3),
    ]
    data = read(tmp_path, *sets, text_58(values, hz=hz, kinds=(8, NEWTON)))
    assert data.responses is not None
    assert data.responses.deviations is not None
    found = data.responses.deviations[:, 0, 0] / (sigma / np.sqrt(averages))
    np.testing.assert_allclose(np.median(found), 1.0, rtol=0.15)
    np.testing.assert_allclose(found, np.median(found), rtol=0.3)
    assert any("exponential window (damping factor 2.3)" in text for text in data.remarks)


def test_shapes_without_modal_mass_have_no_scale(tmp_path: Path) -> None:
    modes = read(tmp_path, shape_55(80.0, {1: (3.0, 0.0, 1.0)}, mass=0.0)).modes
    assert modes is not None
    assert not modes.scaled
    assert np.isnan(modes.damping).all()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (units(5, 1.0, 1.0) + text_58(), r"test.uff:2: set 1 \(164\): units code 5 means 1000 mm"),
        (units(1, 1, 1) + units(5, 1e3, 1e3), r":8: set 2 \(164\): units differ"),
        (text_58(ordinate=3), r":9: set 1 \(58\): the ordinate is of type 3"),
        (text_58().replace(b"5         1 ", b"6         1 "), r":9: .*6 points \(12 numbers\) are announced, its lines hold 10"),
        (text_58() + text_58(hz=HZ + 1, motion=(4, 1)), r":19: set 2 \(58\): its frequencies \(5 from 11 to 21 Hz\) are not those of"),
        (text_58().replace(b"e-09", b"e-x9"), r":16: set 1 \(58\): finite numbers in columns"),
        (points_15((1, 0, 0, 0, 0, 0, 0), (1, 0, 0, 0, 1, 0, 0)), "point 1 is written twice"),
        (binary_58()[:-7], r":9: set 1 \(58b\): 5 points \(80 bytes\) with -1 behind them were announced"),
        (text_58()[:-8], r":2: set 1 \(58\): does not end with a line -1; the file is cut"),
        (text_58()[7:], "'58' stands outside of all sets"),
        (b"hello", "is this a universal file"),
        (b"", "holds no set"),
        (text_58(function=6), r"holds no points, frequency responses or modes \(.*1 coherences"),
        (shape_55(80.0, {1: (3.0, 0.0, 1.0)}, damping=-0.1), "damping ratio -0.1"),
        (uff_set("82", columns("10d", 1, 3, 0), "NONE", columns("10d", 1, 2)), "3 points are announced, 2 follow"),
    ],
    ids=itertools.count(),
)  # fmt: skip
def test_a_fault_is_named_with_line_and_set(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(MeasurementError, match=words):
        read(tmp_path, content)


def test_a_file_cut_anywhere_is_refused_or_read_as_far_as_whole_sets_go(tmp_path: Path) -> None:
    sets = [
        units(1, 1, 1),
        points_2411((3, 0, 0, 0, 0, 0, 0), (12, 0, 0, 0, 1, 0, 0)),
        text_58(),
        binary_58(motion=(12, 2)),
        text_58(ordinate=5, motion=(12, 3)),
        shape_55(80.0, {3: (3.0, 0.0, 1.0), 12: (1, 1, 1)}),
    ]
    whole = b"".join(sets)
    ends = set(itertools.accumulate(map(len, sets)))
    # line ends and blanks at the end of a file say nothing
    complete = {end - back for end in ends for back in range(3)} | {
        end + blanks for end in ends for blanks in range(5)
    }
    outcomes = {"refused": 0, "read": 0}
    for size in range(0, len(whole), 10):
        path = tmp_path / f"cut{size}.uff"
        path.write_bytes(whole[:size])
        try:
            data = read_test_data(path)
        except MeasurementError as error:
            outcomes["refused"] += str(error).startswith(f"{path.name}:")
        else:
            outcomes["read"] += 1
            assert size in complete
            assert len(data.points) == 2
    assert sum(outcomes.values()) == len(range(0, len(whole), 10))
    assert outcomes["refused"] > 200
    assert read(tmp_path, whole).modes is not None


def test_a_large_file_is_read_in_a_process_apart_with_the_same_numbers(tmp_path: Path) -> None:
    hz = np.array(range(1, 4001)) / 2.0
    values = np.exp(1j * hz) / hz
    data = read(tmp_path, text_58(values, hz=hz), points_2411((12, 0, 0, 0, 1, 2, 3)))
    assert (tmp_path / "test.uff").stat().st_size < 1 << 18
    many = read(tmp_path, *(text_58(values, hz=hz, motion=(12, axis)) for axis in (1, 2, 3)))
    assert (tmp_path / "test.uff").stat().st_size > 1 << 18
    assert data.responses is not None
    assert many.responses is not None
    np.testing.assert_array_equal(many.responses.values[:, :1], data.responses.values)
    with pytest.raises(MeasurementError, match=r"test.uff:\d+: set 3"):
        read(tmp_path, (tmp_path / "test.uff").read_bytes()[:-20])


def test_without_pyuff_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr("headstock.scene.test_data.uff.load_library", missing)
    with pytest.raises(MeasurementError, match=r"test.uff:1: .*pip install pyuff==2\.5\.8"):
        read(tmp_path, text_58())
