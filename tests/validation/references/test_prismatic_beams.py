"""Claims about the search for roots."""

import math

import numpy as np
import pytest

from common import approx
from headstock.validation.references.beam_theory import _bracket_roots


def test_roots_come_in_order_and_to_machine_precision() -> None:
    np.testing.assert_allclose(
        _bracket_roots(math.sin, 5, start=1.0, step=0.3), np.pi * np.arange(1, 6), rtol=1e-14
    )


def test_a_root_on_a_grid_point_is_found_once() -> None:
    assert _bracket_roots(lambda x: (x - 1.0) * (x - 2.5), 2, start=0.0, step=0.5) == approx(
        [1.0, 2.5]
    )


def test_a_function_without_enough_roots_is_refused() -> None:
    with pytest.raises(ValueError, match="only 1 of 2 roots"):
        _bracket_roots(lambda x: x - 1.0, 2, start=0.0, step=0.3)
