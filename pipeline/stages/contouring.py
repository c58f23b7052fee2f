"""The contouring stage: a square contour milled on a lumped mechanism, with path, drive forces,
motion and the tool's deviation.

For each face also the stability of the cut: the largest Floquet multiplier, and the depth of cut at
which chatter starts.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import LENGTHS, solve_tool_pose
from headstock.pipeline.answers.contouring import FACES, ContourAnswer, ContourFace, FaceStability
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.mechanism import placed_mechanism
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.scene.reading.forces import (
    ForceRecord,
    read_forces,
    resample_forces,
    resampling_loss,
)
from headstock.scene.requests import ContouringRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import (
    linearise_poses,
    marker_motion,
    modal_damping,
    solve_pose_modes,
)
from headstock.solvers.milling.contouring import (
    drive_forces,
    linear_motion,
    refine_motion,
    tool_gaps,
)
from headstock.solvers.milling.forces import repeated_forces
from headstock.solvers.milling.path_drives import PathDrive, follow_path
from headstock.solvers.milling.regeneration import (
    RegenerativeCut,
    cutting_phases,
    march_regenerative,
)
from headstock.solvers.milling.stability import (
    TipDynamics,
    count_steps,
    largest_multiplier,
    limit_depth,
    milling_gains,
    tip_dynamics,
)
from headstock.solvers.milling.tool_path import square_path
from headstock.solvers.paths.linear_motion import (
    CompliantHistory,
    LinearMotion,
    interpolate_nodes,
    march_linear,
)

NODE_SPACING = 4e-3
SETTLING = 0.3  # left out at both ends of each face [s]
DEEPEST = 0.2  # depth of cut up to which a limit is looked for [m]
# outward normal of each face and the way the tool goes along it
NORMALS = ((-1.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, -1.0))
TRAVELS = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))
SERIES_POINTS = 2000
FACE_POINTS = 8192  # of each face, in a row, for the forces of its legs
ASSUMED = (
    "faces 1 and 3 are those at the lowest and the highest x; which way x points is assumed, so the ratio is reported for both",
    "the tool turns clockwise seen from above and leaves the block on its right: climb milling",
    "the static deflection under gravity is subtracted from the gap",
)
TORQUE = "motor torques are the drives' forces times lead over 2 pi: no friction, no inertia of motor and screw"
CORIOLIS = "coriolis"
MOST_LOST = 0.1  # of the rms of measured forces


@dataclass(frozen=True, eq=False)
class ContourRun:
    """A contour that has been run.

    Attributes:
        times: ``(n,)`` steps [s].
        gap: ``(n, 3)`` tool point of the compliant mechanism less that of the rigid one and less
            the deflection under gravity, machine frame [m].
        gravity_deflection: ``(n, 3)`` static deflection under gravity [m].
        force: ``(n, 3)`` on the tool, ground frame of the chains [N].
        face_times: ``(5,)`` when the straight cuts start, and when the last one ends [s].
        motion: The linear model.
        drive: What the drives do.
        history: Compliant coordinates.
        highest_hz: Highest natural frequency on the way.
    """

    times: FloatArray
    gap: FloatArray
    gravity_deflection: FloatArray
    force: FloatArray
    face_times: FloatArray
    motion: LinearMotion
    drive: PathDrive
    history: CompliantHistory
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
    path, face_times = square_path(request.contour)
    end = min(path.span[1], until)
    step = 2.0 * math.pi / request.cut.spindle / request.steps_per_turn
    times: FloatArray = np.asarray(np.arange(0.0, end, step), dtype=float)
    nodes: FloatArray = np.asarray(
        np.linspace(0.0, end, max(8, round(end / NODE_SPACING))), dtype=float
    )
    drive = follow_path(mechanism.mounted, nodes, path.at(nodes), mechanism.tool)
    turn = mechanism.mounted.mounting.rotation
    ratios = np.array(request.damping_ratios or (0.0,))
    motion = linear_motion(model, drive, times, ratios)
    if request.cutting and request.regeneration and record is None:
        history, force = march_regenerative(
            motion,
            motion.load,
            _regenerative_cut(request, path.velocity(times), times, face_times, turn),
        )
    else:
        force = _given_force(request, path.velocity(times), times, face_times, record) @ turn
        history = march_linear(motion, motion.load + motion.tool_load(force))
    moved = motion.tool_motion(history.compliant)
    if request.model == "nonlinear":
        history = refine_motion(model, drive, motion, force, history)
        moved = tool_gaps(model, drive, times, history.compliant)
    gravity_deflection = (
        motion.tool_motion(interpolate_nodes(times, motion.nodes, motion.gravity_deflection))
        @ turn.T
    )
    modes = solve_pose_modes(linearise_poses(model, drive.states[:: max(1, len(nodes) // 20)]))
    highest = float(modes.frequencies_hz.max())
    return ContourRun(
        times,
        moved @ turn.T - gravity_deflection,
        gravity_deflection,
        force,
        face_times,
        motion,
        drive,
        history,
        highest,
    )


def _tool_force(
    request: ContouringRequest, velocity: FloatArray, times: FloatArray, face_times: FloatArray
) -> FloatArray:
    """``(n, 3)`` cutting force on the tool in the machine frame; the tool enters and leaves over
    its radius.
    """
    feed = np.hypot(velocity[:, 0], velocity[:, 1])
    own = (
        repeated_forces(request.cut, request.steps_per_turn, feed)
        * _engagement(request, times, face_times)[:, None]
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
    velocity: FloatArray,
    times: FloatArray,
    face_times: FloatArray,
    mounting: FloatArray,
) -> RegenerativeCut:
    """What the teeth cut along the path, for a mechanism mounted with a rotation ``(3, 3)``."""
    feed = np.hypot(velocity[:, 0], velocity[:, 1]) * request.cut.tooth_period
    return RegenerativeCut(
        phases=cutting_phases(request.cut, request.steps_per_turn),
        delay=request.steps_per_turn // request.cut.mill.teeth,
        feed=feed,
        share=_engagement(request, times, face_times) * (feed > 0.0),
        frame=travel_frames(velocity) @ mounting,
    )


def _given_force(
    request: ContouringRequest,
    velocity: FloatArray,
    times: FloatArray,
    face_times: FloatArray,
    record: ForceRecord | None,
) -> FloatArray:
    """``(n, 3)`` force that does not depend on the motion, machine frame."""
    if not request.cutting:
        return np.zeros((len(times), 3))
    return (
        _tool_force(request, velocity, times, face_times)
        if record is None
        else resample_forces(record, times)
    )


def _engagement(
    request: ContouringRequest, times: FloatArray, face_times: FloatArray
) -> FloatArray:
    rate = request.contour.feed / request.contour.offset
    return np.asarray(
        np.clip((times - face_times[0]) * rate, 0.0, 1.0)
        * np.clip((face_times[4] - times) * rate, 0.0, 1.0)
    )


def face_instants(run: ContourRun, face: int) -> FloatArray:
    """Which steps lie on a face (0 to 3), its ends left out."""
    return np.asarray(
        (run.times > run.face_times[face] + SETTLING)
        & (run.times < run.face_times[face + 1] - SETTLING)
    )


def high_share(run: ContourRun) -> float:
    """Share of the gap's root mean square above twice the highest natural frequency, in the
    direction where it is largest.
    """
    flat = run.gap - run.gap.mean(axis=0)
    power = np.abs(np.fft.rfft(flat, axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), run.times[1] - run.times[0]) > 2.0 * run.highest_hz
    return float(np.sqrt(power[high].sum(axis=0) / power.sum(axis=0)).max())


def face_stability(
    mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, face: int
) -> FaceStability:
    """Stability of the cut in the middle of a face: largest Floquet multiplier at the depth of cut,
    and the limit depth.

    Args:
        mechanism: Of the scene.
        model: Its bodies and springs.
        request: Contour, tool and cut.
        face: Face of the square, 0 to 3 in the order of the path.
    """
    tip = face_dynamics(mechanism, model, request, face)
    multiplier = cut_multiplier(tip, request, request.cut.axial_depth)
    return FaceStability(
        face + 1,
        multiplier,
        limit_depth(lambda depth: cut_multiplier(tip, request, depth), DEEPEST),
    )


def cut_multiplier(tip: TipDynamics, request: ContouringRequest, depth: float) -> float:
    """Largest Floquet multiplier over a tooth period; the cut is stable below one.

    Args:
        tip: The mechanism at the tip of the tool.
        request: Tool and cut.
        depth: Axial depth of cut [m].
    """
    cut = dataclasses.replace(request.cut, axial_depth=depth)
    return largest_multiplier(
        tip, milling_gains(cut, count_steps(tip, cut.tooth_period)), cut.tooth_period
    )


def face_dynamics(
    mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, face: int
) -> TipDynamics:
    """The mechanism with its tool in the middle of a face: forces along, away and up, chips by
    motions along and away.

    Args:
        mechanism: Of the scene.
        model: Its bodies and springs.
        request: Contour and damping ratios.
        face: Face of the square, 0 to 3 in the order of the path.

    Raises:
        PoseError: The tool cannot get there.
    """
    contour = request.contour
    reach = 0.5 * contour.side + contour.offset
    x, y = (
        center + reach * normal
        for center, normal in zip(contour.center, NORMALS[face], strict=True)
    )
    state = solve_tool_pose(mechanism.mounted, np.array([x, y, contour.height]), mechanism.tool)
    motions = linearise_poses(model, state)
    damping = modal_damping(
        motions, solve_pose_modes(motions), np.array(request.damping_ratios or (0.0,))
    )
    frame: FloatArray = (
        travel_frames(np.array([[*TRAVELS[face], 0.0]]))[0] @ mechanism.mounted.mounting.rotation
    )
    tip = frame @ marker_motion(model, motions, model.tool)[:3]
    return tip_dynamics(motions.mass, damping, np.diag(motions.stiffness), forced=tip, seen=tip[:2])


def evaluate_contour(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    request: ContouringRequest,
    run: ContourRun,
    force_loss: float | None = None,
) -> ContourAnswer:
    """What is kept of a contour that was run.

    Args:
        mechanism: Of the scene.
        model: Its bodies and springs.
        request: Path, tool and cut.
        run: Of the request.
        force_loss: Share of measured forces that is faster than the steps.
    """
    on_tool = run.force @ mechanism.mounted.mounting.rotation.T
    some = np.unique(
        np.linspace(0, len(run.times) - 1, min(SERIES_POINTS, len(run.times))).astype(np.intp)
    )
    return ContourAnswer(
        model=request.model,
        material=request.material,
        cutting=request.cutting,
        regeneration=request.regeneration,
        coriolis=model.velocity_terms,
        faces=tuple(
            _face(model, run, face) for face in range(len(FACES)) if face_instants(run, face).any()
        ),
        least_gravity_deflection=np.abs(run.gravity_deflection).min(axis=0),
        most_gravity_deflection=np.abs(run.gravity_deflection).max(axis=0),
        force_mean=on_tool.mean(axis=0),
        force_peak=np.abs(on_tool).max(axis=0),
        high_share=high_share(run),
        face_times=run.face_times,
        assumed=(*ASSUMED, *([TORQUE] if mechanism.screw_lead else [])),
        times=run.times[some],
        gap=run.gap[some],
        legs=leg_forces(model, run, some),
        screw_lead=mechanism.screw_lead,
        stability=tuple(
            face_stability(mechanism, model, request, face)
            for face in range(len(FACES) if request.regeneration else 0)
        ),
        force_loss=force_loss,
    )


def leg_forces(model: CompliantMechanism, run: ContourRun, some: NDArray[np.intp]) -> FloatArray:
    """Forces of the legs' drives (eq. 14 of Bonnemains et al. 2010, with the work of springs that
    soften as a leg grows).

    Args:
        model: Bodies and springs of the mechanism.
        run: A contour that has been run in ``n`` steps.
        some: ``(k,)`` which steps.

    Returns:
        ``(k, 3)`` [N].
    """
    history = run.history
    thin = CompliantHistory(history.compliant[some], history.rate[some], history.acceleration[some])
    return drive_forces(model, run.drive, run.times[some], thin, run.force[some])[:, : len(LENGTHS)]


def _face(model: CompliantMechanism, run: ContourRun, face: int) -> ContourFace:
    on = face_instants(run, face)
    gap, places = run.gap[on], np.flatnonzero(on)
    start = max(0, (len(places) - FACE_POINTS) // 2)
    legs = leg_forces(model, run, places[start : start + FACE_POINTS])
    return ContourFace(
        face + 1, gap.mean(axis=0), np.ptp(gap, axis=0), legs.mean(axis=0), np.ptp(legs, axis=0)
    )


def run_contour_stage(state: RunState, stage: Stage) -> Outcome:
    """Run the contour the scene asks for."""
    if not state.is_root:
        return Outcome()
    mechanism, request, placed = (
        state.scene.mechanism,
        state.scene.analyses.contouring,
        placed_mechanism(state),
    )
    if mechanism is None or request is None or placed is None:
        raise ValueError("a contour stage needs a placed mechanism and a contour in the scene")
    if not request.damping_ratios:
        state.warn('the contour runs without damping: write [effects] damping = { modal = "2 %" }')
    if not request.cutting:
        state.warn(
            "the contour is simulated without cutting; write [effects] cutting_force = true to cut"
        )
    record = None if request.forces is None or not request.cutting else read_forces(request.forces)
    # the linear model is one about the rigid path, the nonlinear one includes the rotation of gravity
    model = dataclasses.replace(
        placed.model, velocity_terms=CORIOLIS in state.scene.effects, gravity_stiffening=False
    )
    run = run_contour(mechanism, model, request, record=record)
    loss = None if record is None else resampling_loss(record, run.times)
    if loss is not None and loss > MOST_LOST:
        state.warn(
            f"{100.0 * loss:.0f} % of the measured forces' rms is faster than the time steps resolve and is averaged out;"
            " raise steps_per_turn in [analyses.contouring] to resolve it"
        )
    found = evaluate_contour(mechanism, model, request, run, loss)
    reported = ", ".join(
        f"face {face.number} {1e6 * face.gap_mean[0]:+.1f} µm"
        for face in found.faces
        if face.number in (1, 3)
    )
    return Outcome(detail=f"{len(run.times)} steps, gap along x on {reported}", answers=(found,))
