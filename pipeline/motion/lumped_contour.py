"""A contour on a lumped mechanism: bodies on the springs of its legs, linear along the path or by
the full equations; and the mechanism at the tip of its tool.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.mechanisms.exechon import LENGTHS, solve_tool_pose
from headstock.pipeline.motion.contour_cut import (
    CutMotion,
    cut_contour,
    travel_frames,
    turned_modes,
)
from headstock.pipeline.motion.contour_run import (
    ContourDrives,
    ContourRun,
    plan_request,
    request_times,
)
from headstock.pipeline.motion.motors import (
    FrictionSpeeds,
    close_drives,
    controlled_drives,
    drive_assumptions,
)
from headstock.pipeline.stages.lumped_machine import sample_leg_errors
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.reading.csv_files import ForceRecord
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import (
    linearise_poses,
    marker_motion,
    solve_lumped_modes,
)
from headstock.solvers.milling.contouring import (
    FreeLegs,
    drive_forces,
    linear_motion,
    refine_motion,
    thin_history,
    tool_gaps,
)
from headstock.solvers.milling.path_drives import PathDrive, find_tool_positions, follow_path
from headstock.solvers.milling.tip_poles import TipDynamics, tip_dynamics
from headstock.solvers.milling.tool_dynamics import mount_modes
from headstock.solvers.milling.tool_path import plan_contour
from headstock.solvers.motion.alpha import CompliantHistory, LinearMotion, ServoMotion

NODE_SPACING = 4e-3
LEGS = ("leg 1", "leg 2", "leg 3")
TORQUE = "motor torques are the drives' forces times lead over 2 pi: no friction, no inertia of motor and screw"


def run_lumped_contour(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    request: ContouringRequest,
    *,
    record: ForceRecord | None = None,
    until: float = math.inf,
    drives: Sequence[Drive] = (),
) -> ContourRun:
    """Run a contour.

    Args:
        request: Path, tool and cut.
        record: Measured forces in place of computed ones; its time starts with the path.
        until: Stop at this time [s].
        drives: Legs under control; the motors of the others follow their set points.

    Raises:
        PoseError: The path cannot be followed.
        CsvError: The record does not cover it.
    """
    plan, fit = plan_request(
        request,
        LENGTHS,
        lambda lengths, near: find_tool_positions(mechanism.mounted, lengths, near, mechanism.tool),
    )
    times, end = request_times(request, plan, until), min(plan.path.span[1], until)
    nodes: FloatArray = np.asarray(
        np.linspace(0.0, end, max(8, round(end / NODE_SPACING))), dtype=float
    )
    drive = follow_path(mechanism.mounted, nodes, plan.path.at(nodes), mechanism.tool)
    turn = mechanism.mounted.mounting.rotation
    names = tuple(leg.axis for leg in drives)
    free, pushed = _free_motion(mechanism, model, request, drive, times, names)
    friction: FrictionSpeeds = "true" if request.model == "nonlinear" else "set"
    servo = _close_legs(model, drive, free, drives, friction) if drives else None
    motion = free if servo is None else servo.motion
    legs = FreeLegs(names, free) if drives else None

    def find_rest(history: CompliantHistory) -> FloatArray:
        """Return the motion ``(n, 3)`` of the tool that the linear model lacks [m]."""
        gaps = tool_gaps(model, drive, times, history, legs=legs)
        return gaps - motion.tool_motion(history.compliant)

    def cut_under(extra: FloatArray, before: CutMotion | None) -> CutMotion:
        """Cut under a load in addition to that of the linear model; chips are those of the motion
        before it where that differs from the linear one.
        """
        rest = None
        if before is not None and request.regeneration:
            rest = find_rest(before.history)
        loaded = dataclasses.replace(motion, load=motion.load + extra, rest=rest)
        return cut_contour(request, loaded, plan, rotation=turn, record=record)

    if request.model == "nonlinear":
        cut = refine_motion(model, drive, motion, cut_under, legs=legs, pushed=pushed)
        moved = cut.tip + find_rest(cut.history)
    else:
        cut = cut_contour(request, motion, plan, rotation=turn, record=record)
        moved = cut.tip
    gravity_deflection = motion.tool_motion(motion.deflect()) @ turn.T
    modes = solve_lumped_modes(linearise_poses(model, drive.states[:: max(1, len(nodes) // 20)]))
    return ContourRun(
        times=times,
        gap=moved @ turn.T - gravity_deflection,
        gravity_deflection=gravity_deflection,
        force=cut.force @ turn.T,
        plan=plan,
        fit=fit,
        motion=motion,
        history=cut.history,
        drives=_leg_drives(mechanism, model, drive, times, cut)
        if servo is None
        else controlled_drives(servo, drives, cut.history),
        highest_hz=float(modes.frequencies_hz.max()),
        coriolis=model.velocity_terms,
        assumed=drive_assumptions(drives, friction)
        if drives
        else ((TORQUE,) if mechanism.screw_lead else ()),
    )


def _free_motion(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    request: ContouringRequest,
    drive: PathDrive,
    times: FloatArray,
    names: Sequence[str],
) -> tuple[LinearMotion, FloatArray | None]:
    """Return the linear model with the motors of some legs free, and the loads ``(n, c)`` in it of
    springs that are unstressed where legs are longer than commanded [N]; None where none is.
    """
    free = linear_motion(model, drive, times, request.damping, names)
    if not mechanism.leg_errors:
        return free, None
    columns = [model.mechanism.driven.index(LENGTHS[leg]) for leg in mechanism.leg_errors]
    springs = [2 * leg + 1 for leg in mechanism.leg_errors]
    position = drive.at(times).position
    pushed = np.zeros((len(times), len(model.mechanism.compliant)))
    pushed[:, springs] = model.springs.stiffness(position)[:, springs] * sample_leg_errors(
        mechanism.leg_errors, position[:, columns]
    )
    extra = ((0, 0), (0, free.load.shape[1] - pushed.shape[1]))
    return dataclasses.replace(free, load=free.load + np.pad(pushed, extra)), pushed


def _close_legs(
    model: CompliantMechanism,
    drive: PathDrive,
    free: LinearMotion,
    drives: Sequence[Drive],
    friction: FrictionSpeeds,
) -> ServoMotion:
    """Close the loops of the legs of a linear model with free motors."""
    legs = [leg.axis for leg in drives]
    columns = [model.mechanism.driven.index(name) for name in legs]
    now = drive.at(free.times)
    size = free.mass.shape[-1]
    scales = np.zeros((len(legs), size))
    for row, name in enumerate(legs):
        # a scale reads the leg up to its joint at the platform, its axial spring included
        scales[row, [2 * LENGTHS.index(name) + 1, size - len(legs) + row]] = 1.0
    weights = linearise_poses(model, drive.rigid_states(free.nodes), legs).gravity
    return close_drives(
        free,
        drives,
        positions=now.position[:, columns],
        speeds=now.speed[:, columns],
        accelerations=now.acceleration[:, columns],
        gravity=weights,
        scales=np.broadcast_to(scales, (len(free.nodes), *scales.shape)),
        friction=friction,
    )


def _leg_drives(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    drive: PathDrive,
    times: FloatArray,
    cut: CutMotion,
) -> ContourDrives:
    """Return the forces of the legs' drives (eq. 14 of Bonnemains et al. 2010, with the work of
    springs that soften as a leg grows).
    """
    lead = mechanism.screw_lead

    def forces(some: NDArray[np.intp]) -> FloatArray:
        thin = thin_history(cut.history, some)
        return drive_forces(model, drive, times[some], thin, cut.carried[some])[:, : len(LENGTHS)]

    return ContourDrives(
        LEGS,
        forces,
        None if lead is None else lambda some, pushed: pushed * (lead / (2.0 * math.pi)),
    )


def lumped_face_dynamics(
    mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, face: int
) -> TipDynamics:
    """Return the dynamics of the mechanism with its tool in the middle of a face: forces along,
    away and up, chips by motions along and away.

    Args:
        request: Contour and damping ratios.
        face: Number of the straight cut, counted from zero.

    Raises:
        PoseError: The tool cannot reach that position.
    """
    cut = plan_contour(request.contour).cuts[face]
    point = cut.start + 0.5 * cut.length * cut.travel + request.contour.offset * cut.outward
    state = solve_tool_pose(mechanism.mounted, point, mechanism.tool)
    motions = linearise_poses(model, state)
    turn = mechanism.mounted.mounting.rotation
    frame: FloatArray = travel_frames(cut.travel[None], cut.part)[0] @ turn
    mounted = mount_modes(
        motions.mass,
        request.damping.matrix(motions),
        np.diag(motions.stiffness),
        marker_motion(model, motions, model.tool)[:3],
        turned_modes(request.tool_modes, turn),
    )
    tip = frame @ mounted.tip
    return tip_dynamics(mounted.mass, mounted.damping, mounted.stiffness, forced=tip, seen=tip[:2])
