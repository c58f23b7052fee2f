"""The six-dof springs between the segments of a bar, and the mass of one segment."""

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_transfer
from headstock.geometry.parts.materials import Material
from headstock.geometry.parts.patches import in_plane_axes
from headstock.geometry.parts.prismatic_bars import PrismaticBar, shear_coefficient


def spring_stiffness(bar: PrismaticBar, material: Material, first: FloatArray, second: FloatArray) -> FloatArray:
    """Stiffness ``(12, 12)`` of a piece of a bar between two places on its axis [N/m, N, N m].

    Exact for loads at its ends: extension, Saint-Venant torsion and bending with shear in both directions.

    Source: Timoshenko (1921); Przemieniecki (1968), section 5.6 (by inversion of the end's flexibility).
    """
    length = float(np.linalg.norm(second - first))
    end = np.linalg.inv(end_flexibility(bar, material, length))
    if second[bar.axis] < first[bar.axis]:
        raise ValueError("a spring runs in the direction of the bar's axis")
    stretch = np.hstack([-rigid_transfer(first, second), np.eye(6)])
    stiffness = stretch.T @ end @ stretch
    return np.asarray(0.5 * (stiffness + stiffness.T))


def end_flexibility(bar: PrismaticBar, material: Material, length: float) -> FloatArray:
    """Motion ``(6, 6)`` of the upper end of a piece per unit load there, its lower end held [m/N, rad/N, rad/(N m)]."""
    modulus = material.youngs_modulus
    shear = modulus / (2.0 * (1.0 + material.poisson_ratio))
    across = in_plane_axes(bar.axis)
    flexibility = np.zeros((6, 6))
    flexibility[bar.axis, bar.axis] = length / (modulus * bar.area)
    flexibility[3 + bar.axis, 3 + bar.axis] = length / (shear * bar.torsion_constant)
    slide = length / (shear_coefficient(bar, material.poisson_ratio) * shear * bar.area)
    for direction, about, second_moment in zip(across, across[::-1], bar.second_moments, strict=True):
        bending = modulus * second_moment
        # a small rotation about `about` moves points further along the axis by +-1 in `direction`
        sign = float(np.cross(np.eye(3)[about], np.eye(3)[bar.axis])[direction])
        flexibility[direction, direction] = length**3 / (3.0 * bending) + slide
        flexibility[3 + about, 3 + about] = length / bending
        flexibility[direction, 3 + about] = flexibility[3 + about, direction] = sign * length**2 / (2.0 * bending)
    return flexibility


def segment_mass(bar: PrismaticBar, density: float, length: float) -> FloatArray:
    """Mass matrix ``(6, 6)`` of a rigid segment about its centre [kg, kg m^2]."""
    across = in_plane_axes(bar.axis)
    mass = density * bar.area * length
    matrix = np.diag([mass, mass, mass, 0.0, 0.0, 0.0])
    matrix[3 + bar.axis, 3 + bar.axis] = density * length * sum(bar.second_moments)
    for about, second_moment in zip(across[::-1], bar.second_moments, strict=True):
        matrix[3 + about, 3 + about] = density * length * second_moment + mass * length**2 / 12.0
    return matrix
