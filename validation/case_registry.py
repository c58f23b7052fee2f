"""Every validation case by name, in groups, and how they are run."""

import dataclasses
import difflib
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from headstock.geometry.errors import HeadstockError
from headstock.solvers.mpi import MPI
from headstock.validation.coverage import cases, probe_cases, search_cases
from headstock.validation.coverage.coverage_case import CoverageSuite
from headstock.validation.machines import (
    accuracy_cases,
    axes_estimate_cases,
    axis_kit_cases,
    drive_cases,
    estimate_cases,
    flexible_cases,
    identification_cases,
    machine_cases,
    modal_test_cases,
    model_choice_cases,
    model_estimate_cases,
    path_cases,
    peak_cases,
    response_estimate_cases,
)
from headstock.validation.mechanisms import (
    contouring_cases,
    mechanism_cases,
    motion_cases,
    stability_cases,
    tripteor_cases,
)
from headstock.validation.parts import (
    beam_cases,
    benchmarks,
    closed_form_cases,
    eigensolver_cases,
    order_cases,
    plate_cases,
    rail_bases,
    reduction_cases,
    response_cases,
)
from headstock.validation.references.rows import ValidationRow, failed_computation

type Rows = Iterable[ValidationRow]
type CaseFunction = Callable[[MPI.Comm], Rows]


@dataclass(frozen=True)
class Case:
    """A validation case.

    Attributes:
        name: What the command line calls it.
        group: ``beams``, ``benchmarks``, ``orders``, ``reduction``, ``machines``,
            ``axis_construction_kit``, ``tripteor`` or ``tripteor_verification``.
        compute: Collective function that makes the rows; those of rank 0 count.
        on_request: Takes so long that it runs only when it is named itself.
        draw: Computes rows of what is drawn from a seed on, for cases that draw what they compare.
        fresh: Lowest seed for that: the case or its calibration has used those below.
        rows_of: What its rows are printed under; its own name where that is empty.
    """

    name: str
    group: str
    compute: CaseFunction
    on_request: bool = False
    draw: Callable[[int], Rows] | None = None
    fresh: int = 0
    rows_of: str = ""


def _alone(name: str, group: str, compute: Callable[[], Rows], **options: Any) -> Case:
    """Return a case that rank 0 computes alone."""
    return Case(name, group, lambda comm: compute() if comm.rank == 0 else (), **options)


def _suite(
    name: str,
    suite: CoverageSuite[Any, Any],
    items: Mapping[str, Iterable[Any]],
    *,
    on_request: bool = True,
    fresh: int = 0,
    drawn: int = 0,
) -> Case:
    """Return a case that compares items of a suite with the truth.

    Args:
        items: By how the names of their rows begin.
        drawn: How many seeds are drawn from one on, ``fresh`` at least; 0 where none are.
    """
    draw = (lambda first: suite.compare_seeds(range(first, first + drawn))) if drawn else None
    compute = functools.partial(suite.compare, items)
    return _alone(name, "estimates", compute, on_request=on_request, draw=draw, fresh=fresh)


VERIFICATION = "tripteor_verification"


CASES: tuple[Case, ...] = (
    Case("kono-cantilever", "beams", beam_cases.check_cantilever_modes),
    Case("kono-cantilever-static", "beams", beam_cases.check_cantilever_statics),
    Case("kono-fixed-beam", "beams", beam_cases.check_fixed_beam_modes),
    Case("kono-fixed-beam-static", "beams", beam_cases.check_fixed_beam_statics),
    Case("kono-cantilever-theory", "beams", closed_form_cases.check_cantilever_theory),
    Case("kono-fixed-beam-theory", "beams", closed_form_cases.check_fixed_beam_theory),
    Case("torsion-constant", "beams", closed_form_cases.check_torsion_constants),
    Case("fv5-theory", "benchmarks", closed_form_cases.check_deep_beam_theory),
    Case("sdll02-theory", "benchmarks", closed_form_cases.check_slender_beam_theory),
    Case("rod-theory", "benchmarks", closed_form_cases.check_rod_theory),
    Case("block-theory", "benchmarks", closed_form_cases.check_block_theory),
    Case("fv5", "benchmarks", benchmarks.check_deep_beam),
    Case("block", "benchmarks", benchmarks.check_block),
    Case("free", "benchmarks", benchmarks.check_free_column),
    Case("square-column", "benchmarks", benchmarks.check_square_column),
    Case("sdll02", "benchmarks", benchmarks.check_slender_cantilever),
    Case("straight-cantilever", "benchmarks", benchmarks.check_straight_cantilever),
    Case("eigensolvers", "benchmarks", eigensolver_cases.check_eigensolvers),
    Case("thin-parts", "benchmarks", plate_cases.check_thin_plates),
    Case("le10", "benchmarks", benchmarks.check_thick_plate),
    Case("rod", "benchmarks", order_cases.check_rod_frequencies),
    Case("rod-orders", "orders", order_cases.check_rod_orders),
    Case("displacement-orders", "orders", order_cases.check_displacement_orders),
    Case("all-modes", "reduction", reduction_cases.check_all_modes),
    Case("static-exactness", "reduction", reduction_cases.check_static_exactness),
    Case("mode-truncation", "reduction", reduction_cases.check_mode_truncation),
    Case("average-truncation", "reduction", reduction_cases.check_mean_truncation),
    Case("rigid-body-content", "reduction", reduction_cases.check_rigid_body_content),
    Case("mesh-estimates", "estimates", accuracy_cases.check_mesh_estimates),
    _alone(
        "mesh-estimates-response",
        "estimates",
        response_estimate_cases.check_mesh_response_estimates,
    ),
    Case(
        "beam-accuracy", "accuracy", accuracy_cases.check_beam_accuracy, rows_of="stated-accuracy"
    ),
    Case(
        "machine-accuracy",
        "accuracy",
        accuracy_cases.check_machine_accuracy,
        on_request=True,
        rows_of="stated-accuracy",
    ),
    _suite(
        "coverage",
        cases.SUITE,
        {"fitted on": cases.CALIBRATION, "held out": cases.HOLD_OUT},
        fresh=cases.FRESH,
        drawn=cases.NEW_PARTS,
    ),
    # coarse hexahedra between the edges of patches, as searches begin with
    _suite(
        "coverage-hex",
        cases.SUITE,
        {"fitted on": cases.HEX_CALIBRATION, "held out": cases.HEX_HOLD_OUT},
    ),
    # STEP parts whose meshes follow the errors of the one before; factors are those of even meshes
    _suite("coverage-adapted", cases.SUITE, {"held out": cases.ADAPTED_PARTS}),
    # whether what searches call met is met, and ± covers the numbers
    _suite("coverage-search", search_cases.SUITE, {"": search_cases.PARTS}),
    _suite("coverage-search-fresh", search_cases.SUITE, {"": search_cases.FRESH_PARTS}),
    _suite("coverage-search-smoke", search_cases.SUITE, {"": search_cases.SMOKE_PARTS}),
    _suite(
        "probes",
        probe_cases.SUITE,
        {"fitted on": cases.CALIBRATION, "held out": cases.HOLD_OUT},
    ),
    _suite(
        "probes-smoke", probe_cases.SUITE, {"one part": probe_cases.SMOKE_PARTS}, on_request=False
    ),
    # a tube and a sheet, in seconds
    _suite("coverage-smoke", cases.SUITE, {"two parts": cases.SMOKE_PARTS}, on_request=False),
    _suite(
        "model-estimates",
        model_estimate_cases.SUITE,
        {
            "chosen on": model_estimate_cases.CALIBRATION,
            "held out": model_estimate_cases.HOLD_OUT,
        },
        fresh=model_estimate_cases.FRESH,
        drawn=len(model_estimate_cases.HOLD_OUT),
    ),
    _suite(
        "model-estimates-smoke",
        model_estimate_cases.SUITE,
        {"one machine": model_estimate_cases.SMOKE_MACHINES},
        on_request=False,
    ),
    _alone("peaks", "estimates", peak_cases.check_peaks, on_request=True),
    _alone("peaks-smoke", "estimates", peak_cases.check_peaks_smoke),
    _alone(
        "axes-estimates",
        "estimates",
        axes_estimate_cases.check_axes_estimates,
        on_request=True,
        draw=axes_estimate_cases.compare_new_axes,
        fresh=axes_estimate_cases.FRESH,
    ),
    _alone(
        "axes-estimates-smoke", "estimates", axes_estimate_cases.check_axes_smoke, on_request=True
    ),
    _alone(
        "contour-estimates",
        "estimates",
        axes_estimate_cases.check_contour_estimates,
        on_request=True,
        draw=axes_estimate_cases.compare_new_contours,
        fresh=axes_estimate_cases.FRESH_CONTOURS,
    ),
    _alone("contour-estimates-smoke", "estimates", axes_estimate_cases.check_contour_smoke),
    # whether errors are within what was asked, and what that costs; the only lever of a part alone is
    # its mesh
    _suite(
        "model-choice",
        model_choice_cases.MACHINE_SUITE,
        {"machine": model_choice_cases.MACHINES},
    ),
    _suite("part-choice", model_choice_cases.PART_SUITE, {"part": model_choice_cases.PARTS}),
    _suite(
        "model-choice-smoke",
        model_choice_cases.MACHINE_SUITE,
        {"machine": model_choice_cases.SMOKE_MACHINES},
        on_request=False,
    ),
    _alone("reduction-estimates", "estimates", estimate_cases.check_frequency_estimates),
    _alone(
        "reduction-estimates-step",
        "estimates",
        estimate_cases.check_step_estimates,
        rows_of="reduction-estimates",
    ),
    _alone("response-estimates", "estimates", response_estimate_cases.check_response_estimates),
    Case("known-stiffnesses", "identification", identification_cases.check_identification),
    _alone("modal-test", "identification", modal_test_cases.check_modal_test, on_request=True),
    _alone(
        "modal-test-smoke",
        "identification",
        functools.partial(modal_test_cases.check_modal_test, 1),
        rows_of="modal-test",
    ),
    _alone("rail-bases", "guideways", rail_bases.check_rail_bases),
    _alone(
        "flexible-interfaces",
        "interfaces",
        flexible_cases.check_flexible_interfaces,
        on_request=True,
    ),
    _alone("flexible-interfaces-smoke", "interfaces", flexible_cases.check_flexible_smoke),
    _alone("guideway", "guideways", machine_cases.check_guideway),
    _alone("path-test", "path", path_cases.check_path_test),
    _alone("path-cross-check", "path", path_cases.check_path_methods),
    Case("rod-step", "time_response", response_cases.check_rod_step),
    Case("rod-peak", "time_response", response_cases.check_rod_peak, on_request=True),
    Case("nafems-5t", "time_response", response_cases.check_transient_beam),
    Case("nafems-5h", "frequency_response", response_cases.check_harmonic_beam),
    Case("two-mass-drive", "drives", drive_cases.check_two_masses),
    Case("sampled-control", "drives", drive_cases.check_sampled_control),
    Case("drive-friction", "drives", drive_cases.check_friction),
    Case("beam-truncation", "frequency_response", response_cases.check_beam_truncation),
    Case("column-response", "frequency_response", response_cases.check_column_response),
    Case("three-axis-machine", "machines", machine_cases.check_three_axis_machine),
    Case("axis-construction-kit", "axis_construction_kit", axis_kit_cases.check_axis_kit),
    Case("tripteor-lumped", "tripteor", tripteor_cases.check_lumped_modes),
    Case("tripteor-claims", "tripteor", tripteor_cases.check_paper_statements),
    Case("tripteor-elastic-legs", "tripteor", tripteor_cases.check_elastic_legs),
    Case("tripteor-leg-models", "tripteor", tripteor_cases.check_leg_methods),
    Case("tripteor-compliances", "tripteor", tripteor_cases.check_compliances),
    Case("tripteor-cost", "tripteor", tripteor_cases.check_modal_cost),
    Case("tripteor-contouring", "tripteor", contouring_cases.check_contouring),
    Case("tripteor-contouring-nonlinear", "tripteor", contouring_cases.check_nonlinear_contour),
    Case(
        "tripteor-contour-whole",
        "tripteor",
        contouring_cases.check_whole_nonlinear_contour,
        on_request=True,
    ),
    Case("tripteor-stability", "tripteor", contouring_cases.check_contour_stability),
    Case("tripteor-marks", "tripteor", contouring_cases.check_marks, on_request=True),
    Case("milling-stability", "milling_stability", stability_cases.check_stability_methods),
    Case("mechanism-derivatives", VERIFICATION, mechanism_cases.check_mechanism_derivatives),
    Case("exechon-inverse-kinematics", VERIFICATION, mechanism_cases.check_inverse_kinematics),
    Case("mirror-symmetry", VERIFICATION, mechanism_cases.check_mirror_symmetry),
    Case("linear-limits", VERIFICATION, mechanism_cases.check_limits),
    Case("three-models", VERIFICATION, mechanism_cases.check_three_models),
    Case("three-models-path", VERIFICATION, motion_cases.check_common_path),
    Case("energy-balance", VERIFICATION, motion_cases.check_energy_balance),
    Case("integration-orders", VERIFICATION, motion_cases.check_integration_orders),
    Case("singular-passage", VERIFICATION, motion_cases.check_singular_passage),
    Case("constraint-drift", VERIFICATION, motion_cases.check_constraint_drift),
    Case(
        "constraint-drift-million", VERIFICATION, motion_cases.check_million_steps, on_request=True
    ),
)


def _case_names() -> list[str]:
    """Return the names of all cases."""
    return [case.name for case in CASES]


def _group_names() -> list[str]:
    """Return the names of all groups, in order."""
    return list(dict.fromkeys(case.group for case in CASES))


class UnknownCaseError(ValueError):
    """A case or group was asked for that does not exist; the message lists those that do (bad
    input, exit code 2).
    """


def _select_cases(names: Sequence[str]) -> list[Case]:
    """Return the cases that names of cases or groups stand for, each once, in registry order; all
    when no name is given.

    A case that takes very long is run only under its own name.

    Raises:
        UnknownCaseError: A name is neither a case nor a group.
    """
    known = {*_case_names(), *_group_names()}
    unknown = [name for name in names if name.lower() not in known]
    if unknown:
        hints = difflib.get_close_matches(unknown[0].lower(), sorted(known), n=1)
        hint = f" (did you mean {hints[0]!r}?)" if hints else ""
        raise UnknownCaseError(
            f"unknown validation case {unknown[0]!r}{hint}; groups: {', '.join(_group_names())}; cases: {', '.join(_case_names())}"
        )
    wanted = {name.lower() for name in names}
    return [
        case
        for case in CASES
        if case.name in wanted or ((not wanted or case.group in wanted) and not case.on_request)
    ]


class SeedError(ValueError):
    """A seed that a case cannot begin to draw at."""


def _from_seed(case: Case, seed: int) -> CaseFunction:
    if case.draw is None:
        drawn = ", ".join(each.name for each in CASES if each.draw is not None)
        raise SeedError(f"{case.name} draws nothing; a seed is for {drawn}")
    if seed < case.fresh:
        raise SeedError(
            f"{case.name}: seeds below {case.fresh} were used before; write --seed {case.fresh} or more"
        )
    draw = case.draw
    return lambda comm: draw(seed) if comm.rank == 0 else ()


def run_validation(
    names: Sequence[str],
    *,
    comm: MPI.Comm,
    on_case: Callable[[Case, list[ValidationRow]], None] | None = None,
    seed: int | None = None,
) -> list[ValidationRow]:
    """Compute the rows of cases and groups.

    A case whose computation ends with a named error yields one failed row that carries the error's
    text, so that the others are still computed.

    Args:
        names: Cases or groups; empty for all.
        comm: Communicator of the computations; collective.
        on_case: Called after each case, for progress.
        seed: Of the first part or machine that is drawn in place of those of the case; None for
            those.

    Raises:
        UnknownCaseError: A name is neither a case nor a group.
        SeedError: A case draws nothing, or has used the seed.
    """
    rows: list[ValidationRow] = []
    cases = _select_cases(names)
    computations = [case.compute if seed is None else _from_seed(case, seed) for case in cases]
    for case, compute in zip(cases, computations, strict=True):
        try:
            made = list(compute(comm))
        except HeadstockError as error:
            made = [failed_computation(f"{type(error).__name__}: {error}")]
        under = case.rows_of or case.name
        found = [
            dataclasses.replace(row, case=row.case or under) for row in comm.bcast(made, root=0)
        ]
        if on_case is not None:
            on_case(case, found)
        rows += found
    return rows
