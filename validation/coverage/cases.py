"""How often the ± covers the truth, over parts of many kinds: the ± of meshes,
curved faces and modes left out.

What stands behind ± on one part of the suite, beside the truth from a far finer mesh.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component, MeshSettings
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.error_sizes import spread_error
from headstock.pipeline.accuracy.settings import give_sizes
from headstock.reduction.components.elastic import find_cell_errors, reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.corrected_elements import correct_mesh
from headstock.reduction.estimates.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.estimates.mesh_errors import (
    compliance_mesh_errors,
    compliance_shape_errors,
    frequency_mesh_errors,
    frequency_shape_errors,
    meshed_parts,
)
from headstock.reduction.estimates.response_errors import bound_response_errors
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, machine_field
from headstock.reduction.motions.compliance_budget import PointBudget, point_budget
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import ModeSet, pair_modes
from headstock.solvers.second_order import ComplexArray
from headstock.validation.coverage.coverage_case import (
    COMPLIANCE,
    COVERED,
    FREQUENCY,
    SURE,
    UNSURE,
    CoverageCase,
    CoverageSuite,
    compare_number,
    cover_lines,
    prepare_responses,
)
from headstock.validation.coverage.parts import (
    FIRST_ADAPTED,
    FIRST_HEX,
    PRODUCT,
    CoveragePart,
    draw_part,
)
from headstock.validation.references.rows import ValidationRow, show

if TYPE_CHECKING:
    pass

# modes of a judged mesh, and of the true one among which theirs are sought
WATCHED = 8
PARTNERS = 14
JUDGED_MODES, TRUE_MODES = 24, 40  # fixed-interface modes kept
LOSS_FACTOR = 0.03
LINES = 150
# of ±: what may be unknown of a truth that is compared with a corrected mesh, whose ± is a third
SURE_CORRECTED = 0.2
# factors were fitted on the first parts; the others were drawn and kept apart before that, a
# product's part joined them
CALIBRATION, HOLD_OUT = range(24), (*range(24, 48), PRODUCT)
HEX_CALIBRATION = range(FIRST_HEX, FIRST_HEX + 9)
HEX_HOLD_OUT = range(FIRST_HEX + 9, FIRST_HEX + 24)
ADAPTED_PARTS = range(FIRST_ADAPTED, FIRST_ADAPTED + 12)  # nothing was fitted on them
# what the next mesh should miss of the energy that one misses, of the judged and of the true ones
ADAPTED_STEP, TRUE_STEP = 0.2, 0.1
LARGE = 60_000  # points, from which on a true mesh is fine enough
FRESH = PRODUCT + 1
NEW_PARTS = 24  # first seed of no part above, and how many are drawn from one on
SMOKE_PARTS = (8, 15)
# errors of either sign that are spread normally: ± that covers 95 % of them is 2.9 times the median,
# ± that covers 99 % 3.8 times
LARGEST_MEDIAN, LARGEST_MEDIAN_CORRECTED = 3.0, 4.0
CLEAR = 1e-4  # true errors above which a ratio means something


@dataclass(frozen=True, eq=False)
class _PartCoverage:
    """Numbers of one part on its judged meshes.

    Attributes:
        compliances: ``(n,)`` 1 for compliances, 0 for frequencies.
        errors: ``(n,)`` true errors over the number.
        estimates: ``(n,)`` the ±, over the number; NaN for ``± ?``.
        unsure: ``(n,)`` how well the truth is known, over the number.
        lines: ``(m,)`` per frequency response the share that is covered of its visible lines whose
            truth is sure enough; NaN where that are too few.
        failure: What ended the computation of a mesh, empty for nothing.
        sure: Share of ± that may be unknown of the truth.
        corrected: The same with meshes corrected by their estimates; None here.
    """

    seed: int
    kind: str
    compliances: FloatArray
    errors: FloatArray
    estimates: FloatArray
    unsure: FloatArray
    lines: FloatArray
    failure: str = ""
    sure: float = SURE
    corrected: "_PartCoverage | None" = None


@dataclass(frozen=True, eq=False)
class _Solved:
    """A part on one mesh.

    Attributes:
        compliances: ``(3,)`` along x, y and z.
        plain: Mesh errors of frequencies and compliances, as estimated without safety.
        coupled: The part, held at its foot.
        body: What was meshed.
        motions: ``(n, k)`` of the superelement, per number of such a height that the energy it
            strains is the number's relative error.
    """

    modes: ModeSet
    places: BodyPlaces
    compliances: FloatArray
    plain: tuple[FloatArray, FloatArray]
    total: tuple[FloatArray, FloatArray]
    coupled: CoupledMachine
    body: Component
    mesh: ComponentMesh
    motions: FloatArray


def part_texts(code: str) -> Callable[[int], tuple[str, ...]]:
    """Return what a seed's part and its measurement by a file are known by."""
    drawing = Path(__file__).with_name("parts.py")
    return lambda seed: (Path(code).read_text(), drawing.read_text(), str(seed))


def _measure_part(part: CoveragePart) -> _PartCoverage:
    """Errors and estimates of a part on each of its meshes."""
    reference = _solve_reference(part)
    elastic = reference.modes.frequencies_hz[reference.modes.rigid_count :]
    grid = np.linspace(0.2 * elastic[0], 1.15 * elastic[4], LINES)
    right, _ = _respond(reference.coupled, grid, finer=True)
    doubt = UNSURE * np.abs(right - _respond(reference.coupled, grid)[0])
    evaluations: list[_Evaluation] = [_Evaluation(), _Evaluation()]
    failures = []
    meshes, rounds = list(part.meshes), part.rounds
    while meshes:
        try:
            plain = _solve(part, meshes.pop(0), JUDGED_MODES, WATCHED, reference.places)
            element = correct_mesh(plain.coupled.layout.superelements["part"])
            corrected = _analyse(part, plain.body, plain.mesh, element, WATCHED, plain.places)
            for own, each in zip(evaluations, (plain, corrected), strict=True):
                own.tables.append(_compare(each, reference))
                own.lines.append(_cover_lines(each.coupled, grid, right, doubt))
            if rounds and not meshes:
                meshes, rounds = [_follow_errors(plain, ADAPTED_STEP)], rounds - 1
        except HeadstockError as error:
            failures.append(f"{type(error).__name__}: {error}")
    found, other = (own.conclude(part, "; ".join(failures)) for own in evaluations)
    return dataclasses.replace(found, corrected=dataclasses.replace(other, sure=SURE_CORRECTED))


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """Meshes of a part beside its truth: rows of numbers as ``_compare`` finds them, and shares of
    lines.
    """

    tables: list[FloatArray] = field(default_factory=list)
    lines: list[FloatArray] = field(default_factory=list)

    def conclude(self, part: CoveragePart, failure: str) -> _PartCoverage:
        rows = np.concatenate([np.zeros((4, 0)), *self.tables], axis=1)
        lines = np.concatenate([np.zeros(0), *self.lines])
        return _PartCoverage(
            part.seed, part.kind, rows[0], rows[1], rows[2], rows[3], lines, failure
        )


def _solve_reference(part: CoveragePart) -> _Solved:
    """Return the true mesh: one that follows errors as often as those compared with it, in larger
    steps, as long as it is not too large.
    """
    reference = _solve(part, part.reference, TRUE_MODES, PARTNERS)
    for _ in range(part.rounds):
        if len(reference.mesh.points) < LARGE:
            reference = _solve(part, _follow_errors(reference, TRUE_STEP), TRUE_MODES, PARTNERS)
    return reference


def _solve(
    part: CoveragePart,
    settings: MeshSettings,
    modes: int,
    watched: int,
    places: BodyPlaces | None = None,
) -> _Solved:
    body = dataclasses.replace(part.machine.components["part"], mesh=settings)
    request = ReductionRequest(ModeTarget(count=modes))
    mesh = mesh_component(body)
    element = reduce_elastic(body, mesh, comm=MPI.COMM_SELF, request=request)
    return _analyse(part, body, mesh, element, watched, places)


def _analyse(
    part: CoveragePart,
    body: Component,
    mesh: ComponentMesh,
    element: Superelement,
    watched: int,
    places: BodyPlaces | None,
) -> _Solved:
    coupled = couple({"part": element}, part.machine, Pose("reference"))
    found = solve_modal(coupled.system, count=watched)
    places = places or choose_places(element)
    field = machine_field(coupled, {"part": places}, found.shapes)
    budget = point_budget(coupled, "tcp")
    energies = compliance_mesh_errors(coupled, budget.displacements)["part"]
    covering, soft = frequency_mesh_errors(coupled, found)["part"], np.diag(energies)[:3]
    shape = (
        frequency_shape_errors(coupled, found),
        compliance_shape_errors(coupled, budget.displacements),
    )
    nothing = np.zeros(len(found.frequencies_hz))
    bounds = bound_frequency_errors(coupled.system, truncated_parts(coupled), found).bounds_hz
    return _Solved(
        ModeSet(found.frequencies_hz, field, found.rigid_count),
        places,
        np.diag(budget.compliance)[:3],
        (
            np.asarray(covering / element.errors.mesh_safety + 0.5 * bounds),
            np.asarray(soft / element.errors.mesh_safety),
        ),
        (
            covering + shape[0].get("part", nothing) + bounds,
            np.asarray(soft + shape[1].get("part", np.zeros(6))[:3]),
        ),
        coupled,
        body,
        mesh,
        _number_motions(coupled, found, budget),
    )


def _number_motions(coupled: CoupledMachine, modes: ModalResult, budget: PointBudget) -> FloatArray:
    elastic = slice(modes.rigid_count, None)
    strained = (
        modes.shapes[:, elastic] * np.sqrt(0.5) / (2.0 * np.pi * modes.frequencies_hz[elastic])
    )
    pushed = budget.displacements[:, :3] / np.sqrt(np.diag(budget.compliance)[:3])
    return coupled.basis @ np.hstack([strained, pushed])


def _follow_errors(solved: _Solved, step: float) -> MeshSettings:
    """Return the sizes that all watched numbers together ask for."""
    element = solved.coupled.layout.superelements["part"]
    energies = find_cell_errors(solved.body, solved.mesh, element, solved.motions).sum(axis=1)
    sizes = spread_error(solved.mesh, energies, step, solved.body.mesh.sizes)
    return give_sizes(solved.body, sizes).mesh


def _compare(meshed: _Solved, reference: _Solved) -> FloatArray:
    """Rows ``(4, n)``: compliance or not, true error, estimate and what is not known of the truth,
    over the number.
    """
    columns = []
    for pair in pair_modes(meshed.modes, reference.modes):
        if pair.first >= meshed.modes.rigid_count:
            value, left = meshed.modes.frequencies_hz[pair.first], reference.plain[0][pair.second]
            truth = reference.modes.frequencies_hz[pair.second] - left
            estimate = meshed.total[0][pair.first]
            columns.append(compare_number(FREQUENCY, value, truth, estimate=estimate, left=left))
    for value, true, left, estimate in zip(
        meshed.compliances, reference.compliances, reference.plain[1], meshed.total[1], strict=True
    ):
        columns.append(compare_number(COMPLIANCE, value, true + left, estimate=estimate, left=left))
    return np.array(columns).T


def _cover_lines(
    coupled: CoupledMachine, grid: FloatArray, right: ComplexArray, doubt: FloatArray
) -> FloatArray:
    """Share of the visible and sure lines whose error is covered, ``(3,)`` along each load; empty
    where nothing is known.
    """
    found, total = _respond(coupled, grid)
    if not np.isfinite(total).any():
        return np.zeros(0)
    return cover_lines(found, right, total=total, doubt=doubt)


def _respond(
    coupled: CoupledMachine, grid: FloatArray, *, finer: bool = False
) -> tuple[ComplexArray, FloatArray]:
    """Receptances along x, y, z ``(n, 3)``, as computed or as on finer meshes, and the ±."""
    meshed = meshed_parts(coupled)
    if finer:  # as estimated, without what covers the doubt
        element = coupled.layout.superelements["part"]
        meshed = {
            name: dataclasses.replace(
                part, energy=np.asarray(part.energy / element.errors.mesh_safety, dtype=float)
            )
            for name, part in meshed.items()
        }
    model, space = prepare_responses(
        coupled,
        solve_modal(coupled.system),
        loss_factor=LOSS_FACTOR,
        highest_hz=float(grid.max()),
        meshed=meshed,
    )
    errors = bound_response_errors(space, grid)
    found = evaluate_frf(model, grid).receptance
    total = errors.bounds
    for sizes in (errors.mesh_sizes, errors.face_sizes):
        total = total + (0.0 if sizes is None else sizes)
    if finer and errors.mesh is not None:
        found = found + errors.mesh
    return np.diagonal(found, axis1=1, axis2=2), np.diagonal(total, axis1=1, axis2=2)


def _evaluate(what: str, parts: Sequence[_PartCoverage]) -> list[ValidationRow]:
    """Evaluate meshes as they are, then corrected by their estimates."""
    corrected = [part.corrected for part in parts if part.corrected is not None]
    plain = CoverageCase(CLEAR, LARGEST_MEDIAN)
    less = CoverageCase(CLEAR, LARGEST_MEDIAN_CORRECTED)
    return _evaluate_meshes(plain, what, parts) + (
        _evaluate_meshes(less, f"{what}, corrected", corrected) if corrected else []
    )


def _evaluate_meshes(
    case: CoverageCase, what: str, parts: Sequence[_PartCoverage]
) -> list[ValidationRow]:
    known = [part.unsure <= part.sure * part.estimates for part in parts]
    given, true, compliances = (
        [getattr(part, name)[sure] for part, sure in zip(parts, known, strict=True)]
        for name in ("estimates", "errors", "compliances")
    )
    covered = [errors <= sizes for errors, sizes in zip(true, given, strict=True)]
    frequencies = int((np.concatenate(compliances) == 0.0).sum())
    silent = sum(int(np.isnan(part.estimates).sum()) for part in parts)
    numbers = sum(map(len, true))
    unsure = sum(len(part.errors) for part in parts) - numbers - silent
    note = (
        f"{frequencies} frequencies and {numbers - frequencies} compliances of {len(parts)} parts; {silent} say ± ?, of {unsure}"
        f" the truth is not sure enough; {sum(bool(part.failure) for part in parts)} parts with a mesh that failed"
    )
    shares = np.array([some.mean() for some in covered if len(some)])
    responses = [part.lines[~np.isnan(part.lines)] >= COVERED for part in parts]
    return [
        *case.evaluate(what, np.concatenate(true), np.concatenate(given), note),
        show(
            f"{what}: coverage by part, mean",
            shares.mean(),
            "-",
            f"least {shares.min():.2f}; {_by_kind(parts, covered)}",
        ),
        show(f"{what}: parts with 95 % of their numbers covered", (shares >= COVERED).mean(), "-"),
        case.evaluate_responses(
            what,
            np.concatenate([part.lines for part in parts]),
            f"; {_by_kind(parts, responses)}",
        ),
    ]


def _by_kind(parts: Sequence[_PartCoverage], covered: Sequence[FloatArray]) -> str:
    """Share of covered numbers by kind of part."""
    found: dict[str, list[FloatArray]] = {}
    for part, own in zip(parts, covered, strict=True):
        found.setdefault(part.kind, []).append(own)
    return ", ".join(
        f"{kind} {np.concatenate(own).mean():.2f}"
        for kind, own in found.items()
        if len(np.concatenate(own))
    )


SUITE = CoverageSuite(
    lambda seed, scratch: _measure_part(draw_part(seed, scratch.folder)),
    _PartCoverage,
    part_texts(__file__),
    _evaluate,
)
