"""Motors of a machine of components along a contour: what they move of the rigid machine, and their
loops closed around its modes.

The modes are those with locked motors. A motor's coordinate is the travel of the rigid machine that
it brings about; both are coupled by the inertia of that travel, which is also the load by which
the rigid machine bends the modes.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.machine import Machine
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.closures import evaluate_kinematics
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.pipeline.contours.contour_drives import FrictionSpeeds, close_drives
from headstock.pipeline.stages.run_state import MachineParts, RunState
from headstock.scene.requests import ContouringRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.partitioning import velocity_maps
from headstock.solvers.milling.path_drives import move_markers
from headstock.solvers.milling.tool_path import ToolPath
from headstock.solvers.paths.linear_motion import (
    LinearMotion,
    chunk_slices,
    even_nodes,
    interpolate_nodes,
)
from headstock.solvers.paths.sampled_motion import GIVEN, LOAD_SPACING, SampledMotion
from headstock.solvers.paths.servo_motion import ServoMotion


@dataclass(frozen=True, eq=False)
class MovedMachine:
    """What ``d`` motors move of the rigid machine at ``n`` times.

    Attributes:
        positions: ``(n, d)`` set positions [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        channels: ``(n, r, d)`` acceleration in each channel of the way per that of each motor.
        mass: ``(n, d, d)`` [kg].
        tool: ``(n, 3, d)`` motion of the tool against its work per travel of each motor.
        weight: ``(n, d)`` generalised weight [N].
        inertia: ``(n, d)`` what the rigid motion takes beside the weight [N].
    """

    positions: FloatArray
    speeds: FloatArray
    accelerations: FloatArray
    channels: FloatArray
    mass: FloatArray
    tool: FloatArray
    weight: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class WayMotors:
    """Motors under control along a way.

    Attributes:
        drives: Their drives.
        at: What they move at times ``(n,)``.
    """

    drives: tuple[Drive, ...]
    at: Callable[[FloatArray], MovedMachine]


def plan_motors(
    state: RunState,
    request: ContouringRequest,
    path: ToolPath,
    amounts: Callable[[FloatArray], FloatArray],
) -> WayMotors | None:
    """The drives that move a machine along a contour; None without control.

    Args:
        state: Of the run.
        request: The contour.
        path: Of the tool.
        amounts: Accelerations ``(n, r)`` in the channels of the way at times.
    """
    scene, parts = state.scene, state.parts
    if not scene.drives:
        return None
    if scene.mechanism is not None:
        drives = [drive for drive in scene.drives.values() if drive.axis in LENGTHS]
        return _leg_motors(parts, scene.mechanism, path, drives, amounts)
    return _axis_motors(parts, scene.machine, request.point or "", path)


def close_way(
    motors: WayMotors,
    sampled: SampledMotion,
    motion: LinearMotion,
    scales: int,
    *,
    friction: FrictionSpeeds,
) -> ServoMotion:
    """Close the loops of all motors along a way.

    Args:
        motors: Of the machine.
        sampled: The machine with locked motors; its last outputs are what linear scales read, its
            inputs after gravity the channels of the way.
        motion: The same between its nodes.
        scales: The first of these outputs.
        friction: At which speeds it acts.
    """
    now = motors.at(motion.nodes)
    found = sampled.at(motion.nodes, "loads", "rows")
    modes, count = sampled.modes, len(motors.drives)
    kept, own = slice(0, modes), slice(modes, modes + count)
    # the load of an acceleration is what the travel's inertia takes of the modes
    coupling = -found.loads[:, :, GIVEN][:, :, 1:] @ now.channels
    mass = np.zeros((len(motion.nodes), modes + count, modes + count))
    mass[:, kept, kept], mass[:, own, own] = motion.mass, now.mass
    mass[:, kept, own], mass[:, own, kept] = coupling, np.swapaxes(coupling, 1, 2)
    extra = ((0, 0), (0, count), (0, count))
    load_nodes = even_nodes(motion.times, LOAD_SPACING)
    finer = [motors.at(load_nodes[part]) for part in chunk_slices(len(load_nodes))]

    def between(values: Sequence[FloatArray]) -> FloatArray:
        return interpolate_nodes(motion.times, load_nodes, np.concatenate(values))

    pulled = between([each.weight - each.inertia for each in finer])
    weight = np.concatenate([found.loads[:, :, GIVEN.start], now.weight], axis=1)
    unit = np.broadcast_to(np.eye(count), (len(motion.nodes), count, count))
    return close_drives(
        dataclasses.replace(
            motion,
            mass=mass,
            damping=np.pad(motion.damping, extra),
            stiffness=np.pad(motion.stiffness, extra),
            tool=np.concatenate([motion.tool, now.tool], axis=2),
            load=np.concatenate([motion.load, pulled], axis=1),
        ),
        motors.drives,
        positions=between([each.positions for each in finer]),
        speeds=between([each.speeds for each in finer]),
        accelerations=between([each.accelerations for each in finer]),
        gravity=weight,
        scales=np.concatenate([found.rows[:, scales:], unit], axis=2),
        friction=friction,
    )


def _axis_motors(
    parts: MachineParts, machine: Machine, point: str, path: ToolPath
) -> WayMotors | None:
    """Motors of linear axes."""
    travel = find_tool_travel(machine, machine.points[point])
    drives = tuple(each for each in parts.scene.drives.values() if each.axis in travel.axes)
    if not drives:
        return None
    columns = [travel.axes.index(drive.axis) for drive in drives]
    axes = [machine.axes[drive.axis] for drive in drives]
    gravity = np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)
    masses = {name: part.mass_kg for name, part in parts.superelements.items()}
    mass = np.array(
        [
            [
                float(one.direction @ other.direction)
                * sum(masses[name] for name in set(one.moves) & set(other.moves))
                for other in axes
            ]
            for one in axes
        ]
    )
    weight = np.array(
        [
            float(axis.direction @ gravity) * sum(masses[name] for name in axis.moves)
            for axis in axes
        ]
    )
    channels = np.eye(len(travel.axes))[:, columns]
    tool = travel.directions[:, columns]

    def at(times: FloatArray) -> MovedMachine:
        points, count = path.at(times), len(times)
        positions, speeds, accelerations = (
            travel.axis_positions(values)[:, columns]
            for values in (points.position, points.velocity, points.acceleration)
        )
        return MovedMachine(
            positions,
            speeds,
            accelerations,
            channels=np.broadcast_to(channels, (count, *channels.shape)),
            mass=np.broadcast_to(mass, (count, *mass.shape)),
            tool=np.broadcast_to(tool, (count, *tool.shape)),
            weight=np.broadcast_to(weight, (count, len(weight))),
            inertia=accelerations @ mass,
        )

    return WayMotors(drives, at)


def _leg_motors(
    parts: MachineParts,
    mechanism: SceneMechanism,
    path: ToolPath,
    drives: Sequence[Drive],
    amounts: Callable[[FloatArray], FloatArray],
) -> WayMotors | None:
    """Motors of the legs of a mechanism."""
    if not drives:
        return None
    mounted = mechanism.mounted
    known, turn = mounted.mechanism, mounted.mounting.rotation
    bodies = {name: marker for name, marker in mechanism.carries.items() if name in parts.reduced}
    gravity = np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)
    legs = [known.driven.index(drive.axis) for drive in drives]

    def at(times: FloatArray) -> MovedMachine:
        moved = move_markers(mounted, times, path.at(times), mechanism.tool)
        kinematics = evaluate_kinematics(known, moved.states)
        from_legs = velocity_maps(known, kinematics.closure_jacobian)[0][..., legs]
        tool = turn @ kinematics.of_position[:, known.markers.index("tcp")] @ from_legs
        pulled = amounts(times)
        count = len(drives)
        mass = np.zeros((len(times), count, count))
        weight, inertia = np.zeros((len(times), count)), np.zeros((len(times), count))
        channels = []
        for number, (name, marker) in enumerate(bodies.items()):
            place, body = known.markers.index(marker), parts.superelements[name]
            own = parts.plan.components[name].placement
            rotation = moved.rotations[:, place]
            arm = rotation @ (own.origin + own.rotation @ body.center_of_mass)
            turning = kinematics.of_rotation[:, place] @ from_legs
            moving = kinematics.of_position[:, place] @ from_legs - skew_matrices(arm) @ turning
            moving, turning = turn @ moving, turn @ turning
            axes = turn @ rotation @ own.rotation
            tensor = axes @ body.inertia @ np.swapaxes(axes, -1, -2)
            straight, spin = np.split(pulled[:, 6 * number : 6 * number + 6, None], 2, axis=1)
            left, about = np.swapaxes(moving, 1, 2), np.swapaxes(turning, 1, 2)
            mass += body.mass_kg * (left @ moving) + about @ tensor @ turning
            weight += body.mass_kg * (left @ gravity)
            inertia += (body.mass_kg * (left @ straight) + about @ tensor @ spin)[..., 0]
            channels += [moving, turning]
        driven = np.arange(known.driven_slice.start, known.driven_slice.stop)[legs]
        return MovedMachine(
            positions=moved.states[:, driven],
            speeds=moved.rates[:, driven],
            accelerations=moved.growth[:, driven],
            channels=np.concatenate(channels, axis=1),
            mass=mass,
            tool=tool,
            weight=weight,
            inertia=inertia,
        )

    return WayMotors(tuple(drives), at)
