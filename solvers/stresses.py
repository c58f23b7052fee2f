"""Symmetric stress tensors as six numbers, and their equivalent stress at rest and over a cycle."""

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.solvers.second_order import ComplexArray

# xx yy zz xy xz yz: rows and columns of the six numbers
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
STRESS_NAMES = tuple("xyz"[row] + "xyz"[column] for row, column in PAIRS)
# the same of stresses that recovery works with, after their three normal ones
SHEAR_PAIRS = ((1, 2), (0, 2), (0, 1))
# of the square of von Mises' stress, for the six numbers of a deviator: shear stands twice in it
_WEIGHTS = 1.5 * np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
_DEVIATOR = np.eye(6) - np.pad(np.full((3, 3), 1.0 / 3.0), (0, 3))


def pack_tensor[Number: np.inexact](tensors: NDArray[Number]) -> NDArray[Number]:
    """Return the six numbers ``(..., 6)`` of symmetric tensors ``(..., 3, 3)``."""
    return np.stack([tensors[..., row, column] for row, column in PAIRS], axis=-1)


def turn_stress(rotation: FloatArray) -> FloatArray:
    """Return the matrix ``(6, 6)`` from the six numbers in own axes to those in axes turned by a
    rotation ``(3, 3)``: ``R S R^T``.
    """
    columns = []
    for row, column in PAIRS:
        unit = np.zeros((3, 3))
        unit[row, column] = unit[column, row] = 1.0
        columns.append(pack_tensor(rotation @ unit @ rotation.T))
    return np.column_stack(columns)


def largest_von_mises(stress: ComplexArray | FloatArray) -> FloatArray:
    """Return the largest equivalent stress ``(...)`` over a cycle of ``Re(stress exp(i omega t))``,
    from complex amplitudes ``(..., 6)``; of real numbers the equivalent stress itself.

    With the deviator ``s = a + i b`` its square is ``(A + B) / 2 + (A - B) / 2 cos 2 omega t - C sin
    2 omega t``, with the weighted products ``A = a:a``, ``B = b:b`` and ``C = a:b``. It is largest at
    ``(s:conj(s) + |s:s|) / 2``, which is no more than the equivalent stress of the amplitudes only
    where all components are in phase.
    """
    deviator = stress @ _DEVIATOR
    mean = (np.abs(deviator) ** 2 * _WEIGHTS).sum(axis=-1)
    swing = np.abs((deviator * deviator * _WEIGHTS).sum(axis=-1))
    return np.asarray(np.sqrt(0.5 * (mean + swing)), dtype=np.float64)


def von_mises_change(
    stress: ComplexArray | FloatArray, change: ComplexArray | FloatArray
) -> FloatArray:
    """Return by how much a change ``(..., 6)`` of either sign changes the largest equivalent stress
    over a cycle ``(...)`` at most.
    """
    plain = largest_von_mises(stress)
    ends = [largest_von_mises(stress + change), largest_von_mises(stress - change)]
    return np.max([np.abs(end - plain) for end in ends], axis=0)


def true_stresses(material: Material, scaled: NDArray[np.floating]) -> FloatArray:
    """Return the stress tensors ``(..., 3, 3)`` [Pa] of scaled stresses ``(..., 6)``, half of whose
    square is the density of strain energy.

    Args:
        scaled: As ``stress_operators`` makes them: the deviator over sqrt(2 G) and the pressure on
            the diagonal, shear yz, xz, xy over sqrt(G).
    """
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    bulk = material.youngs_modulus / (3.0 * (1.0 - 2.0 * material.poisson_ratio))
    mean = scaled[..., :3].mean(axis=-1, keepdims=True)
    tensors = np.zeros((*scaled.shape[:-1], 3, 3))
    for position, (row, column) in enumerate(SHEAR_PAIRS):
        tensors[..., row, column] = tensors[..., column, row] = (
            np.sqrt(shear) * scaled[..., 3 + position]
        )
    # a pressure p stands as p / sqrt(3 K) at each of the three places
    diagonal = np.sqrt(2.0 * shear) * (scaled[..., :3] - mean) + np.sqrt(3.0 * bulk) * mean
    for axis in range(3):
        tensors[..., axis, axis] = diagonal[..., axis]
    return tensors
