"""What parts of a model are worth, on a terminal."""

import pytest

from headstock.app.actions.effecting import COLUMNS, _print_findings
from headstock.pipeline.numbers.numbers import make_key
from headstock.studies.kind_changes import Change
from headstock.studies.model_influence import ModelFinding, RunPrice
from headstock.studies.model_trials import ModelTrial


def change(share: float, tried: float, written: float, *, mode: int = 7) -> Change:
    key = make_key("frequency", pose="reference", mode=mode)
    return Change(key, share, tried, written, "Hz")


def finding(tried: str, *changes: Change, missing: tuple[str, ...] = ()) -> ModelFinding:
    trial = ModelTrial(
        "elasticity", ("column_left", "column_right"), "elastic", tried, (), "simpler"
    )
    price = RunPrice(10.0, 500.0)
    return ModelFinding(trial, changes, missing, written=price, tried=RunPrice(5.0, 400.0))


def test_lines_fit_what_moves_nothing_shares_one_and_rounding_is_not_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    modes = tuple(f"column_left + column_right bend X ({hz} Hz)" for hz in (48, 110, 180))
    stiff = make_key("compliance", pose="reference", point="tcp", direction="x")
    found = [
        finding("rigid", change(0.2, 40.0, 48.0), missing=modes),
        finding(
            "segmented",
            change(0.0084, 110.9, 110.0, mode=8),
            Change(stiff, 1e-13, 6.68e-8, 6.68e-8, "m/N"),
        ),
        finding("polynomial", change(2e-6, 48.0, 48.0)),
    ]
    _print_findings(found)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= COLUMNS
    said = "\n".join(lines)
    assert "48 → 40 Hz (frequency 7 in pose reference)" in said
    assert "1e-11" not in said and "static compliance" not in said
    assert "less than 0.001 %" in said.split("Summary of models")[1]
    assert "polynomial in place" not in said.split("Summary of models")[0]
