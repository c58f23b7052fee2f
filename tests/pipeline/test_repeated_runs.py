"""the same scene gives the same numbers again, to the last bit on one thread."""

from pathlib import Path

import numpy as np
import pytest

from faults.runs import finish_run, make_places, read_numbers

pytestmark = [pytest.mark.hard("H43"), pytest.mark.fem, pytest.mark.process]


@pytest.mark.trials
def test_two_runs_without_a_common_store_are_equal_to_the_last_bit(tmp_path: Path) -> None:
    both = [make_places(tmp_path / name) for name in ("one", "two")]
    assert [finish_run(places, "steel")[0] for places in both] == [0, 0]
    found = [read_numbers(places.results) for places in both]
    np.testing.assert_array_equal(found[0].compliance, found[1].compliance)
    np.testing.assert_array_equal(found[0].frequencies_hz, found[1].frequencies_hz)
