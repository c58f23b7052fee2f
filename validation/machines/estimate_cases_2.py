"""Error estimates against true errors: reduced machines by number of modes, and unreduced models of them."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg
import scipy.stats
from mpi4py import MPI

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.estimates.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.block_lanczos import ModeTarget
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.validation.machines.estimate_cases import SPECIMENS, Specimen, cast_column, keep_fewer, unreduced
from headstock.validation.machines.monolithic_machines import MonolithicMachine, monolithic_frequencies
from headstock.validation.parts.component_models import full_model, full_modes, held_by
from headstock.validation.references.rows import Target, ValidationRow, judge, judge_bound, show

CASE = "reduction-estimates"
MODE_COUNTS = (0, 3, 6, 10, 16, 25, 40)
WATCHED = 14
SHIFT_HZ = 20.0
COVERED = 0.95  # share of the true errors that an estimate must not be below
LARGEST_MEDIAN = 10.0  # times too large in the median
LEAST_CORRELATION = 0.8
RESOLVED = 3e-8  # relative: the unreduced three-axis machine comes out 1.3e-8 off throughout, beside its air springs
CLEAR = 1e-6  # and above which a ratio of errors means something


@dataclass(frozen=True, eq=False)
class ErrorPairs:
    """True errors and their estimates, relative to the value, ``(n,)`` each; NaN where no estimate was given."""

    true: FloatArray
    estimated: FloatArray

    @property
    def given(self) -> BoolArray:
        """Which have an estimate."""
        return np.isfinite(self.estimated)

    @property
    def clear(self) -> BoolArray:
        """Which have one, and a true error well above the roundoff of both roads."""
        return np.asarray(self.given & (self.true > CLEAR))


def check_frequency_estimates(comm: MPI.Comm) -> list[ValidationRow]:
    """Bounds of the reduction error of natural frequencies over machines of six kinds and numbers of modes from none to forty."""
    rows: list[ValidationRow] = []
    if comm.rank == 0:
        found = []
        for make in SPECIMENS:
            specimen = make()
            pairs = compare_frequencies(specimen, reference_frequencies(unreduced(specimen), WATCHED))
            rows += _report(specimen.name, pairs)
            found.append(pairs)
        rows += judge_pairs(CASE, "all", join_pairs(found))
    return list(comm.bcast(rows, root=0))


def check_step_estimates(comm: MPI.Comm) -> list[ValidationRow]:
    """The same for a column from a STEP file with 195 000 dofs, against modes of the whole mesh."""
    rows: list[ValidationRow] = []
    if comm.rank == 0:
        specimen = cast_column()
        part, mesh, supports = specimen.machine.components["column"], specimen.meshes["column"], specimen.machine.supports
        whole = full_model(mesh, part.material, comm=MPI.COMM_SELF, held=held_by(mesh, tuple(supports.values())))
        pairs = compare_frequencies(specimen, full_modes(whole, WATCHED).frequencies_hz)
        rows = [*_report(specimen.name, pairs), *judge_pairs(CASE, specimen.name, pairs)]
    return list(comm.bcast(rows, root=0))


def compare_frequencies(specimen: Specimen, exact: FloatArray) -> ErrorPairs:
    """True and estimated errors of the lowest elastic frequencies of a machine for every number of modes."""
    whole = reduce_specimen(specimen, max(MODE_COUNTS))
    pairs = []
    for count in MODE_COUNTS:
        parts = {name: keep_fewer(element, count) for name, element in whole.items()} | specimen.rigid
        coupled = couple(parts, specimen.machine, specimen.pose)
        modes = solve_modal(coupled.system, count=min(WATCHED, len(coupled.system.mass)))
        errors = bound_frequency_errors(coupled.system, truncated_parts(coupled), modes)
        kept = slice(modes.rigid_count, len(modes.frequencies_hz))
        right = exact[: len(modes.frequencies_hz)][kept]
        pairs.append(ErrorPairs(modes.frequencies_hz[kept] / right - 1.0, errors.bounds_hz[kept] / right))
    return join_pairs(pairs)


def reduce_specimen(specimen: Specimen, count: int) -> dict[str, Superelement]:
    """Superelements of the elastic components with so many modes."""
    request = ReductionRequest(ModeTarget(count=count), recovery=False)
    parts, supports = specimen.machine.components, tuple(specimen.machine.supports.values())
    return {
        name: reduce_elastic(parts[name], mesh, supports, comm=MPI.COMM_SELF, request=request)
        for name, mesh in specimen.meshes.items()
    }


def reference_frequencies(model: MonolithicMachine, count: int) -> FloatArray:
    """The lowest natural frequencies [Hz] of an unreduced machine, by shift and invert below them all."""
    if model.constraints.shape[0]:
        return monolithic_frequencies(model, count, shift_hz=SHIFT_HZ)
    shift = -((2.0 * np.pi * SHIFT_HZ) ** 2)
    factor = scipy.sparse.linalg.splu(
        (model.stiffness - shift * model.mass).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    inverse = scipy.sparse.linalg.LinearOperator(model.stiffness.shape, matvec=factor.solve, dtype=float)
    values = scipy.sparse.linalg.eigsh(
        model.stiffness.tocsc(), k=count, M=model.mass.tocsc(), sigma=shift, OPinv=inverse, tol=1e-12, return_eigenvectors=False
    )
    return np.asarray(np.sqrt(np.abs(np.sort(values))) / (2.0 * np.pi))


def join_pairs(parts: list[ErrorPairs]) -> ErrorPairs:
    """All of them together."""
    return ErrorPairs(np.concatenate([part.true for part in parts]), np.concatenate([part.estimated for part in parts]))


def judge_pairs(case: str, what: str, pairs: ErrorPairs) -> list[ValidationRow]:
    """Rows for coverage, size and rank correlation of estimates."""
    given, clear = pairs.given, pairs.clear
    missed = float(np.mean(pairs.true[given] > pairs.estimated[given] + RESOLVED))
    ratio = float(np.median(pairs.estimated[clear] / pairs.true[clear]))
    correlation = float(scipy.stats.spearmanr(pairs.true[clear], pairs.estimated[clear]).statistic)
    note = f"{given.sum()} of {len(given)} have an estimate"
    return [
        judge_bound(case, f"{what}: share of true errors above their estimate", missed, 1.0 - COVERED, note),
        judge_bound(
            case, f"{what}: estimate over true error, median", ratio, LARGEST_MEDIAN, f"{clear.sum()} errors above {CLEAR:g}"
        ),
        judge(case, f"{what}: rank correlation", correlation, Target(1.0, "-", 1.0 - LEAST_CORRELATION, "identity")),
    ]


def _report(name: str, pairs: ErrorPairs) -> list[ValidationRow]:
    given, clear = pairs.given, pairs.clear
    covered = float(np.mean(pairs.true[given] <= pairs.estimated[given] + RESOLVED))
    ratios = pairs.estimated[clear] / pairs.true[clear]
    low, middle, high = np.quantile(ratios, [0.1, 0.5, 0.9]) if len(ratios) else (np.nan,) * 3
    note = f"{given.sum()} of {len(given)} with an estimate; estimate over true {low:.2f} .. {middle:.2f} .. {high:.2f}"
    return [show(CASE, f"{name}: share covered", covered, "-", f"{note} (10, 50, 90 %); true up to {pairs.true[given].max():.2g}")]
