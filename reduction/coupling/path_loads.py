"""What accelerating axes does to a coupled machine: the inertia of the rigid travel as a load."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.paths.varying_system import PosedModes
from headstock.solvers.second_order import SecondOrderSystem

PATH_INPUT = ("path", "acceleration")


def add_path_input(
    system: SecondOrderSystem, coupled: CoupledMachine, directions: Mapping[str, FloatArray]
) -> SecondOrderSystem:
    """The system with the acceleration along a path as an input: ``M d'' + C d' + K d = -M
    a_rigid``.

    Its coordinates are then displacements about the rigid machine that travels as its set point
    says. A drive whose motor follows its set point is what the scene describes: the screw's spring
    between motor and slider.

    Args:
        system: Of the machine, with whatever damping.
        coupled: The machine it belongs to, in the same coordinates.
        directions: Velocity ``(3,)`` of every component that travels per unit speed along the path,
            machine frame.

    Raises:
        ModelError: A component that travels is itself fixed to the machine frame.
    """
    load = inertia_load(coupled, directions)
    return dataclasses.replace(system, inputs={**system.inputs, PATH_INPUT: load})


def inertia_load(coupled: CoupledMachine, directions: Mapping[str, FloatArray]) -> FloatArray:
    """Generalised load ``(n,)`` per unit acceleration along a path: the mass times the rigid
    travel, reversed [kg].

    Raises:
        ModelError: A component that travels is itself fixed to the machine frame.
    """
    stacked = np.zeros(coupled.layout.size)
    for name, direction in directions.items():
        superelement, placement = coupled.layout.superelements[name], coupled.placements[name]
        if superelement.supported:
            raise ModelError(
                f"component {name!r} travels along the path, but some of its points are fixed; remove its support"
            )
        own = rigid_motions(superelement, superelement.center_of_mass)[:, :3] @ (
            placement.rotation.T @ direction
        )
        travel = turn_dofs(superelement, placement).T @ own
        stacked[coupled.offsets[name]] = -coupled.matrices.masses[name] @ travel
    return np.asarray(coupled.basis.T @ stacked)


def stack_modes(
    system: SecondOrderSystem, modes: ModalResult, coupled: CoupledMachine
) -> PosedModes:
    """A system with its modes in the stacked dofs of the components, which are the same in every
    pose of a path.

    Args:
        system: The machine in one pose, ``n`` free coordinates, with its path input.
        modes: Its natural modes ``(n, m)``.
        coupled: The coupling with the basis ``(n_all, n)`` and the masses of the components.
    """
    motions = coupled.basis @ modes.shapes
    momenta = np.zeros_like(motions)
    for name, own in coupled.offsets.items():
        momenta[own] = coupled.matrices.masses[name] @ motions[own]
    return PosedModes(system, modes, motions, momenta)
