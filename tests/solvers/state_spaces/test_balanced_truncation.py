"""Truncated state spaces keep their bound, what does not decay, and D."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.state_spaces.balanced_truncation import truncate_balanced
from headstock.solvers.state_spaces.state_space import StateSpace

HZ = np.array([0.0, 0.0, 20.0, 50.0, 51.0, 300.0, 420.0, 600.0])
INPUTS, OUTPUTS = ("N", "N.m"), ("m", "m", "rad")


def make_space(zeta: float = 0.02, *, coupled: bool = True) -> StateSpace:
    """Two rigid and six elastic modes, whose damping may couple all."""
    random, omega = np.random.default_rng(4), 2.0 * np.pi * HZ
    size = 2 * len(HZ)
    first, second = np.arange(0, size, 2), np.arange(1, size, 2)
    scales = np.where(omega > 0.0, omega, 100.0)
    a, b, c = np.zeros((size, size)), np.zeros((size, 2)), np.zeros((3, size))
    a[first, second], a[second, first] = scales, -(omega**2) / scales
    damping = np.diag(2.0 * zeta * omega)
    if coupled:
        row = random.standard_normal(len(HZ)) * (omega > 0.0)
        damping += 5.0 * zeta * np.outer(row, row)
    a[np.ix_(second, second)] = -damping
    b[second] = random.standard_normal((len(HZ), 2)) * [1.0, 50.0]
    c[:, first] = random.standard_normal((3, len(HZ))) / scales * [[1.0], [1.0], [20.0]]
    channels = tuple(("p", axis) for axis in ("x", "y", "rx"))
    d = 1e-6 * random.standard_normal((3, 2))
    return StateSpace(a, b, c, d, channels[1:], channels, ())


@pytest.mark.parametrize("coupled", [True, False])
@pytest.mark.parametrize("share", [0.3, 0.03, 1e-6])
def test_errors_stay_below_their_bound(share: float, *, coupled: bool) -> None:
    space = make_space(coupled=coupled)
    small = truncate_balanced(space, share, INPUTS, OUTPUTS)
    omega = 2.0 * np.pi * np.concatenate([np.linspace(1.0, 700.0, 3000), HZ[2:]])
    error = np.abs(small.space.respond(omega) - space.respond(omega)).max(axis=0)
    rounding = 1e-9 * np.abs(space.respond(omega)).max()
    assert small.share <= share and (error <= small.bounds + rounding).all()
    poles = np.linalg.eigvals(small.space.a)
    assert np.count_nonzero(np.abs(poles) < 1e-3) == 4  # two rigid motions
    assert np.sort(poles.real)[:-4].max(initial=-1.0) < 0.0
    assert np.array_equal(small.space.d, space.d)
    assert len(small.space.a) < len(space.a) or share < 1e-3


def test_states_are_left_out_by_their_hankel_values() -> None:
    """These are roots of the eigenvalues of the product of both Gramians, here by Kronecker products."""
    space = make_space()
    decaying = dataclasses.replace(
        space, a=space.a[4:, 4:], b=space.b[4:], c=space.c[:, 4:], d=0.0 * space.d
    )
    small = truncate_balanced(decaying, 0.05, ("N", "N"), ("m", "m", "m"))
    size, unit = len(decaying.a), np.eye(len(decaying.a))

    def gramian(a: FloatArray, force: FloatArray) -> FloatArray:
        both = np.kron(a, unit) + np.kron(unit, a)
        whole = np.linalg.solve(both, -(force @ force.T).ravel())
        return np.array(whole, dtype=np.float64).reshape(size, size)

    # one unit on each side: the scales cancel in the bound
    product = gramian(decaying.a, decaying.b) @ gramian(decaying.a.T, decaying.c.T)
    hankel = np.sort(np.sqrt(np.abs(scipy.linalg.eigvals(product))))[::-1]
    kept = len(small.space.a)
    assert small.bounds == approx(2.0 * hankel[kept:].sum(), rel=1e-6)


def test_growing_and_undamped_machines_are_refused() -> None:
    with pytest.raises(ModelError, match="grows by"):
        truncate_balanced(make_space(-0.02), 0.1, INPUTS, OUTPUTS)
    with pytest.raises(ModelError, match="no pole of the machine decays"):
        truncate_balanced(make_space(0.0, coupled=False), 0.1, INPUTS, OUTPUTS)
