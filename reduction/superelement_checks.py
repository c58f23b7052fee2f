"""Checks that a superelement must pass before it is coupled: symmetry, definiteness, rigid-body
motions, mass properties.
"""

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.meshing.component_mesh import IntArray
from headstock.reduction.rails import CONTROL_POINT_DOFS, control_point_motion
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import AccuracyError

SYMMETRY_LIMIT = 1e-12
RIGID_STIFFNESS_LIMIT = 1e-9
DEFINITENESS_LIMIT = 1e-9
ROUNDING = float(np.finfo(float).eps)
DEVIATIONS = 4.0  # standard ones of a sum of rounding errors: one in 16 000 is larger
FILE_ROUNDING = 1e-11  # of numbers from files, which other programs may have printed


def check_superelement(superelement: Superelement, *, rounding: float = ROUNDING) -> None:
    """Check symmetry, definiteness, rigid-body motions and mass properties of a superelement.

    A supported component has no rigid-body motions, and a superelement whose mass was not assembled
    (all zero) no mass properties; those checks fall away for it.

    Args:
        rounding: Relative error of its numbers: of double precision, or ``FILE_ROUNDING``.

    Raises:
        AccuracyError: Names the property that is off, by how much and the limit.
    """
    _check_finite(superelement)
    scale = dof_scale(superelement)
    stiffness = superelement.stiffness * scale * scale[:, None]
    mass = superelement.mass * scale * scale[:, None]
    for matrix, what in ((stiffness, "stiffness"), (mass, "mass")):
        _check_symmetric_semidefinite(superelement.name, matrix, what)
    if not superelement.supported:
        _check_rigid_stiffness(superelement, stiffness, scale)
        _check_mass_properties(superelement, rounding)


def characteristic_length(superelement: Superelement) -> float:
    """Return the length that makes rotations comparable to translations [m]: radius of gyration, or
    extent of the boundary nodes.
    """
    if superelement.mass_kg > 0.0 and np.trace(superelement.inertia) > 0.0:
        return float(np.sqrt(0.5 * np.trace(superelement.inertia) / superelement.mass_kg))
    origins = np.array([frame.origin for frame in superelement.frames]).reshape(-1, 3)
    extent = float(np.linalg.norm(np.ptp(origins, axis=0))) if len(origins) else 0.0
    return extent if extent > 0.0 else 1.0


def dof_scale(superelement: Superelement) -> FloatArray:
    """Return the factor per dof ``(n,)`` after which every dof is a length: rotations 1/L, modal
    dofs 1/sqrt(mass).
    """
    scale = np.ones(len(superelement.labels))
    length = characteristic_length(superelement)
    scale[: superelement.boundary_size][rotation_dofs(superelement)] = 1.0 / length
    # a mass-normalised modal dof has the unit m sqrt(kg)
    scale[superelement.boundary_size :] = (
        np.sqrt(superelement.mass_kg) if superelement.mass_kg > 0.0 else 1.0
    )
    return scale


def rotation_dofs(superelement: Superelement) -> IntArray:
    """Return which boundary dofs are rotations."""
    nodes = (6 * np.arange(len(superelement.frames))[:, None] + np.arange(3, 6)).ravel()
    control_points = (
        superelement.node_size
        + CONTROL_POINT_DOFS * np.arange(len(superelement.control_points))
        + CONTROL_POINT_DOFS
        - 1
    )
    return np.concatenate([nodes, control_points])


def rigid_motions(superelement: Superelement, origin: FloatArray) -> FloatArray:
    """Return the dofs ``(n, 6)`` of the six rigid motions about a point of the component frame;
    modal dofs rest.
    """
    motions = np.zeros((len(superelement.labels), 6))
    nodes = motions[: 6 * len(superelement.frames)].reshape(-1, 6, 6)
    if len(nodes):
        places = np.array([frame.origin for frame in superelement.frames])
        nodes[:, :3] = rigid_map(places, origin).reshape(-1, 3, 6)
        nodes[:, 3:, 3:] = np.eye(3)
    for number, control_point in enumerate(superelement.control_points):
        first = superelement.node_size + CONTROL_POINT_DOFS * number
        motions[first : first + CONTROL_POINT_DOFS] = control_point_motion(
            control_point.point, control_point.axis, origin
        )
    return motions


def _check_finite(superelement: Superelement) -> None:
    arrays = {
        "stiffness": superelement.stiffness,
        "mass": superelement.mass,
        "constraints": superelement.constraints,
    }
    if superelement.damping is not None:
        arrays["damping"] = superelement.damping
    for what, array in arrays.items():
        if not np.isfinite(array).all():
            raise AccuracyError(
                f"component {superelement.name!r}: its {what} holds values that are not finite"
            )


def _check_symmetric_semidefinite(name: str, matrix: FloatArray, what: str) -> None:
    largest = float(np.abs(matrix).max(initial=0.0))
    if largest == 0.0:
        return
    asymmetry = float(np.abs(matrix - matrix.T).max()) / largest
    if not asymmetry <= SYMMETRY_LIMIT:
        raise AccuracyError(
            f"component {name!r}: its {what} is unsymmetric by {asymmetry:.2g}, limit {SYMMETRY_LIMIT:g}"
        )
    lowest = float(np.linalg.eigvalsh(matrix / largest)[0])
    if not lowest >= -DEFINITENESS_LIMIT:
        raise AccuracyError(
            f"component {name!r}: its {what} has a negative direction, {lowest:.2g} of its largest entry, "
            f"limit {-DEFINITENESS_LIMIT:g}; look for inverted elements"
        )


def _check_rigid_stiffness(
    superelement: Superelement, stiffness: FloatArray, scale: FloatArray
) -> None:
    motions = rigid_motions(superelement, superelement.center_of_mass) / scale[:, None]
    boundary = superelement.boundary_size
    # one interface has no stiffness but rounding, which is small compared with that of the lowest
    # mode
    scale_of_modes = stiffness.diagonal()[boundary:].min(initial=np.inf)
    size = max(
        float(np.linalg.norm(stiffness[:, :boundary])),
        float(scale_of_modes) if np.isfinite(scale_of_modes) else 0.0,
    )
    norm = size * float(np.linalg.norm(motions))
    residual = float(np.linalg.norm(stiffness @ motions))
    if norm > 0.0 and not residual <= RIGID_STIFFNESS_LIMIT * norm:
        raise AccuracyError(
            f"component {superelement.name!r}: a rigid motion meets {residual / norm:.2g} of its stiffness, "
            f"limit {RIGID_STIFFNESS_LIMIT:g}; tighten the solver's tolerance, or mark the component as supported"
        )


def _check_mass_properties(superelement: Superelement, rounding: float) -> None:
    """Compare the mass of rigid motions with mass, centre and inertia, as closely as rounding of
    the mass matrix lets them agree.

    Entries ``m_ij`` are sums over the mesh of products of shapes, off by ``rounding * sqrt(m_ii
    m_jj)`` times the square root of the number of terms where signs are random; in a rigid motion r
    they add up to ``(sum_i |r_i| sqrt(m_ii))^2``, which is much more than its mass where shapes all
    but cancel. Places far from the component's origin are themselves rounded, by ``rounding`` of
    their distance.

    Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), secs. 2.8 and 3.1.
    """
    if not superelement.mass.any():
        return
    length = characteristic_length(superelement)
    motions = rigid_motions(superelement, superelement.center_of_mass) * np.repeat(
        [1.0, 1.0 / length], 3
    )
    wanted = np.zeros((6, 6))
    wanted[:3, :3] = superelement.mass_kg * np.eye(3)
    wanted[3:, 3:] = superelement.inertia / length**2
    scale = max(superelement.mass_kg, np.finfo(float).tiny)
    error = np.abs(motions.T @ superelement.mass @ motions - wanted) / scale
    sizes = np.abs(motions).T @ np.sqrt(np.abs(superelement.mass.diagonal()))
    terms = np.sqrt(max(superelement.full_dofs, len(superelement.labels)))
    places = np.array(
        [superelement.center_of_mass, *(frame.origin for frame in superelement.frames)]
    )
    distance = float(np.abs(places).max()) / length
    limit = rounding * (DEVIATIONS * terms + distance) * np.outer(sizes, sizes) / scale
    blocks = {"mass": np.s_[:3, :3], "centre of mass": np.s_[:3, 3:], "inertia": np.s_[3:, 3:]}
    for what, block in blocks.items():
        value, allowed = float(error[block].max()), float(limit[block].max())
        if not value <= allowed:
            raise AccuracyError(
                f"component {superelement.name!r}: its {what} is off by {value:.2g} (relative), rounding allows {allowed:.2g}; "
                "the mesh or the reduction has lost mass"
            )
