"""Linear response in time: a rod under a suddenly applied force, whose tip goes to and fro in straight lines."""

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear_time_response import solve_time_response
from headstock.solvers.state_space import to_state_space
from headstock.validation.case_rows import Target, ValidationRow, judge
from headstock.validation.closed_form_cases import ROD
from headstock.validation.line_elements import TIP, rod_system
from headstock.validation.rods import axial_extension, axial_frequencies

ELEMENTS, STEPS_PER_PERIOD, PERIODS = 100, 1000, 3
# the corner of the triangle is rounded by the dispersion of the mesh's shortest waves: peak 1.983, 1.9935, 1.9968 with 20, 60 and
# 150 quadratic elements
PEAK_TOLERANCE, PERIOD_TOLERANCE = 5e-3, 1e-4


def check_rod_step(comm: MPI.Comm) -> list[ValidationRow]:
    """DER-ROD-NU0: peak over static displacement and period of the tip's triangle wave, by exact discretisation."""
    period = 1.0 / float(axial_frequencies(ROD, "clamped-free", 1)[0])
    space = to_state_space(rod_system(ROD, ELEMENTS), inputs=[TIP], outputs=[TIP])
    step = period / STEPS_PER_PERIOD
    found = solve_time_response(space, np.ones((PERIODS * STEPS_PER_PERIOD + 1, 1)), step)
    moved: FloatArray = np.asarray(found.outputs[:, 0] / axial_extension(ROD, 1.0), dtype=float)
    crossings = _rising_crossings(found.times, moved)
    note = f"{ELEMENTS} quadratic elements; the mesh rounds the corner"
    return [
        judge("rod-step", "tip peak over static", moved.max(), Target(2.0, "-", PEAK_TOLERANCE, "closed form"), note),
        judge("rod-step", "period", crossings[1] - crossings[0], Target(period, "s", PERIOD_TOLERANCE, "closed form")),
        judge("rod-step", "tabled period", period, Target(0.00077336617, "s", 1e-8, "closed form")),
    ]


def _rising_crossings(times: FloatArray, values: FloatArray) -> FloatArray:
    """Times at which values rise through one, by linear interpolation."""
    before = np.flatnonzero((values[:-1] < 1.0) & (values[1:] >= 1.0))
    share = (1.0 - values[before]) / (values[before + 1] - values[before])
    return np.asarray(times[before] + share * (times[before + 1] - times[before]))
