"""A superelement whose matrices are corrected by what its mesh is estimated to miss, so that errors are
what is left of the estimate.
"""

import dataclasses

import numpy as np
from scipy.linalg import eigh

from headstock.geometry.frames import FloatArray
from headstock.reduction.superelement import ProbeRows, StaticLoad, Superelement

ROUNDING = 1e-13  # of the largest direction, below which a dof moves nothing but the whole body


def correct_mesh(element: Superelement) -> Superelement:
    """Return the superelement as finer meshes would have it, to first order in the estimate of its
    mesh; itself where nothing is known of that, or where it is corrected already.

    The compliance grows by the energy that the mesh misses: ``K_c^-1 = K^-1 + K^-1 E K^-1``, so that
    ``K_c = K (K + E)^-1 K`` has no negative direction however large ``E`` is, and the rigid motions of
    ``K``. Errors, which had one sign, have either afterwards, and are a share of the estimate.

    Args:
        element: Of finite elements, with the estimate of its mesh.

    Source: Naga, Zhang and Zhou (2006), SIAM J. Sci. Comput. 28, 1289-1300, for eigenvalues corrected
    by recovered gradients; Clapeyron as in ``compliance_mesh_errors``.
    """
    errors = element.errors
    if errors.corrected or errors.missing_energy is None or not errors.missing_energy.any():
        return element
    share, left = errors.mesh_truth
    return dataclasses.replace(
        soften_element(element, share),
        errors=dataclasses.replace(errors, mesh_safety=left, corrected=True),
    )


def soften_element(element: Superelement, share: float) -> Superelement:
    """Return the superelement with a share of the energy that its mesh misses taken out of its
    stiffness; itself where nothing is known of that.

    Args:
        element: Of finite elements, with the estimate of its mesh.
        share: Of its ``missing_energy``; ``mesh_safety`` leaves it as soft as ± allows.
    """
    missing = element.errors.missing_energy
    if missing is None or not missing.any():
        return element
    stiffness, modal = _soften(element.stiffness, share * missing), element.boundary_size
    squares = eigh(stiffness[modal:, modal:], element.mass[modal:, modal:], eigvals_only=True)
    return dataclasses.replace(
        element,
        stiffness=stiffness,
        modal_frequencies_hz=np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi),
        loads={name: _correct_load(load, share) for name, load in element.loads.items()},
        probes={name: _correct_probe(probe, share) for name, probe in element.probes.items()},
    )


def _soften(stiffness: FloatArray, missing: FloatArray) -> FloatArray:
    """Return ``K (K + E)^-1 K``, as ``K - E + E (K + E)^+ E``: what is rigid is not divided by."""
    total = stiffness + missing
    scale = 1.0 / np.sqrt(np.where((size := total.diagonal()) > 0.0, size, 1.0))
    values, shapes = np.linalg.eigh(total * scale * scale[:, None])
    kept = values > ROUNDING * values[-1]
    rows = (shapes[:, kept] / np.sqrt(values[kept])).T * scale @ missing
    softer = stiffness - missing + rows.T @ rows
    return np.asarray(0.5 * (softer + softer.T))


def _correct_load(load: StaticLoad, share: float) -> StaticLoad:
    if load.missing is None:
        return load
    return dataclasses.replace(load, vector=load.vector + share * load.missing)


def _correct_probe(probe: ProbeRows, share: float) -> ProbeRows:
    return dataclasses.replace(
        probe,
        values=_add_missing(probe.values, probe.missing, share),
        loads={
            name: dataclasses.replace(load, values=_add_missing(load.values, load.missing, share))
            for name, load in probe.loads.items()
        },
    )


def _add_missing(values: FloatArray, missing: FloatArray | None, share: float) -> FloatArray:
    """Return what is seen with what the mesh misses of it inside. Of stresses this is what keeps
    them in balance with the loads: the softer coordinates alone would raise them.
    """
    return values if missing is None else values + share * missing
