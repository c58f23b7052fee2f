"""The suite that says how often the part ``model`` of ± covers the truth."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.validation.machines import model_estimate_cases
from headstock.validation.machines.drawn_machines import draw_machine
from headstock.validation.machines.model_estimate_cases import (
    CALIBRATION,
    HOLD_OUT,
    MachineNumbers,
    measure_machine,
)
from headstock.validation.references.rows import ValidationRow


def made_up(errors: list[float], estimates: list[float], lines: list[float]) -> MachineNumbers:
    count = len(errors)
    compliances = np.arange(count) >= count - 3
    return MachineNumbers(
        0,
        compliances.astype(float),
        np.array(errors),
        np.array(estimates),
        np.full(count, 1e-6),
        np.array(lines),
        (1, 2),
    )


def judged(machines: list[MachineNumbers]) -> dict[str, ValidationRow]:
    rows = model_estimate_cases._evaluate("some", machines)
    return {row.quantity.split(": ")[1]: row for row in rows}


def test_machines_have_three_to_eight_bodies_and_both_halves_share_none(tmp_path: Path) -> None:
    assert not set(CALIBRATION) & set(HOLD_OUT) and len(HOLD_OUT) >= 20
    path = tmp_path / "machine.toml"
    models: set[str] = set()
    for seed in (*CALIBRATION, *HOLD_OUT):
        assert draw_machine(seed) == draw_machine(seed)
        path.write_text(draw_machine(seed))
        parts = load_scene(path).machine.components.values()
        assert 3 <= len(parts) <= 8
        models |= {part.fidelity for part in parts}
    assert models == {"rigid", "segmented", "elastic"}


def test_coverage_counts_numbers_and_modes_that_the_truth_lacks() -> None:
    good = made_up([1e-2] * 20, [2e-2] * 20, [1.0, 0.96])
    poor = made_up([1e-2] * 9 + [np.nan], [2e-2] * 7 + [5e-3, np.nan, 1e-2], [0.9, np.nan])
    rows = judged([good, poor])
    missed = rows["share of numbers that ± does not cover"]
    # one too small, one whose mode the truth does not have; of one nothing was said
    assert missed.value == approx(2.0 / 29.0) and not missed.passed
    assert "1 say ± ?" in missed.note
    assert rows["± over true error, median"].value == approx(2.0)
    assert rows["modes named of all that the machines lack"].value == 0.5
    lines = rows["share of frequency responses without 95 % of their lines covered"]
    assert lines.value == approx(1.0 / 3.0)


@pytest.mark.trials
@pytest.mark.fem
@pytest.mark.process
def test_a_machine_of_three_bodies_is_covered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # meshes of 1.5 % are fine enough where rigid bodies leave out tens of per cent
    monkeypatch.setattr(model_estimate_cases, "TRUE_ACCURACY", 0.015)
    monkeypatch.setattr(model_estimate_cases, "TRUE_MODES_TO", 1500.0)
    path = tmp_path / "machine.toml"
    path.write_text(draw_machine(1))
    found = measure_machine(1, load_scene(path), Store(tmp_path / "store"))
    large = found.errors > 0.04
    assert large.sum() >= 6
    assert (found.errors <= found.estimates)[large].all()
    assert (found.estimates <= 1.5 * found.errors)[large].all()
    assert found.named == (4, 4)
