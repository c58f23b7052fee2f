"""a reduced frequency is never below the full one and falls with every mode kept."""

from itertools import pairwise

import numpy as np
import pytest

from common import Dense, make_box, make_component
from headstock.geometry.frames import FloatArray
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H22")

SIZE = (0.038, 0.1, 0.5)
COUNTS = (0, 2, 5, 10, 20, 40)
FLOOR = 1e-7


@pytest.fixture(scope="module", params=["rigid", "average"])
def frequencies(
    request: pytest.FixtureRequest, dense: Dense
) -> tuple[list[FloatArray], FloatArray]:
    mesh = make_box((1, 2, 8), SIZE, {"foot": "z-", "tip": "z+"}, kind="tet10")
    component = make_component({"foot": request.param, "tip": request.param}, size=SIZE)

    def reduced(count: int) -> FloatArray:
        element = reduce_mesh(component, mesh, modes=count, recovery=False)
        return dense.frequencies(element.stiffness, element.mass)[6:]

    refinement = [reduced(count) for count in COUNTS]
    # means leave the body as it is, rigid faces tie their points
    basis, _ = dense.rigid_map(mesh, ["foot", "tip"] if request.param == "rigid" else [])
    stiffness, mass = dense.pencil(mesh, component.material)
    full = dense.frequencies(basis.T @ stiffness @ basis, basis.T @ mass @ basis)[6:]
    return refinement, full


def test_every_reduced_frequency_lies_above_the_full_one(
    frequencies: tuple[list[FloatArray], FloatArray],
) -> None:
    refinement, full = frequencies
    assert min(map(len, refinement)) and len(full)
    assert all((a >= b * (1.0 - FLOOR)) for found in refinement for a, b in zip(found, full))  # noqa: B905


def test_frequencies_fall_with_every_mode_kept(
    frequencies: tuple[list[FloatArray], FloatArray],
) -> None:
    refinement, _ = frequencies
    steps = [b / a for coarse, fine in pairwise(refinement) for a, b in zip(coarse, fine)]  # noqa: B905
    assert steps and max(steps) <= 1.0 + FLOOR


def test_forty_modes_bring_the_first_ten_within_a_percent(
    frequencies: tuple[list[FloatArray], FloatArray],
) -> None:
    refinement, full = frequencies
    assert np.abs(refinement[-1][:10] / full[:10] - 1.0).max() < 1e-2
