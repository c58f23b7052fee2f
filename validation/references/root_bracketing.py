"""Roots of a characteristic equation, found one after the other by sign changes."""

from collections.abc import Callable

from scipy.optimize import brentq

MAXIMUM_STEPS = 200_000


def bracket_roots(function: Callable[[float], float], count: int, *, start: float, step: float) -> list[float]:
    """The first roots of a function above a start, by walking until its sign changes and closing in by Brent's method.

    Args:
        function: Continuous, with simple roots further apart than ``step``.
        count: Number of roots wanted.
        start: Where to begin; not itself a root.
        step: Width of the walk.

    Returns:
        ``count`` roots in rising order.

    Raises:
        ValueError: Fewer roots lie within the first 200000 steps.

    Source: Brent (1973), chapter 4.
    """
    roots: list[float] = []
    low, value_low = start, function(start)
    for number in range(1, MAXIMUM_STEPS + 1):
        if len(roots) == count:
            return roots
        high = start + number * step
        value_high = function(high)
        if value_low * value_high <= 0.0 and value_high != 0.0:
            roots.append(float(brentq(function, low, high, xtol=1e-15 * high, rtol=1e-14)))
        low, value_low = high, value_high
    raise ValueError(f"only {len(roots)} of {count} roots lie between {start:g} and {low:g}")
