"""Errors of guides while a machine travels along a path: offsets of joints over it, and the loads
that they make.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.guide_errors import ErrorProfile
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import lay_out_dofs
from headstock.reduction.coupling.guide_errors import (
    CONTRADICTION,
    GUIDE_ERRORS,
    ROUNDOFF,
    ErrorPlaces,
    contradiction_error,
    find_places,
    follow_fixed,
    sample_offsets,
)
from headstock.reduction.coupling.joint_springs import PlacedJoint, place_joints
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.motion.set_points import PathMotion
from headstock.solvers.second_order import Channel, SecondOrderSystem

PROBED = 401  # places of the path at which offsets are looked for
RATE = f"{GUIDE_ERRORS} rate"
ACCELERATION = f"{GUIDE_ERRORS} acceleration"


@dataclass(frozen=True, eq=False)
class ErrorTravel:
    """Offsets of joints along a path.

    Attributes:
        nodes: ``(k,)`` places of the path, rising: shares of a path, or times [s].
        places: Where errors are read there; between two nodes linearly, else on cubic splines.
        directions: Joint and its dof 0..5 that have an offset along the path.
        shortest: Shortest length over which a harmonic repeats, in the unit of the nodes; infinite
            without waves.
    """

    machine: Machine
    nodes: FloatArray
    places: ErrorPlaces
    directions: tuple[tuple[str, int], ...]
    shortest: float

    @property
    def channels(self) -> tuple[Channel, ...]:
        """A channel per direction."""
        return tuple((GUIDE_ERRORS, f"{joint} {DOF_NAMES[dof]}") for joint, dof in self.directions)

    @property
    def rates(self) -> tuple[Channel, ...]:
        """The same for their rates, which act through dampers."""
        return tuple((RATE, f"{joint} {DOF_NAMES[dof]}") for joint, dof in self.directions)

    @property
    def accelerations(self) -> tuple[Channel, ...]:
        """The same for their accelerations, which act where an offset is a motion."""
        return tuple((ACCELERATION, f"{joint} {DOF_NAMES[dof]}") for joint, dof in self.directions)

    def sample(self, positions: FloatArray) -> FloatArray:
        """Return the offsets ``(n, k)`` at places ``(n,)`` of the path [m, rad].

        Raises:
            ModelError: A place lies outside the table of a profile.
        """
        totals = _add_up(self.machine, _read_places(self.nodes, self.places, positions))
        return np.column_stack([totals[joint][:, dof] for joint, dof in self.directions])


def _read_places(nodes: FloatArray, places: ErrorPlaces, positions: FloatArray) -> ErrorPlaces:
    """Return where errors are read between the nodes of a path."""
    degree = min(3, len(nodes) - 1)
    return places.map(
        lambda values: np.asarray(
            scipy.interpolate.make_interp_spline(nodes, values, k=degree)(positions)
        )
    )


def _add_up(machine: Machine, places: ErrorPlaces) -> dict[str, FloatArray]:
    """Return the offset ``(n, 6)`` of every joint by all of its sources."""
    totals: dict[str, FloatArray] = {}
    for by_joint in sample_offsets(machine, places).values():
        for joint, offset in by_joint.items():
            totals[joint] = totals[joint] + offset if joint in totals else offset
    return totals


@dataclass(frozen=True, eq=False)
class OffsetMotions:
    """Effect of unit offsets of ``k`` directions of joints on a machine in a pose.

    Attributes:
        moved: ``(n_all, k)`` motion of the stacked dofs that fixed directions make, at zero free
            coordinates.
        loads: ``(n, k)`` generalised load of each offset.
        rates: ``(n, k)`` of its rate, by dampers.
        accelerations: ``(n, k)`` of its acceleration, by the inertia of what fixed directions move.
        forces: Joint to ``(6 + m, k)`` what its springs no longer push, joint axes.
        passed: The same of its dampers, per rate.
    """

    moved: FloatArray
    loads: FloatArray
    rates: FloatArray
    accelerations: FloatArray
    forces: dict[str, FloatArray]
    passed: dict[str, FloatArray]


def plan_travel(
    machine: Machine,
    superelements: Mapping[str, Superelement],
    nodes: FloatArray,
    poses: Sequence[Pose],
) -> ErrorTravel | None:
    """Return the offsets along a path; None where no joint has any.

    Args:
        nodes: ``(k,)`` places of the path, rising.

    Raises:
        ModelError: A place lies outside a table.
    """
    placed = [_place_errors(machine, superelements, pose) for pose in poses]
    springs, places = placed[0][0], _stack_places([places_in_pose for _, places_in_pose in placed])
    probes: FloatArray = np.asarray(np.linspace(nodes[0], nodes[-1], PROBED), dtype=float)
    probed = _read_places(nodes, places, probes)
    totals = _add_up(machine, probed)
    directions: list[tuple[str, int]] = []
    for spring in springs:
        offsets = totals.get(spring.name)
        moved = () if offsets is None else np.flatnonzero(offsets.any(axis=0))
        directions += [
            (spring.name, int(dof))
            for dof in moved
            if dof in spring.fixed or spring.stiffness[:, dof].any()
        ]
    if not directions:
        return None
    return ErrorTravel(
        machine,
        nodes,
        places,
        tuple(directions),
        _find_shortest(machine, probes, probed),
    )


def _place_errors(
    machine: Machine, superelements: Mapping[str, Superelement], pose: Pose
) -> tuple[tuple[PlacedJoint, ...], ErrorPlaces]:
    """Return every joint of a machine as placed in a pose, and where its errors are read."""
    placements = place_components(machine, pose)
    layout = lay_out_dofs(superelements, {name: placements[name] for name in superelements})
    springs = place_joints(machine, layout)
    return springs, find_places(machine, pose.positions, layout, springs)


def _stack_places(places: Sequence[ErrorPlaces]) -> ErrorPlaces:
    first = places[0]
    return ErrorPlaces(
        {
            name: np.concatenate([pose_places.rails[name] for pose_places in places])
            for name in first.rails
        },
        first.signs,
        {
            name: np.concatenate([pose_places.positions[name] for pose_places in places])
            for name in first.positions
        },
        {
            name: np.concatenate([pose_places.levers[name] for pose_places in places])
            for name in first.levers
        },
    )


def _find_shortest(machine: Machine, positions: FloatArray, places: ErrorPlaces) -> float:
    """Find the shortest length over which a harmonic repeats: reading it slower than the path goes
    stretches it.
    """
    lengths = [np.inf]
    sources: list[tuple[FloatArray, list[ErrorProfile]]] = []
    for name, read in places.rails.items():
        errors = machine.joints[name].errors
        if errors is not None:
            sources.append((read, [*errors.profiles.values(), *errors.passing.values()]))
    for name, read in places.positions.items():
        motions = machine.axes[name].errors
        if motions is not None:
            sources.append((read, [*motions.motions.values()]))
    for read, profiles in sources:
        speed = float(np.abs(np.gradient(read, positions)).max())
        if speed > 0.0:
            lengths += [wave.period / speed for profile in profiles for wave in profile.waves]
    return float(min(lengths))


def find_offset_motions(
    coupled: CoupledMachine,
    travel: ErrorTravel,
    damped: SecondOrderSystem,
    unmoved: FloatArray | None = None,
) -> OffsetMotions:
    """Find what unit offsets of joints do to a machine in a pose: the springs of their joints push,
    and fixed directions move what they hold, ``q = B y + O e``.

    Args:
        damped: Its system with the damping that acts.
        unmoved: ``(r, n_all)`` rows of what fixed directions are not to move at zero free
            coordinates, such as what scales read; None for none.

    Raises:
        ModelError: What is not to be moved cannot but be.
    """
    layout, basis, fixed = coupled.layout, coupled.basis, coupled.fixed
    count = len(travel.directions)
    units = [{joint: np.eye(6)[dof]} for joint, dof in travel.directions]
    wanted = np.column_stack([fixed.values(unit) for unit in units])
    moved: FloatArray = np.zeros((layout.size, count))
    if wanted.any():
        moved = follow_fixed(fixed.constraints, wanted, layout)
        if unmoved is not None:
            moved = moved - basis @ np.linalg.lstsq(unmoved @ basis, unmoved @ moved)[0]
            reach = np.abs(unmoved) @ np.abs(moved)
            if (np.abs(unmoved @ moved) > CONTRADICTION * reach).any():
                raise ModelError(
                    "errors of rigid guides move what linear scales read, wherever motors are; give these guides a stiffness"
                )
    loads, rates = np.zeros((basis.shape[1], count)), np.zeros((basis.shape[1], count))
    forces: dict[str, FloatArray] = {}
    passed: dict[str, FloatArray] = {}
    for spring, free in zip(fixed.springs, coupled.joint_springs, strict=True):
        stretch = -spring.rows @ moved
        for number, (joint, dof) in enumerate(travel.directions):
            stretch[dof, number] += joint == spring.name
        forces[spring.name] = free.stiffness @ stretch
        loads += free.rows.T @ forces[spring.name]
        passed[spring.name] = free.damping @ stretch
        rates += free.rows.T @ passed[spring.name]
    inertial = np.zeros_like(loads)
    if wanted.any():
        for name, dofs in layout.offsets.items():
            loads -= basis[dofs].T @ (coupled.matrices.stiffnesses[name] @ moved[dofs])
            inertial -= basis[dofs].T @ (coupled.matrices.masses[name] @ moved[dofs])
            if name in coupled.matrices.dampings:
                rates -= basis[dofs].T @ (coupled.matrices.dampings[name] @ moved[dofs])
        if coupled.geometric is not None:
            loads -= basis.T @ (coupled.geometric @ moved)
        rates += _modal_rates(coupled.system, damped, inertial)
    if damped.damping is None and damped.hysteretic is None:
        rates = np.zeros_like(rates)
    return OffsetMotions(moved, loads, rates, inertial, forces, passed)


def move_rows(rows: FloatArray, moved: FloatArray) -> FloatArray:
    """Return the products of rows ``(p, n)`` with motions ``(n, k)``, none where terms cancel to
    roundoff, which no spline along a path could follow.
    """
    products = rows @ moved
    return np.where(np.abs(products) > ROUNDOFF * np.abs(rows) @ np.abs(moved), products, 0.0)


def _modal_rates(
    system: SecondOrderSystem, damped: SecondOrderSystem, inertial: FloatArray
) -> FloatArray:
    """Return the loads ``(n, k)`` by modal damping, which resists the motion of what fixed
    directions move as it does any other.
    """
    if damped.damping is None:
        return np.zeros_like(inertial)
    physical = np.zeros_like(damped.damping) if system.damping is None else system.damping
    modal = damped.damping - physical
    if not modal.any():
        return np.zeros_like(inertial)
    return modal @ np.linalg.lstsq(system.mass, inertial)[0]


def check_offsets(coupled: CoupledMachine, travel: ErrorTravel) -> None:
    """Refuse errors of fixed joints that contradict each other somewhere along a path.

    Raises:
        ModelError: They do; names the joints.
    """
    fixed = coupled.fixed
    units = [{joint: np.eye(6)[dof]} for joint, dof in travel.directions]
    wanted = np.column_stack([fixed.values(unit) for unit in units])
    if not wanted.any():
        return
    missed = fixed.constraints @ follow_fixed(fixed.constraints, wanted, coupled.layout) - wanted
    offsets = travel.sample(np.linspace(travel.nodes[0], travel.nodes[-1], PROBED)).T
    largest, first = float(np.abs(wanted @ offsets).max()), fixed.first
    names = []
    for spring in fixed.springs:
        last = first + len(spring.fixed)
        if np.abs(missed[first:last] @ offsets).max(initial=0.0) > CONTRADICTION * largest:
            names.append(spring.name)
        first = last
    if names:
        raise contradiction_error(names)


def follow_offsets(
    sample: Callable[[FloatArray], FloatArray],
    motion: PathMotion,
    ends: tuple[float, float],
    step: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return offsets, their rates and their accelerations ``(n, k)`` over a motion along a path.

    Args:
        sample: Offsets ``(m, k)`` at places ``(m,)``.
        motion: Along the path; beyond its ends the outermost offsets hold.
        step: Between places from which derivatives are differenced.
    """
    here = np.clip(motion.positions, *ends)
    first, second = _differentiate(sample, here, ends, step)
    speeds, pulls = motion.speeds[:, None], motion.accelerations[:, None]
    return sample(here), first * speeds, second * speeds**2 + first * pulls


def _differentiate(
    sample: Callable[[FloatArray], FloatArray],
    places: FloatArray,
    ends: tuple[float, float],
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the first and second derivative ``(n, k)`` of values along a path, by the polynomial
    through five neighbouring places.

    Args:
        sample: Values ``(m, k)`` at places ``(m,)``.
        places: ``(n,)`` of the path.
        ends: Of the path; nothing is sampled beyond.
        step: Between two of the five.
    """
    step = min(step, 0.25 * (ends[1] - ends[0]))
    around = np.arange(-2.0, 3.0)
    centers = np.clip(places, ends[0] + 2.0 * step, ends[1] - 2.0 * step)
    # roundoff of the outermost places
    wanted = np.clip(centers[:, None] + step * around, *ends)
    values = sample(wanted.ravel()).reshape(len(places), 5, -1)
    coefficients = np.einsum(
        "pj,njk->npk", np.linalg.inv(np.vander(around, increasing=True)), values
    )
    arms = (places - centers) / step
    powers = np.vander(arms, 5, increasing=True)
    first = np.einsum("np,npk->nk", powers[:, :4], coefficients[:, 1:] * np.arange(1, 5)[:, None])
    twice = np.array([2.0, 6.0, 12.0])[:, None]
    second = np.einsum("np,npk->nk", powers[:, :3], coefficients[:, 2:] * twice)
    return first / step, second / step**2
