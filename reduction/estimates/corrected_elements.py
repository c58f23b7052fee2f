"""Superelements changed by their own error estimates: corrected by the estimated discretisation
error, so that only the error of the estimate remains, or refined, without one source of error.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from scipy.linalg import eigh

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import Box
from headstock.reduction.estimates.mesh_errors import SHAPE_SAFETY
from headstock.reduction.superelement import ProbeRows, Recovery, StaticLoad, Superelement

ROUNDING = 1e-13  # over that of the largest direction: below it a dof moves the whole body rigidly

# arrays of a superelement's errors, by its dofs
MATRICES = (
    "missing_energy",
    "shape_stiffness",
    "shape_mass",
    "left_out_stiffness",
    "left_out_mass",
)
LEAST_MODE = 1e-8  # smallest eigenvalue, over the largest, of the participation that gets a mode


def correct_mesh(element: Superelement) -> Superelement:
    """Return the superelement as finer meshes would have it, to first order in the estimate of its
    mesh; unchanged where there is no estimate, or where it is corrected already.

    The compliance grows by the energy that the mesh misses: ``K_c^-1 = K^-1 + K^-1 E K^-1``, so
    that ``K_c = K (K + E)^-1 K`` has no negative direction however large ``E`` is, and the same
    rigid motions as ``K``. The error had one sign before; the remaining error is a share of the
    estimate, with either sign.

    Args:
        element: Superelement of finite elements, with the estimate of its mesh.

    Source: Naga, Zhang and Zhou (2006), SIAM J. Sci. Comput. 28, 1289-1300, for eigenvalues corrected
    by recovered gradients; Clapeyron as in ``compliance_mesh_errors``.
    """
    errors = element.errors
    if errors.corrected or errors.missing_energy is None or not errors.missing_energy.any():
        return element
    share, left = errors.mesh_truth
    return dataclasses.replace(
        _soften_element(element, share),
        errors=dataclasses.replace(errors, mesh_safety=left, corrected=True),
    )


def _soften_element(element: Superelement, share: float) -> Superelement:
    """Return the superelement with a share of the missing energy of its mesh taken out of its
    stiffness; unchanged where there is no estimate.

    Args:
        element: Superelement of finite elements, with the estimate of its mesh.
        share: Share of its ``missing_energy``; ``mesh_safety`` makes it as soft as its ± allows.
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
    """Return ``K (K + E)^-1 K`` as ``K - E + E (K + E)^+ E``, also with rigid motions."""
    total = stiffness + missing
    scale = 1.0 / np.sqrt(np.where((size := total.diagonal()) > 0.0, size, 1.0))
    values, shapes = np.linalg.eigh(total * scale * scale[:, None])
    kept = values > ROUNDING * values[-1]
    rows = (shapes[:, kept] / np.sqrt(values[kept])).T * scale @ missing
    softer = stiffness - missing + rows.T @ rows
    return 0.5 * (softer + softer.T)


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
    """Return output rows with the missing share of the mesh added. Of stresses this keeps
    equilibrium with the loads: the softer coordinates alone would raise them.
    """
    return values if missing is None else values + share * missing


def _with_finer_mesh(element: Superelement) -> Superelement:
    """Return a superelement as soft as its mesh's ± allows; unchanged without an estimate."""
    return _soften_element(element, element.errors.mesh_safety)


def _with_true_faces(element: Superelement) -> Superelement:
    """Return a superelement with the curved faces and small features of the part; unchanged where
    its mesh represents these, or there is no estimate.
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


def _with_modes_left_out(element: Superelement) -> Superelement:
    """Return a superelement with modal dofs for the fixed-interface modes that it leaves out, all
    at the lowest of their frequencies: the upper limit of their effect at any frequency below it.
    Unchanged where it leaves out none.

    The sum of ``p_k p_k^T / omega_k^2`` is known, with the participation ``p_k`` of each mode;
    modes of one frequency with the same sum follow from its eigenvectors.
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
    widened: dict[str, Any] = {
        name: _widen(getattr(errors, name), count, 0, 1) for name in MATRICES
    }
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
        errors=dataclasses.replace(errors, truncation=None, **widened),
    )


def _widen(values: FloatArray | None, count: int, *axes: int) -> FloatArray | None:
    """Return an array with zeros for further dofs along some axes; None stays None."""
    if values is None:
        return None
    return np.pad(values, [(0, count if axis in axes else 0) for axis in range(values.ndim)])


@dataclass(frozen=True)
class Refinement:
    """Describe a source of error that can be removed from a machine, as far as it is estimated.

    Attributes:
        refine: Returns a superelement without the source; unchanged where it has none.
        concerns: Tells whether a component may have it.
        apart: Evaluate one component at a time, as the changes by several may cancel by chance.
    """

    refine: Callable[[Superelement], Superelement]
    concerns: Callable[[Component], bool]
    apart: bool = False


def _is_discrete(part: Component) -> bool:
    return part.fidelity in ("elastic", "polynomial")


def _is_curved(part: Component) -> bool:
    return part.fidelity == "elastic" and not isinstance(part.solid, Box)


FINER_MESH = Refinement(_with_finer_mesh, _is_discrete, apart=True)
TRUE_FACES = Refinement(_with_true_faces, _is_curved)
MORE_MODES = Refinement(_with_modes_left_out, _is_discrete)
# meshes and reductions both make a machine too stiff
FINER_WITH_MORE_MODES = Refinement(
    lambda part: _with_modes_left_out(_with_finer_mesh(part)), _is_discrete
)
SEPARATE_REFINEMENTS = (FINER_MESH, TRUE_FACES, MORE_MODES)
COMBINED_REFINEMENTS = (FINER_WITH_MORE_MODES, TRUE_FACES)  # for long analyses


def list_refinements(
    components: Mapping[str, Component], refinements: Sequence[Refinement]
) -> list[tuple[Refinement, tuple[str, ...]]]:
    """List each refinement with the components that it concerns, combined or one at a time."""
    pairs: list[tuple[Refinement, tuple[str, ...]]] = []
    for refinement in refinements:
        names = tuple(name for name, part in components.items() if refinement.concerns(part))
        if refinement.apart:
            pairs += [(refinement, (name,)) for name in names]
        elif names:
            pairs.append((refinement, names))
    return pairs
