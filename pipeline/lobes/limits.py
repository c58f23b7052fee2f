"""Limits of stability over the speed of the spindle, each found by Floquet multipliers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.pipeline.lobes.cutting_point import CuttingPoint, turn_response
from headstock.scene.analyses.lobes import LobesRequest
from headstock.solvers.milling.border import find_border
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.collocation import PeriodicCut, safe_depth
from headstock.solvers.milling.lobes import LobeDiagram, chatter_eigenvalues
from headstock.solvers.milling.stability import TipPoles
from headstock.solvers.second_order import ComplexArray

BEST_SPEEDS = 3
WORTHWHILE = 1.2  # times the lowest limit: a speed is worth choosing


@dataclass(frozen=True, eq=False)
class Limits:
    """The border of stability along a travel.

    Attributes:
        depths: ``(n,)`` limit depth [m]; the deepest that was looked for where there is none, NaN
            where it was not looked for.
        limited: ``(n,)`` whether there is a limit.
        search: ``(n,)`` by how much the search may be off [m]; NaN where nothing says.
        slopes: ``(n,)`` growth of what chatters over the relative depth, at the limit.
        chatter: ``(n,)`` angular frequency of chatter [rad/s]; NaN where there is none.
        waves: ``(n,)`` whole waves between two teeth; -1 where there are none.
        eigenvalues: ``(n,)`` of receptance times mean cutting stiffness at that frequency, nearest to
            the limit [1/m].
    """

    depths: FloatArray
    limited: BoolArray
    search: FloatArray
    slopes: FloatArray
    chatter: FloatArray
    waves: NDArray[np.intp]
    eigenvalues: ComplexArray


def choose_speeds(request: LobesRequest) -> BoolArray:
    """``(n,)`` at which speeds limits are looked for: all, or an even share of them."""
    count = len(request.speeds)
    kept = min(count, max(2, round(request.checked * count)))
    chosen = np.zeros(count, dtype=bool)
    chosen[np.round(np.linspace(0, count - 1, kept)).astype(np.intp)] = True
    return chosen


def cuts_at_speeds(
    request: LobesRequest,
    tip: TipPoles,
    some: BoolArray,
    coefficients: CuttingCoefficients | None = None,
) -> list[PeriodicCut | None]:
    """Cuts at some of the speeds.

    Args:
        some: ``(n,)`` at which speeds.
        coefficients: Others than those of the request.
    """
    return [
        PeriodicCut(tip, request.cut_at(float(speed), coefficients)) if one else None
        for speed, one in zip(request.speeds, some, strict=True)
    ]


def find_limits(
    point: CuttingPoint, frame: FloatArray, tip: TipPoles, diagram: LobeDiagram
) -> Limits:
    """The border along a travel.

    Args:
        point: Where the machine cuts.
        frame: ``(3, 3)`` rows from :func:`travel_frame`.
        diagram: Limits by a single frequency, near which the border is expected.
    """
    request = point.request
    safe = safe_depth(tip, request.cut_at(float(request.speeds[0])))
    cuts = cuts_at_speeds(request, tip, choose_speeds(request))
    found = find_border(cuts, diagram.depths, safe=safe, deepest=request.deepest)
    depths, chatter = (
        np.array([getattr(each, name) for each in found]) for name in ("depth", "omega")
    )
    limited = np.array([each.limited for each in found])
    eigenvalues = np.zeros(len(found), dtype=complex)
    if limited.any():
        eigenvalues[limited] = chatter_eigenvalues(
            turn_response(point.tip(chatter[limited]), frame),
            point.stiffness,
            chatter[limited],
            depths[limited],
            2.0 * np.pi / (request.mill.teeth * request.speeds[limited]),
        )
    return Limits(
        depths,
        limited,
        np.array([each.error if each.limited else np.nan for each in found]),
        np.array([each.slope for each in found]),
        chatter,
        np.array([each.waves for each in found], dtype=np.intp),
        eigenvalues,
    )


def limits_by_one_frequency(diagram: LobeDiagram) -> Limits:
    """Limits that nothing confirms, of a tool whose receptance is measured."""
    unknown = np.full(len(diagram.speeds), np.nan)
    return Limits(
        diagram.depths,
        diagram.waves >= 0,
        unknown,
        unknown,
        diagram.chatter,
        diagram.waves,
        diagram.eigenvalues,
    )


def best_speeds(depths: FloatArray) -> tuple[int, ...]:
    """The deepest of the limits that no neighbour exceeds, the deepest first; of equal ones in a row
    the middle. A speed at which no limit was looked for is none, and no neighbour.

    Args:
        depths: ``(n,)`` [m]; NaN where none was looked for.
    """
    known = np.flatnonzero(np.isfinite(depths))
    if not len(known):
        return ()
    own = depths[known]
    starts = np.flatnonzero(np.concatenate([[True], own[1:] != own[:-1]]))
    ends = np.concatenate([starts[1:], [len(own)]]) - 1
    level = own[starts]
    before, after = np.concatenate([[-np.inf], level[:-1]]), np.concatenate([level[1:], [-np.inf]])
    tops = np.flatnonzero((level > before) & (level > after) & (level > WORTHWHILE * own.min()))
    order = sorted(tops, key=lambda top: -level[top])[:BEST_SPEEDS]
    return tuple(int(known[(starts[top] + ends[top]) // 2]) for top in order)
