"""What the meshes of the components make of the error of a coupled machine's frequencies and compliances."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.reduction.coupling import CoupledMachine
from headstock.reduction.dof_layout import turn_dofs
from headstock.solvers.modal_analysis import ModalResult

# share of a mode's energy in modal dofs whose mesh error nobody knows (imported parts): beyond it the mode has no estimate
SILENT_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class MeshedPart:
    """A component with an estimate of its mesh, and its dofs in terms of the machine's coordinates.

    Attributes:
        energy: ``(n_c, n_c)`` products of the energies that its mesh misses.
        rows: ``(n_c, n)``.
        silent: ``(n_c,)`` modal dofs that the estimate leaves out; some files estimate the lower ones only.
        reach_hz: Lowest fixed-interface frequency among them [Hz], inf with none.
    """

    energy: FloatArray
    rows: FloatArray
    silent: BoolArray
    reach_hz: float = np.inf


def meshed_parts(coupled: CoupledMachine) -> dict[str, MeshedPart]:
    """The components of a machine whose mesh has an estimate."""
    found = {}
    for name, part in coupled.layout.superelements.items():
        if part.missing_energy is not None:
            rows = turn_dofs(part, coupled.placements[name]) @ coupled.basis[coupled.offsets[name]]
            # a fixed-interface mode is strained, so a mesh misses some of its energy
            silent = np.diag(part.missing_energy) <= 0.0
            silent[: part.boundary_size] = False
            reach = part.modal_frequencies_hz[silent[part.boundary_size :]].min(initial=np.inf)
            found[name] = MeshedPart(part.missing_energy, rows, silent, float(reach))
    return found


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
    """By how much each mesh makes the natural frequencies too high, ``(m,)`` per component [Hz]; NaN where that is not known.

    The square of a frequency is too large by the energy norm of the shape's error; what the kinetic energy adds is of higher order.

    Source: Strang and Fix (1973), An Analysis of the Finite Element Method, lemma 6.3.
    """
    elastic = np.arange(len(modes.frequencies_hz)) >= modes.rigid_count
    squares = np.where(elastic, (2.0 * np.pi * modes.frequencies_hz) ** 2, np.inf)
    shares = {name: np.diag(energy) / squares for name, energy in missing_energies(coupled, modes.shapes).items()}
    total = np.sum([np.zeros(len(squares)), *shares.values()], axis=0)
    # exact for the sum, however large: an error of the square beyond the square itself takes the whole frequency
    drop = modes.frequencies_hz * (1.0 - np.sqrt(np.maximum(1.0 - total, 0.0)))
    unknown = elastic & (silent_shares(coupled, modes.shapes) > SILENT_SHARE)
    drop = np.where(unknown, np.nan, drop)
    return {name: drop * share / np.where(total > 0.0, total, 1.0) for name, share in shares.items()}


def silent_shares(coupled: CoupledMachine, shapes: FloatArray) -> FloatArray:
    """Kinetic energy ``(m,)`` of mass-normalised modes in modal dofs whose mesh error is not known."""
    moved = [(part.rows @ shapes)[part.silent] for part in meshed_parts(coupled).values()]
    return np.asarray(np.sum([np.zeros(shapes.shape[1]), *((own**2).sum(axis=0) for own in moved)], axis=0))


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
