"""Frequency responses of a beam and of a reduced column against whole models, and the response in
time of a suddenly loaded rod.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
import scipy.sparse.linalg

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import Material, ReductionSettings
from headstock.pipeline.planning.analyses import FRF_MARGIN
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.requests import ReductionRequest, mode_target
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_coordinates import keep_modes, to_modal_coordinates
from headstock.solvers.linear.state_space import to_state_space
from headstock.solvers.linear.time_response import solve_time_response
from headstock.solvers.mpi import MPI
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem
from headstock.validation.parts.closed_form_cases import (
    COLUMN_SIZE,
    ROD,
    STEEL,
    column,
    face_interface,
    mesh_settings,
)
from headstock.validation.parts.component_models import (
    ConstrainedMatrices,
    rigid_face_matrices,
    shared_mesh,
)
from headstock.validation.parts.line_elements import (
    TIP,
    cantilever_system,
    rod_system,
    spectral_rod,
)
from headstock.validation.references.prismatic_beams import PrismaticBeam
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    compare_values,
    show,
)
from headstock.validation.references.torsion import axial_extension, axial_frequencies
from headstock.validation.references.values import reference_case

UNIT_BEAM = PrismaticBeam(1.0, 1.0, 12.0 ** (1.0 / 3.0), Material("unit", 1.0, 0.3, 1.0))
ELEMENTS = 60
COLUMN_MESH = 0.05
TO_HZ = 800.0
# between, beside and on resonances (128, 326 and 779 Hz), up to 1.5 times the highest frequency
# asked for
FREQUENCIES = np.array([0.0, 10.0, 100.0, 128.0, 250.0, 326.0, 600.0, 779.0, 800.0, 1000.0, 1200.0])
LOSS_FACTOR = 0.04
RESPONSE_TOLERANCE = 1e-2
CHANNELS = tuple(("tip", dof) for dof in DIRECTIONS)
ROD_ELEMENTS, STEPS_PER_PERIOD, PERIODS = 100, 1000, 3
# A triangle's corner is made of all its waves: N right modes with the static compliance of the
# others lack 2 / (pi^2 N) of the static displacement there, and what a mesh carries beyond its
# reach comes late. Of n quadratic elements a tenth of the modes are right: the largest value is
# 1.983, 1.9935, 1.9953 with 20, 60 and 100. Its flanks are right to 1e-6, and so is the corner in
# which they meet.
ROUNDED_TOLERANCE, PEAK_TOLERANCE, PERIOD_TOLERANCE = 5e-3, 1e-4, 1e-4
FLANKS = ((0.05, 0.45), (0.55, 0.95))
FINE_ELEMENTS, FINE_ORDER, FINE_MODES = 100, 20, 1200


def check_beam_truncation(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """DER-MODETRUNC: share of a cantilever's tip compliance in its first modes, and with static
    correction.
    """
    coordinates = to_modal_coordinates(cantilever_system(UNIT_BEAM, ELEMENTS), [TIP], [TIP])
    if coordinates is None:
        raise ValueError("the beam has no modal coordinates")
    whole = float(coordinates.elastic[0, 0])
    parts = [
        1.0 - float(keep_modes(coordinates, count).residual[0, 0]) / whole for count in range(1, 6)
    ]
    yield from compare_values(reference_case("mode-truncation"), parts)
    yield compare_value(
        "with static correction", whole, Target(1.0 / 3.0, "-", 1e-8, "closed form")
    )


def check_column_response(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Nine responses at the tip, modes kept as the planner keeps them, against direct solves of the
    whole model.
    """
    system, whole = column_models(comm)
    found = solve_frf(system, FREQUENCIES, inputs=CHANNELS, outputs=CHANNELS).receptance
    for hz, value in zip(FREQUENCIES, found, strict=True):
        right = direct_response(whole, hz)
        error = float(np.abs(value - right).max() / np.abs(right).max())
        note = "largest difference of nine entries over the largest entry"
        yield compare_bound(f"{hz:g} Hz", error, 1e-8 if hz == 0.0 else RESPONSE_TOLERANCE, note)


def column_models(
    comm: MPI.Comm, size: float = COLUMN_MESH
) -> tuple[SecondOrderSystem, ConstrainedMatrices]:
    """Return the column of Kono et al. clamped at its foot with one loss factor, reduced for
    responses up to ``TO_HZ``, and whole.
    """
    interfaces = {
        name: face_interface(name, face, "rigid") for name, face in (("foot", "z-"), ("tip", "z+"))
    }
    part = column(mesh_settings("hex27", size), interfaces)
    part = dataclasses.replace(part, reduction=ReductionSettings(modes_to_hz=FRF_MARGIN * TO_HZ))
    mesh = shared_mesh(part, comm=comm)
    element = reduce_elastic(
        part, mesh, comm=comm, request=ReductionRequest(modes=mode_target(part), recovery=False)
    )
    clamp = Joint(
        "clamp", (JointEnd(), JointEnd("column", "foot")), "rigid", fixed=(0, 1, 2, 3, 4, 5)
    )
    points = {"tip": Point("tip", JointEnd("column", "tip"), JointEnd())}
    machine = Machine("column", {"column": part}, {"clamp": clamp}, points)
    bare = couple({"column": element}, machine, Pose("reference")).system
    centers: dict[str, FloatArray] = {
        "foot": np.zeros(3),
        "tip": np.array([0.0, 0.0, COLUMN_SIZE[2]]),
    }
    whole = rigid_face_matrices(mesh, STEEL, centers)
    return dataclasses.replace(bare, hysteretic=LOSS_FACTOR * bare.stiffness), whole


def direct_response(whole: ConstrainedMatrices, hz: float) -> ComplexArray:
    """Receptance ``(3, 3)`` at the tip by one sparse factorisation; at 0 Hz nothing is lost."""
    lossy = (1.0 + 1j * (LOSS_FACTOR if hz > 0.0 else 0.0)) * whole.stiffness[6:, 6:]
    dynamic = (lossy - (2.0 * np.pi * hz) ** 2 * whole.mass[6:, 6:]).tocsc()
    loads = np.zeros((dynamic.shape[0], 3), dtype=complex)
    loads[:3] = np.eye(3)
    return np.asarray(scipy.sparse.linalg.splu(dynamic).solve(loads)[:3])


def check_rod_step(comm: MPI.Comm) -> list[ValidationRow]:
    """DER-ROD-NU0: peak over static displacement and period of the tip's triangle wave, by exact
    discretisation.
    """
    period = 1.0 / float(axial_frequencies(ROD, "clamped-free", 1)[0])
    space = to_state_space(rod_system(ROD, ROD_ELEMENTS), inputs=[TIP], outputs=[TIP])
    found = solve_time_response(
        space, np.ones((PERIODS * STEPS_PER_PERIOD + 1, 1)), period / STEPS_PER_PERIOD
    )
    moved: FloatArray = np.asarray(found.outputs[:, 0] / axial_extension(ROD, 1.0), dtype=float)
    crossings = _rising_crossings(found.times, moved)
    note = f"largest value, {ROD_ELEMENTS} quadratic elements: the mesh rounds the corner"
    corner = _meet_flanks(np.asarray(found.times / period, dtype=float), moved)
    return [
        compare_value(
            "tip peak over static",
            corner,
            Target(2.0, "-", PEAK_TOLERANCE, "closed form"),
            "where both flanks meet",
        ),
        compare_value(
            "rounded peak", moved.max(), Target(2.0, "-", ROUNDED_TOLERANCE, "closed form"), note
        ),
        compare_value(
            "period",
            crossings[1] - crossings[0],
            Target(period, "s", PERIOD_TOLERANCE, "closed form"),
        ),
        compare_value("tabled period", period, Target(0.00077336617, "s", 1e-8, "closed form")),
    ]


def check_rod_peak(comm: MPI.Comm) -> list[ValidationRow]:
    """DER-ROD-NU0: the largest value itself, with so many modes that the corner is sharp."""
    exact = axial_frequencies(ROD, "clamped-free", FINE_MODES + 1)
    limit = float(0.5 * (exact[-2] + exact[-1]))
    system = spectral_rod(ROD, FINE_ELEMENTS, FINE_ORDER)
    space = to_state_space(system, inputs=[TIP], outputs=[TIP], up_to_hz=limit)
    step = 1.0 / float(exact[0]) / STEPS_PER_PERIOD
    found = solve_time_response(space, np.ones((STEPS_PER_PERIOD + 1, 1)), step)
    peak = float(found.outputs.max()) / axial_extension(ROD, 1.0)
    lacking = 2.0 / (np.pi**2 * FINE_MODES)
    note = f"{FINE_MODES} modes of {FINE_ELEMENTS} elements of order {FINE_ORDER}"
    return [
        compare_value(
            "tip peak over static", peak, Target(2.0, "-", PEAK_TOLERANCE, "closed form"), note
        ),
        show(
            "what the peak lacks", 2.0 - peak, "-", f"2 / (pi^2 N) = {lacking:.3e} for right modes"
        ),
    ]


def _meet_flanks(times: FloatArray, values: FloatArray) -> float:
    """Value at which the rising and the falling flank of the first triangle meet, times in
    periods.
    """
    inside = [(times > low) & (times < high) for low, high in FLANKS]
    (rise, start), (fall, top) = (np.polyfit(times[part], values[part], 1) for part in inside)
    return float(start + rise * (top - start) / (rise - fall))


def _rising_crossings(times: FloatArray, values: FloatArray) -> FloatArray:
    """Times at which values rise through one, by linear interpolation."""
    before = np.flatnonzero((values[:-1] < 1.0) & (values[1:] >= 1.0))
    share = (1.0 - values[before]) / (values[before + 1] - values[before])
    return np.asarray(times[before] + share * (times[before + 1] - times[before]))
