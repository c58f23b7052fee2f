"""Errors of guides while a machine travels along a way: offsets of joints over it, and the loads that
they make.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.guide_errors import ErrorProfile
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.reduction.coupling.dof_layout import lay_out_dofs
from headstock.reduction.coupling.guide_errors import (
    GUIDE_ERRORS,
    ErrorPlaces,
    find_places,
    sample_offsets,
)
from headstock.reduction.coupling.joint_springs import PlacedJoint, place_joints
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import Channel

PROBED = 401  # places of the way at which offsets are looked for
RATE = f"{GUIDE_ERRORS} rate"


@dataclass(frozen=True, eq=False)
class ErrorTravel:
    """Offsets of joints along a way.

    Attributes:
        machine: With its errors.
        nodes: ``(k,)`` places of the way, rising: shares of a path, or times [s].
        places: Where errors are read there; between two nodes linearly, else on cubic splines.
        directions: Joint and its dof 0..5 that have an offset on the way.
        shortest: Shortest way over which a wave repeats, in the unit of the nodes; infinite
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

    def sample(self, way: FloatArray) -> FloatArray:
        """Offsets ``(n, k)`` at places ``(n,)`` of the way [m, rad].

        Raises:
            ModelError: A place lies outside the table of a profile.
        """
        totals = _add_up(self.machine, _read_places(self.nodes, self.places, way))
        return np.column_stack([totals[joint][:, dof] for joint, dof in self.directions])


def _read_places(nodes: FloatArray, places: ErrorPlaces, way: FloatArray) -> ErrorPlaces:
    """Where errors are read between the nodes of a way."""
    degree = min(3, len(nodes) - 1)
    return places.map(
        lambda values: np.asarray(
            scipy.interpolate.make_interp_spline(nodes, values, k=degree)(way)
        )
    )


def _add_up(machine: Machine, places: ErrorPlaces) -> dict[str, FloatArray]:
    """Offset ``(n, 6)`` of every joint by all of its sources."""
    totals: dict[str, FloatArray] = {}
    for by_joint in sample_offsets(machine, places).values():
        for joint, offset in by_joint.items():
            totals[joint] = totals[joint] + offset if joint in totals else offset
    return totals


def plan_travel(
    machine: Machine,
    superelements: Mapping[str, Superelement],
    nodes: FloatArray,
    poses: Sequence[Pose],
) -> ErrorTravel | None:
    """The offsets along a way; None where no joint has any.

    Args:
        machine: With its errors.
        superelements: By component.
        nodes: ``(k,)`` places of the way, rising.
        poses: Of the machine there.

    Raises:
        ModelError: A rigid direction has an offset, or a place lies outside a table.
    """
    placed = [_place_errors(machine, superelements, pose) for pose in poses]
    springs, places = placed[0][0], _stack_places([own for _, own in placed])
    probes: FloatArray = np.asarray(np.linspace(nodes[0], nodes[-1], PROBED), dtype=float)
    probed = _read_places(nodes, places, probes)
    totals = _add_up(machine, probed)
    directions = []
    for spring in springs:
        offsets = totals.get(spring.name)
        moved = () if offsets is None else np.flatnonzero(offsets.any(axis=0))
        for dof in map(int, moved):
            if dof in spring.fixed:
                raise ModelError(
                    f"joint {spring.name} is rigid in {DOF_NAMES[dof]}, so its errors cannot push while it travels; give it a stiffness there"
                )
            if spring.stiffness[:, dof].any():
                directions.append((spring.name, dof))
    if not directions:
        return None
    return ErrorTravel(
        machine, nodes, places, tuple(directions), _find_shortest(machine, probes, probed)
    )


def _place_errors(
    machine: Machine, superelements: Mapping[str, Superelement], pose: Pose
) -> tuple[tuple[PlacedJoint, ...], ErrorPlaces]:
    """Every joint of a machine as placed in a pose, and where its errors are read."""
    placements = place_components(machine, pose)
    layout = lay_out_dofs(superelements, {name: placements[name] for name in superelements})
    springs = place_joints(machine, layout)
    return springs, find_places(machine, pose.positions, layout, springs)


def _stack_places(places: Sequence[ErrorPlaces]) -> ErrorPlaces:
    first = places[0]
    return ErrorPlaces(
        {name: np.concatenate([each.rails[name] for each in places]) for name in first.rails},
        first.signs,
        {
            name: np.concatenate([each.positions[name] for each in places])
            for name in first.positions
        },
        {name: np.concatenate([each.levers[name] for each in places]) for name in first.levers},
    )


def _find_shortest(machine: Machine, way: FloatArray, places: ErrorPlaces) -> float:
    """Shortest way over which a wave repeats: what reads it slower than the way goes stretches it."""
    found = [np.inf]
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
        speed = float(np.abs(np.gradient(read, way)).max())
        if speed > 0.0:
            found += [wave.period / speed for profile in profiles for wave in profile.waves]
    return float(min(found))


def offset_loads(
    springs: Sequence[PlacedJoint], directions: Sequence[tuple[str, int]]
) -> FloatArray:
    """Load ``(n, k)`` of a unit offset in each direction, by the joint's springs."""
    by_name = {spring.name: spring for spring in springs}
    return np.column_stack(
        [by_name[joint].rows.T @ by_name[joint].stiffness[:, dof] for joint, dof in directions]
    )


def offset_rate_loads(
    springs: Sequence[PlacedJoint], directions: Sequence[tuple[str, int]]
) -> FloatArray:
    """Load ``(n, k)`` of a unit rate of an offset in each direction, by the joint's dampers."""
    by_name = {spring.name: spring for spring in springs}
    return np.column_stack(
        [by_name[joint].rows.T @ by_name[joint].damping[:, dof] for joint, dof in directions]
    )
