"""The contouring stage: a square contour milled on any machine, with path, drive forces, motion and
the tool's deviation.

For each face also the stability of the cut: the largest Floquet multiplier, and the depth of cut at
the stability limit.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.contouring import (
    ContourAnswer,
    ContourFace,
    FaceStability,
)
from headstock.pipeline.answers.milled_faces import MilledFace
from headstock.pipeline.motion.contour_run import (
    CORIOLIS,
    SETTLING,
    ContourRun,
    face_instants,
    high_share,
)
from headstock.pipeline.motion.coupled_contour import (
    STEPS_PER_PERIOD,
    ContourCourse,
    CoupledRun,
    coupled_face_dynamics,
    run_coupled_contour,
)
from headstock.pipeline.motion.lumped_contour import lumped_face_dynamics, run_lumped_contour
from headstock.pipeline.motion.milled_faces import mill_faces
from headstock.pipeline.numbers.numbers import Number
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.mechanism import placed_mechanism
from headstock.pipeline.stages.refined_models import (
    repeat_with_refined,
)
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.estimates.corrected_elements import COMBINED_REFINEMENTS
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.reading.csv_files import ForceRecord, read_forces, resampling_loss
from headstock.solvers.milling.border import find_border
from headstock.solvers.milling.collocation import FINER, PeriodicCut, safe_depth
from headstock.solvers.milling.forces import MillingCut, describe_sense
from headstock.solvers.milling.tip_poles import TipDynamics, require_poles
from headstock.solvers.milling.tool_path import SquareContour, plan_contour

DEEPEST = 0.2  # largest depth of cut at which a stability limit is searched [m]
SERIES_POINTS = 2000
FACE_POINTS = 8192  # consecutive steps of each face that drive forces are evaluated at
OF_BLOCKS = "faces 1 and 3 are those at the lowest and the highest x; which way x points is assumed, so the ratio is reported for both"
GRAVITY_APART = "the static deflection under gravity is subtracted from the gap"
FAR_OFF = 1e-3  # distance of a measured path from the planned one that causes a warning [m]
MUCH_LEFT = 5e-6  # residual of measured positions about the spline that causes a warning [m]
MOST_LOST = 0.1  # share of the rms of measured forces whose loss causes a warning


def face_stability(
    tip: TipDynamics, request: ContouringRequest, face: int, at: str = ""
) -> FaceStability:
    """Return the stability of the cut in the middle of a face: largest Floquet multiplier at the
    depth of cut, and the limit depth.

    Args:
        tip: Dynamics of the machine at the tool tip in the middle of the face.
        request: Contour, tool and cut.
        face: Number of the straight cut, counted from zero.
    """
    poles, depth = require_poles(tip), request.cut.axial_depth
    cut, safe = PeriodicCut(poles, request.cut), safe_depth(poles, request.cut)
    (limit,) = find_border([cut], np.array([depth]), safe=safe, deepest=DEEPEST)
    return FaceStability(face + 1, at, abs(cut.largest(depth, FINER).value), limit.depth)


def cut_multiplier(tip: TipDynamics, request: ContouringRequest, depth: float) -> float:
    """Return the largest Floquet multiplier over a tooth period; the cut is stable below one.

    Args:
        depth: Axial depth of cut [m].
    """
    return abs(PeriodicCut(require_poles(tip), request.cut).largest(depth, FINER).value)


def evaluate_contour(
    request: ContouringRequest,
    run: ContourRun,
    *,
    stability: tuple[FaceStability, ...] = (),
    milled: tuple[MilledFace, ...] = (),
) -> ContourAnswer:
    """Evaluate a contour that was run.

    Args:
        request: Path, tool and cut.
        stability: Of each face, where it was requested.
    """
    some = np.unique(
        np.linspace(0, len(run.times) - 1, min(SERIES_POINTS, len(run.times))).astype(np.intp)
    )
    forces, block = run.drives.forces(some), isinstance(request.contour, SquareContour)
    return ContourAnswer(
        model=request.model,
        material=request.material,
        cutting=request.cutting,
        regeneration=request.regeneration,
        coriolis=run.coriolis,
        faces=tuple(
            _face(run, face) for face in range(len(run.plan.cuts)) if face_instants(run, face).any()
        ),
        least_gravity_deflection=np.abs(run.gravity_deflection).min(axis=0),
        most_gravity_deflection=np.abs(run.gravity_deflection).max(axis=0),
        force_mean=run.force.mean(axis=0),
        force_peak=np.abs(run.force).max(axis=0),
        high_share=high_share(run),
        face_times=np.array([*(cut.begins for cut in run.plan.cuts), run.plan.leaves]),
        assumed=(
            *([OF_BLOCKS] if block else []),
            describe_sense(request.cut.sense, request.contour.part),
            GRAVITY_APART,
            *run.assumed,
        ),
        compares_faces=block,
        fit=run.fit,
        times=run.times[some],
        gap=run.gap[some],
        drives=run.drives.names,
        drive_forces=forces,
        torques=None if run.drives.torques is None else run.drives.torques(some, forces),
        probes={name: probe.thin(some) for name, probe in run.probes.items()},
        stability=stability,
        milled=milled,
    )


@dataclass(frozen=True, eq=False)
class _Milled:
    """Store the answer of a contour that was run, without its histories.

    Attributes:
        times: ``(n,)`` steps [s].
        reasons: Why numbers are missing.
        course: Course of a machine of components; None of a lumped one.
    """

    answer: ContourAnswer
    times: FloatArray
    reasons: tuple[str, ...]
    course: ContourCourse | None


def _mill(
    state: RunState,
    request: ContouringRequest,
    record: ForceRecord | None,
    like: ContourCourse | None = None,
) -> _Milled:
    """Run a contour of a machine, which may differ little from another one that was run."""
    run, tips = _run_machine(state, request, record, like)
    milled, reasons = mill_faces(request, run) if request.cutting else ((), ())
    stability = tuple(
        face_stability(tip, request, face, run.plan.cuts[face].at) for face, tip in enumerate(tips)
    )
    return _Milled(
        evaluate_contour(request, run, stability=stability, milled=milled),
        run.times,
        (*_explain_gaps(run), *reasons),
        run.course if isinstance(run, CoupledRun) else None,
    )


def _explain_gaps(run: ContourRun) -> list[str]:
    """Explain why faces that were reached have no gap."""
    return [
        f"face {number} has no gap: its cut lasts {1e3 * (cut.ends - cut.begins):.3g} ms, and {1e3 * SETTLING:g} ms at each end are left out;"
        " write a lower feed or a longer side in [analyses.contouring]"
        for number, cut in enumerate(run.plan.cuts, 1)
        if run.times[-1] >= cut.ends and not face_instants(run, number - 1).any()
    ]


def _face(run: ContourRun, face: int) -> ContourFace:
    on, cut = face_instants(run, face), run.plan.cuts[face]
    gap, places = run.gap[on], np.flatnonzero(on)
    start = max(0, (len(places) - FACE_POINTS) // 2)
    some = places[start : start + FACE_POINTS]
    forces = run.drives.forces(some)
    torques = None if run.drives.torques is None else run.drives.torques(some, forces)
    return ContourFace(
        number=face + 1,
        at=cut.at,
        times=(cut.begins, cut.ends),
        outward=float((gap @ cut.outward).mean()),
        outward_span=float(np.ptp(gap @ cut.outward)),
        gap_mean=gap.mean(axis=0),
        gap_span=np.ptp(gap, axis=0),
        drive_mean=forces.mean(axis=0),
        drive_span=np.ptp(forces, axis=0),
        torque_mean=None if torques is None else torques.mean(axis=0),
        torque_span=None if torques is None else np.ptp(torques, axis=0),
    )


def run_contour_stage(state: RunState, stage: Stage) -> Outcome:
    """Run the contour the scene asks for."""
    if not state.is_root:
        return Outcome()
    request = state.scene.analyses[ContouringRequest]
    if not request.cutting:
        state.warn(
            "the contour is simulated without cutting; write [effects] cutting_force = true to cut"
        )
    record = None if request.forces is None or not request.cutting else read_forces(request.forces)
    milled = _mill(state, request, record)
    answer = milled.answer
    loss = None if record is None else resampling_loss(record, milled.times)
    _warn_of_run(state, request, milled, loss)

    def solve(machine: RunState, cut: MillingCut | None) -> list[Number]:
        asked = request if cut is None else dataclasses.replace(request, cut=cut)
        return [*_mill(machine, asked, record, milled.course).answer.list_numbers()]

    repeated = repeat_with_refined(
        state,
        COMBINED_REFINEMENTS,
        solve,
        request.cut if request.cutting and record is None else None,
        asked=request.estimate,
    )
    answer = dataclasses.replace(
        answer,
        force_loss=loss,
        errors=repeated.estimate(tuple(answer.list_numbers())),
        sources=repeated.sources,
        left_out=repeated.left_out,
    )
    reported = ", ".join(
        f"face {face.number} {1e6 * face.gap_mean[0]:+.1f} µm"
        for face in answer.faces
        if face.number in (1, 3)
    )
    return Outcome(
        detail=f"{len(milled.times)} steps, gap along x on {reported}", answers=(answer,)
    )


def _warn_of_run(
    state: RunState, request: ContouringRequest, milled: _Milled, loss: float | None
) -> None:
    """Warn of approximations by time steps, measured forces and measured positions.

    Args:
        loss: Share of the rms of measured forces that is lost; None without measured forces.
    """
    fit, step = milled.answer.fit, float(milled.times[1] - milled.times[0])
    if loss is not None and loss > MOST_LOST:
        state.warn(
            f"{100.0 * loss:.0f} % of the measured forces' rms is faster than the time steps resolve and is averaged out;"
            " raise steps_per_turn in [analyses.contouring] to resolve it"
        )
    if fit is not None and fit.off_path > FAR_OFF:
        state.warn(
            f"measured positions lead the tool up to {1e3 * fit.off_path:.3g} mm off its planned path, on which the cut and the faces are based; does"
            " the time of traces in [analyses.contouring] start with the path?"
        )
    if fit is not None and fit.residual > MUCH_LEFT:
        state.warn(
            f"the spline through measured positions leaves {1e6 * fit.residual:.3g} µm (root mean square); where that is no noise, write a shorter"
            " traces_knots in [analyses.contouring]"
        )
    for mode in request.tool_modes:
        if (steps := 1.0 / (mode.hz * step)) < STEPS_PER_PERIOD:
            state.warn(
                f"mode {mode.name} of the tool, {mode.hz:.0f} Hz, has {steps:.0f} time steps per period; write a larger steps_per_turn in"
                " [analyses.contouring]"
            )
    for reason in milled.reasons:
        state.warn(reason)


def _run_machine(
    state: RunState,
    request: ContouringRequest,
    record: ForceRecord | None,
    like: ContourCourse | None,
) -> tuple[ContourRun, tuple[TipDynamics, ...]]:
    """Run the contour on the machine of a scene, and return with it the machine at the tool tip on
    each face where chips regenerate.
    """
    faces = range(len(plan_contour(request.contour).cuts) if request.regeneration else 0)
    mechanism, placed = state.scene.mechanism, placed_mechanism(state)
    if placed is None:
        coupled = run_coupled_contour(state, request, record, like=like)
        return coupled, tuple(coupled_face_dynamics(coupled, request, face) for face in faces)
    if mechanism is None:
        raise ValueError("a placed mechanism needs a mechanism in the scene")
    if not request.damping:
        state.warn('the contour runs without damping: write [effects] damping = { modal = "2 %" }')
    # the model is linearised about the rigid path; the nonlinear one includes rotating gravity
    model = dataclasses.replace(
        placed.model, velocity_terms=CORIOLIS in state.scene.effects, gravity_stiffening=False
    )
    drives = tuple(state.scene.drives.values())
    run = run_lumped_contour(mechanism, model, request, record=record, drives=drives)
    return run, tuple(lumped_face_dynamics(mechanism, model, request, face) for face in faces)
