"""Superelements without one source of their errors, as far as its estimate says: with them any analysis
tells what the source is worth to it.
"""

import dataclasses

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.reduction.estimates.mesh_correction import soften_element
from headstock.reduction.estimates.mesh_errors import SHAPE_SAFETY
from headstock.reduction.superelement import Recovery, Superelement

LEAST_MODE = 1e-8  # of the largest share in the mass that modes left out take, one of them has


def with_finer_mesh(element: Superelement) -> Superelement:
    """Return a superelement as soft as the ± of its mesh leaves possible; itself where nothing is
    known of that.
    """
    return soften_element(element, element.errors.mesh_safety)


def with_true_faces(element: Superelement) -> Superelement:
    """Return a superelement with the curved faces and small features of the part; itself where its
    mesh cuts none short or nothing is known of that.
    """
    errors = element.errors
    for stiffness, mass in (
        (errors.shape_stiffness, errors.shape_mass),
        (errors.left_out_stiffness, errors.left_out_mass),
    ):
        if stiffness is not None and mass is not None and stiffness.any():
            element = dataclasses.replace(
                element,
                stiffness=element.stiffness + SHAPE_SAFETY * stiffness,
                mass=element.mass + SHAPE_SAFETY * mass,
            )
    return element


def with_modes_left_out(element: Superelement) -> Superelement:
    """Return a superelement with modal dofs for the fixed-interface modes that it leaves out, all
    at the lowest of them: the most that they can do at any frequency below it. Itself where it
    leaves out none.

    The sum of ``p_k p_k^T / omega_k^2`` is known, with the participation ``p_k`` of each mode; modes of
    one frequency that have this sum in common follow from its eigenvectors.
    """
    truncation = element.errors.truncation
    if truncation is None or not np.isfinite(truncation.limit) or not truncation.first.any():
        return element
    boundary = element.boundary_size
    size = np.sqrt(np.maximum(element.mass.diagonal()[:boundary], 0.0))
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(truncation.limit * truncation.first * scale * scale[:, None])
    kept = values > LEAST_MODE * values[-1]
    participations = size[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    count, dof_count = participations.shape[1], len(element.stiffness)
    mass = scipy.linalg.block_diag(element.mass, np.eye(count))
    mass[:boundary, dof_count:] = participations
    mass[dof_count:, :boundary] = participations.T
    errors = element.errors
    hz = np.sqrt(truncation.limit) / (2.0 * np.pi)
    return dataclasses.replace(
        element,
        labels=(
            *element.labels,
            *(("mode", str(element.modal_count + 1 + number)) for number in range(count)),
        ),
        stiffness=scipy.linalg.block_diag(element.stiffness, truncation.limit * np.eye(count)),
        mass=mass,
        damping=_widen(element.damping, count, 0, 1),
        constraints=np.pad(element.constraints, ((0, 0), (0, count))),
        modal_frequencies_hz=np.concatenate([element.modal_frequencies_hz, np.full(count, hz)]),
        recovery=None
        if element.recovery is None
        else Recovery(
            np.pad(element.recovery.basis, ((0, 0), (0, count))), element.recovery.points
        ),
        loads={
            name: dataclasses.replace(
                load,
                vector=np.pad(load.vector, (0, count)),
                missing=_widen(load.missing, count, 0),
            )
            for name, load in element.loads.items()
        },
        rails={
            name: dataclasses.replace(rail, control=np.pad(rail.control, ((0, 0), (0, count))))
            for name, rail in element.rails.items()
        },
        probes={
            name: dataclasses.replace(
                probe,
                values=np.pad(probe.values, ((0, 0), (0, count))),
                smoothing=_widen(probe.smoothing, count, 2),
                missing=_widen(probe.missing, count, 1),
            )
            for name, probe in element.probes.items()
        },
        errors=dataclasses.replace(
            errors,
            truncation=None,
            missing_energy=_widen(errors.missing_energy, count, 0, 1),
            shape_stiffness=_widen(errors.shape_stiffness, count, 0, 1),
            shape_mass=_widen(errors.shape_mass, count, 0, 1),
            left_out_stiffness=_widen(errors.left_out_stiffness, count, 0, 1),
            left_out_mass=_widen(errors.left_out_mass, count, 0, 1),
        ),
    )


def _widen(values: FloatArray | None, count: int, *axes: int) -> FloatArray | None:
    """Return an array with zeros for further dofs along some axes; None stays None."""
    if values is None:
        return None
    return np.pad(values, [(0, count if axis in axes else 0) for axis in range(values.ndim)])
