"""Errors of guides while axes travel along a straight path: offsets of joints over the way, and the
loads that they make.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.guide_errors import ErrorProfile
from headstock.geometry.machine.machine import Machine, MachinePath
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.guide_errors import (
    GUIDE_ERRORS,
    ErrorPlaces,
    find_places,
    sample_offsets,
)
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import Channel

PROBED = 401  # places of the way at which offsets are looked for
RATE = f"{GUIDE_ERRORS} rate"


@dataclass(frozen=True, eq=False)
class ErrorTravel:
    """Offsets of joints along a path.

    Attributes:
        machine: With its errors.
        start: Where they are read at its beginning.
        end: Where at its end.
        directions: Joint and its dof 0..5 that have an offset on the way.
        shortest: Shortest period of a wave on the way [m]; infinite without waves.
    """

    machine: Machine
    start: ErrorPlaces
    end: ErrorPlaces
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

    def sample(self, shares: FloatArray) -> FloatArray:
        """Offsets ``(n, k)`` at shares ``(n,)`` of the way [m, rad].

        Raises:
            ModelError: A place lies outside the table of a profile.
        """
        totals = self._sum_sources(shares)
        return np.column_stack([totals[joint][:, dof] for joint, dof in self.directions])

    def _sum_sources(self, shares: FloatArray) -> dict[str, FloatArray]:
        return _add_up(self.machine, self.start, self.end, shares)


def _add_up(
    machine: Machine, start: ErrorPlaces, end: ErrorPlaces, shares: FloatArray
) -> dict[str, FloatArray]:
    """Offset ``(n, 6)`` of every joint by all of its sources."""
    totals: dict[str, FloatArray] = {}
    for by_joint in sample_offsets(machine, start, end, shares).values():
        for joint, offset in by_joint.items():
            totals[joint] = totals[joint] + offset if joint in totals else offset
    return totals


def plan_travel(
    machine: Machine, path: MachinePath, first: CoupledMachine, last: CoupledMachine
) -> ErrorTravel | None:
    """The offsets along a path; None where no joint has any.

    Args:
        machine: With its errors.
        path: The way.
        first: The machine coupled at its beginning.
        last: The same at its end.

    Raises:
        ModelError: A rigid direction has an offset, or a place lies outside a table.
    """
    start, end = (
        find_places(machine, pose.positions, coupled.layout, coupled.joint_springs)
        for pose, coupled in ((path.start, first), (path.end, last))
    )
    totals = _add_up(machine, start, end, np.linspace(0.0, 1.0, PROBED, dtype=np.float64))
    directions = []
    for spring in first.joint_springs:
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
    return ErrorTravel(machine, start, end, tuple(directions), _find_shortest(machine, path))


def _find_shortest(machine: Machine, path: MachinePath) -> float:
    """Shortest period along the path [m]: an axis that moves slower than the path stretches it."""
    found = [np.inf]
    for axis in path.axes:
        share = abs(path.end.positions.get(axis, 0.0) - path.start.positions.get(axis, 0.0))
        profiles: list[ErrorProfile] = []
        for name in machine.axes[axis].joints:
            errors = machine.joints[name].errors
            if errors is not None:
                profiles += [*errors.profiles.values(), *errors.passing.values()]
        motions = machine.axes[axis].errors
        profiles += [] if motions is None else motions.motions.values()
        periods = [wave.period for profile in profiles for wave in profile.waves]
        found += [period * path.length / share for period in periods]
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
