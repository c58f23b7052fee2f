"""What parts of a model are worth, on a terminal."""

import pytest

from headstock.app.terminal.models import COLUMNS, print_findings
from headstock.studies.answers import Change
from headstock.studies.model_trials import ModelTrial
from headstock.studies.model_worth import ModelFinding, RunPrice


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
    found = [
        finding("rigid", Change("frequencies", 0.2, "mode 7", 40.0, 48.0), missing=modes),
        finding(
            "segmented",
            Change("frequencies", 0.0084, "mode 8", 110.9, 110.0),
            Change("static compliance", 1e-13, "tcp", 66.8, 66.8),
        ),
        finding("polynomial", Change("frequencies", 2e-6, "mode 7", 48.0, 48.0)),
    ]
    print_findings(found)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= COLUMNS
    said = "\n".join(lines)
    assert "1e-11" not in said and "static compliance" not in said
    assert "less than 0.001 %" in said.split("Summary of models")[1]
    assert "polynomial in place" not in said.split("Summary of models")[0]
