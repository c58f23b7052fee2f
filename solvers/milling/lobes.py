"""Stability lobes by a single frequency: limit depth of cut, chatter frequency and waves between two
teeth over the speed of the spindle, of any receptance at the tool point.

``y = G(i omega) F`` and ``F = a A (y - y(t - T))`` with the depth of cut ``a`` and the mean ``A`` of
the cutting stiffness per depth over a turn. A wave of one frequency keeps its size where ``1 = a (1 -
exp(-i omega T)) lambda`` with an eigenvalue ``lambda`` of ``G A``: then ``a = 1 / (2 Re lambda)``,
and the phase between two teeth is ``omega T = pi + 2 arg lambda + 2 pi k`` (Altintas and Budak 1995,
eqs. 20 to 26, with ``lambda = -1 / Lambda`` and signs of this package; zeroth order).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.forces import MillingCut, engagement_angles
from headstock.solvers.second_order import ComplexArray

IndexArray = NDArray[np.intp]
Receptance = Callable[[FloatArray], ComplexArray]
REFINEMENTS = 6  # secant steps between two lines of the grid, at most
SETTLED = 1e-8  # phase that is left where they end [rad]
ROUNDOFF = 1e-9  # of the larger eigenvalue
SMALLEST_WAVE = 1e-9  # beside one: teeth that meet the wave in phase make no chip


@dataclass(frozen=True, eq=False)
class LobeDiagram:
    """Limit of stability over the speed of the spindle.

    Attributes:
        speeds: ``(n,)`` rising [rad/s].
        depths: ``(n,)`` limit depth of cut [m]; the deepest that was looked for where there is no
            limit below it.
        chatter: ``(n,)`` angular frequency of chatter at the limit [rad/s]; NaN where there is none.
        waves: ``(n,)`` whole waves between two teeth; -1 where there are none.
        eigenvalues: ``(n,)`` eigenvalue of receptance times cutting stiffness there [1/m].
    """

    speeds: FloatArray
    depths: FloatArray
    chatter: FloatArray
    waves: IndexArray
    eigenvalues: ComplexArray


def mean_cutting_stiffness(cut: MillingCut) -> FloatArray:
    """``(3, 2)`` mean over a turn of the force along, away and up per depth of cut and per motion
    along and away since the tooth before [N/m^2].

    The helix has no part in it: over a turn every slice sees the same angles.

    Args:
        cut: Tool, material, radial depth and sense.
    """
    low, high = engagement_angles(cut.mill, cut.radial_depth)
    squares = 0.5 * (high - low) + 0.25 * (np.sin(2.0 * high) - np.sin(2.0 * low))
    mixed = 0.5 * (np.sin(high) ** 2 - np.sin(low) ** 2)
    sines = (high - low) - squares
    cosine, sine = np.sin(high) - np.sin(low), np.cos(low) - np.cos(high)
    tangential, radial, axial = cut.coefficients.chip
    tangential, upwards = cut.spin * tangential, cut.upwards * axial
    stiffness = np.array(
        [
            [-tangential * mixed - radial * squares, -tangential * sines - radial * mixed],
            [tangential * squares - radial * mixed, tangential * mixed - radial * sines],
            [upwards * cosine, upwards * sine],
        ]
    )
    return stiffness * cut.mill.teeth / (2.0 * np.pi)


def _chip_eigenvalues(response: ComplexArray, stiffness: FloatArray) -> ComplexArray:
    """Both eigenvalues of receptance times mean cutting stiffness, each followed from line to line,
    ``(f, 2)`` [1/m].

    Args:
        response: ``(f, 3, 3)`` motion along, away and up per force [m/N].
        stiffness: ``(3, 2)`` per depth of cut.
    """
    half, root = _split_eigenvalues(response, stiffness)
    # of both roots the one that points as the last one did
    turned = np.real(np.conj(root[:-1]) * root[1:]) < 0.0
    sign = np.concatenate([[1.0], np.cumprod(np.where(turned, -1.0, 1.0))])
    return np.stack([half + sign * root, half - sign * root], axis=-1)


def _split_eigenvalues(
    response: ComplexArray, stiffness: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Mean of both eigenvalues ``(f,)`` and half their difference ``(f,)``."""
    product = response[:, :2] @ stiffness
    half = 0.5 * (product[:, 0, 0] + product[:, 1, 1])
    apart = 0.5 * (product[:, 0, 0] - product[:, 1, 1])
    return half, np.sqrt(apart**2 + product[:, 0, 1] * product[:, 1, 0])


def find_lobes(
    receptance: Receptance,
    omega: FloatArray,
    stiffness: FloatArray,
    *,
    teeth: int,
    speeds: FloatArray,
    deepest: float,
) -> LobeDiagram:
    """Limit depth of cut over the speed.

    Args:
        receptance: Of angular frequencies ``(f,)`` [rad/s]: ``(f, 3, 3)`` motion of the tool along,
            away and up per force [m/N].
        omega: ``(f,)`` rising, dense where there are peaks [rad/s].
        stiffness: ``(3, 2)`` from :func:`mean_cutting_stiffness`.
        speeds: ``(n,)`` rising [rad/s].
        deepest: Depth up to which a limit is looked for [m].
    """
    values = _chip_eigenvalues(receptance(omega), stiffness)
    periods: FloatArray = np.asarray(2.0 * np.pi / (teeth * speeds), dtype=float)
    crossings = [_crossings(omega, values[:, branch], periods) for branch in range(2)]
    row, waves, near, level, slope = (
        np.concatenate(parts) for parts in zip(*crossings, strict=True)
    )
    # of all frequencies that may chatter at a speed the one with the thinnest limit
    order = np.lexsort((-level.real, row))
    first = order[np.unique(row[order], return_index=True)[1]]
    at = row[first]
    near, level = _refine(
        receptance,
        stiffness,
        near[first],
        level[first],
        slope[first],
        waves=waves[first],
        periods=periods[at],
    )
    waves = waves[first]
    real = level.real > 0.0
    depths = np.full(len(speeds), deepest)
    depths[at[real]] = np.minimum(0.5 / level.real[real], deepest)
    limited = real & (0.5 / np.where(real, level.real, 1.0) < deepest)
    chatter, counts = np.full(len(speeds), np.nan), np.full(len(speeds), -1, dtype=np.intp)
    eigenvalues = np.zeros(len(speeds), dtype=complex)
    chatter[at[limited]], counts[at[limited]] = near[limited], waves[limited]
    eigenvalues[at[limited]] = level[limited]
    return LobeDiagram(speeds, depths, chatter, counts, eigenvalues)


def _phase(values: ComplexArray) -> FloatArray:
    """Phase between two teeth at the limit, from 0 to 2 pi where the real part is positive."""
    return np.pi + 2.0 * np.angle(values)


def _crossings(
    omega: FloatArray, values: ComplexArray, periods: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray, ComplexArray, FloatArray]:
    """Every frequency at which an eigenvalue meets a period: number of the period, whole waves,
    angular frequency and eigenvalue, interpolated between lines, and how fast the phase that is left
    grows with the frequency there [s].
    """
    unstable = values.real > 0.0
    left = np.flatnonzero(unstable[:-1] & unstable[1:])
    right, phase = left + 1, _phase(values)
    ends = np.stack([left, right])
    # waves that fit between two teeth within the range of periods, on both lines of a segment
    low, high = periods.min(), periods.max()
    fewest = np.ceil((omega[ends] * low - phase[ends]).min(axis=0) / (2.0 * np.pi)).astype(np.intp)
    most = np.floor((omega[ends] * high - phase[ends]).max(axis=0) / (2.0 * np.pi)).astype(np.intp)
    fewest = np.maximum(fewest, 0)
    segment, waves = _spread(np.maximum(most - fewest + 1, 0), fewest)
    a, b = left[segment], right[segment]
    begin, end = ((phase[side] + 2.0 * np.pi * waves) / omega[side] for side in (a, b))
    rising = np.argsort(periods)
    ordered = periods[rising]
    first = np.searchsorted(ordered, np.minimum(begin, end), side="left")
    last = np.searchsorted(ordered, np.maximum(begin, end), side="right")
    piece, row = _spread(last - first, first)
    row, a, b, waves = rising[row], a[piece], b[piece], waves[piece]
    period = periods[row]
    slope = period - (phase[b] - phase[a]) / (omega[b] - omega[a])
    slope = np.where(slope == 0.0, period, slope)
    move = (2.0 * np.pi * waves + phase[a] - omega[a] * period) / slope
    share = np.clip(move / (omega[b] - omega[a]), 0.0, 1.0)
    return (
        row,
        waves,
        omega[a] + share * (omega[b] - omega[a]),
        values[a] + share * (values[b] - values[a]),
        slope,
    )


def _spread(counts: IndexArray, first: IndexArray) -> tuple[IndexArray, IndexArray]:
    """So many whole numbers from a first one on, for each entry: its number and the whole number."""
    owner = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return owner, first[owner] + within


def _refine(
    receptance: Receptance,
    stiffness: FloatArray,
    omega: FloatArray,
    values: ComplexArray,
    slope: FloatArray,
    *,
    waves: IndexArray,
    periods: FloatArray,
) -> tuple[FloatArray, ComplexArray]:
    """Secant steps of each frequency towards ``omega T = phase + 2 pi k`` with the receptance itself,
    and the eigenvalues there.

    Args:
        receptance: As in :func:`find_lobes`.
        stiffness: ``(3, 2)``.
        omega: ``(k,)`` interpolated [rad/s].
        values: ``(k,)`` eigenvalues interpolated there.
        slope: ``(k,)`` of the phase that is left [s].
        waves: ``(k,)`` whole waves.
        periods: ``(k,)`` [s].
    """
    omega, slope = omega.copy(), slope.copy()
    values = _nearest(receptance(omega), stiffness, values)
    off = omega * periods - _phase(values) - 2.0 * np.pi * waves
    tried: FloatArray = np.asarray(off.copy())
    for _ in range(REFINEMENTS):
        some = np.flatnonzero(np.abs(tried) > SETTLED)
        if not len(some):
            break
        move = np.clip(-off[some] / slope[some], -0.02 * omega[some], 0.02 * omega[some])
        moved = omega[some] + move
        refined = _nearest(receptance(moved), stiffness, values[some])
        rest = moved * periods[some] - _phase(refined) - 2.0 * np.pi * waves[some]
        closer = np.abs(rest) < np.abs(off[some])
        apart = closer & (rest != off[some])
        slope[some[apart]] = ((rest - off[some]) / move)[apart]
        kept = some[closer]
        omega[kept], values[kept], off[kept] = moved[closer], refined[closer], rest[closer]
        # one that comes no closer is left where it is
        tried[some] = np.where(closer, rest, 0.0)
    return omega, values


def _nearest(response: ComplexArray, stiffness: FloatArray, values: ComplexArray) -> ComplexArray:
    """Of both eigenvalues at each frequency the one nearest to a value ``(f,)``."""
    half, root = _split_eigenvalues(response, stiffness)
    both = np.stack([half + root, half - root])
    size = np.abs(both)
    # one that is roundoff beside the other moves nothing
    far = np.where(size < ROUNDOFF * size.max(axis=0), np.inf, np.abs(both - values))
    return np.take_along_axis(both, np.argmin(far, axis=0)[None], axis=0)[0]


def chatter_eigenvalues(
    response: ComplexArray,
    stiffness: FloatArray,
    omega: FloatArray,
    depths: FloatArray,
    periods: FloatArray,
) -> ComplexArray:
    """``(n,)`` eigenvalues of receptance times mean cutting stiffness at frequencies of chatter,
    nearest to those that chatter there at a limit depth [1/m].

    Args:
        response: ``(n, 3, 3)`` at the frequencies [m/N].
        stiffness: ``(3, 2)`` per depth of cut.
        omega: ``(n,)`` [rad/s].
        depths: ``(n,)`` limits [m].
        periods: ``(n,)`` from tooth to tooth [s].
    """
    wanted = 1.0 / (depths * (1.0 - np.exp(-1j * omega * periods) + SMALLEST_WAVE))
    return _nearest(response, stiffness, np.asarray(wanted))


@dataclass(frozen=True, eq=False)
class _ChatterShapes:
    """Motion of the tool while it chatters.

    Attributes:
        forces: ``(n, 3)`` cutting force along, away and up of each.
        weights: ``(n, 2)`` rows that make the motion along and away to one.
    """

    forces: ComplexArray
    weights: ComplexArray


def chatter_shapes(
    response: ComplexArray, stiffness: FloatArray, eigenvalues: ComplexArray
) -> _ChatterShapes:
    """Eigenvectors at the limit: a part ``u`` of the motion under the forces has the share ``weights
    . u`` in the eigenvalue, and all shares add up to one.

    Args:
        response: ``(n, 3, 3)`` at the frequencies of chatter.
        stiffness: ``(3, 2)``.
        eigenvalues: ``(n,)`` there.
    """
    product = response[:, :2] @ stiffness
    values, vectors = np.linalg.eig(product)
    best = np.argmin(np.abs(values - eigenvalues[:, None]), axis=1)
    number = np.arange(len(best))
    right = vectors[number, :, best]
    left = np.linalg.inv(vectors)[number, best]
    return _ChatterShapes(np.asarray(right @ stiffness.T), np.asarray(left / eigenvalues[:, None]))
