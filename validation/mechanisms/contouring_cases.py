"""Cutting on the lumped Tripteor: tool gap on each face of the contour of the paper (table 1,
figures 5 to 9), stability, and what marks one face and not the other.
"""

import dataclasses
import time
from collections.abc import Iterator

import numpy as np

from headstock.pipeline.motion.contour_run import ContourRun, face_instants, high_share
from headstock.pipeline.motion.contouring import cut_multiplier, face_stability
from headstock.pipeline.motion.lumped_contour import lumped_face_dynamics, run_lumped_contour
from headstock.pipeline.motion.milled_faces import mill_faces
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.scene.building.loader import load_scene
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.tool_dynamics import ToolMode
from headstock.solvers.milling.tool_path import PolylineContour, SquareContour
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.semi_discretisation import (
    milling_gains,
    single_frequency_limit,
)
from headstock.validation.mechanisms.tripteor_machine import SCENE, Tripteor, load_tripteor
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
)

GAP_MIDDLE, GAP_HALF = 12.5, 7.5  # the gap is to lie between 5 and 20 um
SOME = 0.3  # of the nonlinear solution, shown beside the linear one [s]
FINER = 4  # times as many steps: an error of second order falls to a sixteenth
FINER_UNTIL = 0.8  # the tool is well into face 1 then [s]
LEG_STEPS = 8192

# assumed, equal in both directions across the tool
SPINDLE = ToolMode("spindle", 700.0, 0.03, 30e6, np.eye(3)[:, :2])
TOOL = ToolMode("tool", 1800.0, 0.02, 15e6, np.eye(3)[:, :2])
AT_CORNERS = "both from a corner"


def contour_request(material: str, model: str = "linear") -> ContouringRequest:
    """Return the contour of the shipped scene in another material or by another model."""
    request = load_scene(SCENE, variant="lumped").analyses.get(ContouringRequest)
    if request is None:
        raise ValueError(f"{SCENE} has no contour")
    cut = dataclasses.replace(request.cut, coefficients=catalogue_coefficients(material))
    return dataclasses.replace(
        request, cut=cut, material=material, model="nonlinear" if model == "nonlinear" else "linear"
    )


def check_contouring(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check the whole contour, linear along the path, for two sets of coefficients; the orientation
    of x is assumed, so both are reported.
    """
    tripteor = load_tripteor()
    for material in ("al7075-t6", "al7075-t6-dry"):
        begun = time.process_time()
        run = run_lumped_contour(tripteor.scene, tripteor.model, contour_request(material))
        seconds = time.process_time() - begun
        yield from _face_rows(material, run)
        yield from _leg_rows(material, tripteor, run)
        yield from _profile_rows(material, run)
        yield compare_bound(
            f"{material}: content above twice the highest mode",
            high_share(run),
            0.01,
            "no filter",
        )
        yield compare_bound(
            f"{material}: linear contour, processor time [s]", seconds, 10.0, "the paper: 6 h"
        )
    yield _step_row(tripteor, "linear", FINER_UNTIL)
    sizes = 1e6 * np.abs(run.gravity_deflection[:, 0])
    for name, size in (("minimum", sizes.min()), ("maximum", sizes.max())):
        quantity = f"deflection under gravity along x, {name}"
        yield show(quantity, size, "um", "subtracted from every gap")


def check_nonlinear_contour(comm: MPI.Comm) -> list[ValidationRow]:
    """Check the start of the contour by the full equations, beside the linear model, and what the
    whole would cost.
    """
    tripteor = load_tripteor()
    linear = run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request("al7075-t6"), until=SOME
    )
    begun = time.process_time()
    full = run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request("al7075-t6", "nonlinear"), until=SOME
    )
    whole = (time.process_time() - begun) * 10.7 / SOME
    fine = _step_row(tripteor, "nonlinear", SOME)
    deflection = float(np.abs(full.gap + full.gravity_deflection).max())
    share = float(np.abs(full.gap - linear.gap).max()) / deflection
    return [
        compare_bound(
            "linear off the nonlinear motion of the tool, of its whole deflection",
            share,
            0.01,
            "deflection under gravity included",
        ),
        compare_bound(
            "nonlinear contour of 10.7 s, processor time scaled up [s]",
            whole,
            300.0,
            "the paper: 6 h",
        ),
        fine,
    ]


def check_whole_nonlinear_contour(comm: MPI.Comm) -> list[ValidationRow]:
    """Check the whole contour by the full equations: gap on each face, no filter, cost, and how far
    the linear model is off.
    """
    material, tripteor = "al7075-t6", load_tripteor()
    linear = run_lumped_contour(tripteor.scene, tripteor.model, contour_request(material))
    begun = time.process_time()
    full = run_lumped_contour(
        tripteor.scene, tripteor.model, contour_request(material, "nonlinear")
    )
    seconds = time.process_time() - begun
    deflection = float(np.abs(full.gap + full.gravity_deflection).max())
    off = float(np.abs(full.gap - linear.gap).max())
    return [
        *_face_rows(f"nonlinear, {material}", full),
        compare_bound("content above twice the highest mode", high_share(full), 0.01, "no filter"),
        compare_bound("processor time of 10.7 s of motion [s]", seconds, 300.0, "the paper: 6 h"),
        compare_bound(
            "linear off the nonlinear motion of the tool, of its whole deflection",
            off / deflection,
            0.01,
        ),
        show("linear off the nonlinear gap, at most", 1e6 * off, "um"),
    ]


def _face_rows(material: str, run: ContourRun) -> Iterator[ValidationRow]:
    means = []
    for face in (1, 3):
        gap = 1e6 * run.gap[face_instants(run, face - 1), 0]
        means.append(abs(float(gap.mean())))
        note = f"mean {means[-1]:.2f} µm, peak to peak {np.ptp(gap):.2f} µm; the paper: about 10 µm after its filter"
        off = f"{material}: |gap| along x on face {face} off {GAP_MIDDLE} µm [µm]"
        yield compare_bound(off, abs(means[-1] - GAP_MIDDLE), GAP_HALF, note)
    ratio, faces = means[1] / means[0], f"{material}: face 3 over face 1"
    yield show(f"{faces}, x as assumed", ratio, "-", "the paper: clearly larger on face 3")
    note = "the paper does not tell which way x points"
    yield show(f"{faces}, x reversed", 1.0 / ratio, "-", note)


def _profile_rows(material: str, run: ContourRun) -> Iterator[ValidationRow]:
    """Profiles of faces 1 and 3, of which figure 7 of the paper shows measured ones without numbers
    in its text.
    """
    faces, _ = mill_faces(contour_request(material), run)
    first, third = (face for face in faces if face.number in (1, 3))
    for face in (first, third):
        found, gap = face.parameters, run.gap[face_instants(run, face.number - 1)]
        outward = float((gap @ run.plan.cuts[face.number - 1].outward).mean())
        note = f"Ra {1e6 * found.ra:.3f}, Wt {1e6 * found.wt:.3f}, mark at start {1e6 * face.marks[0]:.2f} µm; the paper: marks and about 10 µm"
        yield compare_value(
            f"{material}: location error of face {face.number}, cusps left out",
            1e6 * (found.location - face.cusp / 3.0),
            Target(1e6 * outward, "um", 0.02, "mean gap"),
            note,
        )
    note = "the paper: vibration on face 3, seen and measured"
    ratio = first.parameters.wt / third.parameters.wt
    yield compare_bound(f"{material}: Wt of face 1 over face 3", ratio, 1.0, note)


def _step_row(tripteor: Tripteor, model: str, until: float) -> ValidationRow:
    """Change of the gap when the error of a step is a tenth and less."""
    request = contour_request("al7075-t6", model)
    coarse = run_lumped_contour(tripteor.scene, tripteor.model, request, until=until)
    finer = dataclasses.replace(request, steps_per_turn=FINER * request.steps_per_turn)
    fine = run_lumped_contour(tripteor.scene, tripteor.model, finer, until=until).gap[::FINER][
        : len(coarse.gap)
    ]
    change = float(np.sqrt(((fine - coarse.gap) ** 2).mean() / (coarse.gap**2).mean()))
    return compare_bound(
        f"{model}: change of the gap with {FINER} times as many steps, of its rms", change, 0.01
    )


def _leg_rows(material: str, tripteor: Tripteor, run: ContourRun) -> Iterator[ValidationRow]:
    """Return how much the force of leg 1's drive, and so its motor's torque, varies on faces 1 and
    3.
    """
    spans = []
    for face in (1, 3):
        places = np.flatnonzero(face_instants(run, face - 1))
        middle = (len(places) - LEG_STEPS) // 2
        spans.append(float(np.ptp(run.drives.forces(places[middle : middle + LEG_STEPS])[:, 0])))
    varies = f"{material}: force of leg 1 varies on face 3 by"
    yield show(varies, spans[-1], "N", "peak to peak over 0.4 s")
    note = "claim: the torque of motor 1 varies more on face 3"
    yield compare_bound(
        f"{material}: variation of leg 1 on face 1 over face 3", spans[0] / spans[1], 1.0, note
    )


def check_contour_stability(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Depth of cut at which each face of the paper's block chatters: does regeneration single out
    face 3?
    """
    tripteor = load_tripteor()
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
            yield show(f"{material}: limit depth on face {face + 1}", limits[-1], "mm", note)
        tip = lumped_face_dynamics(tripteor.scene, tripteor.model, request, 2)
        second = (
            1e3
            * request.cut.axial_depth
            * single_frequency_limit(tip, milling_gains(request.cut, 96), request.cut.tooth_period)
        )
        target = Target(second, "mm", 0.02, "single frequency")
        yield compare_value(
            f"{material}: limit depth on face 3, against a single frequency", limits[2], target
        )
        yield show(
            f"{material}: limit depth of face 3 over face 1",
            limits[2] / limits[0],
            "-",
            "no more than this",
        )
    yield from _damping_rows()


def _damping_rows() -> Iterator[ValidationRow]:
    """Find the window of damping in which face 3 chatters at 10 mm and face 1 does not."""
    tripteor = load_tripteor()
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
            below = f"{material}: damping below which face {face + 1} chatters"
            yield show(below, 100.0 * borders[-1], "%")
        window = 100.0 * abs(borders[1] - borders[0])
        yield show(
            f"{material}: faces 3 and 1 differ in this window only", window, "%", "of damping"
        )


def _vary_contour() -> Iterator[tuple[str, ContouringRequest]]:
    """Return the paper's block, and what is changed of it: a name and a contour each."""
    straight = contour_request("al7075-t6")
    yield "straight into face 1", straight
    corners = dataclasses.replace(straight, contour=_enter_from_corners(straight))
    yield AT_CORNERS, corners
    dry = contour_request("al7075-t6-dry")
    yield "with axial force", dataclasses.replace(dry, contour=corners.contour)
    yield "1 % damping", dataclasses.replace(corners, damping=PoseDamping((0.01,)))
    mill = dataclasses.replace(corners.cut.mill, runout=5e-6)
    yield (
        "runout of 5 um",
        dataclasses.replace(corners, cut=dataclasses.replace(corners.cut, mill=mill)),
    )
    waves = dataclasses.replace(corners, regeneration=True)
    yield "regeneration", waves
    modes = (SPINDLE, TOOL)
    yield "spindle and tool", dataclasses.replace(corners, tool_modes=modes)
    yield "spindle, tool and regeneration", dataclasses.replace(waves, tool_modes=modes)


def _enter_from_corners(request: ContouringRequest) -> PolylineContour:
    """Return a line around the block that begins on its last face, so that each of the others is
    entered from a corner.

    Raises:
        ValueError: The contour is no block.
    """
    block = request.contour
    if not isinstance(block, SquareContour):
        raise ValueError("corners are those of a block")
    reach, (x, y) = 0.5 * block.side + block.offset, block.center
    corners = [
        (x + reach * side, y + reach * end) for side, end in ((1, -1), (-1, -1), (-1, 1), (1, 1))
    ]
    # the tool leaves the last face beyond its end
    corners.append((x + reach, y - reach - block.offset))
    return PolylineContour(
        points=tuple(corners),
        feeds=(block.feed,) * 4,
        radius=block.offset,
        height=block.height,
        offset=block.offset,
        lead=block.lead,
        window=block.window,
    )


def check_marks(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Waviness of each face, beside it roughness, marks where the tool comes out of a corner, and
    location error; and limits of stability of the faces at the lowest and the highest x.
    """
    tripteor = load_tripteor()
    for name, request in _vary_contour():
        run = run_lumped_contour(tripteor.scene, tripteor.model, request)
        faces, _ = mill_faces(request, run)
        for face in faces:
            outward = run.plan.cuts[face.number - 1].outward
            side = f"{'lowest' if outward.sum() < 0.0 else 'highest'} {'xy'[int(np.abs(outward).argmax())]}"
            found = face.parameters
            note = f"Ra {1e6 * found.ra:.3f}, at its start {1e6 * face.marks[0]:.2f}, location {1e6 * found.location:.1f} um"
            yield show(f"{name}: Wt at the {side}", 1e6 * found.wt, "um", note)
            if request.regeneration and side.endswith("x"):
                tip = lumped_face_dynamics(tripteor.scene, tripteor.model, request, face.number - 1)
                limit = face_stability(tip, request, face.number - 1).limit_depth
                text = f"{name}: limit depth at the {side}"
                yield show(text, 1e3 * limit, "mm", "the cut is 10 mm deep")
