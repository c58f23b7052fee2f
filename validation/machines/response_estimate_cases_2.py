"""Error estimates of frequency responses against direct solves of unreduced machines."""

import dataclasses

import numpy as np
import scipy.sparse.linalg
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.estimates.frequency_errors import truncated_parts
from headstock.reduction.estimates.response_errors import ErrorSources, project_response
from headstock.reduction.estimates.response_errors_2 import bound_response_errors
from headstock.solvers.linear.frequency_response import evaluate_frf, prepare_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import ComplexArray, Port
from headstock.solvers.system_ports import input_columns, output_rows
from headstock.validation.machines.estimate_cases import (
    Specimen,
    clamped_beam,
    free_pair,
    guideway,
    keep_fewer,
    patched_column,
    ribbed_plate,
    unreduced,
)
from headstock.validation.machines.estimate_cases_2 import (
    RESOLVED,
    ErrorPairs,
    join_pairs,
    judge_pairs,
    reduce_specimen,
    reference_frequencies,
)
from headstock.validation.machines.monolithic_machines import MonolithicMachine
from headstock.validation.references.rows import ValidationRow, show

CASE = "response-estimates"
MODE_COUNTS = (3, 6, 12, 24, 48)
LOSS_FACTOR = 0.04
WATCHED = 10
# (place among the elastic frequencies, share of the way to the next): beside, on and between resonances
LINES = ((0, -0.5), (0, 0.0), (0, 0.02), (1, 0.5), (2, -0.03), (3, 0.01), (4, 0.4))
PORTS: tuple[Port, ...] = (("tcp", "x"), ("tcp", "y"), ("tcp", "z"))
SPECIMENS = (clamped_beam, free_pair, patched_column, ribbed_plate, guideway)


def check_response_estimates(comm: MPI.Comm) -> list[ValidationRow]:
    """Bounds of the reduction error of nine responses per line on five machines, by number of modes."""
    rows: list[ValidationRow] = []
    if comm.rank == 0:
        found = []
        for make in SPECIMENS:
            specimen = make()
            pairs = compare_responses(specimen, LINES)
            rows.append(_report(specimen.name, pairs))
            found.append(pairs)
        rows += judge_pairs(CASE, "all lines", join_pairs(found))
    return list(comm.bcast(rows, root=0))


def compare_responses(specimen: Specimen, lines: tuple[tuple[int, float], ...]) -> ErrorPairs:
    """True and estimated errors of nine entries per line, over the largest entry of the line, for every number of modes."""
    model = unreduced(specimen)
    exact = reference_frequencies(model, WATCHED + 6)
    elastic = exact[exact > 1e-3 * exact[-1]]
    places = np.array([elastic[k] + share * (elastic[k + 1] - elastic[k] if share > 0.0 else elastic[k]) for k, share in lines])
    whole = reduce_specimen(specimen, max(MODE_COUNTS))
    right = np.array([direct_response(model, hz) for hz in places])
    sizes = np.abs(right).max(axis=(1, 2), keepdims=True)
    pairs = []
    for count in MODE_COUNTS:
        parts = {name: keep_fewer(element, count) for name, element in whole.items()} | specimen.rigid
        coupled = couple(parts, specimen.machine, specimen.pose)
        modes = solve_modal(coupled.system)
        lossy = dataclasses.replace(coupled.system, damping=None, hysteretic=LOSS_FACTOR * coupled.system.stiffness)
        found = evaluate_frf(prepare_frf(lossy, inputs=PORTS, outputs=PORTS, modes=modes), places).receptance
        ports = (input_columns(lossy, PORTS), output_rows(lossy, PORTS))
        sources = ErrorSources(truncated_parts(coupled), loss_factors=dict.fromkeys(parts, LOSS_FACTOR))
        errors = bound_response_errors(project_response(lossy, sources, modes, ports, float(places.max())), places)
        pairs.append(ErrorPairs((np.abs(found - right) / sizes).ravel(), (errors.bounds / sizes).ravel()))
    return join_pairs(pairs)


def direct_response(model: MonolithicMachine, hz: float) -> ComplexArray:
    """Receptance ``(3, 3)`` at the tool by one sparse factorisation, one loss factor throughout."""
    rows: FloatArray = model.points["tcp"].toarray()[:3]
    dynamic = (1.0 + 1j * LOSS_FACTOR) * model.stiffness - (2.0 * np.pi * hz) ** 2 * model.mass
    # the loss factor keeps all pivots away from zero: the symmetric ordering needs no pivoting
    factor = scipy.sparse.linalg.splu(
        dynamic.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return np.asarray(rows @ factor.solve(rows.T.astype(complex)))


def _report(name: str, pairs: ErrorPairs) -> ValidationRow:
    given, clear = pairs.given, pairs.clear
    covered = float(np.mean(pairs.true[given] <= pairs.estimated[given] + RESOLVED))
    low, middle, high = np.quantile(pairs.estimated[clear] / pairs.true[clear], [0.1, 0.5, 0.9])
    note = f"{given.sum()} of {len(given)} with an estimate; estimate over true {low:.2f} .. {middle:.2f} .. {high:.2f}"
    return show(CASE, f"{name}: share covered", covered, "-", f"{note}; true up to {pairs.true[given].max():.2g}")
