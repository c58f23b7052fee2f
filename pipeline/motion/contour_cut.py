"""Cutting forces along a contour: of rigid teeth, measured, or regenerative, with chips as thick as
the previous teeth left them.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.reading.csv_files import ForceRecord, resample_forces
from headstock.solvers.milling.forces import Side, part_sign, repeated_forces
from headstock.solvers.milling.regeneration import (
    RegenerativeCut,
    cutting_phases,
    integrate_regenerative,
)
from headstock.solvers.milling.tool_dynamics import ToolMode, mount_modes
from headstock.solvers.milling.tool_path import ContourPlan
from headstock.solvers.motion.alpha import (
    CompliantHistory,
    LinearMotion,
    chunk_slices,
    integrate_linear,
)


@dataclass(frozen=True, eq=False)
class CutMotion:
    """Store the motion of a machine that has cut a contour, in the axes of its motion.

    Attributes:
        tip: ``(n, 3)`` motion of the tool tip by the modes that are kept [m].
        force: ``(n, 3)`` on the tip [N].
        carried: ``(n, 3)`` force on the machine, less what accelerates the modes of the tool, where
            that differs from ``force`` [N].
    """

    history: CompliantHistory
    tip: FloatArray
    force: FloatArray
    carried: FloatArray


def cut_contour(
    request: ContouringRequest,
    motion: LinearMotion,
    plan: ContourPlan,
    *,
    rotation: FloatArray,
    record: ForceRecord | None,
) -> CutMotion:
    """Integrate the motion of a machine along its trajectory, with the modes of its tool.

    Args:
        request: Path, tool and cut.
        motion: The machine along its trajectory.
        plan: The contour, laid out in time.
        rotation: ``(3, 3)`` from the axes of the motion to those of the machine.
        record: Measured forces in place of computed ones.

    Raises:
        CsvError: The record does not cover the trajectory.
        ConvergenceError: The motion grows without bound.
    """
    times, size = motion.times, motion.mass.shape[-1]
    velocity = plan.path.velocity(times)
    modes = turned_modes(request.tool_modes, rotation)
    tipped = _mount_tool(motion, plan, modes, rotation) if modes else motion
    if request.cutting and request.regeneration and record is None:
        history, force = integrate_regenerative(
            tipped, tipped.load, _regenerative_cut(request, plan, velocity, times, rotation)
        )
    else:
        force = _given_force(request, plan, velocity, times, record) @ rotation
        load = tipped.tool_load(force)
        load += tipped.load
        history = integrate_linear(tipped, load)
    carried, after = force, history.compliant.shape[1]
    for mode in reversed(modes):
        # in its directions spring and damper transmit the force less that of its mass
        part_of_mode = slice(after - mode.directions.shape[1], after)
        transmitted = (
            mode.stiffness * history.compliant[:, part_of_mode]
            + mode.damper * history.rate[:, part_of_mode]
        )
        carried = carried @ (np.eye(3) - mode.projector) + transmitted @ mode.directions.T
        after = part_of_mode.start
    kept = slice(0, size)
    return CutMotion(
        CompliantHistory(
            history.compliant[:, kept], history.rate[:, kept], history.acceleration[:, kept]
        ),
        tipped.tool_motion(history.compliant),
        force,
        carried,
    )


def turned_modes(modes: Sequence[ToolMode], rotation: FloatArray) -> tuple[ToolMode, ...]:
    """Return the modes of a tool in rotated axes.

    Args:
        rotation: ``(3, 3)`` from the other axes to those of the machine.
    """
    return tuple(
        dataclasses.replace(mode, directions=rotation.T @ mode.directions) for mode in modes
    )


def _mount_tool(
    motion: LinearMotion, plan: ContourPlan, modes: Sequence[ToolMode], rotation: FloatArray
) -> LinearMotion:
    """Return a machine with the modes of its tool; the tool's weight is left out, as the gap is
    measured from equilibrium under gravity.
    """
    mounted = mount_modes(motion.mass, motion.damping, motion.stiffness, motion.tool, modes)
    extra = mounted.mass.shape[-1] - motion.mass.shape[-1]
    load = np.pad(motion.load, ((0, 0), (0, extra)))
    for part in chunk_slices(len(motion.times)):
        acceleration = plan.path.at(motion.times[part]).acceleration @ rotation
        load[part] -= (motion.between(mounted.weighed, part) @ acceleration[..., None])[..., 0]
    return dataclasses.replace(
        motion,
        mass=mounted.mass,
        damping=mounted.damping,
        stiffness=mounted.stiffness,
        tool=mounted.tip,
        gravity_deflection=np.pad(motion.gravity_deflection, ((0, 0), (0, extra))),
        load=load,
    )


def travel_frames(velocity: FloatArray, part: Side) -> FloatArray:
    """Return frames ``(n, 3, 3)`` from velocities ``(n, 3)``: rows along the travel, away from the
    part on one side of it, and up.
    """
    along = velocity / np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-9)[:, None]
    zero = np.zeros(len(velocity))
    away = part_sign(part) * np.stack([-along[:, 1], along[:, 0], zero], axis=-1)
    return np.stack([along, away, np.broadcast_to([0.0, 0.0, 1.0], velocity.shape)], axis=1)


def _regenerative_cut(
    request: ContouringRequest,
    plan: ContourPlan,
    velocity: FloatArray,
    times: FloatArray,
    mounting: FloatArray,
) -> RegenerativeCut:
    """Return the regenerative cut along the path, for a machine whose axes of motion are rotated by
    ``(3, 3)``.
    """
    feed = np.hypot(velocity[:, 0], velocity[:, 1]) * request.cut.tooth_period
    return RegenerativeCut(
        phases=cutting_phases(request.cut, request.steps_per_turn),
        delay=request.steps_per_turn // request.cut.mill.teeth,
        feed=feed,
        share=_engagement(plan, times) * (feed > 0.0),
        frame=travel_frames(velocity, request.contour.part) @ mounting,
    )


def _given_force(
    request: ContouringRequest,
    plan: ContourPlan,
    velocity: FloatArray,
    times: FloatArray,
    record: ForceRecord | None,
) -> FloatArray:
    """Return the force ``(n, 3)`` on the tool that does not depend on the motion, machine frame: as
    recorded, or of rigid teeth, of a tool that enters and leaves over its radius.
    """
    if not request.cutting:
        return np.zeros((len(times), 3))
    if record is not None:
        return resample_forces(record, times)
    feed = np.hypot(velocity[:, 0], velocity[:, 1])
    force = repeated_forces(request.cut, request.steps_per_turn, feed)
    force = (force * _engagement(plan, times)[:, None])[:, None, :]
    return (force @ travel_frames(velocity, request.contour.part))[:, 0]


def _engagement(plan: ContourPlan, times: FloatArray) -> FloatArray:
    return np.clip((times - plan.enters) / plan.entry, 0.0, 1.0) * np.clip(
        (plan.leaves - times) / plan.exit, 0.0, 1.0
    )
