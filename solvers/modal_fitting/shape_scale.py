"""What fitted shapes are worth: how much of one phase they are, their modal scale from driving points,
and whether each pole has one shape.
"""

from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.modal_fitting.modal_model import ModalModel
from headstock.solvers.second_order import ComplexArray


def phase_collinearity(shapes: ComplexArray) -> FloatArray:
    """Return the modal phase collinearity ``(k,)`` of shapes ``(m, k)``: 1 where all motions pass zero
    together, near 0 where phases are spread evenly.

    Source: Pappa, Elliott and Schenk (1993), without their mean.
    """
    real, imaginary = (np.sum(part**2, axis=0) for part in (shapes.real, shapes.imag))
    mixed = np.sum(shapes.real * shapes.imag, axis=0)
    whole = np.where(real + imaginary > 0.0, real + imaginary, 1.0)
    return np.asarray(((real - imaginary) ** 2 + 4.0 * mixed**2) / whole**2)


def mean_phases(shapes: ComplexArray) -> FloatArray:
    """Return the angle ``(k,)`` of the line in the complex plane that shapes ``(m, k)`` lie along [rad],
    from -pi/2 to pi/2.
    """
    return np.asarray(0.5 * np.angle(np.sum(shapes**2, axis=0)))


def scale_shapes(
    model: ModalModel, driving_points: Sequence[tuple[int, int, float]]
) -> tuple[ComplexArray, FloatArray]:
    """Return shapes ``(m, k)`` of modal mass one, and how well driving points agree with each other
    ``(k,)``: the share of the residues there that one scale per mode explains; nan of a single one.

    Args:
        driving_points: Motion, force, and the cosine between their directions, 1 or -1; at least one.
    """
    motions, forces, signs = (np.array(each) for each in zip(*driving_points, strict=True))
    moved = signs[:, None] * model.shapes[motions]
    excited = model.participations[forces]
    # participations come from all motions, the shape at a driving point from one response: it has
    # the noise, and is what is regressed
    products = np.sum(excited.conj() * moved, axis=0)
    sizes = np.sum(np.abs(excited) ** 2, axis=0)
    ratios = np.where(products == 0.0, np.inf, products)
    scaled = model.shapes * np.sqrt(2j * model.poles.imag * sizes / ratios)
    both = sizes * np.sum(np.abs(moved) ** 2, axis=0)
    agreement = np.abs(products) ** 2 / np.where(both > 0.0, both, 1.0)
    if len(driving_points) == 1:
        agreement = np.full(len(model.poles), np.nan)
    return _turn_up(scaled), agreement


def scale_deviations(
    model: ModalModel, driving_points: Sequence[tuple[int, int, float]]
) -> FloatArray:
    """Return relative standard deviations ``(k,)`` of the scales of ``scale_shapes``, from noise at
    driving points.
    """
    motions, forces, _ = (np.array(each) for each in zip(*driving_points, strict=True))
    excited, moved = np.abs(model.participations[forces]), np.abs(model.shapes[motions])
    noise = np.linalg.norm(excited * model.shape_deviations[motions], axis=0)
    return np.asarray(0.5 * noise / np.maximum(np.sum(excited * moved, axis=0), 1e-300))


def unit_shapes(shapes: ComplexArray) -> ComplexArray:
    """Return shapes ``(m, k)`` with mean phase zero and a largest motion of one."""
    largest = np.max(np.abs(shapes), axis=0, initial=0.0)
    turned = shapes * np.exp(-1j * mean_phases(shapes))
    return _turn_up(turned / np.where(largest > 0.0, largest, 1.0))


def one_shape_shares(
    model: ModalModel, frequencies_hz: FloatArray, values: ComplexArray
) -> FloatArray:
    """Return, per mode, the share ``(k,)`` of its residues ``(m, f)`` that one shape explains, in
    squares: much less than 1 says that there are two modes.

    Residues are those of the model and what responses ``(l, m, f)`` without the model still have of
    the pole.
    """
    rest = np.nan_to_num(values - model.evaluate(frequencies_hz))
    shares = np.ones(len(model.poles))
    laplace = 2j * np.pi * frequencies_hz
    for mode, pole in enumerate(model.poles):
        shape = 1.0 / (laplace - pole)
        missing = np.tensordot(shape.conj(), rest, axes=1) / np.sum(np.abs(shape) ** 2)
        residues = np.outer(model.shapes[:, mode], model.participations[:, mode]) + missing
        levels = np.linalg.svd(np.where(np.isfinite(values[0]), residues, 0.0), compute_uv=False)
        shares[mode] = levels[0] ** 2 / max(float(np.sum(levels**2)), np.finfo(float).tiny)
    return shares


def _turn_up(shapes: ComplexArray) -> ComplexArray:
    """Return shapes whose largest motion has a positive real part."""
    if not shapes.size:
        return shapes
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(shapes.shape[1])]
    return np.asarray(shapes * np.where(largest.real < 0.0, -1.0, 1.0))
