"""A contour on a lumped mechanism from its request: path, drives, forces and motion."""

import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.reading.forces import ForceRecord, resample_forces
from headstock.scene.requests import ContouringRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.compliant_mechanism import CompliantMechanism
from headstock.solvers.mechanisms.modes import linearise_poses, solve_pose_modes
from headstock.solvers.milling.contouring import (
    GiveHistory,
    LinearMotion,
    interpolate_nodes,
    linear_motion,
    march_linear,
    refine_motion,
    tool_gaps,
)
from headstock.solvers.milling.forces import repeated_forces
from headstock.solvers.milling.path_drives import PathDrive, follow_path
from headstock.solvers.milling.regeneration import RegenerativeCut, cutting_phases, march_regenerative
from headstock.solvers.milling.tool_path import square_path

NODE_SPACING = 4e-3
SETTLING = 0.3  # left out at both ends of each face [s]


@dataclass(frozen=True, eq=False)
class ContourRun:
    """A contour that has been run.

    Attributes:
        times: ``(n,)`` steps [s].
        gap: ``(n, 3)`` tool point of the mechanism that gives less the rigid one's, less the sag, machine frame [m].
        sag: ``(n, 3)`` static sag under gravity [m].
        force: ``(n, 3)`` on the tool, ground frame of the chains [N].
        marks: ``(5,)`` when the straight cuts start, and when the last one ends [s].
        motion: The linear model.
        drive: What the drives do.
        history: Compliant coordinates.
        highest_hz: Highest natural frequency on the way.
    """

    times: FloatArray
    gap: FloatArray
    sag: FloatArray
    force: FloatArray
    marks: FloatArray
    motion: LinearMotion
    drive: PathDrive
    history: GiveHistory
    highest_hz: float


def run_contour(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    request: ContouringRequest,
    *,
    record: ForceRecord | None = None,
    until: float = math.inf,
) -> ContourRun:
    """Run a contour.

    Args:
        mechanism: Of the scene.
        model: Its bodies and springs.
        request: Path, tool and cut.
        record: Measured forces in place of computed ones; its time starts with the path.
        until: Stop at this time [s].

    Raises:
        PoseError: The path cannot be followed.
        ForceFileError: The record does not cover it.
    """
    path, marks = square_path(request.contour)
    end = min(path.span[1], until)
    step = 2.0 * math.pi / request.cut.spindle / request.steps_per_turn
    times: FloatArray = np.asarray(np.arange(0.0, end, step), dtype=float)
    nodes: FloatArray = np.asarray(np.linspace(0.0, end, max(8, round(end / NODE_SPACING))), dtype=float)
    drive = follow_path(mechanism.mounted, nodes, path.at(nodes), mechanism.tool)
    turn = mechanism.mounted.mounting.rotation
    ratios = np.array(request.damping_ratios or (0.0,))
    motion = linear_motion(model, drive, times, ratios)
    if request.cutting and request.regeneration and record is None:
        history, force = march_regenerative(
            motion, motion.load, regenerative_cut(request, path.velocity(times), times, marks, turn)
        )
    else:
        force = _given_force(request, path.velocity(times), times, marks, record) @ turn
        history = march_linear(motion, motion.load + motion.tool_load(force))
    moved = motion.tool_motion(history.give)
    if request.model == "nonlinear":
        history = refine_motion(model, drive, motion, force, history)
        moved = tool_gaps(model, drive, times, history.give)
    sag = motion.tool_motion(interpolate_nodes(times, motion.nodes, motion.sag)) @ turn.T
    modes = solve_pose_modes(linearise_poses(model, drive.states[:: max(1, len(nodes) // 20)]))
    highest = float(modes.frequencies_hz.max())
    return ContourRun(times, moved @ turn.T - sag, sag, force, marks, motion, drive, history, highest)


def tool_force(request: ContouringRequest, velocity: FloatArray, times: FloatArray, marks: FloatArray) -> FloatArray:
    """``(n, 3)`` cutting force on the tool in the machine frame; the tool enters and leaves over its radius."""
    feed = np.hypot(velocity[:, 0], velocity[:, 1])
    own = repeated_forces(request.cut, request.steps_per_turn, feed) * _engagement(request, times, marks)[:, None]
    return np.asarray((own[:, None, :] @ travel_frames(velocity))[:, 0])


def travel_frames(velocity: FloatArray) -> FloatArray:
    """``(n, 3, 3)`` with rows along the travel, away from the part on its right, and up, from velocities ``(n, 3)``."""
    along = velocity / np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-9)[:, None]
    zero = np.zeros(len(velocity))
    away = np.stack([-along[:, 1], along[:, 0], zero], axis=-1)
    return np.stack([along, away, np.broadcast_to([0.0, 0.0, 1.0], velocity.shape)], axis=1)


def regenerative_cut(
    request: ContouringRequest, velocity: FloatArray, times: FloatArray, marks: FloatArray, mounting: FloatArray
) -> RegenerativeCut:
    """What the teeth cut along the path, for a mechanism mounted with a rotation ``(3, 3)``."""
    feed = np.hypot(velocity[:, 0], velocity[:, 1]) * request.cut.tooth_period
    return RegenerativeCut(
        phases=cutting_phases(request.cut, request.steps_per_turn),
        delay=request.steps_per_turn // request.cut.mill.teeth,
        feed=feed,
        share=_engagement(request, times, marks) * (feed > 0.0),
        frame=travel_frames(velocity) @ mounting,
    )


def _given_force(
    request: ContouringRequest, velocity: FloatArray, times: FloatArray, marks: FloatArray, record: ForceRecord | None
) -> FloatArray:
    """``(n, 3)`` force that does not depend on the motion, machine frame."""
    if not request.cutting:
        return np.zeros((len(times), 3))
    return tool_force(request, velocity, times, marks) if record is None else resample_forces(record, times)


def _engagement(request: ContouringRequest, times: FloatArray, marks: FloatArray) -> FloatArray:
    rate = request.contour.feed / request.contour.offset
    return np.asarray(np.clip((times - marks[0]) * rate, 0.0, 1.0) * np.clip((marks[4] - times) * rate, 0.0, 1.0))


def face_instants(run: ContourRun, face: int) -> FloatArray:
    """Which steps lie on a face (0 to 3), its ends left out."""
    return np.asarray((run.times > run.marks[face] + SETTLING) & (run.times < run.marks[face + 1] - SETTLING))


def high_share(run: ContourRun) -> float:
    """Share of the gap's root mean square above twice the highest natural frequency, in the direction where it is largest."""
    flat = run.gap - run.gap.mean(axis=0)
    power = np.abs(np.fft.rfft(flat, axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), run.times[1] - run.times[0]) > 2.0 * run.highest_hz
    return float(np.sqrt(power[high].sum(axis=0) / power.sum(axis=0)).max())
