"""How measured shapes and frequency responses agree with computed ones: per channel, per mode, per
frequency. MAC and pairs themselves are in ``mode_pairing``.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import Field, unit_columns
from headstock.solvers.second_order import ComplexArray

QUIET = 0.5  # of the mean motion of all channels: noise of what moves less says little


def fit_scale(shapes: Field, references: Field) -> Field:
    """Return the modal scale factor ``(k,)`` by which each shape ``(c, k)`` comes nearest to its
    reference ``(c, k)``; 0 for a shape that rests.

    Source: Allemang and Brown (1982).
    """
    squares = np.sum(np.abs(shapes) ** 2, axis=0)
    return np.sum(shapes.conj() * references, axis=0) / np.where(squares > 0.0, squares, 1.0)


def agree_by_channel(measured: Field, computed: Field) -> tuple[FloatArray, FloatArray]:
    """Compare paired shapes channel by channel.

    Args:
        measured: ``(c, k)`` of ``k`` pairs, of any size and phase.
        computed: ``(c, k)`` in the same order.

    Returns:
        Coordinate MAC ``(c,)``, 1 where all pairs agree but for a factor, NaN where a channel rests in
        all of them; and the mean difference of scaled shapes ``(c,)``, 0 where they agree, relative to
        the mean motion of the channel, or to half of that of all channels where it moves less: a wrong
        sign or direction shows here.

    Source: Lieven and Ewins (1988), COMAC; Hunt (1992), enhanced COMAC.
    """
    first, second = unit_columns(measured), unit_columns(computed)
    factor = fit_scale(second, first)
    second = second * (factor / np.where(np.abs(factor) > 0.0, np.abs(factor), 1.0))
    products = np.abs(np.sum(first.conj() * second, axis=1)) ** 2
    squares = np.sum(np.abs(first) ** 2, axis=1) * np.sum(np.abs(second) ** 2, axis=1)
    moved = np.mean(np.abs(first) + np.abs(second), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        comac = np.where(squares > 0.0, products / squares, np.nan)
    least = np.maximum(moved, QUIET * moved.mean())
    ecomac = np.mean(np.abs(first - second), axis=1) / np.where(least > 0.0, least, 1.0)
    return comac, ecomac


def cross_orthogonality(measured: Field, computed: FloatArray, mass: FloatArray) -> FloatArray:
    """Return ``(k, m)`` kinetic energy that expanded measured shapes share with computed ones: 1 on
    the pairs and 0 beside them where both are the same modes.

    Args:
        measured: ``(n, k)`` expanded to the coordinates of the mass.
        computed: ``(n, m)``.
        mass: ``(n, n)``.

    Source: Ewins (2000), Modal Testing, section 5.3.
    """
    carried = mass @ computed
    own = np.sum(computed * carried, axis=0)
    sizes = np.einsum("nk,nk->k", measured.conj(), mass @ measured).real
    scale = np.sqrt(np.outer(sizes, own))
    return np.abs(measured.conj().T @ carried) / np.where(scale > 0.0, scale, 1.0)


def response_assurance(measured: ComplexArray, computed: ComplexArray) -> FloatArray:
    """Return the frequency response assurance criterion ``(m, f)`` of each entry over all lines; NaN
    for one that was not measured.

    Args:
        measured: ``(l, m, f)``, nan where nothing was measured.
        computed: ``(l, m, f)`` on the same lines.

    Source: Heylen and Lammens (1996), FRAC.
    """
    known = np.isfinite(measured) & np.isfinite(computed)
    first, second = np.where(known, measured, 0.0), np.where(known, computed, 0.0)
    shared = np.abs(np.sum(first.conj() * second, axis=0)) ** 2
    sizes = np.sum(np.abs(first) ** 2, axis=0) * np.sum(np.abs(second) ** 2, axis=0)
    return np.where(sizes > 0.0, shared / np.where(sizes > 0.0, sizes, 1.0), np.nan)


def domain_assurance(measured: ComplexArray, computed: ComplexArray) -> FloatArray:
    """Return the frequency domain assurance criterion ``(l, l)``: how much the operating shape at each
    measured line looks like that at each computed one.

    A stiffness that is off shifts the ridge away from the diagonal.

    Args:
        measured: ``(l, m, f)``, nan where nothing was measured.
        computed: ``(l, m, f)``.

    Source: Pascual, Golinval and Razeto (1997), FDAC.
    """
    known = np.isfinite(measured).all(axis=0) & np.isfinite(computed).all(axis=0)
    first, second = measured[:, known].T, computed[:, known].T
    products: Field = unit_columns(first).conj().T @ unit_columns(second)
    # the sign of the original criterion tells shapes that move against each other apart
    return np.real(products) * np.abs(products)
