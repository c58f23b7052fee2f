"""A contour on a lumped mechanism from its request: path, drives, forces, motion, and what is told of each face."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.force_files import ForceRecord, resample_forces
from headstock.pipeline.scene import ContouringRequest, SceneMechanism
from headstock.solvers.compliant_mechanism import CompliantMechanism
from headstock.solvers.contouring import (
    GiveHistory,
    LinearMotion,
    drive_forces,
    interpolate_nodes,
    linear_motion,
    march_linear,
    refine_motion,
    tool_gaps,
)
from headstock.solvers.mechanism_modes import linearise_poses, solve_pose_modes
from headstock.solvers.milling_forces import cutting_forces
from headstock.solvers.path_drives import PathDrive, follow_path
from headstock.solvers.tool_paths import square_path

NODE_SPACING = 4e-3
SETTLING = 0.3  # left out at both ends of each face [s]
SERIES_POINTS = 2000
FACES = ("lowest x", "highest y", "highest x", "lowest y")
ASSUMED = (
    "faces 1 and 3 are those at the lowest and the highest x; which way x points is assumed, so the ratio is told for both",
    "the tool turns clockwise seen from above and leaves the block on its right: climb milling",
    "the static sag under gravity is subtracted from the gap",
)


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
    on_tool = tool_force(request, path.at(times).velocity, times, marks) if record is None else resample_forces(record, times)
    force = on_tool @ turn
    ratios = np.array(request.damping_ratios or (0.0,))
    motion = linear_motion(model, drive, times, ratios)
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
    rate = request.contour.feed / request.contour.offset
    engaged = np.clip((times - marks[0]) * rate, 0.0, 1.0) * np.clip((marks[4] - times) * rate, 0.0, 1.0)
    own = cutting_forces(request.cut, times, feed) * engaged[:, None]
    along = velocity / np.maximum(feed, 1e-9)[:, None]
    away = np.stack([-along[:, 1], along[:, 0], np.zeros_like(feed)], axis=-1)
    return np.asarray(own[:, :1] * along + own[:, 1:2] * away + own[:, 2:] * np.array([0.0, 0.0, 1.0]))


def face_instants(run: ContourRun, face: int) -> FloatArray:
    """Which steps lie on a face (0 to 3), its ends left out."""
    return np.asarray((run.times > run.marks[face] + SETTLING) & (run.times < run.marks[face + 1] - SETTLING))


def high_share(run: ContourRun) -> float:
    """Share of the gap's root mean square above twice the highest natural frequency, in the direction where it is largest."""
    flat = run.gap - run.gap.mean(axis=0)
    power = np.abs(np.fft.rfft(flat, axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), run.times[1] - run.times[0]) > 2.0 * run.highest_hz
    return float(np.sqrt(power[high].sum(axis=0) / power.sum(axis=0)).max())


def summarise_contour(
    mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, run: ContourRun
) -> dict[str, Any]:
    """As it stands in ``summary.json``: faces, ratio for both orientations, sag, leg forces, and a thinned series."""
    faces = []
    for number, name in enumerate(FACES):
        on = face_instants(run, number)
        if on.any():
            gap = 1e6 * run.gap[on]
            faces.append(
                {
                    "face": number + 1,
                    "at": name,
                    "mean_um": gap.mean(axis=0).tolist(),
                    "peak_to_peak_um": np.ptp(gap, axis=0).tolist(),
                }
            )
    near, far = (next((item["mean_um"][0] for item in faces if item["face"] == number), None) for number in (1, 3))
    ratio = abs(far / near) if near and far else None
    some = np.unique(np.linspace(0, len(run.times) - 1, min(SERIES_POINTS, len(run.times))).astype(int))
    thin = GiveHistory(run.history.give[some], run.history.rate[some], run.history.acceleration[some])
    legs = drive_forces(model, run.drive, run.times[some], thin, run.force[some])[:, :3]
    on_tool = run.force @ mechanism.mounted.mounting.rotation.T
    return {
        "model": request.model,
        "material": request.material,
        "faces": faces,
        "face_3_over_face_1": {"x as assumed": ratio, "x reversed": None if not ratio else 1.0 / ratio},
        "sag_um": {"least": (1e6 * np.abs(run.sag).min(axis=0)).tolist(), "most": (1e6 * np.abs(run.sag).max(axis=0)).tolist()},
        "force_mean_n": on_tool.mean(axis=0).tolist(),
        "force_peak_n": np.abs(on_tool).max(axis=0).tolist(),
        "share_above_twice_the_highest_mode": high_share(run),
        "marks_s": run.marks.tolist(),
        "assumed": list(ASSUMED),
        "series": {
            "time_s": run.times[some].tolist(),
            "gap_um": (1e6 * run.gap[some]).tolist(),
            "leg_force_n": legs.tolist(),
        },
    }
