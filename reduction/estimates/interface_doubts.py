"""How much the choice between rigid and averaging interfaces may matter, from the forces that pass through them."""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs

# A round punch of radius a on a half-space gives 0.5 (1 - nu^2) / (E a) under a force along its normal, even pressure 0.54 in the mean
# (Johnson 1985, Contact Mechanics, sections 3.2 and 3.4). Moments and the other directions give about as much: two halves of a bar came
# out within a factor of two of what both kinds give.
FORCE_DOUBT, MOMENT_DOUBT = 0.04, 0.12


def doubted_energies(
    coupled: CoupledMachine,
    motions: FloatArray,
    squares: FloatArray,
    areas: Mapping[tuple[str, str], float],
    parts: Mapping[str, Material],
) -> dict[str, FloatArray]:
    """Twice the energies ``(m,)`` by which the kind of each interface may change motions, by ``component.interface``.

    Args:
        coupled: The machine.
        motions: ``(n, m)`` generalised displacements.
        squares: ``(m,)`` of the angular frequencies at which they move, 0 at rest.
        areas: Area of fixed interfaces by component and interface [m^2].
        parts: Materials of meshed components.
    """
    found: dict[str, FloatArray] = {}
    for (name, interface), area in areas.items():
        element = coupled.layout.superelements[name]
        if interface not in element.attachments:
            continue
        own = turn_dofs(element, coupled.placements[name]) @ coupled.basis[coupled.offsets[name]] @ motions
        node = element.attachments[interface].node
        rows = slice(6 * node, 6 * node + 6)
        forces = element.stiffness[rows] @ own - (element.mass[rows] @ own) * squares
        radius, modulus = np.sqrt(area / np.pi), parts[name].youngs_modulus / (1.0 - parts[name].poisson_ratio ** 2)
        pushes, turns = (forces[:3] ** 2).sum(axis=0), (forces[3:] ** 2).sum(axis=0)
        found[f"{name}.{interface}"] = (FORCE_DOUBT * pushes / radius + MOMENT_DOUBT * turns / radius**3) / modulus
    return found
