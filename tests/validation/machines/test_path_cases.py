"""The second method for a path deviation agrees with the first."""

import numpy as np

from headstock.validation.machines.path_cases import METHODS_TOLERANCE, _compare_methods


def test_absolute_coordinates_coupled_anew_agree_with_carried_modes() -> None:
    first, second, frozen = _compare_methods()
    size = np.abs(second).max()
    assert np.abs(first - second).max() < METHODS_TOLERANCE * size
    # and the pose that is kept is distinguished
    assert np.abs(frozen - second).max() > 20.0 * METHODS_TOLERANCE * size
