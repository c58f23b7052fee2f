"""What the drives of a mechanism do along a tool path: positions, speeds and accelerations that
belong together.

Speeds and accelerations come from the closures and the tool's motion, ``[phi_q; J] qd = [0; v]``
and ``[phi_q; J] qdd = [-gamma; a - bias]``, at nodes; between nodes a quintic polynomial keeps all
three continuous (Hermite). Nothing is differenced.
"""

from dataclasses import dataclass

import numpy as np
import scipy.interpolate
from numpy.typing import NDArray

from headstock.geometry.errors import JointLimitError, SingularPoseError, UnreachablePoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import closure_bias, evaluate_kinematics
from headstock.geometry.mechanisms.exechon import (
    LARGEST_CONDITION,
    LENGTHS,
    MountedExechon,
    PoseSurvey,
    name_limit_faults,
    survey_tool_poses,
)
from headstock.geometry.mechanisms.kinematics import Bias, marker_bias
from headstock.solvers.errors import ModelError
from headstock.solvers.mechanisms.partitioning import Drive, velocity_maps
from headstock.solvers.milling.tool_path import PathPoints

# change of a coordinate between nodes, beyond what its rate explains, that means another assembly
BRANCH_JUMP = 0.2
FEWEST_SAMPLES_PER_KNOT = 3
MOST_ITERATIONS = 30
SAME_LENGTH = 1e-12  # of legs [m]


@dataclass(frozen=True, eq=False)
class PathDrive:
    """Drives along a path.

    Attributes:
        times: ``(k,)`` nodes [s].
        states: ``(k, n)`` rigid coordinates there.
        law: Positions of the drives over time, with continuous second derivative.
    """

    times: FloatArray
    states: FloatArray
    law: scipy.interpolate.BPoly | scipy.interpolate.BSpline

    def at(self, times: FloatArray | float) -> Drive:
        """Positions, speeds and accelerations ``(..., u)`` at times."""
        position, speed, acceleration = (
            np.asarray(self.law(times, nu=order)) for order in range(3)
        )
        return Drive(position, speed, acceleration)

    def rigid_states(self, times: FloatArray) -> FloatArray:
        """``(..., n)`` rigid coordinates between nodes, good enough to start Newton from."""
        return np.asarray(scipy.interpolate.make_interp_spline(self.times, self.states, k=3)(times))


@dataclass(frozen=True, eq=False)
class MarkerMotion:
    """Markers of a mechanism on its way, in the ground frame of its chains.

    Attributes:
        states: ``(k, n)`` rigid coordinates.
        rates: ``(k, n)`` their rates.
        growth: ``(k, n)`` rates of these.
        rotations: ``(k, P, 3, 3)`` orientation of each marker.
        acceleration: ``(k, P, 3)`` of the origins [m/s^2].
        omega: ``(k, P, 3)`` angular velocity [rad/s].
        alpha: ``(k, P, 3)`` angular acceleration [rad/s^2].
    """

    states: FloatArray
    rates: FloatArray
    growth: FloatArray
    rotations: FloatArray
    acceleration: FloatArray
    omega: FloatArray
    alpha: FloatArray


def move_markers(
    machine: MountedExechon,
    times: FloatArray,
    path: PathPoints,
    direction: FloatArray,
    *,
    velocity_terms: bool = True,
) -> MarkerMotion:
    """The rigid mechanism as its tool goes along a path without turning.

    Args:
        times: ``(k,)`` [s].
        path: The path at these times, machine frame.
        direction: ``(3,)`` of the tool, machine frame.
        velocity_terms: Whether markers are accelerated by speeds, too; without them they do not
            turn at any speed, and answer to the accelerations of the drives alone.

    Raises:
        PoseError: A point is out of reach, singular or beyond a joint's limits; says when.
    """
    survey = survey_tool_poses(machine, path.position, direction)
    _require_poses(machine, times, survey)
    mechanism, turn = machine.mechanism, machine.mounting.rotation
    kinematics = evaluate_kinematics(mechanism, survey.states)
    tool, rigid = mechanism.markers.index("tcp"), slice(0, mechanism.compliant_slice.start)
    # the tool turns about its own axis only
    across = np.swapaxes(kinematics.placement.rotations[:, tool, :, :2], -1, -2)
    rows = [
        kinematics.closure_jacobian,
        kinematics.of_position[:, tool],
        across @ kinematics.of_rotation[:, tool],
    ]
    matrix = np.concatenate(rows, axis=-2)[..., rigid]
    rates, growth = np.zeros_like(survey.states), np.zeros_like(survey.states)
    nothing = np.zeros((len(times), 2))
    closed = np.zeros((len(times), kinematics.closure_jacobian.shape[-2]))
    rates[:, rigid] = _solve(matrix, (closed, path.velocity @ turn, nothing))
    bias = marker_bias(kinematics.placement, rates)
    pull = path.acceleration @ turn - bias.acceleration[:, tool]
    twist = -(across @ bias.alpha[:, tool, :, None])[..., 0]
    growth[:, rigid] = _solve(
        matrix, (-closure_bias(mechanism, kinematics.placement, bias), pull, twist)
    )
    accelerated = growth[:, None, :, None]
    if not velocity_terms:
        drives = growth[:, mechanism.driven_slice, None]
        accelerated = (velocity_maps(mechanism, kinematics.closure_jacobian)[0] @ drives)[:, None]
        none = np.zeros_like(bias.omega)
        bias = Bias(omega=none, velocity=bias.velocity, alpha=none, acceleration=none)
    return MarkerMotion(
        states=survey.states,
        rates=rates,
        growth=growth,
        rotations=kinematics.placement.rotations,
        acceleration=bias.acceleration + (kinematics.of_position @ accelerated)[..., 0],
        omega=bias.omega,
        alpha=bias.alpha + (kinematics.of_rotation @ accelerated)[..., 0],
    )


def follow_path(
    machine: MountedExechon, times: FloatArray, path: PathPoints, direction: FloatArray
) -> PathDrive:
    """Drives that lead the tool along a path without turning it.

    Args:
        times: ``(k,)`` nodes [s].
        path: The path at the nodes, machine frame.
        direction: ``(3,)`` of the tool, machine frame.

    Raises:
        PoseError: A point is out of reach, singular, beyond a joint's limits, or the path changes
            the assembly; says when.
    """
    moved = move_markers(machine, times, path, direction)
    _require_one_branch(times, moved.states, moved.rates)
    driven = machine.mechanism.driven_slice
    nodes = np.stack(
        [moved.states[:, driven], moved.rates[:, driven], moved.growth[:, driven]], axis=1
    )
    return PathDrive(times, moved.states, scipy.interpolate.BPoly.from_derivatives(times, nodes))


def find_tool_positions(
    machine: MountedExechon, lengths: FloatArray, near: PathPoints, direction: FloatArray
) -> FloatArray:
    """Tool points ``(k, 3)`` at which the legs have given lengths, the tool not turned; machine
    frame [m].

    Newton's method with the derivative where the tool is supposed to be, which measured legs leave
    by millimetres at most.

    Args:
        lengths: ``(k, 3)`` of the legs [m].
        near: Where the tool is supposed to be.
        direction: ``(3,)`` of the tool, machine frame.

    Raises:
        PoseError: A supposed point cannot be reached.
        ModelError: Legs of these lengths lead the tool too far off.
    """
    legs = [machine.mechanism.index(name) for name in LENGTHS]
    still = np.zeros_like(near.position)
    columns = []
    for axis in range(3):
        velocity = still.copy()
        velocity[:, axis] = 1.0
        moved = move_markers(
            machine,
            np.arange(len(still), dtype=np.float64),
            PathPoints(near.position, velocity, still),
            direction,
        )
        columns.append(moved.rates[:, legs])
    inverse = np.linalg.inv(np.stack(columns, axis=-1))
    positions = near.position.copy()
    for _ in range(MOST_ITERATIONS):
        off = survey_tool_poses(machine, positions, direction).states[:, legs] - lengths
        positions -= (inverse @ off[..., None])[..., 0]
        if np.abs(off).max() < SAME_LENGTH:
            return positions
    raise ModelError(
        f"legs of the measured lengths lead the tool off its planned path by so much that it is not found: legs differ by up to"
        f" {1e3 * float(np.nanmax(np.abs(off))):.3g} mm; does the time of the record start with the path?"
    )


def smooth_samples(
    times: FloatArray, samples: FloatArray, spacing: float
) -> scipy.interpolate.BSpline:
    """A smooth law through noisy samples of driven coordinates: a least-squares quintic spline with
    knots so far apart [s].

    Measured leg lengths must not be differenced twice: a micrometre of noise at 1 kHz becomes
    metres per second squared. A spline with fewer knots than samples has derivatives that are as
    smooth as its knots allow, and leaves the rest as residual.

    Args:
        times: ``(n,)`` rising [s].
        samples: ``(n, u)`` or ``(n,)`` driven coordinates [m, rad].
        spacing: Distance of the knots [s]; rounded so that they divide the time evenly.

    Raises:
        ModelError: Times do not rise, values are not finite, or there are too few samples between
            knots.
    """
    if not (np.isfinite(times).all() and np.isfinite(samples).all()):
        raise ModelError("samples of a drive hold values that are not finite")
    if not (np.diff(times) > 0.0).all():
        raise ModelError(
            f"times of a drive must rise; they do not after {times[int(np.argmin(np.diff(times)))]:.6g} s"
        )
    count = max(1, round((times[-1] - times[0]) / spacing))
    knots = np.linspace(times[0], times[-1], count + 1)
    if np.histogram(times, knots)[0].min() < FEWEST_SAMPLES_PER_KNOT:
        raise ModelError(
            f"fewer than {FEWEST_SAMPLES_PER_KNOT} samples lie between two knots {spacing:g} s apart; take a wider spacing"
        )
    ends = [times[0]] * 5 + [*knots] + [times[-1]] * 5
    return scipy.interpolate.make_lsq_spline(times, samples, np.array(ends), k=5)


def _solve(matrix: FloatArray, parts: tuple[FloatArray, ...]) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, np.concatenate(parts, axis=-1)[..., None])[..., 0])


def _require_poses(machine: MountedExechon, times: FloatArray, survey: PoseSurvey) -> None:
    def first(bad: NDArray[np.bool_]) -> str:
        return f"the path at t = {times[int(np.argmax(bad))]:.4g} s"

    if not survey.reached.all():
        raise UnreachablePoseError(
            f"{first(~survey.reached)}: no assembly of the mechanism reaches the tool pose"
        )
    if not (survey.condition < LARGEST_CONDITION).all():
        raise SingularPoseError(
            f"{first(survey.condition >= LARGEST_CONDITION)}: a singular pose; a motion is lost or gained"
        )
    if not survey.within.all():
        first_bad = int(np.argmax(~survey.within))
        raise JointLimitError(
            f"{first(~survey.within)}: {'; '.join(name_limit_faults(machine, survey.states[first_bad]))}"
        )


def _require_one_branch(times: FloatArray, states: FloatArray, rates: FloatArray) -> None:
    expected = 0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None]
    jumps = np.abs(np.diff(states, axis=0) - expected).max(axis=-1)
    if (jumps > BRANCH_JUMP).any():
        raise SingularPoseError(
            f"the path at t = {times[int(np.argmax(jumps > BRANCH_JUMP))]:.4g} s jumps to another assembly"
        )
