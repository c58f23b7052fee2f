"""The suite that compares cut bodies on flexible interfaces with bodies in one piece."""

import numpy as np
import pytest

from common import approx
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.validation.machines import flexible_cases
from headstock.validation.machines.flexible_cases import (
    CUTS,
    EVERY_DIRECTION,
    STEPS,
    _find_joined_frequencies,
    _find_wrong_step,
    _join_parts,
    _SplitBody,
    check_flexible_smoke,
)


def test_a_cut_beam_passes_in_ten_frequencies() -> None:
    rows = list(check_flexible_smoke())
    assert [row for row in rows if not row.passed] == []
    (weak,) = [row for row in rows if "weak, 30 shapes" in row.quantity]
    # rigid sections are half a percent off: the comparison sees what it has to
    assert "0 shapes: 0.6" in weak.note and weak.tolerance == 2e-3


@pytest.mark.parametrize("body", [*CUTS, *STEPS], ids=lambda body: body.name)
def test_parts_fill_the_body_and_meet_in_a_rectangle(body: _SplitBody) -> None:
    assert len(body.bars) > 1
    for number in range(len(body.bars) - 1):
        sides = np.delete(body.find_patch(number).size, body.axis)
        assert body.find_patch(number).size[body.axis] == approx(0.0, abs=1e-12)
        assert (sides >= 0.01).all()
    for bar in body.bars:
        for axis in range(3):
            inside = bar.clip(body.grid[axis], axis)
            assert (inside[0], inside[-1]) == approx((bar.low[axis], bar.high[axis]))


def test_parts_with_meshes_of_their_own_weigh_as_much_and_float() -> None:
    body = CUTS[1]
    machine = _join_parts(body, "weak", 3, modes=2)
    mass = sum(part.mass_kg for part in machine.layout.superelements.values())
    assert mass == approx(7850.0 * 0.4 * 0.04 * 0.03)
    counts = [len(part.labels) for part in machine.layout.superelements.values()]
    assert len(set(counts)) > 1 and len(EVERY_DIRECTION) == 6
    assert np.count_nonzero(solve_modal(machine.system).frequencies_hz < 1.0) == 6
    assert np.isinf(_find_joined_frequencies(machine, 100)[-1])


def test_a_step_against_the_form_is_found() -> None:
    errors = np.array([[np.inf, np.inf], [0.3, 0.2], [0.1, 0.25]])
    assert _find_wrong_step(errors, "strong") == approx(0.05)
    assert _find_wrong_step(errors, "weak") == approx(0.2)
    assert flexible_cases.DISTURBED < 1e-3
