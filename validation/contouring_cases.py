"""The contour of the paper (its table 1 and figures 5 to 9) on the lumped Tripteor: tool gap on each face, cost, and no filter."""

import time
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.solvers.contouring import LinearMotion, interpolate_nodes, linear_motion, march_linear, refine_motion, tool_gaps
from headstock.solvers.cutting_materials import CUTTING_MATERIALS
from headstock.solvers.milling_forces import EndMill, MillingCut, cutting_forces
from headstock.solvers.path_drives import PathDrive, follow_path
from headstock.solvers.tool_paths import SquareContour, square_path
from headstock.validation.case_rows import ValidationRow, judge_bound, show
from headstock.validation.tripteor_machine import Tripteor, load_tripteor

# printed: tool 20 mm, 4 teeth, 13000 rpm, 5 m/min, 10 and 5 mm deep; assumed: block, corners, averages, helix, damping
CONTOUR = SquareContour(side=0.2, center=(0.0, 0.0), height=0.2, offset=0.01, lead=0.02, feed=5.0 / 60.0, window=0.01)
TURN = 60.0 / 13000.0
STEPS_PER_TURN = 96
DAMPING = np.array([0.02])
NODE_SPACING = 4e-3
ENTRY, SETTLING = 0.01, 0.3
HIGHEST_HZ = 640.0
WINDOW = 0.12  # of the nonlinear solution, shown beside the linear one
GAP_RANGE = (5.0, 20.0)


@dataclass(frozen=True, eq=False)
class ContourRun:
    """A contour: ``(n,)`` times, ``(n, 3)`` gap of the tool less gravity sag and sag itself [m], machine frame; seconds it took."""

    times: FloatArray
    gap: FloatArray
    sag: FloatArray
    force: FloatArray
    marks: FloatArray
    motion: LinearMotion
    drive: PathDrive
    seconds: float


def check_contouring(comm: MPI.Comm) -> list[ValidationRow]:
    """The whole contour, linear along the path, for two sets of coefficients; the orientation of x is assumed, so both are told."""
    case, tripteor = "tripteor-contouring", load_tripteor()
    rows: list[ValidationRow] = []
    for material in ("al7075-t6", "al7075-t6-dry"):
        run = run_contour(tripteor, material)
        near, far = (_face(run, face) for face in (0, 2))
        means, ripples = (np.abs(near[0]), np.abs(far[0])), (near[1], far[1])
        for face, mean, ripple in zip((1, 3), means, ripples, strict=True):
            middle = 0.5 * sum(GAP_RANGE)
            rows.append(
                judge_bound(
                    case,
                    f"{material}: |gap| along x on face {face} off {middle:g} µm [µm]",
                    abs(1e6 * mean - middle),
                    0.5 * (GAP_RANGE[1] - GAP_RANGE[0]),
                    f"mean {1e6 * mean:.2f} µm, peak to peak {1e6 * ripple:.2f} µm; the paper: about 10 µm after its filter",
                )
            )
        ratio = float(means[1] / means[0])
        note = "face 3 at the highest x; the paper: clearly larger on face 3"
        rows.append(show(case, f"{material}: face 3 over face 1, x as assumed", ratio, "-", note))
        rows.append(
            show(
                case, f"{material}: face 3 over face 1, x reversed", 1.0 / ratio, "-", "the paper does not tell which way x points"
            )
        )
        rows.append(
            judge_bound(case, f"{material}: content above twice the highest mode", _high_share(run, slice(None)), 0.01, "no filter")
        )
        rows.append(judge_bound(case, f"{material}: linear contour, processor time [s]", run.seconds, 10.0, "the paper: 6 h"))
    rows.append(
        show(case, "gravity sag along x, least", 1e6 * float(np.abs(run.sag[:, 0]).min()), "um", "subtracted from every gap")
    )
    rows.append(
        show(case, "gravity sag along x, most", 1e6 * float(np.abs(run.sag[:, 0]).max()), "um", "subtracted from every gap")
    )
    return rows


def check_nonlinear_contour(comm: MPI.Comm) -> list[ValidationRow]:
    """The start of the contour by the full equations, beside the linear model, and what the whole would cost."""
    case, tripteor = "tripteor-contouring-nonlinear", load_tripteor()
    run = run_contour(tripteor, "al7075-t6", span=(0.0, 0.2 + WINDOW))
    start = time.process_time()
    first = march_linear(run.motion, run.motion.load + run.motion.tool_load(run.force))
    found = refine_motion(tripteor.model, run.drive, run.motion, run.force, first)
    turn = tripteor.scene.mounted.mounting.rotation
    exact = tool_gaps(tripteor.model, run.drive, run.times, found.give) @ turn.T
    whole = (time.process_time() - start) * 10.7 / run.times[-1]
    linear = run.gap + run.sag
    share = float(np.abs(exact - linear).max() / np.abs(exact).max())
    return [
        judge_bound(
            case, "linear off the nonlinear motion of the tool, of its whole deflection", share, 0.01, "gravity sag included"
        ),
        judge_bound(case, "nonlinear contour of 10.7 s, processor time scaled up [s]", whole, 300.0, "the paper: 6 h"),
    ]


def run_contour(tripteor: Tripteor, material: str, *, span: tuple[float, float] | None = None) -> ContourRun:
    """The contour with a work material, whole or a part of its time."""
    begun = time.process_time()
    path, marks = square_path(CONTOUR)
    start, end = span or path.span
    times: FloatArray = np.asarray(np.arange(start, end, TURN / STEPS_PER_TURN), dtype=float)
    nodes: FloatArray = np.asarray(np.linspace(start, end, max(8, round((end - start) / NODE_SPACING))), dtype=float)
    drive = follow_path(tripteor.scene.mounted, nodes, path.at(nodes), tripteor.scene.tool)
    points = path.at(times)
    force = _tool_force(points.velocity, times, material, marks) @ tripteor.scene.mounted.mounting.rotation
    motion = linear_motion(tripteor.model, drive, times, DAMPING)
    found = march_linear(motion, motion.load + motion.tool_load(force))
    turn = tripteor.scene.mounted.mounting.rotation.T
    sag = motion.tool_motion(interpolate_nodes(times, motion.nodes, motion.sag)) @ turn
    gap = motion.tool_motion(found.give) @ turn - sag
    return ContourRun(times, gap, sag, force, marks, motion, drive, time.process_time() - begun)


def _tool_force(velocity: FloatArray, times: FloatArray, material: str, marks: FloatArray) -> FloatArray:
    """``(n, 3)`` force on the tool in the machine frame; the tool enters and leaves over its radius."""
    feed = np.hypot(velocity[:, 0], velocity[:, 1])
    cut = MillingCut(
        EndMill(0.02, 4, np.radians(30.0)), CUTTING_MATERIALS[material], 2.0 * np.pi / TURN, axial_depth=0.01, radial_depth=0.005
    )
    entered = np.clip((times - marks[0]) * CONTOUR.feed / ENTRY, 0.0, 1.0)
    left = np.clip((marks[4] - times) * CONTOUR.feed / ENTRY, 0.0, 1.0)
    own = cutting_forces(cut, times, feed) * (entered * left)[:, None]
    along = velocity / np.maximum(feed, 1e-9)[:, None]
    away = np.stack([-along[:, 1], along[:, 0], np.zeros_like(feed)], axis=-1)
    return np.asarray(own[:, :1] * along + own[:, 1:2] * away + own[:, 2:] * np.array([0.0, 0.0, 1.0]))


def _face(run: ContourRun, face: int) -> tuple[float, float]:
    """Mean and peak-to-peak of the gap along x on a face, its ends left out [m]."""
    on = (run.times > run.marks[face] + SETTLING) & (run.times < run.marks[face + 1] - SETTLING)
    return float(run.gap[on, 0].mean()), float(np.ptp(run.gap[on, 0]))


def _high_share(run: ContourRun, on: slice) -> float:
    """Share of the tool gap's root mean square above twice the highest mode, along the axis where it is largest; of some instants."""
    step = TURN / STEPS_PER_TURN
    flat = run.gap[on] - run.gap[on].mean(axis=0)
    power = np.abs(np.fft.rfft(flat, axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), step) > 2.0 * HIGHEST_HZ
    return float(np.sqrt(power[high].sum(axis=0) / power.sum(axis=0)).max())
