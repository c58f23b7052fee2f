"""Errors of how far a tool is off in a pose without moving, by the meshes of the machine's components."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.channels import GRAVITY
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.coupling.probes import missing_of_loads
from headstock.reduction.estimates.mesh_errors import (
    SILENT_SHARE,
    meshed_parts,
    silent_energies,
)
from headstock.reduction.motions.tool_deviation import FORCES, ToolDeviation


@dataclass(frozen=True, eq=False)
class DeviationChanges:
    """Changes of a deviation ``(6,)`` of a tool [m, rad], by component; NaN where nobody knows.

    Attributes:
        meshes: With finer meshes, times the factor that covers 95 % of true errors.
        faces: With the true curved faces of parts, likewise times a factor.
        left_out: With small features that meshes lack, likewise.
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
    """Estimate what finer meshes and true surfaces change in a deviation, by its source.

    The change by a mesh is the energy product of the errors of two responses, to the source and to
    a unit load at the tool: a sum over components. What a true surface changes is to first order
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
        pull = None if gravity is None or source != GRAVITY else gravity
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
            if pull is not None:
                fallen = turn @ coupled.matrices.rigid[name][:, :3] @ pull
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
    return np.asarray(silent_energies(coupled, motions) > SILENT_SHARE * energies)
