"""Sums over the nodes of a tooth period by Fourier transforms."""

import numpy as np

from headstock.solvers.milling.full_discretisation import _correlate


def test_transforms_give_the_sums_of_functions_times_responses_that_begin_at_each_node() -> None:
    rng = np.random.default_rng(2)
    responses, functions = rng.standard_normal((2, 3, 9)), rng.standard_normal((9, 4))
    found = _correlate(responses, functions)
    assert found.shape == (2, 4, 3, 9)
    for start in range(9):
        direct = np.einsum("prn,nk->pkr", responses[..., : 9 - start], functions[start:])
        np.testing.assert_allclose(found[..., start], direct, rtol=0.0, atol=1e-12)
