"""Every validation case by name, in groups, and how they are run."""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from headstock.geometry.errors import HeadstockError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.validation.coverage.cases import FRESH as FRESH_PARTS
from headstock.validation.coverage.cases import (
    check_adapted_coverage,
    check_coverage,
    check_coverage_smoke,
    check_hex_coverage,
    cover_new_parts,
)
from headstock.validation.coverage.probe_cases import check_probes, check_probes_smoke
from headstock.validation.coverage.search_cases import (
    check_fresh_search,
    check_search,
    check_search_smoke,
)
from headstock.validation.machines.accuracy_cases import (
    check_beam_accuracy,
    check_machine_accuracy,
    check_mesh_estimates,
)
from headstock.validation.machines.axes_estimate_cases import FRESH as FRESH_AXES
from headstock.validation.machines.axes_estimate_cases import (
    check_axes_estimates,
    check_axes_smoke,
    compare_new_axes,
)
from headstock.validation.machines.axis_kit_cases import check_axis_kit
from headstock.validation.machines.contour_estimate_cases import (
    FRESH_CONTOURS,
    check_contour_estimates,
    check_contour_smoke,
    compare_new_contours,
)
from headstock.validation.machines.drive_cases import (
    check_friction,
    check_sampled_control,
    check_two_masses,
)
from headstock.validation.machines.estimate_cases import (
    check_frequency_estimates,
    check_step_estimates,
)
from headstock.validation.machines.flexible_cases import (
    check_flexible_interfaces,
    check_flexible_smoke,
)
from headstock.validation.machines.identification_cases import check_identification
from headstock.validation.machines.machine_cases import check_guideway, check_three_axis_machine
from headstock.validation.machines.model_choice_cases import (
    check_model_choice,
    check_model_choice_smoke,
    check_part_choice,
)
from headstock.validation.machines.model_estimate_cases import FRESH as FRESH_MACHINES
from headstock.validation.machines.model_estimate_cases import (
    check_model_estimates,
    check_model_estimates_smoke,
    compare_new_machines,
)
from headstock.validation.machines.path_cases import check_path_methods, check_path_test
from headstock.validation.machines.peak_cases import check_peaks, check_peaks_smoke
from headstock.validation.machines.response_estimate_cases import (
    check_mesh_response_estimates,
    check_response_estimates,
)
from headstock.validation.mechanisms.contouring_cases import (
    check_contour_stability,
    check_contouring,
    check_nonlinear_contour,
    check_whole_nonlinear_contour,
)
from headstock.validation.mechanisms.marks_cases import check_marks
from headstock.validation.mechanisms.mechanism_cases import (
    check_inverse_kinematics,
    check_limits,
    check_mechanism_derivatives,
    check_mirror_symmetry,
    check_three_models,
)
from headstock.validation.mechanisms.motion_cases import (
    check_common_path,
    check_constraint_drift,
    check_energy_balance,
    check_integration_orders,
    check_million_steps,
    check_singular_passage,
)
from headstock.validation.mechanisms.stability_cases import check_stability_methods
from headstock.validation.mechanisms.tripteor_cases import (
    check_compliances,
    check_elastic_legs,
    check_leg_methods,
    check_lumped_modes,
    check_modal_cost,
    check_paper_statements,
)
from headstock.validation.parts.beam_cases import (
    check_cantilever_modes,
    check_cantilever_statics,
    check_fixed_beam_modes,
    check_fixed_beam_statics,
)
from headstock.validation.parts.closed_form_cases import (
    check_block_theory,
    check_cantilever_theory,
    check_deep_beam_theory,
    check_fixed_beam_theory,
    check_rod_theory,
    check_slender_beam_theory,
    check_torsion_constants,
)
from headstock.validation.parts.deep_beam import check_harmonic_beam, check_transient_beam
from headstock.validation.parts.eigensolver_cases import check_eigensolvers
from headstock.validation.parts.modal_benchmarks import (
    check_block,
    check_deep_beam,
    check_free_column,
    check_slender_cantilever,
    check_square_column,
)
from headstock.validation.parts.order_cases import (
    check_displacement_orders,
    check_rod_frequencies,
    check_rod_orders,
)
from headstock.validation.parts.plate_cases import check_thin_plates
from headstock.validation.parts.rail_bases import check_rail_bases
from headstock.validation.parts.reduction_cases import (
    check_all_modes,
    check_mean_truncation,
    check_mode_truncation,
    check_rigid_body_content,
    check_static_exactness,
)
from headstock.validation.parts.response_cases import (
    check_beam_truncation,
    check_column_response,
    check_rod_peak,
    check_rod_step,
)
from headstock.validation.parts.static_benchmarks import (
    check_straight_cantilever,
    check_thick_plate,
)
from headstock.validation.references.rows import ValidationRow, failed_computation

CaseFunction = Callable[[MPI.Comm], list[ValidationRow]]


@dataclass(frozen=True)
class Case:
    """A validation case.

    Attributes:
        name: What the command line calls it.
        group: ``beams``, ``benchmarks``, ``orders``, ``reduction``, ``machines``,
            ``axis_construction_kit``, ``tripteor`` or ``tripteor_verification``.
        compute: Collective function that returns the rows.
        on_request: Takes so long that it runs only when it is named itself.
        draw: Computes rows of what is drawn from a seed on, for cases that draw what they compare.
        fresh: Lowest seed for that: the case or its calibration has used those below.
    """

    name: str
    group: str
    title: str
    compute: CaseFunction
    on_request: bool = False
    draw: Callable[[int], list[ValidationRow]] | None = None
    fresh: int = 0


def _on_root(compute: Callable[[], list[ValidationRow]]) -> CaseFunction:
    """Return a case that rank 0 computes alone, its rows on every rank."""
    return lambda comm: make_on_root(comm, compute)


VERIFICATION = "tripteor_verification"


CASES: tuple[Case, ...] = (
    Case(
        "kono-cantilever",
        "beams",
        "six frequencies of the column of Kono et al.",
        check_cantilever_modes,
    ),
    Case(
        "kono-cantilever-static",
        "beams",
        "compliances of the column of Kono et al.",
        check_cantilever_statics,
    ),
    Case(
        "kono-fixed-beam",
        "beams",
        "six frequencies of the fixed beam of Kono et al.",
        check_fixed_beam_modes,
    ),
    Case(
        "kono-fixed-beam-static",
        "beams",
        "deflections of the fixed beam of Kono et al.",
        check_fixed_beam_statics,
    ),
    Case(
        "kono-cantilever-theory",
        "beams",
        "the column of Kono et al. by beam theories",
        check_cantilever_theory,
    ),
    Case(
        "kono-fixed-beam-theory",
        "beams",
        "the fixed beam of Kono et al. by beam theories",
        check_fixed_beam_theory,
    ),
    Case("torsion-constant", "beams", "torsion constants of rectangles", check_torsion_constants),
    Case("fv5-theory", "benchmarks", "NAFEMS FV5 by beam theories", check_deep_beam_theory),
    Case("sdll02-theory", "benchmarks", "SDLL02 by Euler and Bernoulli", check_slender_beam_theory),
    Case("rod-theory", "benchmarks", "rod without lateral contraction", check_rod_theory),
    Case(
        "block-theory", "benchmarks", "block on four air springs, closed form", check_block_theory
    ),
    Case("fv5", "benchmarks", "NAFEMS FV5, deep beam on averaged supports", check_deep_beam),
    Case("block", "benchmarks", "rigid block on four air springs", check_block),
    Case("free", "benchmarks", "the column of Kono et al. without support", check_free_column),
    Case("square-column", "benchmarks", "square column with repeated modes", check_square_column),
    Case("sdll02", "benchmarks", "SDLL02, slender cantilever", check_slender_cantilever),
    Case(
        "straight-cantilever",
        "benchmarks",
        "MacNeal and Harder's straight cantilever, slanted elements",
        check_straight_cantilever,
    ),
    Case(
        "eigensolvers",
        "benchmarks",
        "repeated modes, thin parts and free bodies by each eigensolver",
        check_eigensolvers,
    ),
    Case(
        "thin-parts",
        "benchmarks",
        "plates down to 1:1000, one element through the thickness",
        check_thin_plates,
    ),
    Case("le10", "benchmarks", "NAFEMS LE10, thick plate under pressure", check_thick_plate),
    Case(
        "rod",
        "benchmarks",
        "axial frequencies of the rod without lateral contraction",
        check_rod_frequencies,
    ),
    Case("rod-orders", "orders", "order of axial frequencies", check_rod_orders),
    Case(
        "displacement-orders",
        "orders",
        "order of the displacement under a manufactured load",
        check_displacement_orders,
    ),
    Case(
        "all-modes",
        "reduction",
        "every mode kept is the whole model, none is Guyan's",
        check_all_modes,
    ),
    Case(
        "static-exactness",
        "reduction",
        "static interface response with any number of modes",
        check_static_exactness,
    ),
    Case(
        "mode-truncation",
        "reduction",
        "free column with rigid faces by number of modes",
        check_mode_truncation,
    ),
    Case(
        "average-truncation", "reduction", "free column with averaging faces", check_mean_truncation
    ),
    Case(
        "rigid-body-content",
        "reduction",
        "rigid-body frequencies, mass, centre and inertia",
        check_rigid_body_content,
    ),
    Case("mesh-estimates", "estimates", "± of meshes against a fine mesh", check_mesh_estimates),
    Case(
        "mesh-estimates-response",
        "estimates",
        "± of meshes in frequency responses against fine meshes",
        _on_root(check_mesh_response_estimates),
    ),
    Case(
        "beam-accuracy",
        "accuracy",
        "the column of Kono et al. with 3 %, 1 % and 0.1 % asked for, the fixed beam with 1 %",
        check_beam_accuracy,
    ),
    Case(
        "machine-accuracy",
        "accuracy",
        "the three-axis machine and two STEP parts with 1 % asked for",
        check_machine_accuracy,
        on_request=True,
    ),
    Case(
        "coverage",
        "estimates",
        "how often ± covers the truth, over 49 parts",
        _on_root(check_coverage),
        on_request=True,
        draw=cover_new_parts,
        fresh=FRESH_PARTS,
    ),
    Case(
        "coverage-hex",
        "estimates",
        "the same over 24 parts of coarse hexahedra between the edges of patches",
        _on_root(check_hex_coverage),
        on_request=True,
    ),
    Case(
        "coverage-adapted",
        "estimates",
        "the same over 12 STEP parts whose meshes follow the errors of the one before",
        _on_root(check_adapted_coverage),
        on_request=True,
    ),
    Case(
        "coverage-search",
        "estimates",
        "what searches for 1 % call met on twelve rings, tubes and bent bars",
        _on_root(check_search),
        on_request=True,
    ),
    Case(
        "coverage-search-fresh",
        "estimates",
        "the same on eight fresh ones: elliptical ring, frustum, S-bent pipe, slotted tube, U-bar",
        _on_root(check_fresh_search),
        on_request=True,
    ),
    Case(
        "coverage-search-smoke",
        "estimates",
        "the same on two of the twelve",
        _on_root(check_search_smoke),
        on_request=True,
    ),
    Case(
        "probes",
        "estimates",
        "how often ± covers the truth at probes, over 49 parts",
        _on_root(check_probes),
        on_request=True,
    ),
    Case("probes-smoke", "estimates", "the same on one part", _on_root(check_probes_smoke)),
    Case("coverage-smoke", "estimates", "the same on two parts", _on_root(check_coverage_smoke)),
    Case(
        "model-estimates",
        "estimates",
        "what rigid and segmented bodies leave out, over 32 machines",
        _on_root(check_model_estimates),
        on_request=True,
        draw=compare_new_machines,
        fresh=FRESH_MACHINES,
    ),
    Case(
        "model-estimates-smoke",
        "estimates",
        "the same on one machine",
        _on_root(check_model_estimates_smoke),
    ),
    Case(
        "peaks",
        "estimates",
        "± of peaks of frequency responses, and their accuracy when it is asked for, on three machines",
        _on_root(check_peaks),
        on_request=True,
    ),
    Case("peaks-smoke", "estimates", "± alone, on one machine", _on_root(check_peaks_smoke)),
    Case(
        "axes-estimates",
        "estimates",
        "± of volumetric maps and of paths against fine meshes, on five machines",
        _on_root(check_axes_estimates),
        on_request=True,
        draw=compare_new_axes,
        fresh=FRESH_AXES,
    ),
    Case(
        "axes-estimates-smoke",
        "estimates",
        "the same on one machine",
        _on_root(check_axes_smoke),
        on_request=True,
    ),
    Case(
        "contour-estimates",
        "estimates",
        "± of contours against fine meshes, on a machine looked at and one held out",
        _on_root(check_contour_estimates),
        on_request=True,
        draw=compare_new_contours,
        fresh=FRESH_CONTOURS,
    ),
    Case(
        "contour-estimates-smoke",
        "estimates",
        "the same of a short contour of one machine",
        _on_root(check_contour_smoke),
    ),
    Case(
        "model-choice",
        "estimates",
        "whether a stated accuracy is kept and at what cost, over 20 machines",
        _on_root(check_model_choice),
        on_request=True,
    ),
    Case(
        "part-choice",
        "estimates",
        "the same over ten parts alone",
        _on_root(check_part_choice),
        on_request=True,
    ),
    Case(
        "model-choice-smoke",
        "estimates",
        "`model-choice` on one machine",
        _on_root(check_model_choice_smoke),
    ),
    Case(
        "reduction-estimates",
        "estimates",
        "± of frequencies against unreduced machines",
        _on_root(check_frequency_estimates),
    ),
    Case(
        "reduction-estimates-step",
        "estimates",
        "± of a large STEP part's frequencies",
        _on_root(check_step_estimates),
    ),
    Case(
        "response-estimates",
        "estimates",
        "± of frequency responses against direct solves",
        _on_root(check_response_estimates),
    ),
    Case(
        "known-stiffnesses",
        "identification",
        "known stiffnesses found again from noisy data, 50 seeds",
        check_identification,
    ),
    Case(
        "rail-bases",
        "guideways",
        "splines, polynomials and frames as dofs of a rail",
        _on_root(check_rail_bases),
    ),
    Case(
        "flexible-interfaces",
        "interfaces",
        "beams, plates and blocks cut and joined again against one mesh",
        _on_root(check_flexible_interfaces),
        on_request=True,
    ),
    Case(
        "flexible-interfaces-smoke",
        "interfaces",
        "the same on a beam",
        _on_root(check_flexible_smoke),
    ),
    Case(
        "guideway",
        "guideways",
        "a table at 50 places of its rails against a model of its own at each",
        _on_root(check_guideway),
    ),
    Case(
        "path-test",
        "path",
        "the path test of Kono et al. with variants BE and YCE",
        _on_root(check_path_test),
    ),
    Case(
        "path-cross-check",
        "path",
        "a path by parallel-transported modes and by absolute coordinates",
        _on_root(check_path_methods),
    ),
    Case("rod-step", "time_response", "a rod under a suddenly applied force", check_rod_step),
    Case(
        "rod-peak",
        "time_response",
        "its sharp peak with 1200 modes",
        check_rod_peak,
        on_request=True,
    ),
    Case(
        "nafems-5t",
        "time_response",
        "NAFEMS 5T, deep beam under a suddenly applied load",
        check_transient_beam,
    ),
    Case(
        "nafems-5h",
        "frequency_response",
        "NAFEMS 5H, deep beam under a harmonic load",
        check_harmonic_beam,
    ),
    Case(
        "two-mass-drive",
        "drives",
        "a motor that drives a load, controlled, against closed forms",
        check_two_masses,
    ),
    Case(
        "sampled-control",
        "drives",
        "a sampled controller step by step beside its dead time",
        check_sampled_control,
    ),
    Case(
        "drive-friction",
        "drives",
        "sliding, sticking and slipping, and the balance of energy",
        check_friction,
    ),
    Case(
        "beam-truncation",
        "frequency_response",
        "share of a cantilever's tip compliance in its modes",
        check_beam_truncation,
    ),
    Case(
        "column-response",
        "frequency_response",
        "reduced column against direct solves of its whole model",
        check_column_response,
    ),
    Case(
        "three-axis-machine",
        "machines",
        "the shipped machine against a monolithic model of itself",
        check_three_axis_machine,
    ),
    Case(
        "axis-construction-kit",
        "axis_construction_kit",
        "table 3 and figures 17, 18 of Kono et al.",
        check_axis_kit,
    ),
    Case(
        "tripteor-lumped",
        "tripteor",
        "measured modes in three configurations and the lumped model",
        check_lumped_modes,
    ),
    Case(
        "tripteor-claims",
        "tripteor",
        "what the paper says of its model, confirmed or not",
        check_paper_statements,
    ),
    Case(
        "tripteor-elastic-legs",
        "tripteor",
        "measured modes in three configurations and elastic legs",
        check_elastic_legs,
    ),
    Case(
        "tripteor-leg-models",
        "tripteor",
        "elastic legs by three independent methods, stiff legs and the lumped model",
        check_leg_methods,
    ),
    Case(
        "tripteor-compliances",
        "tripteor",
        "what could be missing beside elastic legs, one after the other",
        check_compliances,
    ),
    Case(
        "tripteor-cost",
        "tripteor",
        "modes of one configuration and a map of 100 x 100",
        check_modal_cost,
    ),
    Case(
        "tripteor-contouring",
        "tripteor",
        "tool gap along x on the faces of the milled block",
        check_contouring,
    ),
    Case(
        "tripteor-contouring-nonlinear",
        "tripteor",
        "the start of the contour by the full equations",
        check_nonlinear_contour,
    ),
    Case(
        "tripteor-contour-whole",
        "tripteor",
        "the whole contour by the full equations",
        check_whole_nonlinear_contour,
        on_request=True,
    ),
    Case(
        "tripteor-stability",
        "tripteor",
        "limit depths of the contour face by face",
        check_contour_stability,
    ),
    Case(
        "tripteor-marks",
        "tripteor",
        "waviness and marks face by face: what marks one face and not the other",
        check_marks,
        on_request=True,
    ),
    Case(
        "milling-stability",
        "milling_stability",
        "multipliers and limit depths by independent methods",
        check_stability_methods,
    ),
    Case(
        "mechanism-derivatives",
        VERIFICATION,
        "Jacobians, bias and inertial forces by complex steps",
        check_mechanism_derivatives,
    ),
    Case(
        "exechon-inverse-kinematics",
        VERIFICATION,
        "the published table of 16 assemblies",
        check_inverse_kinematics,
    ),
    Case(
        "mirror-symmetry",
        VERIFICATION,
        "both sides of the plane of symmetry",
        check_mirror_symmetry,
    ),
    Case(
        "linear-limits",
        VERIFICATION,
        "small forces and small swings of the nonlinear equations",
        check_limits,
    ),
    Case(
        "three-models",
        VERIFICATION,
        "ODE, DAE and absolute coordinates in one instant",
        check_three_models,
    ),
    Case(
        "three-models-path",
        VERIFICATION,
        "ODE and absolute coordinates over 10 ms",
        check_common_path,
    ),
    Case("energy-balance", VERIFICATION, "energy gained is work put in", check_energy_balance),
    Case(
        "integration-orders",
        VERIFICATION,
        "generalised-α on ODE and index-3 DAE",
        check_integration_orders,
    ),
    Case(
        "singular-passage",
        VERIFICATION,
        "20 s to and fro over a singular pose",
        check_singular_passage,
    ),
    Case("constraint-drift", VERIFICATION, "open loops over 10 000 steps", check_constraint_drift),
    Case(
        "constraint-drift-million",
        VERIFICATION,
        "open loops over 1 000 000 steps",
        check_million_steps,
        on_request=True,
    ),
)


def _case_names() -> list[str]:
    """Return the names of all cases."""
    return [case.name for case in CASES]


def group_names() -> list[str]:
    """Return the names of all groups, in order."""
    return list(dict.fromkeys(case.group for case in CASES))


class UnknownCaseError(ValueError):
    """A case or group was asked for that does not exist; the message lists those that do (bad
    input, exit code 2).
    """


def select_cases(names: Sequence[str]) -> list[Case]:
    """Return the cases that names of cases or groups stand for, each once, in registry order; all
    when no name is given.

    A case that takes very long is run only under its own name.

    Raises:
        UnknownCaseError: A name is neither a case nor a group.
    """
    known = {*_case_names(), *group_names()}
    unknown = [name for name in names if name.lower() not in known]
    if unknown:
        hints = difflib.get_close_matches(unknown[0].lower(), sorted(known), n=1)
        hint = f" (did you mean {hints[0]!r}?)" if hints else ""
        raise UnknownCaseError(
            f"unknown validation case {unknown[0]!r}{hint}; groups: {', '.join(group_names())}; cases: {', '.join(_case_names())}"
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
    return _on_root(lambda: draw(seed))


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
    cases = select_cases(names)
    computations = [case.compute if seed is None else _from_seed(case, seed) for case in cases]
    for case, compute in zip(cases, computations, strict=True):
        try:
            found = compute(comm)
        except HeadstockError as error:
            found = [failed_computation(case.name, f"{type(error).__name__}: {error}")]
        if on_case is not None:
            on_case(case, found)
        rows += found
    return rows
