"""Poles and shapes of a test by ``modes`` and ``fit_modes``: from responses, or from the file."""

from pathlib import Path

import numpy as np
import pytest
from built_responses import KnownModes, draw_modes, measure

import headstock as hs
from common import Shell, approx

KNOWN = draw_modes(3, 5, motions=8)
MODES = len(KNOWN.hz)


def write_csv(path: Path, known: KnownModes = KNOWN, *, forces: int = 2) -> Path:
    """Write responses of a test with 1 % noise."""
    found = measure(known, noise=0.01, seed=3, forces=forces, lines=300)
    pairs = [(m, f) for m in range(len(found.motions)) for f in range(forces)]
    heads = [f"{m + 1}:+z/{f + 1}:+z {part} [m/N]" for m, f in pairs for part in ("re", "im")]
    columns = [found.frequencies_hz]
    for motion, force in pairs:
        values = found.values[:, motion, force]
        columns += [values.real, values.imag]
    rows = (",".join(f"{value:.12g}" for value in row) for row in np.column_stack(columns))
    path.write_text("\n".join([",".join(["frequency", *heads]), *rows]) + "\n")
    return path


def test_a_test_becomes_modes_with_intervals_a_diagram_and_a_universal_file(
    shell: Shell,
) -> None:
    write_csv(shell.folder / "test.csv")
    printed = shell.prints("modes test.csv --order 20 -o found --json x.json")
    assert f"{MODES} modes from 20 to 300 Hz" in printed
    found = shell.json("found/modes.json")
    assert found == shell.json("x.json")
    hz = np.array([mode["frequency_hz"] for mode in found["modes"]])
    damping = np.array([mode["damping_ratio"] for mode in found["modes"]])
    errors = np.array([mode["frequency_error_hz"] for mode in found["modes"]])
    assert hz == approx(KNOWN.hz, rel=1e-3)
    assert damping == approx(KNOWN.damping, rel=0.15)
    assert np.abs(hz - KNOWN.hz).max() < 3.0 * errors.max()
    assert found["scaled"]
    assert found["errors_from"] == "residuals"
    assert np.array(found["responses"]["frac"]).min() > 0.99
    diagram = shell.text("found/stabilisation.svg")
    assert diagram.startswith('<svg xmlns="http://www.w3.org/2000/svg"')
    assert diagram.count("<circle") > 40
    assert len(shell.rows("found/modes.csv")) == MODES


def test_modes_that_were_written_are_read_as_they_were(shell: Shell) -> None:
    pytest.importorskip("pyuff")
    fit = hs.fit_modes(write_csv(shell.folder / "test.csv"), order=20)
    shell("modes test.csv --order 20 -o found")
    again = hs.fit_modes(shell.folder / "found" / "modes.uff")
    assert again.source == "file"
    assert again.modes.scaled
    assert again.modes.frequencies_hz == approx(fit.modes.frequencies_hz, rel=1e-5)
    assert again.modes.damping == approx(fit.modes.damping, rel=1e-4)
    assert np.abs(again.modes.shapes - fit.modes.shapes).max() < 1e-4


def test_a_band_and_references_leave_the_rest_out(tmp_path: Path) -> None:
    test = write_csv(tmp_path / "test.csv")
    low, high = (KNOWN.hz[:-1] + KNOWN.hz[1:])[[1, 3]] / 2.0
    steps: list[str] = []
    fit = hs.fit_modes(test, band=(low, high), order=20, references="1", progress=steps.append)
    assert fit.modes.frequencies_hz == approx(KNOWN.hz[2:4], rel=3e-3)
    assert fit.responses is not None
    assert [channel.point for channel in fit.responses.forces] == ["1"]
    assert steps


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--band 20..300", "is no band"),
        ("--band 300Hz..20Hz", "write the lower frequency first"),
        ("--band 400Hz..500Hz", "test.csv:1: 0 lines from 400 to 500 Hz, and a fit needs 20"),
        ("--references 7", "test.csv:1: no reference 7; choose of 1:+z, 2:+z"),
        ("--order 1", "not in the range"),
    ],
)
def test_what_cannot_be_fitted_is_refused(shell: Shell, options: str, words: str) -> None:
    write_csv(shell.folder / "test.csv")
    assert words in shell.refuses(f"modes test.csv {options} -o found")


def test_arguments_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(hs.SceneError, match=r"write \(low, high\) in Hz"):
        hs.fit_modes(tmp_path / "test.csv", band=(300.0, 20.0))
    with pytest.raises(hs.SceneError, match="write a number from 4 on"):
        hs.fit_modes(tmp_path / "test.csv", order=1)
