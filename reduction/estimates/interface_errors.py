"""How much of a motion lies in the deformation shapes of joints between flexible interfaces."""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint
from headstock.reduction.coupling.coupling import CoupledMachine


def shape_energies(
    coupled: CoupledMachine, joints: Mapping[str, Joint], motions: FloatArray
) -> dict[str, FloatArray]:
    """Twice the strain energies ``(m,)`` that the shapes at each joint hold.

    In the strong form this is, to first order, by how much the squares of the angular frequencies
    of mass-normalised modes fall when the joint gets its shapes.

    Args:
        coupled: The machine with shapes.
        joints: By name; only those with shapes are among the result.
        motions: ``(n, m)`` generalised displacements.
    """
    stacked = coupled.basis @ motions
    found: dict[str, FloatArray] = {}
    for name, joint in joints.items():
        for end in joint.ends:
            part = coupled.layout.superelements.get(end.component or "")
            entry = None if part is None else part.interface_maps.get(end.interface or "")
            if part is None or entry is None or entry.shapes is None:
                continue
            own = slice(entry.shapes.first, entry.shapes.first + entry.shapes.count)
            moved = stacked[coupled.offsets[end.component or ""]][own]
            energy = np.einsum("im,ij,jm->m", moved, part.stiffness[own, own], moved)
            found[name] = found.get(name, np.zeros(motions.shape[1])) + energy
    return found
