"""Tables of frequency responses: CSV, MATLAB and text say the same as what was written."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import ComplexArray, TestChannel

HZ = np.array([10.0, 12.5, 20.0])
ONE = np.array([1 + 2j, -3 + 4j, 0.5 - 1j])
OTHER = np.array([-2j, 1.0, 3 + 3j])


def write_csv(path: Path, heading: str, *columns: object) -> None:
    rows = np.array([HZ, *columns], dtype=float).T
    path.write_text("\n".join([heading, *(",".join(map(repr, row)) for row in rows.tolist())]))


def values_of(path: Path, motion: int = 0, force: int = 0) -> ComplexArray:
    responses = read_test_data(path).responses
    assert responses is not None
    np.testing.assert_array_equal(responses.frequencies_hz, HZ)
    return responses.values[:, motion, force]


def test_columns_of_csv_are_parts_of_pairs_with_units(tmp_path: Path) -> None:
    path = tmp_path / "test.csv"
    write_csv(
        path,
        "frequency [Hz],12:+x/3:-z re [um/N],12:+x/3:-z im [um/N],a1:y/3:-z mag [m/s^2/N],a1:y/3:-z phase [deg]",
        *(ONE.real, ONE.imag, abs(OTHER), np.degrees(np.angle(OTHER))),
    )
    np.testing.assert_allclose(values_of(path), 1e-6 * ONE)
    np.testing.assert_allclose(values_of(path, 1), OTHER / (2j * np.pi * HZ) ** 2)
    responses = read_test_data(path).responses
    assert responses is not None
    assert responses.motions == (
        TestChannel("12", (1.0, 0.0, 0.0)),
        TestChannel("a1", (0.0, 1.0, 0.0)),
    )
    assert responses.forces == (TestChannel("3", (0.0, 0.0, -1.0)),)


def test_arrays_of_matlab_have_names_and_a_unit(tmp_path: Path) -> None:
    path = tmp_path / "test.mat"
    content = {
        "frequency": HZ,
        "H": np.stack([ONE, OTHER], axis=1)[:, :, None],
        "outputs": np.array(["12:+x", "12:-y"], dtype=object),
        "inputs": "3:+z",
        "unit": "m/s/N",
    }
    scipy.io.savemat(path, content, do_compression=True)
    np.testing.assert_allclose(values_of(path, 1), OTHER / (2j * np.pi * HZ))
    scipy.io.savemat(path, {"frequency": HZ, "H": ONE})
    np.testing.assert_allclose(values_of(path), ONE)


def test_three_columns_are_one_receptance(tmp_path: Path) -> None:
    path = tmp_path / "tip.frf"
    rows = zip(HZ, ONE.real, ONE.imag, strict=True)
    path.write_text(
        "tool 12 mm\n" + "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    )
    np.testing.assert_array_equal(values_of(path), ONE)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "f,1:+x/1:+x re\n1,2\n", "a.csv:1: column 'f' names no pair of channels"),
        ("a.csv", "1:+x/1:+x re,1:+x/1:+x im\n1,2\n2,3\n", "a.csv:1: has no column frequency"),
        ("a.csv", "frequency,1:+x/1:+x re,1:+x/1:+x RE\n1,2,3\n", "stands twice"),
        ("a.csv", "frequency,1:+x/1:+x re [N/m],1:+x/1:+x im [N/m]\n1,2,3\n2,3,4\n", r"the unit 'N/m' is not read"),
        ("a.csv", "frequency,1:+x/1:+x re,1:+x/1:+x im [um/N]\n1,2,3\n2,3,4\n", "re is in m/N, im in um/N"),
        ("a.csv", "frequency\n1\n2\n", "holds no frequency response"),
        ("a.frf", "10 1 2\n20 1\n", "a.frf:2: frequency .* needed, not '20 1'"),
        ("a.frf", "10 1 2\n\n5 1 2\n", "a.frf:3: frequencies must rise; 5 Hz follows 10 Hz"),
        ("a.txt", "nothing\n", "a.txt:1: holds 0 lines of three numbers"),
        ("a.mat", "no file of MATLAB", "a.mat:1: cannot be read .*save it again with -v7"),
        ("a.xls", "", r"a.xls:1: test data end in .uff, "),
    ],
)  # fmt: skip
def test_a_fault_is_named_with_its_remedy(tmp_path: Path, name: str, text: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(MeasurementError, match=words):
        read_test_data(path)


def test_arrays_of_matlab_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "test.mat"
    scipy.io.savemat(path, {"frequency": HZ, "H": np.ones((3, 2, 1))})
    with pytest.raises(MeasurementError, match="outputs names 0 channels of 2 in H"):
        read_test_data(path)
    scipy.io.savemat(path, {"frequency": HZ[:2], "H": np.ones((3, 1, 1))})
    with pytest.raises(MeasurementError, match=r"H has the shape \(3, 1, 1\)"):
        read_test_data(path)
    scipy.io.savemat(path, {"G": HZ})
    with pytest.raises(MeasurementError, match="needs numbers frequency"):
        read_test_data(path)
