"""Errors of guides along a path: what they move while the axes travel, in addition to what
acceleration does.

The response is that of the machine in the middle of the path; its static part is that of the pose
at hand, from poses along the way.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine, MachinePath
from headstock.reduction.coupling.channels import channel_rows
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.error_travel import (
    ErrorTravel,
    OffsetMotions,
    check_offsets,
    find_offset_motions,
    follow_offsets,
    move_rows,
    plan_travel,
)
from headstock.reduction.coupling.guide_errors import has_errors
from headstock.reduction.coupling.joint_forces import SPRING, JointForces
from headstock.reduction.coupling.probes import carry_probe
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.reduction.superelement import Superelement
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.set_points import PathMotion, SetPoint, sample_move
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.state_space import Feedthrough

STEPS_PER_WAVE = 48
PLACES_PER_WAVE = 100  # for derivatives
MOST_STEP = 1e-3  # between these places, as a share of the path
NODES = 7  # poses of the path between which static responses are interpolated


@dataclass(frozen=True, eq=False)
class PathErrors:
    """Errors of guides along a path.

    Attributes:
        outputs: Where its deviation is wanted.
        travel: Offsets of joints along it.
        places: Shares ``(m,)`` of the path; the middle alone where the pose is frozen.
        gains: Static response ``(m, n_outputs, k)`` per unit offset there.
    """

    path: MachinePath
    outputs: tuple[Channel, ...]
    travel: ErrorTravel
    places: FloatArray
    gains: FloatArray

    @property
    def shortest(self) -> float:
        """Shortest period of a wave along the path [m]; infinite without waves."""
        return self.travel.shortest * self.path.length

    def amounts(self, move: SetPoint, times: FloatArray) -> FloatArray:
        """Return the offsets from those at the beginning, their rates and their accelerations at
        instants of a move ``(n, 3 k)``: what the channels of :func:`add_error_inputs` take.
        """
        now, length = sample_move(move, times), self.path.length
        values = (now.positions, now.speeds, now.accelerations)
        shares = PathMotion(*(np.asarray(value / length) for value in values))
        step = min(MOST_STEP, self.travel.shortest / PLACES_PER_WAVE)
        offsets, rates, growth = follow_offsets(self.travel.sample, shares, (0.0, 1.0), step)
        return np.hstack([offsets - self.travel.sample(np.zeros(1)), rates, growth])

    def follow_pose(self, frozen: PathDeviation, move: SetPoint) -> PathDeviation:
        """Return a deviation in the frozen pose with the static part of the pose at hand."""
        if len(self.places) == 1:
            return frozen
        path_shares = sample_move(move, frozen.times).positions / self.path.length
        shares: FloatArray = np.clip(path_shares, 0.0, 1.0)
        gains = scipy.interpolate.BarycentricInterpolator(self.places, self.gains)
        first, offsets = self.travel.sample(np.zeros(1)), self.travel.sample(shares)
        here = np.einsum("nok,nk->no", gains(shares), offsets) - gains(0.0) @ first[0]
        change = here - (offsets - first) @ gains(0.5).T
        return dataclasses.replace(
            frozen, total=frozen.total + change, quasi_static=frozen.quasi_static + change
        )


def find_path_errors(
    superelements: Mapping[str, Superelement],
    machine: Machine,
    path: MachinePath,
    outputs: Sequence[Channel],
    *,
    nodes: int,
) -> PathErrors | None:
    """Find the errors of guides along a path; None where there are none.

    Args:
        outputs: Where its deviation is wanted.
        nodes: Poses between which the static response is interpolated; one keeps the middle one.

    Raises:
        ModelError: Errors of rigid guides contradict each other, or a profile ends along the path.
    """
    if not has_errors(machine):
        return None
    travel = plan_travel(machine, superelements, np.array([0.0, 1.0]), (path.start, path.end))
    if travel is None:
        return None
    # Chebyshev points of the first kind; a single one is the middle
    places = 0.5 - 0.5 * np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
    posed = [
        couple(superelements, machine, path.pose_at(float(share) * path.length)) for share in places
    ]
    check_offsets(posed[nodes // 2], travel)
    return PathErrors(
        path=path,
        outputs=tuple(outputs),
        travel=travel,
        places=np.asarray(places),
        gains=np.array([_static_gain(coupled, travel, outputs) for coupled in posed]),
    )


def _static_gain(
    coupled: CoupledMachine, travel: ErrorTravel, outputs: Sequence[Channel]
) -> FloatArray:
    """Return the motion ``(n_outputs, k)`` per unit offset in a pose."""
    motions = find_offset_motions(coupled, travel, coupled.system)
    moved = solve_machine_static(coupled, motions.loads).displacements
    rows = np.array([coupled.system.outputs[channel] for channel in outputs])
    return rows @ moved + _move_outputs(coupled, travel.machine, motions, outputs)


def _move_outputs(
    coupled: CoupledMachine, machine: Machine, motions: OffsetMotions, outputs: Sequence[Channel]
) -> FloatArray:
    """Return what fixed directions move of outputs at zero free coordinates ``(n_outputs, k)``.

    Args:
        outputs: Points or interfaces, with a direction.
    """
    if not motions.moved.any():
        return np.zeros((len(outputs), motions.moved.shape[1]))
    moved = {
        name: move_rows(channel_rows(coupled.layout, machine, name), motions.moved)
        for name in dict.fromkeys(name for name, _ in outputs)
    }
    return np.array([moved[name][DOF_NAMES.index(dof)] for name, dof in outputs])


def pass_offsets(
    coupled: CoupledMachine,
    travel: ErrorTravel,
    motions: OffsetMotions,
    outputs: Sequence[Channel],
    joints: Sequence[JointForces],
    probes: Mapping[str, Sequence[Channel]],
) -> Feedthrough:
    """Return what unit offsets, and their unit rates, add at once to outputs, to forces of joints, whose
    springs rest elsewhere, and to what probes see.

    Args:
        outputs: Points or interfaces, with a direction.
        probes: Names of probes to what they see.
    """
    machine, still = travel.machine, np.zeros(motions.moved.shape[1])
    moved = _move_outputs(coupled, machine, motions, outputs)
    rows = [np.concatenate([row, still]) for row in moved]
    channels = [*outputs]
    for joint in joints:
        channels += joint.channels(SPRING)
        for direction, damper in zip(joint.directions, joint.dampers, strict=True):
            dof = DOF_NAMES.index(direction)
            passed = motions.passed[joint.name][dof] * float(damper.any())
            rows.append(-np.concatenate([motions.forces[joint.name][dof], passed]))
    for name, probe_rows in probes.items():
        channels += probe_rows
        carried = carry_probe(coupled, machine.probes[name], motions.moved)
        rows += [np.concatenate([row, still]) for row in carried]
    return Feedthrough(
        tuple(channels),
        (*travel.channels, *travel.rates),
        np.array(rows).reshape(len(rows), 2 * len(still)),
    )


def add_error_inputs(
    system: SecondOrderSystem, travel: ErrorTravel, motions: OffsetMotions
) -> tuple[SecondOrderSystem, tuple[Channel, ...]]:
    """Return the system with offsets, their rates and their accelerations as inputs, and these."""
    channels = (*travel.channels, *travel.rates, *travel.accelerations)
    columns = np.hstack([motions.loads, motions.rates, motions.accelerations])
    columns_of = dict(zip(channels, columns.T, strict=True))
    return dataclasses.replace(system, inputs={**system.inputs, **columns_of}), channels
