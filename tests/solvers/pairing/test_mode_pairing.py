"""Modes are found again by shape, whatever their order, sign, size and neighbours."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import (
    ModeSet,
    correlate_modes,
    find_clusters,
    pair_modes,
)


def orthonormal(count: int, size: int = 30, seed: int = 1) -> FloatArray:
    return np.asarray(np.linalg.qr(np.random.default_rng(seed).standard_normal((size, count)))[0])


def rotation(angle: float) -> FloatArray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@settings(deadline=None, max_examples=50)
@given(order=st.permutations(range(7)), seed=st.integers(0, 1000))
def test_modes_that_change_order_sign_and_size_are_found_again(order: list[int], seed: int) -> None:
    shapes, random = orthonormal(7, seed=seed), np.random.default_rng(seed)
    changed = shapes[:, order] * random.uniform(0.1, 9.0, 7) * random.choice([-1.0, 1.0], 7)
    hz = np.array([10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0])
    pairs = pair_modes(ModeSet(hz, shapes), ModeSet(1.3 * hz, changed))
    assert {pair.second: pair.first for pair in pairs} == dict(enumerate(order))
    assert all(pair.correlation == approx(1.0) for pair in pairs)


@settings(deadline=None, max_examples=30)
@given(angle=st.floats(0.0, 3.2), spread=st.floats(0.0, 0.015))
def test_repeated_modes_that_turn_into_each_other_stay_a_pair_in_the_order_of_their_frequencies(
    angle: float, spread: float
) -> None:
    shapes = orthonormal(4)
    turned = shapes.copy()
    turned[:, 1:3] = shapes[:, 1:3] @ rotation(angle)
    first = ModeSet(np.array([10.0, 50.0, 50.0 * (1.0 + spread), 90.0]), shapes)
    second = ModeSet(np.array([11.0, 55.0, 55.0 * (1.0 + spread), 99.0]), turned)
    pairs = pair_modes(first, second)
    assert sorted((pair.first, pair.second) for pair in pairs)[::3] == [(0, 0), (3, 3)]
    assert all(pair.correlation == approx(1.0) for pair in pairs)
    crossed = {pair.first: pair.second for pair in pairs}[1] == 2
    # shapes decide within the pair as long as they tell anything
    assert (
        crossed == (np.sin(angle) ** 2 > np.cos(angle) ** 2) or abs(np.sin(angle) ** 2 - 0.5) < 0.01
    )


def test_a_pair_that_is_pushed_apart_is_found_in_the_space_it_spanned() -> None:
    shapes = orthonormal(3)
    apart = shapes @ np.block([[rotation(0.7), np.zeros((2, 1))], [np.zeros((1, 2)), np.eye(1)]])
    pairs = pair_modes(
        ModeSet(np.array([50.0, 50.2, 90.0]), shapes), ModeSet(np.array([45.0, 56.0, 90.0]), apart)
    )
    assert [(pair.first, pair.second) for pair in pairs] == [(0, 0), (1, 1), (2, 2)]
    assert min(pair.correlation for pair in pairs) == approx(1.0)


def test_far_apart_frequencies_do_not_lend_each_other_their_shapes() -> None:
    shapes = orthonormal(2)
    pairs = pair_modes(
        ModeSet(np.array([50.0, 70.0]), shapes),
        ModeSet(np.array([50.0, 70.0]), shapes @ rotation(np.pi / 4.0)),
    )
    assert pairs and all(pair.correlation == approx(0.5) for pair in pairs)


def test_a_mode_of_another_shape_is_missing_and_its_rival_extra() -> None:
    shapes = orthonormal(4)
    pairs = pair_modes(
        ModeSet(np.array([10.0, 20.0, 30.0]), shapes[:, :3]),
        ModeSet(np.array([10.0, 20.0, 30.0]), shapes[:, [0, 3, 2]]),
    )
    assert [(pair.first, pair.second) for pair in pairs] == [(0, 0), (2, 2)]


def test_rigid_body_modes_are_one_space_whatever_their_roundoff() -> None:
    shapes = orthonormal(7)
    mixed = shapes.copy()
    mixed[:, :6] = shapes[:, :6] @ orthonormal(6, 6, seed=4)
    first = ModeSet(np.array([1e-6, 2e-6, 5e-6, 5e-6, 7e-6, 9e-6, 40.0]), shapes, rigid_count=6)
    second = ModeSet(np.array([0.0, 1e-7, 5e-6, 6e-6, 7e-6, 8e-6, 44.0]), mixed, rigid_count=6)
    pairs = pair_modes(first, second)
    assert len(pairs) == 7 and all(pair.correlation == approx(1.0) for pair in pairs)
    assert find_clusters(first) == [[0, 1, 2, 3, 4, 5], [6]]


def test_no_modes_make_no_pairs_and_a_resting_field_correlates_with_nothing() -> None:
    shapes = orthonormal(2)
    nothing = ModeSet(np.zeros(0), np.zeros((30, 0)))
    assert pair_modes(nothing, ModeSet(np.array([1.0, 2.0]), shapes)) == ()
    assert correlate_modes(np.zeros((30, 1)), shapes).tolist() == [[0.0, 0.0]]
