"""What accelerating axes does to a coupled machine: the inertia of the rigid travel as a load."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rotate_dofs
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.control.drive_trains import (
    MOTOR,
    DriveTrain,
    find_turns,
    measured_channel,
)
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.motion.closed_loop import RigidTravel
from headstock.solvers.motion.plant import PosedModes
from headstock.solvers.second_order import SecondOrderSystem

PATH_INPUT = ("path", "acceleration")
POINT_ROWS = 12  # that a body which turns adds to its dofs: a point and the slope of a field


def add_path_input(
    system: SecondOrderSystem, coupled: CoupledMachine, directions: Mapping[str, FloatArray]
) -> SecondOrderSystem:
    """Return the system with the acceleration along a path as an input:
    ``M d'' + C d' + K d = -M a_rigid``.

    Its coordinates are then displacements about the rigid machine that travels as its set point
    says. A drive whose motor follows its set point is what the scene describes: the screw's spring
    between motor and slider.

    Args:
        system: Of the machine, with whatever damping.
        coupled: The machine it belongs to, in the same coordinates.
        directions: Of every component that travels, per unit speed along the path, machine frame:
            velocity ``(3,)``, or ``(6,)`` that of its centre of mass and how it turns.

    Raises:
        ModelError: A component that travels is itself fixed to the machine frame.
    """
    load = inertia_load(coupled, directions)
    return dataclasses.replace(system, inputs={**system.inputs, PATH_INPUT: load})


def inertia_load(coupled: CoupledMachine, directions: Mapping[str, FloatArray]) -> FloatArray:
    """Return the generalised load ``(n,)`` per unit acceleration along a path: the mass times the
    rigid travel, reversed [kg].

    Raises:
        ModelError: A component that travels is itself fixed to the machine frame.
    """
    return -coupled.basis.T @ find_momenta(coupled, rigid_travel(coupled, directions))


def rigid_travel(coupled: CoupledMachine, directions: Mapping[str, FloatArray]) -> FloatArray:
    """Return the motion ``(n_all,)`` of the stacked dofs of all components per travel along a path,
    without deformation.

    Raises:
        ModelError: A component that travels is itself fixed to the machine frame.
    """
    stacked = np.zeros(coupled.layout.size)
    for name, direction in directions.items():
        stacked[coupled.offsets[name]] = body_travel(coupled, name)[:, : len(direction)] @ direction
    return stacked


def body_travel(coupled: CoupledMachine, name: str) -> FloatArray:
    """Return the motion ``(n_own, 6)`` of the dofs of a component that moves as a rigid body along
    and about the machine's axes through its centre of mass.

    Raises:
        ModelError: The component is itself fixed to the machine frame.
    """
    superelement, placement = coupled.layout.superelements[name], coupled.placements[name]
    if superelement.supported:
        raise ModelError(
            f"component {name!r} travels along the path, but some of its points are fixed; remove its support"
        )
    local = rigid_motions(superelement, superelement.center_of_mass) @ rotate_dofs(
        placement.rotation.T
    )
    return turn_dofs(superelement, placement).T @ local


def body_loads(coupled: CoupledMachine, name: str) -> FloatArray:
    """Return the generalised loads ``(n, 6)`` per unit acceleration of a component as a rigid body:
    its mass times that motion, reversed.
    """
    return -coupled.basis[coupled.offsets[name]].T @ (
        coupled.matrices.masses[name] @ body_travel(coupled, name)
    )


def find_momenta(coupled: CoupledMachine, motions: FloatArray) -> FloatArray:
    """Return the masses of the components times motions ``(n_all, ...)`` of the stacked dofs."""
    momenta = np.zeros_like(motions)
    for name, dofs in coupled.offsets.items():
        momenta[dofs] = coupled.matrices.masses[name] @ motions[dofs]
    return momenta


def stack_modes(
    system: SecondOrderSystem, modes: ModalResult, coupled: CoupledMachine
) -> PosedModes:
    """Return a system with its modes in the stacked dofs of the components, which are the same in
    every pose of a path.

    Args:
        system: The machine in one pose, ``n`` free coordinates, with its path input.
        coupled: The coupling with the basis ``(n_all, n)`` and the masses of the components.
    """
    motions = coupled.basis @ modes.shapes
    return PosedModes(system, modes, motions, find_momenta(coupled, motions))


@dataclass(frozen=True, eq=False)
class TurningBody:
    """A body that is turned as the machine travels.

    Attributes:
        rows: Its dofs among the stacked ones.
        travel: ``(n_own, 6)`` their motion where it moves as a rigid body, its centre of mass along
            and itself about machine axes.
        mass: ``(n_own, n_own)`` in machine axes.
        rotation: ``(3, 3)`` from its own axes to the machine's.
        inertia: ``(3, 3)`` about its centre of mass, own axes.
    """

    rows: slice
    travel: FloatArray
    mass: FloatArray
    rotation: FloatArray
    kilograms: float
    inertia: FloatArray


def turn_with_bodies(posed: PosedModes, bodies: Sequence[TurningBody]) -> PosedModes:
    """Return the modes in dofs that stay with the matter of bodies that turn.

    A point of a body moves by ``t + [theta] R r``, with its place ``r`` in the body and the turn
    ``R`` of the pose. Parallel transport by the product of such motions over the mass of the body
    takes all of the coupling by speeds (Coriolis and gyroscopic terms) out of the equations; by that
    of ``t`` and ``theta`` it would leave what the turning of the inertia brings about. Of an elastic
    body that is so for the rigid part of its motion; its deformation is compared in machine axes.
    """
    motions, momenta = [posed.motions], [posed.momenta]
    for body in bodies:
        body_momenta, travel = posed.momenta[body.rows], body.travel
        rigid: FloatArray = np.asarray(
            # of a point mass without inertia the turn is open
            np.linalg.lstsq(travel.T @ body.mass @ travel, travel.T @ body_momenta)[0]
        )
        # the rigid part as it stands is taken off, and put back as a field of the body's points
        motions.append(travel @ rigid)
        momenta.append(np.asarray(-(body.mass @ (travel @ rigid))))
        motions.append(rigid[:3])
        momenta.append(body.kilograms * rigid[:3])
        moments = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
        slope = skew_matrices(rigid[3:].T) @ body.rotation
        motions.append(slope.reshape(len(slope), 9).T)
        momenta.append((slope @ moments).reshape(len(slope), 9).T)
    return dataclasses.replace(
        posed, motions=np.concatenate(motions), momenta=np.concatenate(momenta)
    )


def bound_gyroscopic_shift(
    posed: PosedModes, bodies: Sequence[TurningBody], rates: Sequence[float]
) -> float:
    """Return how far gyroscopic forces on the deformation of bodies, of which ``turn_with_bodies``
    has a part only, can move a natural frequency, as a share of it; to first order in the speeds.

    Two modes of equal frequency and unit mass that ``g`` couples are split by ``g / 2`` to both
    sides, modes of different frequencies by less. Of a body that turns at ``omega``, ``g = 2 omega
    int rho u_1 . (e x u_2)``; without that of its rigid motions alone it is at most ``2 omega (2
    sqrt(r s) + s)``, of which ``r`` and ``s`` are the shares of kinetic energy in its rigid motion
    and in its deformation.

    Args:
        posed: A machine in a pose, its modes of unit mass, in dofs that do not turn.
        rates: Speed of each [rad/s].
    """
    elastic = slice(posed.modes.rigid_count, None)
    shifts = np.zeros(posed.motions.shape[1])
    for body, rate in zip(bodies, rates, strict=True):
        momenta, travel = posed.momenta[body.rows], body.travel
        inertial = travel.T @ momenta
        rigid = (inertial * np.linalg.lstsq(travel.T @ body.mass @ travel, inertial)[0]).sum(axis=0)
        whole = (posed.motions[body.rows] * momenta).sum(axis=0)
        deforming = np.maximum(whole - rigid, 0.0)
        shifts += rate * (2.0 * np.sqrt(rigid * deforming) + deforming)
    omega = 2.0 * np.pi * posed.modes.frequencies_hz[elastic]
    return float((shifts[elastic] / omega).max(initial=0.0))


def find_rigid_travels(
    coupled: CoupledMachine,
    trains: Sequence[DriveTrain],
    directions: Mapping[str, FloatArray],
    shares: Mapping[str, float],
) -> tuple[RigidTravel, ...]:
    """Find what each drive does per travel along a path while the machine stays rigid.

    Args:
        coupled: The machine in a pose, motors locked.
        directions: Velocity ``(3,)`` of every component that travels per unit speed along the path.
        shares: Travel of each axis per travel along the path.
    """
    # the least-squares solution is the exact one: joints let axes travel
    travel = np.linalg.lstsq(coupled.basis, rigid_travel(coupled, directions), rcond=None)[0]
    travels = []
    for train in trains:
        motor, scale = float(train.stretch @ travel), float(train.scale @ travel)
        encoder = motor if measured_channel(train)[1] == MOTOR else scale
        share = shares.get(train.axis, 0.0)
        travels.append(RigidTravel(share, encoder, motor, float(train.slide @ travel)))
    return tuple(travels)


def add_driven_path_input(
    system: SecondOrderSystem,
    released: CoupledMachine,
    trains: Sequence[DriveTrain],
    directions: Mapping[str, FloatArray],
    travels: Sequence[RigidTravel],
) -> SecondOrderSystem:
    """Do the same for a machine with its motors unlocked: they and the screws turn as the travel
    asks.

    Args:
        system: From ``free_motors``, with whatever damping.
        released: The machine it belongs to, from ``release_motors``.
        trains: Its drives in the pose, rows as long as without motors.
        directions: Velocity ``(3,)`` of every component that travels per unit speed along the path.
    """
    load = inertia_load(released, directions)
    rows, masses = _turning_masses(trains, len(load))
    load = load - (masses * np.repeat([travel.motor for travel in travels], 2)) @ rows
    return dataclasses.replace(system, inputs={**system.inputs, PATH_INPUT: load})


def stack_driven_modes(
    system: SecondOrderSystem,
    modes: ModalResult,
    released: CoupledMachine,
    trains: Sequence[DriveTrain],
) -> PosedModes:
    """Return a machine with free motors and its modes, in the stacked dofs of the components and
    the turns of motors and screws in space.
    """
    bodies = stack_modes(system, modes, released)
    rows, masses = _turning_masses(trains, len(system.mass))
    turns = rows @ modes.shapes
    return dataclasses.replace(
        bodies,
        motions=np.vstack([bodies.motions, turns]),
        momenta=np.vstack([bodies.momenta, masses[:, None] * turns]),
    )


def housing_loads(trains: Sequence[DriveTrain], turned: FloatArray, total: int) -> FloatArray:
    """Return the loads ``(total, k)`` of motors and screws per unit acceleration with which their
    housings are turned.

    Args:
        trains: Drives of a machine with free motors.
        turned: ``(d, k)`` turn of each housing about its screw, as travel.
    """
    rows, masses = _turning_masses(trains, total)
    return -rows.T @ (masses[:, None] * np.repeat(turned, 2, axis=0))


def _turning_masses(trains: Sequence[DriveTrain], total: int) -> tuple[FloatArray, FloatArray]:
    """Return the turns in space ``(2 d, total)`` of each motor and its screw, and their masses
    ``(2 d,)`` [kg].
    """
    rows: list[FloatArray] = [np.zeros((0, total))]
    for train, turns in zip(trains, find_turns(trains, total), strict=True):
        stator = np.pad(train.stator, (0, total - len(train.stator)))
        rows.append(np.stack([turns.motor, turns.screw]) + stator)
    masses = [mass for train in trains for mass in (train.motor_mass, train.screw_mass)]
    return np.concatenate(rows), np.array(masses, dtype=float)
