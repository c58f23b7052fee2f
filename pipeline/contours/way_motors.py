"""Motors of a machine along a way: what they move of the rigid machine, and their loops closed around
its modes.

The modes are those with locked motors. A motor's coordinate is the travel of the rigid machine that
it brings about; both are coupled by the inertia of that travel, which is also the load by which
the rigid machine bends the modes.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import NO_OFFSET, Machine
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.closures import evaluate_kinematics
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.pipeline.contours.contour_drives import FrictionSpeeds, close_drives
from headstock.pipeline.contours.ways import RigidWay
from headstock.pipeline.stages.run_state import MachineParts, RunState
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
from headstock.solvers.paths.sampled_motion import GIVEN, LOAD_SPACING, TOOL, SampledMotion
from headstock.solvers.paths.servo_motion import ServoMotion
from headstock.solvers.paths.set_points import PathMotion
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class MovedMachine:
    """What ``d`` motors move of the rigid machine at ``n`` times.

    Attributes:
        positions: ``(n, d)`` set positions [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        channels: ``(n, r, d)`` acceleration in each channel of the way per that of each motor.
        mass: ``(n, d, d)`` [kg].
        outputs: ``(n, p, d)`` motion at the outputs of the way per travel of each motor.
        weight: ``(n, d)`` generalised weight [N].
        inertia: ``(n, d)`` what the rigid motion takes beside the weight [N].
    """

    positions: FloatArray
    speeds: FloatArray
    accelerations: FloatArray
    channels: FloatArray
    mass: FloatArray
    outputs: FloatArray
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
    path: ToolPath,
    outputs: Sequence[Channel],
    *,
    amounts: Callable[[FloatArray], FloatArray],
    direction: FloatArray | None = None,
) -> WayMotors | None:
    """The drives that move a machine along a way; None without control.

    Args:
        state: Of the run.
        path: Of the tool.
        outputs: Where motion is wanted: of the tool first, its three directions. Of axes there are
            no others.
        amounts: Accelerations ``(n, r)`` of the bodies in the channels of the way at times.
        direction: ``(3,)`` of a mechanism's tool.
    """
    scene, parts = state.scene, state.parts
    if not scene.drives:
        return None
    if scene.mechanism is not None and direction is not None:
        drives = [drive for drive in scene.drives.values() if drive.axis in LENGTHS]
        return _leg_motors(
            parts, scene.mechanism, path, drives, amounts, direction=direction, outputs=outputs
        )
    return _axis_motors(parts, scene.machine, outputs[0][0], path)


def lead_motors(
    speeding: WayMotors,
    pulling: WayMotors,
    nodes: FloatArray,
    travel: Callable[[FloatArray], PathMotion],
) -> WayMotors:
    """Motors along a line, from what they move where it is travelled at a speed of one, and where it is
    accelerated by one: the former counts with the square of the speed.

    Args:
        speeding: Motors at unit speed, over positions of the line.
        pulling: The same at unit acceleration.
        nodes: ``(k,)`` positions between which both are interpolated.
        travel: Motion along the line at times.
    """
    fast, pulled = speeding.at(nodes), pulling.at(nodes)
    fields = [
        *dataclasses.astuple(fast),
        pulled.accelerations,
        pulled.inertia,
    ]
    laws = [scipy.interpolate.make_interp_spline(nodes, values, k=3) for values in fields]

    def at(times: FloatArray) -> MovedMachine:
        now = travel(times)
        v, a = now.speeds[:, None], now.accelerations[:, None]
        *own, by_pull, held = (np.asarray(law(now.positions)) for law in laws)
        found = MovedMachine(*own)
        return dataclasses.replace(
            found,
            speeds=found.speeds * v,
            accelerations=found.accelerations * v**2 + by_pull * a,
            inertia=found.inertia * v**2 + held * a,
        )

    return WayMotors(speeding.drives, at)


def lead_bodies(motors: WayMotors | None) -> Callable[[float], FloatArray]:
    """Travel ``(r, d)`` in each channel of a way per travel of each motor, at a place of it."""
    if motors is None:
        return lambda where: np.zeros((0, 0))
    return lambda where: motors.at(np.array([where])).channels[0]


def close_way(
    motors: WayMotors,
    sampled: SampledMotion,
    motion: LinearMotion,
    scales: int,
    *,
    way: RigidWay,
    given: Callable[[FloatArray], FloatArray],
    friction: FrictionSpeeds,
    load_spacing: float = LOAD_SPACING,
) -> ServoMotion:
    """Close the loops of all motors along a way.

    Args:
        motors: Of the machine.
        sampled: The machine with locked motors; its last outputs are what linear scales read, then
            momenta, its inputs after gravity the channels of the way.
        motion: The same between its nodes.
        scales: The first of these outputs.
        way: Of the machine.
        given: Values ``(n, 1 + r)`` of weight and of its channels at times.
        friction: At which speeds it acts.
        load_spacing: Time between which loads of the rigid motion are linear [s].
    """
    now = motors.at(motion.nodes)
    found = sampled.at(motion.nodes, "loads", "rows", "direct")
    modes, count = sampled.modes, len(motors.drives)
    kept, own = slice(0, modes), slice(modes, modes + count)
    # the load of an acceleration is what the travel's inertia takes of the modes
    bodies = slice(GIVEN.start + 1, GIVEN.start + 1 + now.channels.shape[1])
    coupling = -found.loads[:, :, bodies] @ now.channels
    mass = np.zeros((len(motion.nodes), modes + count, modes + count))
    mass[:, kept, kept], mass[:, own, own] = motion.mass, now.mass
    mass[:, kept, own], mass[:, own, kept] = coupling, np.swapaxes(coupling, 1, 2)
    extra = ((0, 0), (0, count), (0, count))
    load_nodes = even_nodes(motion.times, load_spacing)
    finer = [motors.at(load_nodes[part]) for part in chunk_slices(len(load_nodes))]

    def between(values: Sequence[FloatArray]) -> FloatArray:
        return interpolate_nodes(motion.times, load_nodes, np.concatenate(values))

    # offsets of joints that modes follow at once move what scales read and what motors accelerate
    reads, momenta = slice(scales, scales + count), slice(scales + count, scales + 2 * count)
    placed = {channel: 1 + number for number, channel in enumerate(way.channels)}
    offsets, pulling = ([placed[pair[end]] for pair in way.offsets] for end in (0, 1))
    moved, moving = (
        between([given(load_nodes[part])[:, columns] for part in chunk_slices(len(load_nodes))])
        for columns in (offsets, pulling)
    )
    beyond = found.direct[:, :, [GIVEN.start + column for column in offsets]]
    pulled = between([each.weight - each.inertia for each in finer])
    pulled -= motion.apply(beyond[:, momenta], moving)
    weight = np.concatenate([found.loads[:, :, GIVEN.start], now.weight], axis=1)
    unit = np.broadcast_to(np.eye(count), (len(motion.nodes), count, count))
    return close_drives(
        dataclasses.replace(
            motion,
            mass=mass,
            damping=np.pad(motion.damping, extra),
            stiffness=np.pad(motion.stiffness, extra),
            tool=np.concatenate([motion.tool, now.outputs[:, TOOL]], axis=2),
            load=np.concatenate([motion.load, pulled], axis=1),
        ),
        motors.drives,
        positions=between([each.positions for each in finer]),
        speeds=between([each.speeds for each in finer]),
        accelerations=between([each.accelerations for each in finer]),
        gravity=weight,
        scales=np.concatenate([found.rows[:, reads], unit], axis=2),
        beside=motion.apply(beyond[:, reads], moved),
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
            outputs=np.broadcast_to(tool, (count, *tool.shape)),
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
    *,
    direction: FloatArray,
    outputs: Sequence[Channel],
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
        moved = move_markers(mounted, times, path.at(times), direction)
        kinematics = evaluate_kinematics(known, moved.states)
        from_legs = velocity_maps(known, kinematics.closure_jacobian)[0][..., legs]
        pulled = amounts(times)
        count = len(drives)
        mass = np.zeros((len(times), count, count))
        weight, inertia = np.zeros((len(times), count)), np.zeros((len(times), count))
        channels = []

        def travel(name: str, local: FloatArray) -> tuple[FloatArray, FloatArray]:
            """Motion and turning ``(n, 3, d)`` of a place in a body."""
            place, own = known.markers.index(bodies[name]), parts.plan.components[name].placement
            arm = moved.rotations[:, place] @ (own.origin + own.rotation @ local)
            turning = kinematics.of_rotation[:, place] @ from_legs
            moving = kinematics.of_position[:, place] @ from_legs - skew_matrices(arm) @ turning
            return turn @ moving, turn @ turning

        def output_rows(channel: Channel) -> FloatArray:
            """Motion ``(n, d)`` at an output: of a point its tool's less its work's, or of an
            interface.
            """
            point, dof = parts.scene.machine.points.get(channel[0]), DOF_NAMES.index(channel[1])
            ends = [(JointEnd(*channel[0].split(".", 1)), 1.0, NO_OFFSET)]
            if point is not None:
                at_tool = point.carrier is point.tool
                ends = [
                    (point.tool, 1.0, point.offset if at_tool else NO_OFFSET),
                    (point.work, -1.0, NO_OFFSET if at_tool else point.offset),
                ]
            total = np.zeros((len(times), 6, count))
            for end, sign, offset in ends:
                if end.component in bodies and end.interface is not None:
                    local = parts.superelements[end.component].place_of(end.interface) + offset
                    total += sign * np.concatenate(travel(end.component, local), axis=1)
            return np.asarray(total[:, dof])

        for number, (name, marker) in enumerate(bodies.items()):
            place, body = known.markers.index(marker), parts.superelements[name]
            own = parts.plan.components[name].placement
            moving, turning = travel(name, body.center_of_mass)
            axes = turn @ moved.rotations[:, place] @ own.rotation
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
            outputs=np.stack([output_rows(channel) for channel in outputs], axis=1),
            weight=weight,
            inertia=inertia,
        )

    return WayMotors(tuple(drives), at)
