"""Errors of a machine at rest by the meshes of its components: of the deviation of its tool in a
pose, and of displacements and stresses at probes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.channels import GRAVITY
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.coupling.probes import PlacedProbe, missing_of_loads
from headstock.reduction.estimates.mesh_errors import (
    SILENT_SHARE,
    meshed_parts,
    product_errors,
    silent_energies,
)
from headstock.reduction.motions.tool_deviation import FORCES, ToolDeviation
from headstock.solvers.linear.static_response import solve_balanced
from headstock.solvers.second_order import ComplexArray
from headstock.solvers.stresses import largest_von_mises, von_mises_change

SEEN, MOVED = 9, 3  # rows of a probe, and those of displacement; the others are stresses
STRESSED = SEEN - MOVED
# Safety factors that cover 95 % of true errors (`validate probes`): of the whole change of a stress; of
# each of its two parts, which may cancel by chance, and of stress changes by recovery around a probe; of
# these in an equivalent stress, which depends on one direction of the change only
WHOLE, PART, MISES_PART = 1.3, 1.7, 0.55
# share of a cell's size over which stress changes by recovery act as an error of the strain, by
# which the probe moves relative to its dofs
MOVED_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class DeviationChanges:
    """Store changes of the deviation ``(6,)`` of a tool [m, rad]; NaN where unknown.

    Attributes:
        meshes: Changes by finer meshes, times the safety factor that covers 95 % of true errors.
        faces: Changes by the true curved faces of parts, likewise times a factor.
        left_out: Changes by small features that meshes lack, likewise.
    """

    meshes: Mapping[str, FloatArray]
    faces: Mapping[str, FloatArray]
    left_out: Mapping[str, FloatArray]


def estimate_deviation(
    coupled: CoupledMachine,
    machine: Machine,
    gravity: FloatArray | None,
    deviation: ToolDeviation,
) -> dict[str, DeviationChanges]:
    """Estimate the changes of a deviation by finer meshes and true surfaces, by its source.

    The change by a mesh is the energy product of the errors of two responses, to the source and to
    a unit load at the tool: a sum over components. The change by a true surface is to first order
    ``lambda^T (df - dK u)``, with the weight ``df`` that a mesh lacks.

    Args:
        coupled: The machine in a pose, with the loads of its sources.
        gravity: ``(3,)`` acceleration in machine axes [m/s^2]; None without.

    Source: Prudhomme and Oden (1999), Comput. Methods Appl. Mech. Engrg. 176, 313-331.
    """
    influence = deviation.influence
    unknown = _is_silent(coupled, influence)
    parts, changes_by_source = meshed_parts(coupled), dict[str, DeviationChanges]()
    elements = coupled.layout.superelements
    for source, response in deviation.responses.items():
        loads = {GRAVITY: [GRAVITY], FORCES: list(machine.loads)}.get(source, [])
        inside = missing_of_loads(coupled, machine, gravity, loads)
        blank = np.where(unknown | _is_silent(coupled, response.moved[:, None])[0], np.nan, 0.0)
        acceleration = None if gravity is None or source != GRAVITY else gravity
        meshes: dict[str, FloatArray] = {}
        faces: dict[str, FloatArray] = {}
        left_out: dict[str, FloatArray] = {}
        for name, part in parts.items():
            turn = turn_dofs(elements[name], coupled.placements[name])
            local = part.rows @ influence
            given = part.without_rigid(
                part.rows @ response.moved + turn @ response.offset[coupled.offsets[name]]
            )
            strained = part.without_rigid(local)
            fallen: FloatArray = np.zeros(len(turn))
            if acceleration is not None:
                fallen = turn @ coupled.matrices.rigid[name][:, :3] @ acceleration
            meshes[name] = strained.T @ part.energy @ given + blank
            if name in inside:
                meshes[name] = meshes[name] + influence.T @ inside[name]
            for changes, change in ((faces, part.faces), (left_out, part.left_out)):
                if change is not None and change.stiffness.any():
                    changes[name] = local.T @ change.mass @ fallen - (
                        strained.T @ change.stiffness @ given
                    )
        changes_by_source[source] = DeviationChanges(meshes, faces, left_out)
    return changes_by_source


def _is_silent(coupled: CoupledMachine, motions: FloatArray) -> FloatArray:
    """Return which motions ``(n, m)`` strain dofs whose mesh error is not known."""
    energies = np.einsum("im,ij,jm->m", motions, coupled.system.stiffness, motions)
    return silent_energies(coupled, motions) > SILENT_SHARE * energies


@dataclass(frozen=True, eq=False)
class RestErrors:
    """Store errors of displacement x y z [m] and stress xx yy zz xy xz yz [Pa] at a probe.

    Attributes:
        products: Component to its change ``(9,)`` by finer meshes: by way of the coordinates, and
            in the probe's component inside; of displacements times the safety factor of the mesh,
            of stresses as estimated; NaN where unknown.
        faces: Component to the size ``(9,)`` of the changes by curved faces and small features that
            its mesh lacks.
        local: ``(s, 6)`` stress changes by recovery at the probe and around, as in
            ``ProbeRows.smoothing``.
        moved: Size of the displacement error within the cells of the probe [m].
    """

    component: str
    products: Mapping[str, FloatArray]
    faces: Mapping[str, FloatArray]
    local: FloatArray
    moved: float

    @property
    def meshes(self) -> dict[str, FloatArray]:
        """Sizes ``(9,)`` of the errors by the mesh of each component."""
        sizes = {name: np.abs(change) for name, change in self.products.items()}
        if self.component in sizes:
            sizes[self.component][:MOVED] += self.moved
        for name, size in sizes.items():
            whole = self.products[name][MOVED:]
            parts: FloatArray = np.zeros((0, STRESSED))
            if name == self.component:
                parts = np.vstack([whole, self.local])
                whole = whole + self.local[0]
            size[MOVED:] = np.linalg.norm(np.vstack([WHOLE * whole, PART * parts]), axis=0)
        return sizes


def estimate_at_rest(
    coupled: CoupledMachine, probe: PlacedProbe, moved: FloatArray, inside: Mapping[str, FloatArray]
) -> RestErrors:
    """Return the errors of displacement and stress at a probe in a static response.

    The error of a displacement is the energy product of the errors of the response and of the
    response to a unit force at the probe. That of a stress is the same with the load whose work is
    the stress, plus the stress change by recovery there: it contains the local error of the cells
    next to the probe, where the response to that load is hardly resolved. The part of the products
    by way of the coordinates is meaningless alone: where a part bends more, its stress per motion
    falls.

    Args:
        moved: ``(n,)`` static response.
        inside: ``missing_of_loads`` of the machine.

    Source: Prudhomme and Oden (1999) as in ``product_errors``; Zienkiewicz and Zhu (1992), Int. J.
    Numer. Meth. Engng. 33, 1331-1364, recovered stresses.
    """
    duals = solve_balanced(coupled.system, probe.values.T)
    meshes, faces = product_errors(coupled, duals.displacements, moved)
    for name, missing in inside.items():
        meshes[name] = meshes[name] + duals.displacements.T @ missing
    elements = coupled.layout.superelements
    for name, change in meshes.items():
        change[MOVED:] /= elements[name].errors.mesh_safety
    unknown = ~duals.balanced
    energy = float(moved @ coupled.system.stiffness @ moved)
    if float(silent_energies(coupled, moved[:, None])[0]) > SILENT_SHARE * energy:
        unknown[:] = True
    local: FloatArray = np.zeros((1, STRESSED))
    if probe.missing is None or probe.smoothing is None:
        unknown[:] = True
    else:
        missing_part, local = probe.missing @ moved, probe.smoothing @ moved
        for load in probe.loads.values():
            if load.missing is not None and load.smoothing is not None:
                missing_part, local = missing_part + load.missing, local + load.smoothing
        missing_part[:MOVED] *= probe.mesh_safety
        meshes[probe.component] += missing_part
    if probe.singular:
        unknown[MOVED:] = True
    return RestErrors(
        component=probe.component,
        products={name: np.where(unknown, np.nan, change) for name, change in meshes.items()},
        faces={name: np.abs(change) for name, change in faces.items()},
        local=local,
        moved=float(moved_locally(probe.strain_reach, local)),
    )


def moved_locally(strain_reach: float, local: ComplexArray | FloatArray) -> FloatArray:
    """Return the size of the displacement error within the cells of a probe ``(...)`` [m], which
    energy products underestimate where the probe hardly moves: that of the strain over a share of
    the cell size.

    Args:
        strain_reach: Size of the probe's largest cell over Young's modulus [m/Pa].
        local: ``(s, 6, ...)`` changes of stresses by recovery [Pa].
    """
    shears = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    squares = np.tensordot(shears, (np.abs(local) ** 2).sum(axis=0), axes=1)
    return MOVED_SHARE * strain_reach * np.sqrt(squares)


def bound_von_mises(stress: FloatArray, errors: RestErrors) -> tuple[float, float]:
    """Return the error of the equivalent stress by meshes, and by the curved faces and small
    features that they lack [Pa]; NaN where unknown.

    Args:
        stress: ``(6,)`` [Pa].
    """
    products = np.sum([change[MOVED:] for change in errors.products.values()], axis=0)
    parts = [
        *von_mises_change(stress, np.stack([products, errors.local[0]])),
        # the directions of stress changes around the probe are unknown at the probe
        *largest_von_mises(errors.local[1:]),
    ]
    whole = float(von_mises_change(stress, products + errors.local[0]))
    meshed = np.hypot(WHOLE * whole, MISES_PART * np.linalg.norm(parts))
    faces = [
        von_mises_change(stress, np.copysign(size[MOVED:], stress))
        for size in errors.faces.values()
    ]
    return float(meshed), float(np.sum(faces))
