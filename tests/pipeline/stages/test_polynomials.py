"""A body of polynomials runs through every stage, is kept in the store, and says what it is worth."""

from pathlib import Path

import numpy as np
import pytest

import scene_runs
from headstock.pipeline.results.results import Results
from headstock.scene.building.loader import load_scene

pytestmark = [pytest.mark.fem, pytest.mark.process]

CANTILEVER = Path(__file__).resolve().parents[3] / "machines" / "cantilever.toml"


def run(folder: Path, fidelity: str) -> Results:
    scene = load_scene(
        CANTILEVER, overrides=[f"components.column.fidelity={fidelity}", "effects.gravity=true"]
    )
    return scene_runs.run(scene, folder, fidelity)


def test_polynomials_are_finite_elements_within_their_estimate(tmp_path: Path) -> None:
    # in one store: neither takes the other's superelement
    meshed, found, again = (run(tmp_path, name) for name in ("elastic", "polynomial", "polynomial"))
    modes, true = found.modal[0], meshed.modal[0].frequencies_hz
    assert found.components["column"].fidelity == "polynomial"
    spread = [own.total for own in meshed.modal[0].list_errors()]
    for hz, fine, stated, own in zip(
        modes.frequencies_hz, true, modes.list_errors(), spread, strict=True
    ):
        assert own is not None and stated.total is not None
        assert hz != fine and abs(hz - fine) < stated.total + own < 0.1 * hz
    assert not modes.list_errors()[0].left_out
    assert [record.cached for record in again.stages if record.stage.kind == "expand"] == [True]
    assert np.array_equal(again.modal[0].frequencies_hz, modes.frequencies_hz)
