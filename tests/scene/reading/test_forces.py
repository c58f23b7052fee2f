import time
from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import SMALL_BYTES
from headstock.scene.reading.csv_files import (
    CsvError,
    ForceRecord,
    read_corners,
    read_forces,
    resample_forces,
    resampling_loss,
)


def write(folder: Path, times: FloatArray, forces: FloatArray) -> Path:
    path = folder / "forces.csv"
    rows = "\n".join(
        ",".join(f"{value!r}" for value in map(float, row))
        for row in np.column_stack([times, forces])
    )
    path.write_text(f"time [s],fx,fy,fz\n{rows}\n")
    return path


TIMES = np.arange(0.0, 0.1, 1e-3, dtype=np.float64)
FORCES = np.stack([np.sin(40.0 * TIMES), TIMES, np.ones_like(TIMES)], axis=-1)


def test_a_sound_record_comes_back_as_it_was_written(tmp_path: Path) -> None:
    record = read_forces(write(tmp_path, TIMES, FORCES))
    assert np.array_equal(record.times, TIMES) and np.array_equal(record.forces, FORCES)


def test_what_is_linear_between_samples_is_resampled_exactly() -> None:
    record = ForceRecord(TIMES, FORCES)
    times = np.arange(0.001, 0.098, 3e-4, dtype=np.float64)
    assert np.allclose(resample_forces(record, times)[:, 1], times, atol=1e-15)
    assert np.allclose(resample_forces(record, times)[:, 2], 1.0, atol=1e-12)


def test_impulse_is_kept_and_fast_oscillations_do_not_fold_back() -> None:
    fine = np.arange(0.0, 1.0, 1e-5, dtype=np.float64)
    record = ForceRecord(fine, np.stack([np.sin(2.0 * np.pi * 9990.0 * fine)] * 3, axis=-1) + 5.0)
    times = np.arange(5e-4, 0.999, 1e-3, dtype=np.float64)
    found = resample_forces(record, times)[:, 0]
    # sampled at 1 kHz the oscillation would look like a slow one of full size
    assert np.ptp(np.interp(times, fine, record.forces[:, 0])) > 1.0
    assert np.abs(found - 5.0).max() < 0.05
    whole = np.trapezoid(
        record.forces[(fine >= 0.0) & (fine <= 0.9985), 0], fine[(fine >= 0.0) & (fine <= 0.9985)]
    )
    assert found.sum() * 1e-3 == approx(whole, rel=2e-3)


@pytest.mark.parametrize(("change", "message"), [
    (lambda t, f: (np.delete(t, range(40, 60)), np.delete(f, range(40, 60), axis=0)), "missing.* 0.039 and 0.06"),
    (lambda t, f: (t[[0, 1, 3, 2, *range(4, 100)]], f), "time.* 0.003 s"),
    (lambda t, f: (t, np.where(np.arange(100)[:, None] == 7, np.nan, f)), "forces.csv:9 .*not finite"),
    (lambda t, f: (t[:1], f[:1]), "at least two"),
])  # fmt: skip
def test_a_damaged_record_is_refused_by_name(tmp_path: Path, change: object, message: str) -> None:
    assert callable(change)
    with pytest.raises(CsvError, match=message):
        read_forces(write(tmp_path, *change(TIMES, FORCES)))


@pytest.mark.parametrize(("text", "message"), [
    ("", "column time"), ("time,fx,fy\n0,0,0\n", "column fz"), ("time,fx,fy,fz\n0,1,2,x\n", ":2 .*numbers"),
    ("time,fx,fy,fz\n0,1\n", ":2 .*numbers"),
])  # fmt: skip
def test_a_file_that_is_no_record_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "forces.csv"
    path.write_text(text)
    with pytest.raises(CsvError, match=message):
        read_forces(path)


def test_a_record_that_is_too_short_says_what_is_needed(tmp_path: Path) -> None:
    with pytest.raises(CsvError, match=r"0\.099 s.* 0\.2 s"):
        resample_forces(ForceRecord(TIMES, FORCES), np.linspace(0.0, 0.2, 50, dtype=np.float64))
    with pytest.raises(CsvError, match="cannot be read"):
        read_forces(tmp_path / "missing.csv")


def test_what_is_faster_than_the_steps_is_told() -> None:
    fine, steps = (
        np.arange(0.0, 1.0, 1e-5, dtype=np.float64),
        np.arange(0.01, 0.99, 1e-3, dtype=np.float64),
    )
    low_frequency = np.stack(
        [np.sin(40.0 * fine), np.zeros_like(fine), np.cos(30.0 * fine)], axis=-1
    )
    fast = np.stack(
        [np.zeros_like(fine), np.sin(2.0 * np.pi * 3300.0 * fine), np.zeros_like(fine)], axis=-1
    )
    assert resampling_loss(ForceRecord(fine, low_frequency), steps) < 1e-3
    # equal parts of what the steps hold and of what they do not
    mixed = resampling_loss(ForceRecord(fine, low_frequency + np.sqrt(2.0) * fast), steps)
    assert mixed == approx(np.sqrt(0.5), rel=0.05)


def test_corners_beyond_their_number_or_size_are_refused_soon(tmp_path: Path) -> None:
    path = tmp_path / "corners.csv"
    path.write_text("x,y,z\n" + "0,1,2\n" * 1_000_000)
    start = time.process_time()
    with pytest.raises(CsvError, match=r"corners.csv has 6 MB; a table of corners may"):
        read_corners(path)
    path.write_text("x,y,z\n" + "0,1,2\n" * 2001)
    with pytest.raises(CsvError, match=r"corners.csv:2002: more than 2000 rows; leave out"):
        read_corners(path)
    assert time.process_time() - start < 1.0
    path.write_text("x,y,z\n0,0,0\n1,0,0\n")
    assert read_corners(path)[1] is None


@pytest.mark.process
def test_a_long_record_is_read_apart_with_the_same_numbers_and_faults(tmp_path: Path) -> None:
    path, rows = tmp_path / "long.csv", np.random.default_rng(1).random((9000, 3))
    lines = [
        ",".join(repr(float(value)) for value in (number / 1e3, *row))
        for number, row in enumerate(rows)
    ]
    path.write_text("\n".join(["time,fx,fy,fz", *lines]) + "\n")
    assert path.stat().st_size > SMALL_BYTES
    np.testing.assert_array_equal(read_forces(path).forces, rows)
    path.write_text("\n".join(["time,fx,fy,fz", *lines[:8000], "8,1,2", *lines[8001:]]))
    with pytest.raises(CsvError, match=r"long.csv:8002 is no row of numbers: '8,1,2'"):
        read_forces(path)
