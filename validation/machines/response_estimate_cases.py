"""Estimates of what a mesh does to frequency responses, against far finer meshes."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import Component, MeshSettings, ReductionSettings
from headstock.geometry.parts.solids import HollowColumn
from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.results.estimates import DISCRETISATION
from headstock.pipeline.results.frf import PortFigures
from headstock.pipeline.stages.frf_errors import ResponseEstimate, add_figure_errors
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.mesh_errors import meshed_parts
from headstock.reduction.estimates.response_errors import ErrorSources, project_response
from headstock.reduction.estimates.response_errors_2 import bound_response_errors
from headstock.reduction.requests import ReductionRequest
from headstock.scene.building.loader import load_scene
from headstock.solvers.elastic.block_lanczos import ModeTarget
from headstock.solvers.linear.frequency_response import FrequencyResponse, evaluate_frf, prepare_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.system_ports import input_columns, output_rows
from headstock.validation.machines.accuracy_cases import CANTILEVER, LARGEST_FACTOR, LEAST_RANK
from headstock.validation.machines.estimate_cases import CLAMP
from headstock.validation.machines.estimate_cases_2 import CLEAR, ErrorPairs, join_pairs
from headstock.validation.machines.response_estimate_cases_2 import LINES, LOSS_FACTOR, PORTS
from headstock.validation.parts.beam_components import face_interface
from headstock.validation.parts.closed_form_cases import STEEL
from headstock.validation.references.rows import Target, ValidationRow, judge, show

CASE = "mesh-estimates-response"
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
            MeshSettings(size=0.025, cells="hex", order=1, force=True),
            MeshSettings(size=0.016, cells="tet", order=1, force=True),
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


@dataclass(frozen=True, eq=False)
class _Found:
    """Response of one mesh: nine entries per line, and the most negative real part at each port, with their errors."""

    lines: FrequencyResponse
    changes: FloatArray
    depths: FloatArray
    depth_errors: FloatArray


def check_mesh_response_estimates(comm: MPI.Comm) -> list[ValidationRow]:
    """Estimated against true errors of nine responses per line, and of the most negative real parts, over kinds and sizes of elements."""
    rows: list[ValidationRow] = []
    if comm.rank == 0:
        parts = [compare_meshes(machine, *MESHES[machine.name]) for machine in (_cantilever(), _hollow_column())]
        for name, found in zip(MESHES, parts, strict=True):
            rows += [_report(f"{name}, {what}", pairs) for what, pairs in found.items()]
        for what in parts[0]:
            rows += _judge(what, join_pairs([found[what] for found in parts]))
    return list(comm.bcast(rows, root=0))


def compare_meshes(machine: Machine, fine: MeshSettings, meshes: Sequence[MeshSettings]) -> dict[str, ErrorPairs]:
    """True and estimated errors of lines, over the largest entry of a line, and of most negative real parts."""
    exact = _reduced(machine, fine)
    modes = solve_modal(exact.system, count=12)
    elastic = modes.frequencies_hz[modes.rigid_count :]
    ends = [(elastic[k], elastic[k + 1] - elastic[k] if share > 0.0 else elastic[k], share) for k, share in LINES]
    places = np.array([0.0, *(start + share * width for start, width, share in ends)])
    right = _respond(exact, places)
    sizes = np.abs(right.lines.receptance).max(axis=(1, 2), keepdims=True)
    lines, direct, depths = [], [], []
    for mesh in meshes:
        found = _respond(_reduced(machine, mesh), places)
        pair = np.abs(found.lines.receptance - right.lines.receptance) / sizes, found.changes / sizes
        lines.append(ErrorPairs(pair[0].ravel(), pair[1].ravel()))
        direct.append(ErrorPairs(*(np.diagonal(each, axis1=1, axis2=2).ravel() for each in pair)))
        depths.append(ErrorPairs(np.abs(found.depths / right.depths - 1.0), np.abs(found.depth_errors / right.depths)))
    return {"lines": join_pairs(lines), "lines along the load": join_pairs(direct), "most negative real part": join_pairs(depths)}


def _cantilever() -> Machine:
    return dataclasses.replace(load_scene(CANTILEVER).machine, name="cantilever")


def _hollow_column() -> Machine:
    """Walls of 12 mm on a stiff spring."""
    interfaces = {"foot": face_interface("foot", "z-", "rigid"), "tip": face_interface("tip", "z+", "average")}
    solid = HollowColumn((0.20, 0.24, 0.70), 0.012, 0.015, 0.01, ribs_z=2)
    column = Component("column", solid, STEEL, interfaces=interfaces, reduction=ReductionSettings(modes=0))
    joints = {"clamp": Joint("clamp", (JointEnd(), JointEnd("column", "foot")), "spring", stiffness=0.2 * CLAMP)}
    return Machine("hollow column", {"column": column}, joints, {"tcp": Point("tcp", JointEnd("column", "tip"), JointEnd())})


def _reduced(machine: Machine, settings: MeshSettings) -> CoupledMachine:
    column = dataclasses.replace(machine.components["column"], mesh=settings)
    request = ReductionRequest(ModeTarget(count=MODES))
    element = reduce_elastic(column, mesh_component(column), comm=MPI.COMM_SELF, request=request)
    changed = dataclasses.replace(machine, components={"column": column})
    return couple({"column": element}, changed, Pose("reference"))


def _respond(coupled: CoupledMachine, places: FloatArray) -> _Found:
    modes = solve_modal(coupled.system)
    lossy = dataclasses.replace(coupled.system, damping=None, hysteretic=LOSS_FACTOR * coupled.system.stiffness)
    model = prepare_frf(lossy, inputs=PORTS, outputs=PORTS, modes=modes)
    ports = (input_columns(lossy, PORTS), output_rows(lossy, PORTS))
    sources = ErrorSources(meshed=meshed_parts(coupled), loss_factors={"column": LOSS_FACTOR})
    space = project_response(lossy, sources, modes, ports, REACH * places.max())
    lines, grid = (evaluate_frf(model, hz) for hz in (places, np.linspace(0.0, REACH * places.max(), GRID)))
    errors = [bound_response_errors(space, response.frequencies_hz) for response in (lines, grid)]
    changes = [np.zeros(lines.receptance.shape) if found.mesh is None else np.abs(found.mesh) for found in errors]
    figures = []
    for number, port in enumerate(PORTS):
        real = grid.receptance[:, number, number].real
        deepest = int(np.argmin(real))
        hz = float(grid.frequencies_hz[deepest])
        figures.append(PortFigures(port, None, float(real[deepest]), hz, None, None, None, "", None))
    judged = add_figure_errors(tuple(figures), grid, ResponseEstimate(errors[1], space, ()))
    return _Found(
        lines,
        changes[0],
        np.array([own.worst_real for own in judged]),
        np.array([own.worst_real_error_share.get(DISCRETISATION, np.nan) for own in judged]),
    )


def _judge(what: str, pairs: ErrorPairs) -> list[ValidationRow]:
    clear = pairs.clear
    ratios = pairs.estimated[clear] / pairs.true[clear]
    middle = float(np.median(ratios))
    rank = float(scipy.stats.spearmanr(pairs.estimated[clear], pairs.true[clear]).statistic)
    factor = Target(1.0, "-", LARGEST_FACTOR - 1.0, "converged 3D")
    note = f"effectivity {middle:.2f}; {clear.sum()} errors above {CLEAR:g}"
    return [
        judge(CASE, f"{what}: estimated over true error, median, as a factor", max(middle, 1.0 / middle), factor, note),
        judge(CASE, f"{what}: rank correlation", rank, Target(1.0, "-", 1.0 - LEAST_RANK, "converged 3D")),
    ]


def _report(name: str, pairs: ErrorPairs) -> ValidationRow:
    clear = pairs.clear
    low, middle, high = np.quantile(pairs.estimated[clear] / pairs.true[clear], [0.1, 0.5, 0.9])
    note = f"10 .. 90 %: {low:.2f} .. {high:.2f}; {clear.sum()} of {len(clear)} errors, up to {pairs.true.max():.2g}"
    return show(CASE, f"{name}: effectivity, median", float(middle), "-", note)
