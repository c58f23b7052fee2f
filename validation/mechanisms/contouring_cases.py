"""Cutting on the lumped Tripteor: tool gap on each face of the contour of the paper (table 1,
figures 5 to 9), and stability.

Stability of regenerative cutting is checked by closed forms and by published cases with independent
methods.
"""

import dataclasses
import time

import numpy as np
import scipy.special

from headstock.geometry.frames import FloatArray
from headstock.pipeline.contours.contour_run import ContourRun, face_instants, high_share
from headstock.pipeline.contours.contouring import cut_multiplier, face_stability
from headstock.pipeline.contours.lumped_contour import lumped_face_dynamics, run_lumped_contour
from headstock.pipeline.contours.milled_faces import mill_faces
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.scene.building.loader import load_scene
from headstock.scene.requests import ContouringRequest
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.stability import (
    TipDynamics,
    floquet_multipliers,
    largest_multiplier,
    milling_gains,
    single_frequency_limit,
    tip_dynamics,
)
from headstock.solvers.mpi import MPI
from headstock.solvers.paths.linear_motion import LinearMotion, Regeneration, march_linear
from headstock.validation.mechanisms.tripteor_machine import SCENE, Tripteor, load_tripteor
from headstock.validation.references.rows import Target, ValidationRow, judge, judge_bound, show

GAP_MIDDLE, GAP_HALF = 12.5, 7.5  # the gap is to lie between 5 and 20 um
SOME = 0.3  # of the nonlinear solution, shown beside the linear one [s]
FINER = 4  # times as many steps: an error of second order falls to a sixteenth
FINER_UNTIL = 0.8  # the tool is well into face 1 then [s]
LEG_STEPS = 8192
# Insperger and Stepan (2004), Int. J. Numer. Meth. Eng. 61, 117-141, sec. 5: one mode, two teeth
MASS, HZ, ZETA, CHIP, NORMAL, TEETH = 0.03993, 922.0, 0.011, 6e8, 2e8, 2
# frequency of chatter over the natural one, waves between two cuts
TURNING = (
    (1.0213, 3),
    (1.0057, 1),
    (1.0471, 5),
)
MATHIEU = ((1.0, 0.05), (0.5, -0.1), (2.0, 0.2))  # parametric excitation, weight of the delay
MARCHED_STEPS = 1600
SLOTTING = ((5000.0, 0.2e-3), (5000.0, 1e-3), (15000.0, 1e-3))  # rpm, depth of cut [m]


def contour_request(material: str, model: str = "linear") -> ContouringRequest:
    """The contour of the shipped scene in another material or by another model."""
    request = load_scene(SCENE, variant="lumped").analyses.contouring
    if request is None:
        raise ValueError(f"{SCENE} has no contour")
    cut = dataclasses.replace(request.cut, coefficients=catalogue_coefficients(material))
    return dataclasses.replace(
        request, cut=cut, material=material, model="nonlinear" if model == "nonlinear" else "linear"
    )


def check_contouring(comm: MPI.Comm) -> list[ValidationRow]:
    """The whole contour, linear along the path, for two sets of coefficients; the orientation of x
    is assumed, so both are reported.
    """
    case, tripteor = "tripteor-contouring", load_tripteor()
    rows: list[ValidationRow] = []
    for material in ("al7075-t6", "al7075-t6-dry"):
        begun = time.process_time()
        run = run_lumped_contour(tripteor.scene, tripteor.model, contour_request(material))
        seconds = time.process_time() - begun
        rows += _face_rows(case, material, run)
        rows += _leg_rows(case, material, tripteor, run)
        rows += _profile_rows(case, material, run)
        rows.append(
            judge_bound(
                case,
                f"{material}: content above twice the highest mode",
                high_share(run),
                0.01,
                "no filter",
            )
        )
        rows.append(
            judge_bound(
                case,
                f"{material}: linear contour, processor time [s]",
                seconds,
                10.0,
                "the paper: 6 h",
            )
        )
    rows.append(_step_row(case, tripteor, "linear", FINER_UNTIL))
    gravity_deflection = 1e6 * np.abs(run.gravity_deflection[:, 0])
    rows.append(
        show(
            case,
            "deflection under gravity along x, minimum",
            float(gravity_deflection.min()),
            "um",
            "subtracted from every gap",
        )
    )
    rows.append(
        show(
            case,
            "deflection under gravity along x, maximum",
            float(gravity_deflection.max()),
            "um",
            "subtracted from every gap",
        )
    )
    return rows


def check_nonlinear_contour(comm: MPI.Comm) -> list[ValidationRow]:
    """The start of the contour by the full equations, beside the linear model, and what the whole
    would cost.
    """
    case, tripteor = "tripteor-contouring-nonlinear", load_tripteor()
    linear = run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request("al7075-t6"), until=SOME
    )
    begun = time.process_time()
    full = run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request("al7075-t6", "nonlinear"), until=SOME
    )
    whole = (time.process_time() - begun) * 10.7 / SOME
    fine = _step_row(case, tripteor, "nonlinear", SOME)
    deflection = float(np.abs(full.gap + full.gravity_deflection).max())
    share = float(np.abs(full.gap - linear.gap).max()) / deflection
    return [
        judge_bound(
            case,
            "linear off the nonlinear motion of the tool, of its whole deflection",
            share,
            0.01,
            "deflection under gravity included",
        ),
        judge_bound(
            case,
            "nonlinear contour of 10.7 s, processor time scaled up [s]",
            whole,
            300.0,
            "the paper: 6 h",
        ),
        fine,
    ]


def check_whole_nonlinear_contour(comm: MPI.Comm) -> list[ValidationRow]:
    """The whole contour by the full equations: gap on each face, no filter, cost, and how far the
    linear model is off.
    """
    case, material, tripteor = "tripteor-contour-whole", "al7075-t6", load_tripteor()
    linear = run_lumped_contour(tripteor.scene, tripteor.model, contour_request(material))
    begun = time.process_time()
    full = run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request(material, "nonlinear")
    )
    seconds = time.process_time() - begun
    deflection = float(np.abs(full.gap + full.gravity_deflection).max())
    off = float(np.abs(full.gap - linear.gap).max())
    return [
        *_face_rows(case, f"nonlinear, {material}", full),
        judge_bound(
            case, "content above twice the highest mode", high_share(full), 0.01, "no filter"
        ),
        judge_bound(
            case, "processor time of 10.7 s of motion [s]", seconds, 300.0, "the paper: 6 h"
        ),
        judge_bound(
            case,
            "linear off the nonlinear motion of the tool, of its whole deflection",
            off / deflection,
            0.01,
        ),
        show(case, "linear off the nonlinear gap, at most", 1e6 * off, "um"),
    ]


def _face_rows(case: str, material: str, run: ContourRun) -> list[ValidationRow]:
    rows, means = [], []
    for face in (1, 3):
        gap = 1e6 * run.gap[face_instants(run, face - 1), 0]
        means.append(abs(float(gap.mean())))
        note = f"mean {means[-1]:.2f} µm, peak to peak {np.ptp(gap):.2f} µm; the paper: about 10 µm after its filter"
        rows.append(
            judge_bound(
                case,
                f"{material}: |gap| along x on face {face} off {GAP_MIDDLE} µm [µm]",
                abs(means[-1] - GAP_MIDDLE),
                GAP_HALF,
                note,
            )
        )
    ratio = means[1] / means[0]
    rows.append(
        show(
            case,
            f"{material}: face 3 over face 1, x as assumed",
            ratio,
            "-",
            "the paper: clearly larger on face 3",
        )
    )
    note = "the paper does not tell which way x points"
    rows.append(show(case, f"{material}: face 3 over face 1, x reversed", 1.0 / ratio, "-", note))
    return rows


def _profile_rows(case: str, material: str, run: ContourRun) -> list[ValidationRow]:
    """Profiles of faces 1 and 3, of which figure 7 of the paper shows measured ones without numbers
    in its text.
    """
    faces, _ = mill_faces(contour_request(material), run)
    first, third = (face for face in faces if face.number in (1, 3))
    rows = []
    for face in (first, third):
        found, gap = face.parameters, run.gap[face_instants(run, face.number - 1)]
        outward = float((gap @ run.plan.cuts[face.number - 1].outward).mean())
        note = f"Ra {1e6 * found.ra:.3f}, Wt {1e6 * found.wt:.3f}, mark at start {1e6 * face.marks[0]:.2f} µm; the paper: marks and about 10 µm"
        rows.append(
            judge(
                case,
                f"{material}: location error of face {face.number}, cusps left out",
                1e6 * (found.location - face.cusp / 3.0),
                Target(1e6 * outward, "um", 0.02, "mean gap"),
                note,
            )
        )
    note = "the paper: vibration on face 3, seen and measured"
    ratio = first.parameters.wt / third.parameters.wt
    return [*rows, judge_bound(case, f"{material}: Wt of face 1 over face 3", ratio, 1.0, note)]


def _step_row(case: str, tripteor: Tripteor, model: str, until: float) -> ValidationRow:
    """Change of the gap when the error of a step is a tenth and less."""
    request = contour_request("al7075-t6", model)
    coarse = run_lumped_contour(tripteor.scene, tripteor.model, request, until=until)
    finer = dataclasses.replace(request, steps_per_turn=FINER * request.steps_per_turn)
    fine = run_lumped_contour(tripteor.scene, tripteor.model, finer, until=until).gap[::FINER][
        : len(coarse.gap)
    ]
    change = float(np.sqrt(((fine - coarse.gap) ** 2).mean() / (coarse.gap**2).mean()))
    return judge_bound(
        case,
        f"{model}: change of the gap with {FINER} times as many steps, of its rms",
        change,
        0.01,
    )


def _leg_rows(case: str, material: str, tripteor: Tripteor, run: ContourRun) -> list[ValidationRow]:
    """How much the force of leg 1's drive, and so its motor's torque, varies on faces 1 and 3."""
    spans = []
    for face in (1, 3):
        places = np.flatnonzero(face_instants(run, face - 1))
        middle = (len(places) - LEG_STEPS) // 2
        spans.append(float(np.ptp(run.drives.forces(places[middle : middle + LEG_STEPS])[:, 0])))
        rows = [
            show(
                case,
                f"{material}: force of leg 1 varies on face 3 by",
                spans[-1],
                "N",
                "peak to peak over 0.4 s",
            )
        ]
    note = "claim: the torque of motor 1 varies more on face 3"
    return [
        *rows,
        judge_bound(
            case,
            f"{material}: variation of leg 1 on face 1 over face 3",
            spans[0] / spans[1],
            1.0,
            note,
        ),
    ]


def check_stability_methods(comm: MPI.Comm, steps: int = MARCHED_STEPS) -> list[ValidationRow]:
    """Multipliers on borders known in closed form, and of a published milling case by marching its
    equation in time.
    """
    return [*_turning_rows(), *_mathieu_rows(), *_milling_rows(steps)]


def check_contour_stability(comm: MPI.Comm) -> list[ValidationRow]:
    """Depth of cut at which each face of the paper's block chatters: does regeneration single out
    face 3?
    """
    case, tripteor = "tripteor-stability", load_tripteor()
    rows: list[ValidationRow] = []
    for material in ("al7075-t6", "al7075-t6-dry", "al6061-t6"):
        request = contour_request(material)
        limits = []
        for face in range(4):
            found = face_stability(
                lumped_face_dynamics(tripteor.scene, tripteor.model, request, face), request, face
            )
            limits.append(1e3 * found.limit_depth)
            note = (
                "the paper cuts 10 mm: stable" if found.stable else "the paper cuts 10 mm: unstable"
            )
            rows.append(
                show(case, f"{material}: limit depth on face {face + 1}", limits[-1], "mm", note)
            )
        tip = lumped_face_dynamics(tripteor.scene, tripteor.model, request, 2)
        second = (
            1e3
            * request.cut.axial_depth
            * single_frequency_limit(tip, milling_gains(request.cut, 96), request.cut.tooth_period)
        )
        target = Target(second, "mm", 0.02, "single frequency")
        rows.append(
            judge(
                case,
                f"{material}: limit depth on face 3, against a single frequency",
                limits[2],
                target,
            )
        )
        rows.append(
            show(
                case,
                f"{material}: limit depth of face 3 over face 1",
                limits[2] / limits[0],
                "-",
                "no more than this",
            )
        )
    rows += _damping_rows(case)
    return rows


def one_mode() -> TipDynamics:
    """The single mode of the published case."""
    omega = 2.0 * np.pi * HZ
    mass, damping, stiffness = (
        MASS * np.eye(1),
        2.0 * ZETA * omega * MASS * np.eye(1),
        MASS * omega**2 * np.eye(1),
    )
    return tip_dynamics(mass, damping, stiffness, forced=np.eye(1))


def _slotting_gain(times: FloatArray, period: float, depth: float) -> FloatArray:
    """``(n,)`` force per motion of two teeth in a full slot, up-milling [N/m]."""
    angle = np.pi * times / period
    # one of two teeth is in the cut at any time
    return np.asarray(
        -depth
        * (CHIP * np.cos(angle % np.pi) + NORMAL * np.sin(angle % np.pi))
        * np.sin(angle % np.pi)
    )


def _turning_rows() -> list[ValidationRow]:
    """Constant engagement: on the border of the lobes the largest multiplier is one (Tobias;
    Altintas 2012, sec. 4.2).
    """
    case, tip, rows = "stability-closed-forms", one_mode(), []
    omega = 2.0 * np.pi * HZ
    for ratio, waves in TURNING:
        chatter = ratio * omega
        response = 1.0 / (MASS * (omega**2 - chatter**2 + 2j * ZETA * omega * chatter))
        gain = 0.5 / response.real  # negative: the force works against the motion
        # exp(-i omega T) = 1 - 1 / (gain response)
        period = (2.0 * np.pi * waves - float(np.angle(1.0 - 1.0 / (gain * response)))) / chatter
        errors = [
            abs(largest_multiplier(tip, np.full((steps * waves, 1, 1), gain), period) - 1.0)
            for steps in (30, 60, 120)
        ]
        name = f"turning at {ratio:g} times the natural frequency, {waves} waves"
        rows.append(judge_bound(case, f"{name}: multiplier off one", errors[-1], 1e-3))
        rows.append(
            judge(
                case,
                f"{name}: order",
                float(np.log2(errors[-2] / errors[-1])),
                Target(2.0, "-", 0.1, "theory"),
            )
        )
        factor = single_frequency_limit(tip, np.full((1, 1, 1), gain), period)
        rows.append(
            judge(
                case,
                f"{name}: limit by a single frequency",
                factor,
                Target(1.0, "-", 1e-4, "closed form"),
            )
        )
    return rows


def _mathieu_rows() -> list[ValidationRow]:
    """``x'' + (delta + epsilon cos t) x = b x(t - 2 pi)``: borders by Mathieu's characteristic
    values (Insperger and Stepan 2002).
    """
    case, rows, steps = "stability-closed-forms", [], 300
    times = (np.arange(steps) + 0.5) * 2.0 * np.pi / steps
    for epsilon, weight in MATHIEU:
        for order, sign in ((0, 1.0), (1, -1.0)):
            delta = float(scipy.special.mathieu_a(order, 2.0 * epsilon)) / 4.0 + sign * weight
            tip = TipDynamics(
                np.array([[0.0, 1.0], [-delta, 0.0]]),
                np.array([[0.0], [1.0]]),
                np.array([[1.0, 0.0]]),
                1.0,
            )
            gains = (-epsilon * np.cos(times))[:, None, None]
            found = floquet_multipliers(
                tip, gains, 2.0 * np.pi, past=np.full((steps, 1, 1), -weight)
            )
            off = float(np.abs(found - sign).min())
            name = f"delayed Mathieu equation, epsilon {epsilon:g}, b {weight:g}: a multiplier off {sign:+.0f}"
            rows.append(judge_bound(case, name, off, 1e-3))
    return rows


def _milling_rows(steps: int) -> list[ValidationRow]:
    """Largest multiplier by semi-discretisation and from the growth of a marched motion, both with
    so many steps per tooth.
    """
    case, rows, allowed = "stability-published-milling", [], 5e-4 * (MARCHED_STEPS / steps) ** 2
    for rpm, depth in SLOTTING:
        period = 60.0 / (TEETH * rpm)
        fine = _slotting_gain((np.arange(steps * 8) + 0.5) * period / (steps * 8), period, depth)
        found = largest_multiplier(
            one_mode(), fine.reshape(steps, 8).mean(axis=1)[:, None, None], period
        )
        marched = _marched_multiplier(period, depth, steps)
        name = f"multiplier, slotting at {rpm:g} rpm, {1e3 * depth:g} mm"
        rows.append(judge(case, name, found, Target(marched, "-", allowed, "marched in time")))
    return rows


def _marched_multiplier(period: float, depth: float, steps: int, turns: int = 60) -> float:
    """Growth over a period of the two strongest waves in a marched motion."""
    times = np.arange(steps * turns) * period / steps
    omega = 2.0 * np.pi * HZ

    def both(value: float) -> FloatArray:
        return np.full((2, 1, 1), value)

    tool = np.zeros((2, 3, 1))
    tool[:, 0] = 1.0
    motion = LinearMotion(
        times=times,
        nodes=times[[0, -1]],
        mass=both(MASS),
        damping=both(2.0 * ZETA * omega * MASS),
        stiffness=both(MASS * omega**2),
        tool=tool,
        gravity_deflection=np.zeros((2, 1)),
        load=np.zeros((len(times), 1)),
    )
    kick = np.zeros((len(times), 1))
    kick[1:40] = 1.0
    stiffness = np.zeros((len(times), 3, 3))
    stiffness[:, 0, 0] = _slotting_gain(times, period, depth)
    moved = (
        march_linear(motion, kick, regeneration=Regeneration(stiffness, steps))
        .compliant[:, 0]
        .reshape(turns, steps)
    )
    before, now, after = moved[-3], moved[-2], moved[-1]
    first, second = np.linalg.lstsq(np.stack([now, before], axis=1), after, rcond=None)[0]
    return float(np.abs(np.roots([1.0, -first, -second])).max())


def _damping_rows(case: str) -> list[ValidationRow]:
    """The window of damping in which face 3 chatters at 10 mm and face 1 does not."""
    tripteor, rows = load_tripteor(), []
    for material in ("al7075-t6", "al7075-t6-dry"):
        request = contour_request(material)
        borders = []
        for face in (0, 2):
            low, high = 0.0005, 0.03
            for _ in range(12):
                zeta = 0.5 * (low + high)
                tip = lumped_face_dynamics(
                    tripteor.scene,
                    tripteor.model,
                    dataclasses.replace(request, damping=PoseDamping((zeta,))),
                    face,
                )
                stable = cut_multiplier(tip, request, request.cut.axial_depth) < 1.0
                low, high = (low, zeta) if stable else (zeta, high)
            borders.append(0.5 * (low + high))
            rows.append(
                show(
                    case,
                    f"{material}: damping below which face {face + 1} chatters",
                    100.0 * borders[-1],
                    "%",
                )
            )
        rows.append(
            show(
                case,
                f"{material}: faces 3 and 1 differ in this window only",
                100.0 * abs(borders[1] - borders[0]),
                "%",
                "of damping",
            )
        )
    return rows
