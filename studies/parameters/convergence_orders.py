"""What three meshes say about a fourth, infinitely fine one: observed order and Richardson's extrapolation."""

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.optimize import brentq

LEAST_SIZES = 3
SMALLEST_ORDER, LARGEST_ORDER = 0.05, 12.0
TRUSTED_ORDER = 0.5
UNCHANGED = 1e-12


@dataclass(frozen=True)
class Extrapolation:
    """Where a value goes as the mesh size goes to zero, by its three finest meshes.

    Attributes:
        order: Observed order of convergence [-]; None where the three values show none.
        limit: Extrapolated value; None without an order.
        finest: Value of the finest mesh.
        remark: Why there is no order, or what to mind; empty when all is well.
    """

    order: float | None
    limit: float | None
    finest: float
    remark: str = ""

    @property
    def error(self) -> float | None:
        """Relative distance of the finest value from the limit [-]."""
        return None if self.limit is None or self.limit == 0.0 else self.finest / self.limit - 1.0


def extrapolate_values(sizes: Sequence[float], values: Sequence[float]) -> Extrapolation:
    """Observed order and limit of a value from the three finest of at least three meshes.

    Args:
        sizes: Mesh sizes, each another; in any order.
        values: One per size.

    Raises:
        ValueError: There are fewer than three sizes, or two are equal.

    Source: Richardson (1911); Roache (1994) for sizes that do not halve: ``f = f0 + c h^p`` through three points.
    """
    if len(set(sizes)) != len(values) or len(values) < LEAST_SIZES:
        raise ValueError(f"an order takes at least {LEAST_SIZES} meshes of different sizes")
    pairs = sorted(zip(sizes, values, strict=True))[:LEAST_SIZES]
    (fine, f3), (middle, f2), (coarse, f1) = pairs
    first, last = f1 - f2, f2 - f3
    if max(abs(first), abs(last)) <= UNCHANGED * max(abs(f3), 1e-300):
        return Extrapolation(None, None, f3, "does not depend on the mesh size")
    if last == 0.0 or first / last <= 0.0:
        return Extrapolation(None, None, f3, "not monotone: the last two changes have different signs")

    def excess(order: float) -> float:
        return float((coarse**order - middle**order) / (middle**order - fine**order) - first / last)

    if excess(SMALLEST_ORDER) >= 0.0:
        return Extrapolation(None, None, f3, "not converging: the last change is not smaller than the one before")
    if excess(LARGEST_ORDER) <= 0.0:
        return Extrapolation(None, None, f3, f"changes fall faster than any order up to {LARGEST_ORDER:g}: too coarse to tell")
    order = float(brentq(excess, SMALLEST_ORDER, LARGEST_ORDER, xtol=1e-12))
    remark = "" if order >= TRUSTED_ORDER else f"an order below {TRUSTED_ORDER:g}: too coarse to trust the limit"
    return Extrapolation(order, f3 - last / ((middle / fine) ** order - 1.0), f3, remark)
