"""What the meshes of the components make of the error of a coupled machine's frequencies and compliances."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling import CoupledMachine
from headstock.reduction.dof_layout import turn_dofs
from headstock.solvers.modal_analysis import ModalResult


@dataclass(frozen=True, eq=False)
class MeshedPart:
    """A component with an estimate of its mesh, and its dofs in terms of the machine's coordinates.

    Attributes:
        energy: ``(n_c, n_c)`` products of the energies that its mesh misses.
        rows: ``(n_c, n)``.
    """

    energy: FloatArray
    rows: FloatArray


def meshed_parts(coupled: CoupledMachine) -> dict[str, MeshedPart]:
    """The components of a machine whose mesh has an estimate."""
    return {
        name: MeshedPart(part.missing_energy, turn_dofs(part, coupled.placements[name]) @ coupled.basis[coupled.offsets[name]])
        for name, part in coupled.layout.superelements.items()
        if part.missing_energy is not None
    }


def missing_energies(coupled: CoupledMachine, motions: FloatArray) -> dict[str, FloatArray]:
    """Energy products of the discretisation errors of each meshed component under motions of the machine.

    Args:
        coupled: The machine.
        motions: ``(n, m)`` generalised displacements.

    Returns:
        Component to ``(m, m)``; components without an estimate are left out.
    """
    seen = {name: (part.energy, part.rows @ motions) for name, part in meshed_parts(coupled).items()}
    return {name: own.T @ energy @ own for name, (energy, own) in seen.items()}


def frequency_mesh_errors(coupled: CoupledMachine, modes: ModalResult) -> dict[str, FloatArray]:
    """By how much each mesh makes the natural frequencies too high, ``(m,)`` per component [Hz].

    The square of a frequency is too large by the energy norm of the shape's error; what the kinetic energy adds is of higher order.

    Source: Strang and Fix (1973), An Analysis of the Finite Element Method, lemma 6.3.
    """
    elastic = np.arange(len(modes.frequencies_hz)) >= modes.rigid_count
    squares = np.where(elastic, (2.0 * np.pi * modes.frequencies_hz) ** 2, np.inf)
    shares = {name: np.diag(energy) / squares for name, energy in missing_energies(coupled, modes.shapes).items()}
    total = np.sum([np.zeros(len(squares)), *shares.values()], axis=0)
    # exact for the sum, however large: an error of the square beyond the square itself takes the whole frequency
    drop = modes.frequencies_hz * (1.0 - np.sqrt(np.maximum(1.0 - total, 0.0)))
    return {name: drop * share / np.where(total > 0.0, total, 1.0) for name, share in shares.items()}


def compliance_mesh_errors(coupled: CoupledMachine, displacements: FloatArray) -> dict[str, FloatArray]:
    """By how much each mesh makes a static compliance too small.

    Args:
        coupled: The machine.
        displacements: ``(n, 6)`` responses to unit loads at a point.

    Returns:
        Component to ``(6, 6)``, to be added to the compliance: its diagonal is never negative.

    Source: Clapeyron; the energy of a finite element solution under given loads is too small by the energy of its error.
    """
    return missing_energies(coupled, displacements)
