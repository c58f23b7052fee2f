"""Linear response in time: a rod under a suddenly applied force, whose tip goes to and fro in straight lines."""

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.state_space import to_state_space
from headstock.solvers.linear.time_response import solve_time_response
from headstock.validation.parts.closed_form_cases import ROD
from headstock.validation.parts.line_elements import TIP, rod_system, spectral_rod
from headstock.validation.references.rods import axial_extension, axial_frequencies
from headstock.validation.references.rows import Target, ValidationRow, judge, show

ELEMENTS, STEPS_PER_PERIOD, PERIODS = 100, 1000, 3
# A triangle's corner is made of all its waves: N right modes with the static compliance of the others lack 2 / (pi^2 N) of the static
# displacement there, and what a mesh carries beyond its reach comes late. Of n quadratic elements a tenth of the modes are right: the
# largest value is 1.983, 1.9935, 1.9953 with 20, 60 and 100. Its flanks are right to 1e-6, and so is the corner in which they meet.
ROUNDED_TOLERANCE, PEAK_TOLERANCE, PERIOD_TOLERANCE = 5e-3, 1e-4, 1e-4
FLANKS = ((0.05, 0.45), (0.55, 0.95))
FINE_ELEMENTS, FINE_ORDER, FINE_MODES = 100, 20, 1200


def check_rod_step(comm: MPI.Comm) -> list[ValidationRow]:
    """DER-ROD-NU0: peak over static displacement and period of the tip's triangle wave, by exact discretisation."""
    period = 1.0 / float(axial_frequencies(ROD, "clamped-free", 1)[0])
    space = to_state_space(rod_system(ROD, ELEMENTS), inputs=[TIP], outputs=[TIP])
    found = solve_time_response(space, np.ones((PERIODS * STEPS_PER_PERIOD + 1, 1)), period / STEPS_PER_PERIOD)
    moved: FloatArray = np.asarray(found.outputs[:, 0] / axial_extension(ROD, 1.0), dtype=float)
    crossings = _rising_crossings(found.times, moved)
    note = f"largest value, {ELEMENTS} quadratic elements: the mesh rounds the corner"
    corner = _meet_flanks(np.asarray(found.times / period, dtype=float), moved)
    return [
        judge(
            "rod-step", "tip peak over static", corner, Target(2.0, "-", PEAK_TOLERANCE, "closed form"), "where both flanks meet"
        ),
        judge("rod-step", "rounded peak", moved.max(), Target(2.0, "-", ROUNDED_TOLERANCE, "closed form"), note),
        judge("rod-step", "period", crossings[1] - crossings[0], Target(period, "s", PERIOD_TOLERANCE, "closed form")),
        judge("rod-step", "tabled period", period, Target(0.00077336617, "s", 1e-8, "closed form")),
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
    note = f"{FINE_MODES} modes of {FINE_ELEMENTS} elements of order {FINE_ORDER}"
    return [
        judge("rod-peak", "tip peak over static", peak, Target(2.0, "-", PEAK_TOLERANCE, "closed form"), note),
        show(
            "rod-peak",
            "what the peak lacks",
            2.0 - peak,
            "-",
            f"2 / (pi^2 N) = {2.0 / (np.pi**2 * FINE_MODES):.3e} for right modes",
        ),
    ]


def _meet_flanks(times: FloatArray, values: FloatArray) -> float:
    """Value at which the rising and the falling flank of the first triangle meet, times in periods."""
    inside = [(times > low) & (times < high) for low, high in FLANKS]
    (rise, start), (fall, top) = (np.polyfit(times[part], values[part], 1) for part in inside)
    return float(start + rise * (top - start) / (rise - fall))


def _rising_crossings(times: FloatArray, values: FloatArray) -> FloatArray:
    """Times at which values rise through one, by linear interpolation."""
    before = np.flatnonzero((values[:-1] < 1.0) & (values[1:] >= 1.0))
    share = (1.0 - values[before]) / (values[before + 1] - values[before])
    return np.asarray(times[before] + share * (times[before + 1] - times[before]))
