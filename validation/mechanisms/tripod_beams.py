"""The tripod with elastic legs as a frame of beam elements, independent of superelements, rails and
coupling.

Every leg is a row of Timoshenko elements (Przemieniecki 1968, sections 5.6 and 11.4; Davis,
Henshell and Warburton 1972 for the mass with shear), everything else is rigid. Joints are rows of
constraints whose null space is taken by a singular value decomposition.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray, Frame, rigid_transfer, rotate_dofs, skew
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.prismatic_bars import PrismaticBar, prismatic_bar, shear_coefficient
from headstock.geometry.parts.solids import Tube

FRAME, PLATFORM = slice(0, 6), slice(6, 12)
ELEMENTS_PER_METRE = 20
CARRIAGE_ELEMENTS = 8
SIMPSON = np.array([1.0, *([4.0, 2.0] * (CARRIAGE_ELEMENTS // 2))[:-1], 1.0]) / (
    3.0 * CARRIAGE_ELEMENTS
)


@dataclass(frozen=True, eq=False)
class RigidPart:
    """A rigid body: mass [kg], centre of mass ``(3,)`` in the machine frame [m] and inertia ``(3,
    3)`` about it in machine axes.
    """

    mass: float
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class ElasticLeg:
    """A leg in a pose.

    Attributes:
        tube: Shape, material and mass.
        placement: Of the tube, its axis z, in the machine frame.
        sleeve: Rigid, around the base joint.
        base: ``(3,)`` base joint in the machine frame [m].
        tip: ``(3,)`` platform joint.
        carriage: Length of the sleeve's hold on the leg [m].
        free_rotation: Axis of the tube's frame the platform joint turns freely about, 0 or 1.
        second_axis: ``(3,)`` axis of the base joint on the frame, machine frame; None for a ball.
        springs: Across the leg and along it, at the platform joint [N/m].
    """

    tube: Component
    placement: Frame
    sleeve: RigidPart
    base: FloatArray
    tip: FloatArray
    carriage: float
    free_rotation: int
    second_axis: FloatArray | None
    springs: tuple[float, float]


def solve_tripod(
    legs: tuple[ElasticLeg, ...],
    platform: tuple[RigidPart, ...],
    frame: RigidPart,
    *,
    frame_stiffness: FloatArray,
    count: int,
) -> FloatArray:
    """Return the lowest natural frequencies ``(count,)`` [Hz].

    Args:
        platform: Rigid bodies that move as one.
        frame: What the base joints stand on; it does not turn.
        frame_stiffness: ``(3,)`` along x, y, z [N/m], infinite where it is fixed.
    """
    origin = platform[0].center
    grids = [_leg_grid(leg) for leg in legs]
    size = 12 + sum(6 + 6 * len(grid) for grid in grids)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    mass[FRAME, FRAME] = _rigid_mass(frame, frame.center)
    mass[PLATFORM, PLATFORM] = sum(
        (_rigid_mass(part, origin) for part in platform), np.zeros((6, 6))
    )
    springy = np.isfinite(frame_stiffness)
    stiffness[range(3), range(3)] = np.where(springy, frame_stiffness, 0.0)
    rows = [np.eye(6, size)[[*np.flatnonzero(~springy), 3, 4, 5]]]
    start = 12
    for leg, grid in zip(legs, grids, strict=True):
        sleeve, nodes = slice(start, start + 6), slice(start + 6, start + 6 + 6 * len(grid))
        mass[sleeve, sleeve] = _rigid_mass(leg.sleeve, leg.base)
        mass[nodes, nodes], stiffness[nodes, nodes] = _leg_matrices(leg, grid)
        rows += [
            _base_rows(leg, sleeve, size, frame.center),
            _slide_rows(leg, grid, size, sleeve=sleeve, nodes=nodes),
        ]
        fixed, sprung = _tip_rows(leg, grid, nodes, size, origin)
        rows.append(fixed)
        stiffness += sprung.T @ (np.array(leg.springs)[:, None] * sprung)
        start = nodes.stop
    free = scipy.linalg.null_space(np.vstack(rows))
    eigenvalues = scipy.linalg.eigh(
        free.T @ stiffness @ free,
        free.T @ mass @ free,
        eigvals_only=True,
        subset_by_index=(0, count - 1),
    )
    return np.sqrt(eigenvalues) / (2.0 * np.pi)


def _rigid_mass(part: RigidPart, origin: FloatArray) -> FloatArray:
    own = np.zeros((6, 6))
    own[:3, :3], own[3:, 3:] = part.mass * np.eye(3), part.inertia
    carry = rigid_transfer(origin, part.center)
    return carry.T @ own @ carry


def _leg_grid(leg: ElasticLeg) -> FloatArray:
    """Places of the nodes along the tube [m], with both ends of the sleeve among them."""
    length = leg.tube.solid.length if isinstance(leg.tube.solid, Tube) else 0.0
    low, high = _hold(leg)
    before, after = (
        np.linspace(a, b, max(2, round(ELEMENTS_PER_METRE * (b - a)) + 1))
        for a, b in ((0.0, low), (high, length))
    )
    return np.concatenate([before[:-1], np.linspace(low, high, CARRIAGE_ELEMENTS + 1), after[1:]])


def _hold(leg: ElasticLeg) -> tuple[float, float]:
    place = float(leg.placement.rotation[:, 2] @ (leg.base - leg.placement.origin))
    return place - 0.5 * leg.carriage, place + 0.5 * leg.carriage


def _leg_matrices(leg: ElasticLeg, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness of a leg, dofs in machine axes."""
    bar = prismatic_bar(leg.tube.solid)
    density = (
        leg.tube.material.density
        if leg.tube.mass is None
        else leg.tube.mass / (bar.area * bar.length)
    )
    size = 6 * len(grid)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for element, length in enumerate(np.diff(grid)):
        here = slice(6 * element, 6 * element + 12)
        own_mass, own_stiffness = _beam_element(leg.tube, bar, density, float(length))
        mass[here, here] += own_mass
        stiffness[here, here] += own_stiffness
    turn = scipy.linalg.block_diag(*[rotate_dofs(leg.placement.rotation.T)] * len(grid))
    return turn.T @ mass @ turn, turn.T @ stiffness @ turn


def _beam_element(
    part: Component, bar: PrismaticBar, density: float, length: float
) -> tuple[FloatArray, FloatArray]:
    """Consistent mass and stiffness ``(12, 12)`` of a round Timoshenko element along z, dofs x y z
    rx ry rz at each end.
    """
    young, nu = part.material.youngs_modulus, part.material.poisson_ratio
    shear, second = young / (2.0 * (1.0 + nu)), bar.second_moments[0]
    phi = 12.0 * young * second / (shear_coefficient(bar, nu) * shear * bar.area * length**2)
    mass, stiffness = np.zeros((12, 12)), np.zeros((12, 12))
    line = np.array([[2.0, 1.0], [1.0, 2.0]]) * length / 6.0
    rod = np.array([[1.0, -1.0], [-1.0, 1.0]]) / length
    for dofs, inertia, rigidity in (
        ((2, 8), density * bar.area, young * bar.area),
        ((5, 11), density * 2.0 * second, shear * bar.torsion_constant),
    ):
        mass[np.ix_(dofs, dofs)], stiffness[np.ix_(dofs, dofs)] = inertia * line, rigidity * rod
    bent = young * second / (length**3 * (1.0 + phi)) * _bending_stiffness(length, phi)
    moved = (
        density
        * (
            bar.area * length * _bending_mass(length, phi)
            + second / length * _rotary_mass(length, phi)
        )
        / (1.0 + phi) ** 2
    )
    # a slope of x along z is a turn about y, a slope of y one about -x
    for planes, sign in (((0, 4, 6, 10), 1.0), ((1, 3, 7, 9), -1.0)):
        flip = np.array([1.0, sign, 1.0, sign])
        mass[np.ix_(planes, planes)] = flip[:, None] * moved * flip
        stiffness[np.ix_(planes, planes)] = flip[:, None] * bent * flip
    return mass, stiffness


def _bending_stiffness(h: float, phi: float) -> FloatArray:
    a, b = (4.0 + phi) * h**2, (2.0 - phi) * h**2
    return np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, a, -6 * h, b],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, b, -6 * h, a],
        ]
    )


def _bending_mass(h: float, p: float) -> FloatArray:
    a, b = 13 / 35 + 7 * p / 10 + p**2 / 3, (11 / 210 + 11 * p / 120 + p**2 / 24) * h
    c, d = 9 / 70 + 3 * p / 10 + p**2 / 6, (13 / 420 + 3 * p / 40 + p**2 / 24) * h
    e, f = (1 / 105 + p / 60 + p**2 / 120) * h**2, (1 / 140 + p / 60 + p**2 / 120) * h**2
    return np.array([[a, b, c, -d], [b, e, d, -f], [c, d, a, -b], [-d, -f, -b, e]])


def _rotary_mass(h: float, p: float) -> FloatArray:
    a, b = 6 / 5, (1 / 10 - p / 2) * h
    c, d = (2 / 15 + p / 6 + p**2 / 3) * h**2, (1 / 30 + p / 6 - p**2 / 6) * h**2
    return np.array([[a, b, -a, b], [b, c, -b, -d], [-a, -b, a, -b], [b, -d, -b, c]])


def _base_rows(leg: ElasticLeg, sleeve: slice, size: int, frame_center: FloatArray) -> FloatArray:
    """Return rows: the sleeve's middle stays at the base joint of the frame; on a cross it does not turn
    about the normal of both axes.
    """
    rows = np.zeros((3, size))
    rows[:, sleeve], rows[:, FRAME] = np.eye(3, 6), -rigid_transfer(frame_center, leg.base)[:3]
    if leg.second_axis is None:
        return rows
    normal = np.cross(leg.placement.rotation[:, 0], leg.second_axis)
    turned = np.zeros((1, size))
    turned[0, sleeve.start + 3 : sleeve.stop] = normal
    turned[0, FRAME.start + 3 : FRAME.stop] = -normal
    return np.vstack([rows, turned])


def _slide_rows(
    leg: ElasticLeg, grid: FloatArray, size: int, *, sleeve: slice, nodes: slice
) -> FloatArray:
    """Return rows: the sleeve moves as the leg does in the mean over its length, and turns as the
    straight line that fits the leg best.
    """
    inside = np.flatnonzero((grid >= _hold(leg)[0] - 1e-12) & (grid <= _hold(leg)[1] + 1e-12))
    arms = grid[inside] - grid[inside].mean()
    slopes = 12.0 * SIMPSON * arms / leg.carriage**2
    turn = leg.placement.rotation.T
    # a slope of y along z is a turn about -x, one of x a turn about y
    across = skew(np.array([0.0, 0.0, 1.0])) @ turn
    rows = np.zeros((6, size))
    rows[:, sleeve] = -rotate_dofs(turn)
    for node, mean, slope in zip(inside, SIMPSON, slopes, strict=True):
        first = nodes.start + 6 * int(node)
        rows[:3, first : first + 3] += mean * turn
        rows[3:5, first : first + 3] += slope * across[:2]
        rows[5, first + 3 : first + 6] += mean * turn[2]
    return rows


def _tip_rows(
    leg: ElasticLeg, grid: FloatArray, nodes: slice, size: int, origin: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Relative motions of platform and leg at the platform joint, leg axes: those fixed ``(3, n)``,
    and across and along the leg.
    """
    end = leg.placement.origin + leg.placement.rotation[:, 2] * grid[-1]
    turn = rotate_dofs(leg.placement.rotation.T)
    rows = np.zeros((6, size))
    rows[:, PLATFORM] = turn @ rigid_transfer(origin, leg.tip)
    rows[:, nodes.stop - 6 : nodes.stop] = -turn @ rigid_transfer(end, leg.tip)
    across = 1 - leg.free_rotation
    return rows[[leg.free_rotation, 3 + across, 5]], rows[[across, 2]]
