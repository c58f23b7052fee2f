"""Rods and slender beams of line elements as second-order systems: small models with closed-form
answers.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import SecondOrderSystem
from headstock.validation.references.beam_theory import PrismaticBeam

TIP = ("tip", "x")
QUADRATIC_STIFFNESS = np.array([[7.0, -8.0, 1.0], [-8.0, 16.0, -8.0], [1.0, -8.0, 7.0]]) / 3.0
QUADRATIC_MASS = np.array([[4.0, 2.0, -1.0], [2.0, 16.0, 2.0], [-1.0, 2.0, 4.0]]) / 30.0


def rod_system(
    beam: PrismaticBeam, elements: int, *, clamped: bool = True, end_dashpot: float = 0.0
) -> SecondOrderSystem:
    """Return a rod along x, loaded and seen at its right end, the port ``("tip", "x")``.

    Args:
        beam: Its length, section and material.
        clamped: The left end is fixed; else it is free.
        end_dashpot: Viscous damper between the left end and ground [N s/m].

    Source: Przemieniecki (1968), sections 5.5 and 11.3; Zienkiewicz and Taylor (2000) for the
    quadratic element.
    """
    step = beam.length / elements
    stiffness = (
        beam.material.youngs_modulus * beam.area / step * _assemble(QUADRATIC_STIFFNESS, elements)
    )
    mass = beam.mass_per_length * step * _assemble(QUADRATIC_MASS, elements)
    damping = np.zeros_like(mass)
    damping[0, 0] = end_dashpot
    kept = slice(1 if clamped else 0, None)
    return _tip_system(
        stiffness[kept, kept], mass[kept, kept], damping[kept, kept] if end_dashpot else None, -1
    )


def spectral_rod(beam: PrismaticBeam, elements: int, order: int) -> SecondOrderSystem:
    """Return a clamped rod of elements of high order with nodes and integration at
    Gauss-Lobatto-Legendre points: diagonal mass.

    About two of three modes have their frequency to many digits; of quadratic elements it is one of
    ten.

    Args:
        beam: Its length, section and material.

    Source: Maday and Patera (1989), Spectral element methods; Canuto, Hussaini, Quarteroni and Zang
    (2006), section 2.3.
    """
    nodes, weights = _lobatto_points(order)
    slopes = _lagrange_slopes(nodes)
    half = 0.5 * beam.length / elements
    stiffness = (
        beam.material.youngs_modulus
        * beam.area
        / half
        * _assemble(slopes.T @ (weights[:, None] * slopes), elements)
    )
    mass = beam.mass_per_length * half * _assemble(np.diag(weights), elements)
    return _tip_system(stiffness[1:, 1:], mass[1:, 1:], None, -1)


def _lobatto_points(order: int) -> tuple[FloatArray, FloatArray]:
    """Nodes in [-1, 1] and weights ``(order + 1,)``: the ends and the roots of the derivative of
    the Legendre polynomial.
    """
    legendre = np.polynomial.legendre.Legendre.basis(order)
    nodes = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    return nodes, 2.0 / (order * (order + 1) * legendre(nodes) ** 2)


def _lagrange_slopes(nodes: FloatArray) -> FloatArray:
    """Derivative at node i of the polynomial that is one at node j ``(n, n)``, by barycentric
    weights.
    """
    gaps = nodes[:, None] - nodes + np.eye(len(nodes))
    weights = 1.0 / gaps.prod(axis=1)
    slopes = weights / weights[:, None] / gaps
    np.fill_diagonal(slopes, 0.0)
    np.fill_diagonal(slopes, -slopes.sum(axis=1))
    return np.asarray(slopes)


def cantilever_system(beam: PrismaticBeam, elements: int) -> SecondOrderSystem:
    """Return an Euler-Bernoulli cantilever, loaded and seen across its tip, the port ``("tip",
    "x")``.

    Source: Przemieniecki (1968), sections 5.6 and 11.3 (cubic shapes, consistent mass).
    """
    h = beam.length / elements
    local_stiffness = np.array(
        [[12.0, 6.0 * h, -12.0, 6.0 * h], [6.0 * h, 4.0 * h**2, -6.0 * h, 2.0 * h**2],
         [-12.0, -6.0 * h, 12.0, -6.0 * h], [6.0 * h, 2.0 * h**2, -6.0 * h, 4.0 * h**2]]
    )  # fmt: skip
    local_mass = np.array(
        [[156.0, 22.0 * h, 54.0, -13.0 * h], [22.0 * h, 4.0 * h**2, 13.0 * h, -3.0 * h**2],
         [54.0, 13.0 * h, 156.0, -22.0 * h], [-13.0 * h, -3.0 * h**2, -22.0 * h, 4.0 * h**2]]
    )  # fmt: skip
    stiffness = beam.bending_stiffness / h**3 * _assemble(local_stiffness, elements, shared=2)
    mass = beam.mass_per_length * h / 420.0 * _assemble(local_mass, elements, shared=2)
    return _tip_system(stiffness[2:, 2:], mass[2:, 2:], None, -2)


def _assemble(local: FloatArray, elements: int, *, shared: int = 1) -> FloatArray:
    """Equal elements in a row; neighbours share so many dofs."""
    stride = len(local) - shared
    total = np.zeros((elements * stride + shared,) * 2)
    for element in range(elements):
        here = slice(element * stride, element * stride + len(local))
        total[here, here] += local
    return total


def _tip_system(
    stiffness: FloatArray, mass: FloatArray, damping: FloatArray | None, tip: int
) -> SecondOrderSystem:
    channel = np.zeros(len(mass))
    channel[tip] = 1.0
    return SecondOrderSystem(
        mass,
        damping,
        stiffness,
        {TIP: channel},
        {TIP: channel},
        tuple(f"q{i}" for i in range(len(mass))),
    )
