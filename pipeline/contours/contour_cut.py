"""What is cut along a contour: forces of rigid teeth, measured ones, or chips as thick as the last
teeth left them.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.reading.forces import ForceRecord, resample_forces
from headstock.scene.requests import ContouringRequest
from headstock.solvers.milling.forces import repeated_forces
from headstock.solvers.milling.regeneration import (
    RegenerativeCut,
    cutting_phases,
    march_regenerative,
)
from headstock.solvers.milling.tool_path import ContourPlan
from headstock.solvers.paths.linear_motion import CompliantHistory, LinearMotion, march_linear


def cut_contour(
    request: ContouringRequest,
    motion: LinearMotion,
    plan: ContourPlan,
    *,
    rotation: FloatArray,
    record: ForceRecord | None,
) -> tuple[CompliantHistory, FloatArray]:
    """The motion of a machine on its way, and the ``(n, 3)`` force on the tool, in the axes of the
    motion [N].

    Args:
        request: Path, tool and cut.
        motion: The machine on its way.
        plan: The contour, laid out in time.
        rotation: ``(3, 3)`` from the axes of the motion to those of the machine.
        record: Measured forces in place of computed ones.

    Raises:
        ForceFileError: The record does not cover the way.
        ConvergenceError: The motion grows without bound.
    """
    times = motion.times
    velocity = plan.path.velocity(times)
    if request.cutting and request.regeneration and record is None:
        return march_regenerative(
            motion,
            motion.load,
            _regenerative_cut(request, plan, velocity, times, rotation),
        )
    force = _given_force(request, plan, velocity, times, record) @ rotation
    return march_linear(motion, motion.load + motion.tool_load(force)), force


def _tool_force(
    request: ContouringRequest, plan: ContourPlan, velocity: FloatArray, times: FloatArray
) -> FloatArray:
    """``(n, 3)`` cutting force on the tool in the machine frame; the tool enters and leaves over
    its radius.
    """
    feed = np.hypot(velocity[:, 0], velocity[:, 1])
    own = (
        repeated_forces(request.cut, request.steps_per_turn, feed)
        * _engagement(plan, times)[:, None]
    )
    return np.asarray((own[:, None, :] @ travel_frames(velocity))[:, 0])


def travel_frames(velocity: FloatArray) -> FloatArray:
    """``(n, 3, 3)`` with rows along the travel, away from the part on its right, and up, from
    velocities ``(n, 3)``.
    """
    along = velocity / np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-9)[:, None]
    zero = np.zeros(len(velocity))
    away = np.stack([-along[:, 1], along[:, 0], zero], axis=-1)
    return np.stack([along, away, np.broadcast_to([0.0, 0.0, 1.0], velocity.shape)], axis=1)


def _regenerative_cut(
    request: ContouringRequest,
    plan: ContourPlan,
    velocity: FloatArray,
    times: FloatArray,
    mounting: FloatArray,
) -> RegenerativeCut:
    """What the teeth cut along the path, for a machine whose axes of motion are
    turned by a rotation ``(3, 3)``.
    """
    feed = np.hypot(velocity[:, 0], velocity[:, 1]) * request.cut.tooth_period
    return RegenerativeCut(
        phases=cutting_phases(request.cut, request.steps_per_turn),
        delay=request.steps_per_turn // request.cut.mill.teeth,
        feed=feed,
        share=_engagement(plan, times) * (feed > 0.0),
        frame=travel_frames(velocity) @ mounting,
    )


def _given_force(
    request: ContouringRequest,
    plan: ContourPlan,
    velocity: FloatArray,
    times: FloatArray,
    record: ForceRecord | None,
) -> FloatArray:
    """``(n, 3)`` force that does not depend on the motion, machine frame."""
    if not request.cutting:
        return np.zeros((len(times), 3))
    return (
        _tool_force(request, plan, velocity, times)
        if record is None
        else resample_forces(record, times)
    )


def _engagement(plan: ContourPlan, times: FloatArray) -> FloatArray:
    return np.asarray(
        np.clip((times - plan.enters) / plan.entry, 0.0, 1.0)
        * np.clip((plan.leaves - times) / plan.entry, 0.0, 1.0)
    )
