"""Error estimates of a number: a half width in shares, one per source of error."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

REDUCTION = "reduction"
DISCRETISATION = "discretisation"
CURVED_FACES = "curved faces"
LEFT_OUT = "features left out"  # of a mesh
MODEL = "model"  # of bodies that are no finite elements
CUTTING = "cutting coefficients"
BORDER = "border of stability"  # how near a search came to it
ALL_SOURCES = "all sources"  # without a split by source
FIT = "fit"  # of parameters to measurements
INTERFACE = "interface"  # of rigid joints between elastic bodies


@dataclass(frozen=True)
class Estimate:
    """Store the possible error of a number, in the unit of the number.

    Attributes:
        shares: Source of error to its size; None where no bound of a source can be given.
        left_out: Sources that are not included, in plain words, such as ``the mesh of column``.
        parts: Source of error to the part of each component in its share.
    """

    shares: Mapping[str, float | None] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    parts: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def total(self) -> float | None:
        """Sum of the shares, as errors of one sign may add up. None where one of them has no bound,
        or nothing was estimated.
        """
        sizes = [size for size in self.shares.values() if size is not None]
        return sum(sizes) if sizes and len(sizes) == len(self.shares) else None

    @property
    def known(self) -> float | None:
        """Sum of the known shares, a lower limit where others are unknown; None without any."""
        return known_part(self.shares)


def combine_estimates(parts: Sequence[Estimate]) -> Estimate:
    """Return one estimate from several of the same number; shares of the same source are added."""
    shares: dict[str, float | None] = {}
    for part in parts:
        for source, size in part.shares.items():
            before = shares.get(source, 0.0)
            shares[source] = None if before is None or size is None else before + size
    owners: dict[str, dict[str, float]] = {}
    for part in parts:
        for source, sizes in part.parts.items():
            known_sizes = owners.setdefault(source, {})
            for name, own in sizes.items():
                known_sizes[name] = known_sizes.get(name, 0.0) + own
    return Estimate(
        shares, tuple(dict.fromkeys(words for part in parts for words in part.left_out)), owners
    )


def list_left_out(errors: Iterable[Estimate]) -> list[str]:
    """Return what is not included in some estimates, sorted."""
    return sorted({words for error in errors for words in error.left_out})


def known_part(shares: Mapping[str, float | None]) -> float | None:
    """Return the sum of the known shares; None where none is known: unknown is not zero."""
    return sum(size for size in shares.values() if size is not None) or None


def show_share(share: float | None) -> str:
    """Format a share in per cent, with two digits."""
    if share is None or not math.isfinite(share):
        return "an unknown amount"
    percent = 100.0 * share
    if percent == 0.0:
        return "0 %"
    return (
        f"{percent:.0f} %"
        if percent >= 10.0
        else f"{percent:.2g} %"
        if percent >= 1e-3
        else f"{percent:.0e} %"
    )


def scale_total(error: Estimate | None, factor: float = 1.0) -> float | None:
    """Return the total in another unit; None where there is none."""
    return None if error is None else scale_known(error.total, factor)


def scale_known(value: float | None, factor: float) -> float | None:
    """Return a number in another unit; None where there is none."""
    return None if value is None else factor * value


def scale_shares(error: Estimate, factor: float) -> dict[str, float | None]:
    """Return the share of each source in another unit."""
    return {source: scale_known(size, factor) for source, size in error.shares.items()}


def scale_parts(error: Estimate, factor: float = 1.0) -> dict[str, dict[str, float]]:
    """Return the part of each component in another unit, by source of error."""
    return {
        source: {name: factor * size for name, size in parts.items()}
        for source, parts in error.parts.items()
    }
