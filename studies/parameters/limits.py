"""Where numbers go as meshes get finer, how sure that is, and how fine a mesh an accuracy takes."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from headstock.pipeline.numbers.estimates import DISCRETISATION, Estimate
from headstock.pipeline.numbers.numbers import Number
from headstock.studies.parameters.tables import (
    LEAST_SIZES,
    TRUSTED_ORDER,
    UNCHANGED,
    extrapolate_values,
)

# Frequencies and compliances of second-order elements converge with order 4 where the fields are
# smooth; what meshes that have no nodes in common show beyond that is chance.
LARGEST_ORDER, ROUNDED = 4.0, 0.05
# Most errors fall faster (`pipeline/accuracy/quantities.py`): taken where an order is not seen
CAUTIOUS_ORDER = 1.5
# values follow the estimated errors of meshes where these fall, and by slopes that are alike
MOST_OF_BEFORE, SAME_SLOPE = 0.95, 3.0
USUAL_SHARE = 0.5  # true error over what stands behind ±, median of `validate coverage`
FIRM_ORDER = 1.0  # of a limit by the sizes that stands against one by the estimates
LEAST_DOUBT = 1.0 / 3.0  # of the distance from the finest mesh to the limit
SCATTER = 1.5  # times the spread of three meshes without an order
LEAST_SLOPE, LARGEST_SLOPE = 0.5, 3.5  # of dofs over size: blocks have 3, sheets 2, curved faces 0
TIME_SLOPE, MEMORY_SLOPE = 1.4, 1.2  # over dofs, at least: those of a sparse factorisation
Reach = Literal["coarsest", "between", "beyond", "far"]
FAR = 20.0  # times the dofs of the finest mesh: nobody can tell from there


@dataclass(frozen=True, eq=False)
class MeshCosts:
    """What each mesh of a series cost, coarse to fine.

    Attributes:
        factors: ``(n,)`` sizes, as shares of the size at factor 1.
        dofs: ``(n,)`` of all components before reduction.
        seconds: ``(n,)`` wall-clock time from scene to results [s].
        memory_mb: ``(n,)`` peak resident memory [MB].
    """

    factors: tuple[float, ...]
    dofs: tuple[int, ...]
    seconds: tuple[float, ...]
    memory_mb: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class MeshedNumber:
    """A number on each mesh of a series, coarse to fine; values are in the unit on screen.

    Attributes:
        name: ``f1``, ``tcp x``.
        numbers: One per mesh; None where a mesh has no such mode. The last one is there.
    """

    name: str
    title: str
    numbers: tuple[Number | None, ...]

    @property
    def finest(self) -> Number:
        """On the last mesh."""
        return next(number for number in reversed(self.numbers) if number is not None)

    @property
    def unit(self) -> str:
        """On screen."""
        return self.finest.shown[0]

    @property
    def values(self) -> tuple[float | None, ...]:
        """One per mesh."""
        return self._scale(lambda number: number.value)

    @property
    def bounds(self) -> tuple[float | None, ...]:
        """± on each mesh; None where it has no estimate."""
        return self._scale(lambda number: (number.error or Estimate()).total)

    @property
    def mesh_errors(self) -> tuple[float | None, ...]:
        """The part of the mesh in ±."""
        return self._scale(lambda number: (number.error or Estimate()).shares.get(DISCRETISATION))

    @property
    def fixed(self) -> float:
        """The part of ± that no finer mesh takes away: fixed-interface modes left out, curved faces."""
        shares = (self.finest.error or Estimate()).shares
        rest = sum(size or 0.0 for source, size in shares.items() if source != DISCRETISATION)
        return self.finest.shown[1] * rest

    def _scale(self, read: Callable[[Number], float | None]) -> tuple[float | None, ...]:
        found = [None if number is None else read(number) for number in self.numbers]
        return tuple(None if value is None else self.finest.shown[1] * value for value in found)


@dataclass(frozen=True, eq=False)
class Limit:
    """A number on an infinitely fine mesh.

    Attributes:
        value: Extrapolated; that of the finest mesh where no order is seen.
        error: How far it may be off, either way; None where nobody can tell.
        order: Observed order of convergence over the size; None where none is seen.
        remark: Why there is none, and what would be needed; empty when all is well.
    """

    value: float
    error: float | None
    order: float | None = None
    remark: str = ""

    @property
    def share(self) -> float:
        """Its error as a share of it; inf where nobody can tell."""
        return math.inf if self.error is None or not self.value else abs(self.error / self.value)


@dataclass(frozen=True, eq=False)
class MeshNeed:
    """The mesh that an accuracy takes.

    Attributes:
        accuracy: Largest relative error of any number.
        factor: Its size, as a share of the size at factor 1.
        dofs: About so many.
        seconds: [s].
        memory_mb: [MB].
        decisive: Name of the number that takes the finest mesh.
        reach: Whether the coarsest mesh will do, or it lies between meshes that were computed, or
            beyond them, or so far beyond that its numbers say little.
    """

    accuracy: float
    factor: float
    dofs: int
    seconds: float
    memory_mb: float
    decisive: str
    reach: Reach


def find_limit(factors: Sequence[float], series: MeshedNumber) -> Limit:
    """Return the limit of a number as the mesh gets finer, by its three finest meshes.

    There are two ways to it. Over the sizes (Richardson) the order is free; it takes meshes of which
    every element shrinks alike, which curved faces and patches prevent in most CAD parts. Over the
    estimated errors of the meshes, to which true ones are proportional, there is no order to be
    found. The limit may be off by what the ways, and pairs of the meshes, differ from each other and
    from what the estimate of the finest mesh usually amounts to, and by no less than a share of the
    distance from that mesh.

    Args:
        factors: Sizes, coarse to fine.

    Source: Richardson (1911); Roache (1994), J. Fluids Eng. 116, 405-413; Zienkiewicz and Zhu
    (1992) on errors that are estimated.
    """
    meshes = [
        _Mesh(factor, value, error)
        for factor, value, error in zip(factors, series.values, series.mesh_errors, strict=True)
        if value is not None
    ]
    last = meshes[-LEAST_SIZES:]
    finest, bound = last[-1].value, series.bounds[-1]
    if len(last) < LEAST_SIZES:
        return Limit(finest, bound, remark="too few meshes")
    spread = max(mesh.value for mesh in last) - min(mesh.value for mesh in last)
    if spread <= UNCHANGED * abs(finest):
        return Limit(finest, series.fixed, remark="does not depend on the mesh")
    ways = _find_ways(last)
    if isinstance(ways, str):
        return Limit(finest, max(SCATTER * spread, bound or 0.0), remark=ways)
    value, others = ways
    return _bound_limit(last, value, others, fixed=series.fixed)


def _find_ways(last: Sequence["_Mesh"]) -> tuple[float, list[float]] | str:
    """Return the limit of three meshes and others beside it; or why there is none."""
    richardson, remark = _extrapolate_sizes(last)
    others = _extrapolate_errors(last)
    if others is None and richardson is None:
        return remark or "no order"
    if others is None:
        return richardson or last[-1].value, [_limit_by_order(last, CAUTIOUS_ORDER)]
    # an order below one says little beside that
    firm = richardson is not None and (_observe_order(last, richardson) or 0.0) >= FIRM_ORDER
    return others[0], [*others[1:], *([richardson] if richardson and firm else [])]


def _bound_limit(
    last: Sequence["_Mesh"], value: float, seconds: Sequence[float], *, fixed: float
) -> Limit:
    """Return a limit with how far it may be off, and its order where that is believable.

    Args:
        seconds: Limits found in other ways.
        fixed: The part of ± that no finer mesh takes away.
    """
    finest, estimate = last[-1].value, last[-1].error
    if estimate is not None:
        usual = finest + math.copysign(USUAL_SHARE * estimate, value - finest)
        seconds = [*seconds, usual]
    distance, order = abs(finest - value), _observe_order(last, value)
    error = max(LEAST_DOUBT * distance, *(abs(value - other) for other in seconds))
    if estimate is not None and error > distance:
        return Limit(value, error + fixed, remark="two ways differ")
    if order is not None and order > LARGEST_ORDER + ROUNDED:
        # a stroke of luck on the last mesh: no sequence falls so fast
        wide = max(error, estimate or 0.0) + fixed
        return Limit(value, wide, remark=f"faster than order {LARGEST_ORDER:g}")
    return Limit(value, error + fixed, order)


class _Mesh(NamedTuple):
    factor: float
    value: float
    error: float | None


def _extrapolate_sizes(last: Sequence[_Mesh]) -> tuple[float | None, str]:
    """The limit by Richardson's extrapolation; None, and why, without a believable order."""
    found = extrapolate_values([mesh.factor for mesh in last], [mesh.value for mesh in last])
    order = found.order
    if order is None and found.remark.startswith("changes fall faster"):
        order = LARGEST_ORDER
    if order is None or order < TRUSTED_ORDER:
        return None, found.remark.split(":")[0]
    return _limit_by_order(last, min(order, LARGEST_ORDER)), ""


def _limit_by_order(last: Sequence[_Mesh], order: float) -> float:
    *_, before, finest = last
    ratio = math.pow(before.factor / finest.factor, order)
    return finest.value - (before.value - finest.value) / (ratio - 1.0)


def _extrapolate_errors(last: Sequence[_Mesh]) -> tuple[float, float, float] | None:
    """Limits at which the estimated error vanishes: by all three meshes, and by each pair of
    neighbours; None where values do not follow the estimates.
    """
    errors = [mesh.error for mesh in last if mesh.error is not None]
    values = [mesh.value for mesh in last]
    if len(errors) < LEAST_SIZES or any(
        after > MOST_OF_BEFORE * before or not after > 0.0
        for before, after in itertools.pairwise(errors)
    ):
        return None
    slopes = [
        (values[place] - values[place + 1]) / (errors[place] - errors[place + 1])
        for place in (0, 1)
    ]
    if slopes[0] * slopes[1] <= 0.0 or not 1.0 / SAME_SLOPE < slopes[0] / slopes[1] < SAME_SLOPE:
        return None
    line = np.polynomial.Polynomial.fit(errors, values, 1).convert()
    pairs = [values[place + 1] - errors[place + 1] * slopes[place] for place in (0, 1)]
    return float(line(0.0)), pairs[0], pairs[1]


def _observe_order(last: Sequence[_Mesh], limit: float) -> float | None:
    """Power of the size with which the distance from the limit falls."""
    distances = [abs(mesh.value - limit) for mesh in last]
    if min(distances) <= 0.0:
        return None
    sizes = [mesh.factor for mesh in last]
    return float(np.polyfit(np.log(sizes), np.log(distances), 1)[0])


def list_deviations(series: MeshedNumber, limit: Limit) -> list[float | None]:
    """Return the relative distance of each value from the limit, with its sign; None where there is
    no value.
    """
    return [
        None if value is None or not limit.value else value / limit.value - 1.0
        for value in series.values
    ]


def find_need(
    accuracy: float, costs: MeshCosts, series: Sequence[MeshedNumber], limits: Sequence[Limit]
) -> MeshNeed:
    """The coarsest mesh on which every number is within an accuracy, and what it costs."""
    needs = [
        (*_needed_factor(accuracy, costs.factors, each, limit), each.name)
        for each, limit in zip(series, limits, strict=True)
    ]
    factor, reach, decisive = min(needs, key=lambda need: need[0])
    dofs = estimate_dofs(costs, factor)
    reach = "far" if dofs > FAR * costs.dofs[-1] else reach
    return MeshNeed(
        accuracy,
        factor,
        round(dofs),
        estimate_cost(costs.dofs, costs.seconds, dofs, TIME_SLOPE),
        estimate_cost(costs.dofs, costs.memory_mb, dofs, MEMORY_SLOPE),
        decisive,
        reach,
    )


def _needed_factor(
    accuracy: float, factors: Sequence[float], series: MeshedNumber, limit: Limit
) -> tuple[float, Reach]:
    # where no order is seen the limit is no better than its own error
    doubt = limit.share if limit.order is None else 0.0
    errors = [
        math.inf if error is None else abs(error) + doubt
        for error in list_deviations(series, limit)
    ]
    if not math.isfinite(errors[-1]):
        return factors[-1] / FAR, "far"
    if errors[-1] > accuracy:
        order = CAUTIOUS_ORDER if limit.order is None else limit.order
        return factors[-1] * (accuracy / errors[-1]) ** (1.0 / order), "beyond"
    good = len(list(itertools.takewhile(lambda error: error <= accuracy, reversed(errors))))
    if good == len(errors):
        return factors[0], "coarsest"
    fine, coarse = errors[-good], errors[-good - 1]
    if not math.isfinite(coarse) or fine <= 0.0:
        return factors[-good], "between"
    along = math.log(accuracy / fine) / math.log(coarse / fine)
    return factors[-good] * (factors[-good - 1] / factors[-good]) ** along, "between"


def estimate_dofs(costs: MeshCosts, factor: float) -> float:
    """Degrees of freedom at a size, by those of the meshes computed."""
    slope = 3.0
    if len(costs.factors) > 1:
        first = max(-LEAST_SIZES, -len(costs.factors))
        slope = math.log(costs.dofs[-1] / costs.dofs[first]) / math.log(
            costs.factors[first] / costs.factors[-1]
        )
    # over 1 / size, which rises as dofs do
    sizes = [1.0 / known for known in costs.factors]
    return _follow(
        sizes, costs.dofs, 1.0 / factor, float(np.clip(slope, LEAST_SLOPE, LARGEST_SLOPE))
    )


def estimate_cost(
    dofs: Sequence[int], costs: Sequence[float], wanted: float, least: float
) -> float:
    """Seconds or memory at a number of dofs, by those of the meshes computed.

    Args:
        dofs: Of the meshes, coarse to fine.
        least: Power of the dofs with which the cost grows beyond the finest mesh, at least.
    """
    slope = least
    if len(dofs) > 1 and costs[-1] > costs[-2] > 0.0 and dofs[-1] > dofs[-2]:
        slope = max(least, math.log(costs[-1] / costs[-2]) / math.log(dofs[-1] / dofs[-2]))
    return _follow(dofs, costs, wanted, min(slope, 2.0))


def _follow(places: Sequence[float], values: Sequence[float], wanted: float, slope: float) -> float:
    """A value between others on double logarithmic axes; beyond the last with a slope."""
    if wanted > places[-1]:
        return float(values[-1] * (wanted / places[-1]) ** slope)
    logs = np.log(np.maximum(values, np.finfo(float).tiny))
    return float(np.exp(np.interp(math.log(wanted), np.log(places), logs)))
