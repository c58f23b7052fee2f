"""Intervals and blind directions of a linear fit are those of the closed form."""

from typing import Any

import numpy as np

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.studies.identification.statistics import FitStatistics, assess

NO_PRIOR = np.full(2, np.inf)
WIDE = np.full(2, 5.0)
SUM = np.full((6, 2), 100.0)
LINE = np.column_stack([np.ones(20), np.linspace(-1.0, 1.0, 20)])


def fit(design: FloatArray, residuals: FloatArray | None = None, **known: Any) -> FitStatistics:
    """Of two parameters; without a prior, and with residuals of zero, where none are given."""
    names = known.pop("names", ["offset", "slope"])
    settings: dict[str, Any] = {"prior": NO_PRIOR, "from_residuals": False} | known
    zero = np.zeros(len(design)) if residuals is None else residuals
    prior = settings.pop("prior")
    return assess(names, design, zero, prior, WIDE, **settings)


def test_standard_deviations_are_those_of_weighed_least_squares() -> None:
    found = fit(LINE / 0.1)
    assert found.sigmas**2 == approx(0.01 * np.diag(np.linalg.inv(LINE.T @ LINE)))
    assert found.quantiles == approx(1.959964, rel=1e-6)
    assert found.noise.freedom == approx(18.0)
    assert found.unidentifiable == ()


def test_residuals_set_the_size_of_the_errors_where_that_is_asked_for() -> None:
    residuals = np.random.default_rng(0).normal(0.0, 3.0, 20)
    stated, found = (fit(LINE, residuals, from_residuals=asked) for asked in (False, True))
    noise = np.sqrt(residuals @ residuals / 18.0)
    assert found.noise.factor == approx(noise)
    assert found.sigmas == approx(noise * stated.sigmas)
    # Student's t with 18 degrees of freedom
    assert found.quantiles == approx(2.100922, rel=1e-6)


def test_a_prior_counts_as_one_more_measurement() -> None:
    found = fit(LINE, prior=np.array([np.inf, 0.2]))
    information = LINE.T @ LINE + np.diag([0.0, 25.0])
    assert found.sigmas**2 == approx(np.diag(np.linalg.inv(information)))
    share = (LINE.T @ LINE)[1, 1] / information[1, 1]
    assert found.noise.freedom == approx(20.0 - 1.0 - share)
    assert found.data_share[1] == approx(share, rel=1e-2)


def test_a_sum_that_alone_is_seen_leaves_the_difference_blind() -> None:
    found = fit(SUM, names=["a", "b"])
    (unidentifiable,) = found.unidentifiable
    entries = dict(unidentifiable.entries)
    sign = np.sign(entries["a"])
    assert entries == approx({"a": sign * np.sqrt(0.5), "b": -sign * np.sqrt(0.5)})
    assert unidentifiable.spread > 1e6
    assert np.isinf(found.sigmas).all()
    assert found.data_share == approx([0.5, 0.5], abs=1e-3)


def test_priors_make_a_blind_direction_finite_and_leave_it_blind() -> None:
    found = fit(SUM, prior=np.full(2, 0.3))
    assert found.sigmas == approx(0.3 * np.sqrt(0.5), rel=1e-3)
    assert found.correlations[0, 1] == approx(-1.0, abs=1e-3)
    assert len(found.unidentifiable) == 1
