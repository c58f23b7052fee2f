"""How often what stands behind ± covers the truth at probes: displacement, stress and equivalent
stress at places inside and on parts of many kinds, under forces and under a body load.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, Probe
from headstock.geometry.parts.components import Load, Material, MeshSettings
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.surface import extract_surface
from headstock.meshing.elements.topology import corner_count
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.probes import missing_of_loads, place_probe
from headstock.reduction.estimates.static_errors import (
    MOVED,
    SEEN,
    WHOLE,
    RestErrors,
    bound_von_mises,
    estimate_at_rest,
)
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.elastic.stress_recovery import find_point_rows
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.mpi import MPI
from headstock.solvers.stresses import largest_von_mises
from headstock.validation.coverage.cases import part_texts
from headstock.validation.coverage.coverage_case import (
    CHANNELS,
    SURE,
    UNSURE,
    CoverageCase,
    CoverageSuite,
)
from headstock.validation.coverage.parts import CoveragePart, draw_part
from headstock.validation.references.rows import ValidationRow, show

SMOKE_PARTS = (14,)
PLACES = 4  # inside, and as many on the surface
BODY_LOAD = Load("own", "part", "body", vector=(3.0, 4.0, -9.0))
QUANTITIES = ("displacement", "stress", "equivalent stress")
CLEAR = (1e-4, 1e-3, 1e-3)  # true errors above which a ratio means something
LARGEST_MEDIAN = (3.0, 4.0, 3.0)  # of ± over the true error


@dataclass(frozen=True, eq=False)
class _ProbeCoverage:
    """Numbers at the probes of one part on its meshes, displacements over the largest one at
    any of its probes under the same load, stresses over the equivalent stress.

    Attributes:
        quantities: ``(n,)`` which of ``QUANTITIES``.
        errors: ``(n,)`` true errors.
        estimates: ``(n,)`` what stands behind ±; NaN for ``± ?``.
        unsure: ``(n,)`` how well the truth is known.
        failure: What ended the computation of a mesh, empty for nothing.
    """

    seed: int
    kind: str
    quantities: FloatArray
    errors: FloatArray
    estimates: FloatArray
    unsure: FloatArray
    failure: str = ""


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a probe sees of each of ``k`` loads on one mesh.

    Attributes:
        values: ``(10, k)`` displacement, stress, equivalent stress.
        errors: ``(10, k)`` what stands behind ±.
        corrected: ``(10, k)`` the values with the signed estimates of displacements, and with recovered
            stresses.
        doubts: ``(10, k)`` how far these may be off.
    """

    values: FloatArray
    errors: FloatArray
    corrected: FloatArray
    doubts: FloatArray


def _measure_probes(part: CoveragePart) -> _ProbeCoverage:
    """Errors and estimates at the probes of a part on each of its meshes."""
    mesh = _mesh(part, part.reference)
    probes = _draw_places(mesh, np.random.default_rng([20261125, part.seed]))
    right = _solve(part, part.reference, mesh, probes)
    largest = np.max(
        [np.abs(seen.corrected[:MOVED]).max(axis=0) for seen in right.values()], axis=0
    )
    tables, failures = [], []
    for settings in part.meshes:
        try:
            solved = _solve(part, settings, _mesh(part, settings), probes)
        except HeadstockError as error:
            failures.append(f"{type(error).__name__}: {error}")
            continue
        tables += [
            _compare(seen, right[name], largest) for name, seen in solved.items() if name in right
        ]
    rows = np.concatenate([np.zeros((4, 0)), *tables], axis=1)
    return _ProbeCoverage(
        part.seed, part.kind, rows[0], rows[1], rows[2], rows[3], "; ".join(failures)
    )


def _draw_places(mesh: ComponentMesh, random: np.random.Generator) -> tuple[Probe, ...]:
    """Places in random cells and on random facets of a mesh."""
    surface = extract_surface(mesh.cells, mesh.kind)
    chosen = [
        ("inside", mesh.cells[:, : corner_count(mesh.kind)]),
        ("face", surface.facets[:, : surface.corners]),
    ]
    found = []
    for what, corners in chosen:
        for number, row in enumerate(random.choice(len(corners), PLACES)):
            shares = random.dirichlet(np.full(corners.shape[1], 2.0))
            x, y, z = shares @ mesh.points[corners[row]]
            found.append(Probe(f"{what} {number}", "part", (float(x), float(y), float(z))))
    return tuple(found)


def _mesh(part: CoveragePart, settings: MeshSettings) -> ComponentMesh:
    body = dataclasses.replace(part.machine.components["part"], mesh=settings)
    return mesh_component(body)


def _solve(
    part: CoveragePart, settings: MeshSettings, mesh: ComponentMesh, probes: Sequence[Probe]
) -> dict[str, _Seen]:
    """Return what probes see on a mesh; those outside it, near curved faces, are left out."""
    body = dataclasses.replace(part.machine.components["part"], mesh=settings)
    own = {probe.name: probe for probe in probes if _holds(mesh, body.material, probe)}
    loads = {BODY_LOAD.name: BODY_LOAD}
    element = reduce_elastic(
        body, mesh, (), (BODY_LOAD,), comm=MPI.COMM_SELF, request=ReductionRequest(),
        probes=tuple(own.values()),
    )  # fmt: skip
    machine = dataclasses.replace(part.machine, loads=loads, probes=own)
    coupled = couple({"part": element}, machine, Pose("reference"))
    forces = [coupled.system.inputs[channel] for channel in CHANNELS]
    given = np.column_stack([*forces, coupled.loads[BODY_LOAD.name]])
    moved = solve_static(coupled.system, given).displacements
    inside = missing_of_loads(coupled, machine, None)
    found = {}
    for name, probe in own.items():
        placed = place_probe(coupled, machine, probe, None)
        columns = []
        for column in range(given.shape[1]):
            motion = moved[:, column]
            # the probe knows of the body load wherever it acts
            acts = column == len(CHANNELS)
            seen = placed if acts else dataclasses.replace(placed, loads={})
            errors = estimate_at_rest(coupled, seen, motion, inside if acts else {})
            values = seen.values @ motion
            for load in seen.loads.values():
                values = values + load.values
            columns.append(_measure_place(values, errors, element.errors.mesh_safety))
        found[name] = _Seen(*np.array(columns).transpose(1, 2, 0))
    return found


def _measure_place(values: FloatArray, errors: RestErrors, safety: float) -> list[FloatArray]:
    """Rows ``(10,)`` of ``_Seen`` of displacement and stress ``(9,)``."""
    total = errors.meshes["part"] + errors.faces.get("part", np.zeros(SEEN))
    mises = sum(bound_von_mises(values[MOVED:], errors))
    product = errors.products["part"].copy()
    product[:MOVED] /= safety
    recovered = values[MOVED:] + errors.local[0]
    corrected = np.concatenate([(values + product)[:MOVED], recovered])
    around = np.linalg.norm(errors.local, axis=0)
    doubts = np.abs(product) + np.concatenate([np.full(MOVED, errors.moved), around])
    return [
        np.append(values, largest_von_mises(values[MOVED:])),
        np.append(total, mises),
        np.append(corrected, largest_von_mises(recovered)),
        UNSURE * np.append(doubts, mises / WHOLE),
    ]


def _compare(seen: _Seen, right: _Seen, largest: FloatArray) -> FloatArray:
    """Rows ``(4, n)``: quantity, true error, estimate and what is not known of the truth, over the
    largest displacement ``(k,)`` or the equivalent stress.
    """
    count = seen.values.shape[1]
    scales = np.vstack([np.tile(largest, (MOVED, 1)), np.tile(right.corrected[-1], (SEEN - 2, 1))])
    which = np.repeat([0.0, 1.0, 2.0], [MOVED, SEEN - MOVED, 1])
    rows = (np.abs(seen.values - right.corrected), seen.errors, right.doubts)
    return np.array([np.repeat(which, count), *((row / scales).ravel() for row in rows)])


def _holds(mesh: ComponentMesh, material: Material, probe: Probe) -> bool:
    try:
        find_point_rows(mesh, material, np.array(probe.position))
    except ModelError:
        return False
    return True


def _evaluate(what: str, parts: Sequence[_ProbeCoverage]) -> Iterator[ValidationRow]:
    for number, quantity in enumerate(QUANTITIES):
        errors, estimates, unsure = (
            np.concatenate([getattr(part, name)[part.quantities == number] for part in parts])
            for name in ("errors", "estimates", "unsure")
        )
        silent = np.isnan(estimates)
        known = ~silent & (unsure <= SURE * estimates)
        note = (
            f"{known.sum()} numbers of {len(parts)} parts; {silent.sum()} say ± ?, of {(~known & ~silent).sum()} the truth is not sure"
            f" enough; {sum(bool(part.failure) for part in parts)} parts with a mesh that failed"
        )
        suite = CoverageCase(CLEAR[number], LARGEST_MEDIAN[number])
        yield from suite.evaluate(f"{what}, {quantity}", errors[known], estimates[known], note)
        yield show(f"{what}, {quantity}: true error, median", np.median(errors[known]), "-")


SUITE = CoverageSuite(
    lambda seed, scratch: _measure_probes(draw_part(seed, scratch.folder)),
    _ProbeCoverage,
    part_texts(__file__),
    _evaluate,
)
