"""a cluster of modes at the cut-off is kept whole."""

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import CLUSTER_GAP, ModeTarget

pytestmark = pytest.mark.hard("H06")

COMM = MPI.COMM_SELF
# nearly square: bending in x and in y differ by 0.2 %, as 1.723 and 1.727 Hz do
SIZE = (0.1, 0.1 * 1.0027, 0.8)
ReduceTo = Callable[[ModeTarget], Superelement]


@pytest.fixture(scope="module")
def column() -> ComponentMesh:
    return make_box((2, 2, 6), SIZE, {"foot": "z-", "tip": "z+"})


@pytest.fixture(scope="module")
def reduce_to(column: ComponentMesh) -> ReduceTo:
    component = make_component({"foot": "rigid", "tip": "rigid"}, size=SIZE)
    return lambda target: reduce_elastic(
        component, column, comm=COMM, request=ReductionRequest(target, recovery=False)
    )


def receptance(element: Superelement, frequency_hz: float) -> FloatArray:
    """Motion of the tip's x under a unit force there, foot fixed."""
    tip = element.interface_maps["tip"].node
    free = np.r_[np.arange(6 * tip, 6 * tip + 6), np.arange(12, len(element.stiffness))]
    square = (2.0 * np.pi * frequency_hz) ** 2
    dynamic = (element.stiffness - square * element.mass)[np.ix_(free, free)]
    return np.linalg.inv(dynamic)[:6, :6]


def test_the_column_has_clusters(reduce_to: ReduceTo) -> None:
    found = reduce_to(ModeTarget(count=8)).modal_frequencies_hz
    split = found[1] / found[0] - 1.0
    assert 1e-3 < split < CLUSTER_GAP


@pytest.mark.parametrize("count", [1, 3, 5, 8])
def test_a_count_is_extended_to_the_end_of_its_cluster(reduce_to: ReduceTo, count: int) -> None:
    found = reduce_to(ModeTarget(count=count)).modal_frequencies_hz
    following = reduce_to(ModeTarget(count=len(found) + 1)).modal_frequencies_hz
    assert len(found) >= count
    assert following[len(found)] > found[-1] * (1.0 + CLUSTER_GAP)
    assert all(found[i] <= found[i - 1] * (1.0 + CLUSTER_GAP) for i in range(count, len(found)))


def test_a_cut_between_twins_by_frequency_keeps_both(reduce_to: ReduceTo) -> None:
    first, second = reduce_to(ModeTarget(count=1)).modal_frequencies_hz[:2]
    cut = reduce_to(ModeTarget(up_to_hz=0.5 * (first + second)))
    assert len(cut.modal_frequencies_hz) == 2
    assert cut.cutoff_hz > second * (1.0 + CLUSTER_GAP)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.9])
def test_one_mode_more_inside_a_cluster_changes_no_receptance(
    reduce_to: ReduceTo, share: float
) -> None:
    one, two = reduce_to(ModeTarget(count=1)), reduce_to(ModeTarget(count=2))
    low = one.modal_frequencies_hz[0]
    before, after = receptance(one, share * low), receptance(two, share * low)
    assert np.abs(after - before).max() < 1e-4 * np.abs(before).max()


def test_the_first_left_out_frequency_bounds_what_is_complete(reduce_to: ReduceTo) -> None:
    few, many = reduce_to(ModeTarget(count=4)), reduce_to(ModeTarget(count=12))
    assert few.cutoff_hz == approx(many.modal_frequencies_hz[few.modal_count], rel=1e-3)
