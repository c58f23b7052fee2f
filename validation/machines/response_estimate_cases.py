"""Error estimates of frequency responses against direct solves of unreduced machines and against
far finer meshes.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from scipy.sparse.linalg import splu

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import Component, MeshSettings, ReductionSettings
from headstock.geometry.parts.solids import HollowColumn
from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.answers.frf import DrivePointFigures
from headstock.pipeline.numbers.estimates import DISCRETISATION
from headstock.pipeline.stages.frf import ResponseEstimate, estimate_figures
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.mesh_errors import meshed_parts
from headstock.reduction.estimates.response_errors import bound_response_errors
from headstock.reduction.requests import ReductionRequest
from headstock.scene.building.loader import load_scene
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.linear.frequency_response import FrequencyResponse, evaluate_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.mpi import MPI
from headstock.solvers.second_order import ComplexArray
from headstock.validation.coverage.coverage_case import CHANNELS, prepare_responses
from headstock.validation.machines.accuracy_cases import CANTILEVER, LARGEST_FACTOR, LEAST_RANK
from headstock.validation.machines.estimate_cases import (
    CLAMP,
    CLEAR,
    SHIFT_HZ,
    ErrorPairs,
    Specimen,
    clamped_beam,
    evaluate_pairs,
    free_pair,
    guideway,
    join_pairs,
    keep_fewer,
    patched_column,
    reduce_specimen,
    report_coverage,
    ribbed_plate,
    unreduced,
)
from headstock.validation.machines.monolithic_machines import (
    MonolithicMachine,
    monolithic_frequencies,
)
from headstock.validation.parts.closed_form_cases import STEEL, face_interface
from headstock.validation.references.rows import Target, ValidationRow, compare_value, show

MODE_COUNTS = (3, 6, 12, 24, 48)
LOSS_FACTOR = 0.04
WATCHED = 10
# (place among the elastic frequencies, share of the way to the next): beside, on and between
# resonances
LINES = ((0, -0.5), (0, 0.0), (0, 0.02), (1, 0.5), (2, -0.03), (3, 0.01), (4, 0.4))
SPECIMENS = (clamped_beam, free_pair, patched_column, ribbed_plate, guideway)
MODES = 40
GRID = 600  # lines over which the most negative real part is sought
REACH = 1.3  # of the highest line
# far finer than the finest that is judged, and those
MESHES = {
    "cantilever": (
        MeshSettings(size=0.010, cells="hex"),
        (
            MeshSettings(size=0.050, cells="hex"),
            MeshSettings(size=0.025, cells="hex"),
            MeshSettings(size=0.038, cells="tet"),
            MeshSettings(size=0.020, cells="tet"),
            MeshSettings(size=0.025, cells="hex", order=1, allow_locking=True),
            MeshSettings(size=0.016, cells="tet", order=1, allow_locking=True),
        ),
    ),
    "hollow column": (
        MeshSettings(size=0.025, cells="tet"),
        (
            MeshSettings(size=0.15, cells="tet"),
            MeshSettings(size=0.10, cells="tet"),
            MeshSettings(size=0.07, cells="tet"),
            MeshSettings(size=0.05, cells="tet"),
        ),
    ),
}


def check_response_estimates() -> Iterator[ValidationRow]:
    """Bounds of the reduction error of nine responses per line on five machines, by number of
    modes.
    """
    found = []
    for make in SPECIMENS:
        specimen = make()
        pairs = _compare_responses(specimen, LINES)
        yield report_coverage(specimen.name, pairs)
        found.append(pairs)
    yield from evaluate_pairs("all lines", join_pairs(found))


def _compare_responses(specimen: Specimen, lines: tuple[tuple[int, float], ...]) -> ErrorPairs:
    """True and estimated errors of nine entries per line, over the largest entry of the line, for
    every number of modes.
    """
    model = unreduced(specimen)
    exact = monolithic_frequencies(model, WATCHED + 6, shift_hz=SHIFT_HZ)
    elastic = exact[exact > 1e-3 * exact[-1]]
    places = np.array(
        [
            elastic[k] + share * (elastic[k + 1] - elastic[k] if share > 0.0 else elastic[k])
            for k, share in lines
        ]
    )
    whole = reduce_specimen(specimen, max(MODE_COUNTS))
    right = np.array([_direct_response(model, hz) for hz in places])
    sizes = np.abs(right).max(axis=(1, 2), keepdims=True)
    pairs = []
    for count in MODE_COUNTS:
        parts = {
            name: keep_fewer(element, count) for name, element in whole.items()
        } | specimen.rigid
        coupled = couple(parts, specimen.machine, specimen.pose)
        modes = solve_modal(coupled.system)
        prepared, space = prepare_responses(
            coupled, modes, loss_factor=LOSS_FACTOR, highest_hz=float(places.max())
        )
        found = evaluate_frf(prepared, places).receptance
        errors = bound_response_errors(space, places)
        pairs.append(
            ErrorPairs((np.abs(found - right) / sizes).ravel(), (errors.bounds / sizes).ravel())
        )
    return join_pairs(pairs)


def _direct_response(model: MonolithicMachine, hz: float) -> ComplexArray:
    """Receptance ``(3, 3)`` at the tool by one sparse factorisation, one loss factor throughout."""
    rows: FloatArray = model.points["tcp"].toarray()[:3]
    dynamic = (1.0 + 1j * LOSS_FACTOR) * model.stiffness - (2.0 * np.pi * hz) ** 2 * model.mass
    # the loss factor keeps all pivots away from zero; PETSc's scalars are real
    factor = splu(
        dynamic.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return rows @ factor.solve(rows.T.astype(complex))


@dataclass(frozen=True, eq=False)
class _Found:
    """Response of one mesh: nine entries per line, and the most negative real part at each port,
    with their errors.
    """

    lines: FrequencyResponse
    changes: FloatArray
    depths: FloatArray
    depth_errors: FloatArray


def check_mesh_response_estimates() -> Iterator[ValidationRow]:
    """Estimated against true errors of nine responses per line, and of the most negative real
    parts, over kinds and sizes of elements.
    """
    parts = []
    for machine in (
        dataclasses.replace(load_scene(CANTILEVER).machine, name="cantilever"),
        _hollow_column(),
    ):
        fine, meshes = MESHES[machine.name]
        parts.append(_compare_meshes(machine, fine, meshes))
    for name, found in zip(MESHES, parts, strict=True):
        yield from [_report(f"{name}, {what}", pairs) for what, pairs in found.items()]
    for what in parts[0]:
        yield from _evaluate(what, join_pairs([found[what] for found in parts]))


def _compare_meshes(
    machine: Machine, fine: MeshSettings, meshes: Sequence[MeshSettings]
) -> dict[str, ErrorPairs]:
    """True and estimated errors of lines, over the largest entry of a line, and of most negative
    real parts.

    Args:
        fine: Mesh whose response counts as true.
        meshes: Coarser ones, whose errors are estimated.
    """
    exact = _reduced(machine, fine)
    modes = solve_modal(exact.system, count=12)
    elastic = modes.frequencies_hz[modes.rigid_count :]
    ends = [
        (elastic[k], elastic[k + 1] - elastic[k] if share > 0.0 else elastic[k], share)
        for k, share in LINES
    ]
    places = np.array([0.0, *(start + share * width for start, width, share in ends)])
    right = _respond(exact, places)
    sizes = np.abs(right.lines.receptance).max(axis=(1, 2), keepdims=True)
    lines, direct, depths = [], [], []
    for mesh in meshes:
        found = _respond(_reduced(machine, mesh), places)
        true = np.abs(found.lines.receptance - right.lines.receptance) / sizes
        estimated = found.changes / sizes
        along, foreseen = (np.diagonal(each, axis1=1, axis2=2) for each in (true, estimated))
        lines.append(ErrorPairs(true.ravel(), estimated.ravel()))
        direct.append(ErrorPairs(along.ravel(), foreseen.ravel()))
        depths.append(
            ErrorPairs(
                np.abs(found.depths / right.depths - 1.0), np.abs(found.depth_errors / right.depths)
            )
        )
    return {
        "lines": join_pairs(lines),
        "lines along the load": join_pairs(direct),
        "most negative real part": join_pairs(depths),
    }


def _hollow_column() -> Machine:
    """Walls of 12 mm on a stiff spring."""
    interfaces = {
        "foot": face_interface("foot", "z-", "rigid"),
        "tip": face_interface("tip", "z+", "average"),
    }
    solid = HollowColumn((0.20, 0.24, 0.70), 0.012, 0.015, 0.01, ribs_z=2)
    column = Component(
        "column", solid, STEEL, interfaces=interfaces, reduction=ReductionSettings(modes=0)
    )
    joints = {
        "clamp": Joint(
            "clamp", (JointEnd(), JointEnd("column", "foot")), "spring", stiffness=0.2 * CLAMP
        )
    }
    return Machine(
        "hollow column",
        {"column": column},
        joints,
        {"tcp": Point("tcp", JointEnd("column", "tip"), JointEnd())},
    )


def _reduced(machine: Machine, settings: MeshSettings) -> CoupledMachine:
    column = dataclasses.replace(machine.components["column"], mesh=settings)
    request = ReductionRequest(ModeTarget(count=MODES))
    element = reduce_elastic(column, mesh_component(column), comm=MPI.COMM_SELF, request=request)
    # as estimated, without the factor that covers 95 %: `validate coverage` judges that
    errors = dataclasses.replace(element.errors, mesh_safety=1.0)
    element = dataclasses.replace(element, errors=errors)
    changed = dataclasses.replace(machine, components={"column": column})
    return couple({"column": element}, changed, Pose("reference"))


def _respond(coupled: CoupledMachine, places: FloatArray) -> _Found:
    model, space = prepare_responses(
        coupled,
        solve_modal(coupled.system),
        loss_factor=LOSS_FACTOR,
        highest_hz=REACH * float(places.max()),
        truncated={},
        meshed=meshed_parts(coupled),
    )
    lines, grid = (
        evaluate_frf(model, hz) for hz in (places, np.linspace(0.0, REACH * places.max(), GRID))
    )
    errors = [bound_response_errors(space, response.frequencies_hz) for response in (lines, grid)]
    changes = [
        np.zeros(lines.receptance.shape) if found.mesh is None else np.abs(found.mesh)
        for found in errors
    ]
    figures = []
    for number, channel in enumerate(CHANNELS):
        real = grid.receptance[:, number, number].real
        deepest = int(np.argmin(real))
        hz = float(grid.frequencies_hz[deepest])
        figures.append(
            DrivePointFigures(channel, None, float(real[deepest]), hz, None, None, None, "", None)
        )
    known = estimate_figures(tuple(figures), grid, ResponseEstimate(errors[1], space, ()))
    return _Found(
        lines,
        changes[0],
        np.array([own.most_negative_real for own in figures]),
        np.array(
            [
                known[own.channel].shares[DISCRETISATION] if own.channel in known else np.nan
                for own in figures
            ]
        ),
    )


def _evaluate(what: str, pairs: ErrorPairs) -> list[ValidationRow]:
    clear = pairs.clear
    ratios = pairs.estimated[clear] / pairs.true[clear]
    middle = float(np.median(ratios))
    rank = float(scipy.stats.spearmanr(pairs.estimated[clear], pairs.true[clear]).statistic)
    factor = Target(1.0, "-", LARGEST_FACTOR - 1.0, "converged 3D")
    note = f"effectivity {middle:.2f}; {clear.sum()} errors above {CLEAR:g}"
    return [
        compare_value(
            f"{what}: estimated over true error, median, as a factor",
            max(middle, 1.0 / middle),
            factor,
            note,
        ),
        compare_value(
            f"{what}: rank correlation", rank, Target(1.0, "-", 1.0 - LEAST_RANK, "converged 3D")
        ),
    ]


def _report(name: str, pairs: ErrorPairs) -> ValidationRow:
    clear = pairs.clear
    low, middle, high = np.quantile(pairs.estimated[clear] / pairs.true[clear], [0.1, 0.5, 0.9])
    note = f"10 .. 90 %: {low:.2f} .. {high:.2f}; {clear.sum()} of {len(clear)} errors, up to {pairs.true.max():.2g}"
    return show(f"{name}: effectivity, median", middle, "-", note)
