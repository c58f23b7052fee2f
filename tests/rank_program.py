"""Reduces small bodies on however many ranks there are and writes what came out; run by
test_ranks.py under mpirun.
"""

import dataclasses
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.linalg
from mpi4py import MPI

from common import STEEL, make_box, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    CouplingKind,
    Interface,
    LinearSolver,
    Load,
    Patch,
    ReductionSettings,
    Support,
)
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh, SurfaceGaps
from headstock.meshing.elements.quality import facet_places
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.validation.parts.component_models import full_displacement, full_model, full_modes

COMM = MPI.COMM_WORLD
ENDS = {"foot": "z-", "tip": "z+"}
OIL = Load("oil", "body", "pressure", (Patch("x+"),), magnitude=1e6)


def reduced(
    mesh: ComponentMesh,
    couplings: Mapping[str, CouplingKind],
    count: int,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    gravity: bool = True,
    solver: LinearSolver = "auto",
) -> Superelement:
    interfaces = {
        name: Interface(name, (Patch("z+"),), coupling) for name, coupling in couplings.items()
    }
    settings = ReductionSettings(modes=count, solver=solver)
    solid = Box((1.0, 1.0, 1.0))
    component = Component("body", solid, STEEL, interfaces=interfaces, reduction=settings)
    request = ReductionRequest(ModeTarget(count=count), gravity=gravity)
    mine = mesh if COMM.rank == 0 else None
    element = reduce_elastic(component, mine, supports, loads, comm=COMM, request=request)
    check_superelement(element)
    return element


def report(name: str, element: Superelement, found: dict[str, FloatArray]) -> None:
    """Frequencies, static response of the second interface with the first fixed, mass, and recovered
    points on rank 0.
    """
    count = len(element.stiffness)
    values = np.abs(scipy.linalg.eigvalsh(element.stiffness, element.mass))[6:]
    found[f"{name}.frequencies"] = np.sqrt(values) / (2.0 * np.pi)
    free = np.arange(6, count)
    found[f"{name}.compliance"] = np.linalg.inv(element.stiffness[np.ix_(free, free)])[:6, :6]
    if element.errors.missing_energy is not None and element.errors.missing_energy.any():
        found[f"{name}.missing energy"] = element.errors.missing_energy[:12, :12]
    if element.errors.shape_stiffness is not None and element.errors.shape_mass is not None:
        found[f"{name}.shape stiffness"] = element.errors.shape_stiffness[:12, :12]
        found[f"{name}.shape mass"] = element.errors.shape_mass[:12, :12]
    masses = [element.mass_kg, *element.center_of_mass, *np.diag(element.inertia)]
    found[f"{name}.mass"] = np.array(masses)
    if COMM.rank == 0:
        for load, vector in element.loads.items():
            answer = np.zeros(count)
            answer[6:] = np.linalg.solve(element.stiffness[np.ix_(free, free)], vector.vector[6:])
            moved = present(element.recovery).basis @ answer
            found[f"{name}.moved by {load}"] = moved + present(vector.particular).ravel()


def main(path: Path, iterative: bool) -> None:
    found: dict[str, FloatArray] = {}
    column = make_box((2, 3, 8), (0.04, 0.1, 0.5), {**ENDS, "load:oil": "x+"}, kind="tet10")
    oiled = column.patches["load:oil"]
    places = facet_places(column.points, oiled)
    gaps = SurfaceGaps(oiled, 1e-8 * (0.1 + places[:, :, 2]))
    column = dataclasses.replace(column, gaps=gaps)
    mixed: dict[str, CouplingKind] = {"foot": "rigid", "tip": "average"}
    rigid: dict[str, CouplingKind] = dict.fromkeys(ENDS, "rigid")
    average: dict[str, CouplingKind] = dict.fromkeys(ENDS, "average")
    report("rigid", reduced(column, rigid, 10, loads=(OIL,)), found)
    report("average", reduced(column, average, 10, loads=(OIL,)), found)
    if iterative:
        report("iterative", reduced(column, mixed, 10, loads=(OIL,), solver="iterative"), found)
    cell = make_box((1, 1, 1), (0.1, 0.1, 0.1), ENDS)
    report("one cell", reduced(cell, rigid, 9), found)
    two = make_box((1, 1, 2), (0.1, 0.12, 0.2), ENDS)
    report("two cells", reduced(two, mixed, 10_000), found)
    slide = (Support("slide", "body", (Patch("y-"),), ("y",)),)
    half = make_box((2, 2, 4), (0.1, 0.1, 0.3), {**ENDS, "support:slide": "y-"})
    plane = reduced(half, average, 5, slide)
    found["plane.frequencies"] = plane.modal_frequencies_hz
    square = make_box((2, 2, 5), (0.1, 0.1, 0.5))
    model = full_model(square, STEEL, comm=COMM)
    modes = full_modes(model, 6)
    found["free.frequencies"] = modes.frequencies_hz
    below = 0.5 * (modes.frequencies_hz[1] + modes.frequencies_hz[2])
    count = count_frequencies_below(model.operators, model.owned_fixed, below)
    found["free.count"] = np.array([count])
    # bending twins: only the plane they span is defined, so its projector is compared
    equals = model.everywhere(modes.shapes[:, :2]).reshape(-1, 2)
    found["free.plane"] = (equals @ equals.T)[:60, :60] / np.linalg.norm(equals) ** 2
    fixed = np.repeat((square.points[:, 2] < 1e-9)[:, None], 3, axis=1)
    loads = np.zeros((len(square.points), 3))
    loads[-1] = [1.0, 2.0, 3.0]
    held = full_model(square, STEEL, comm=COMM, fixed=fixed)
    found["fixed.displacement"] = full_displacement(held, loads)
    if COMM.rank == 0:
        np.savez(path, allow_pickle=False, **found)


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]), sys.argv[2:] == ["iterative"])
    except BaseException:
        # one rank's failure must not leave the others waiting
        traceback.print_exc()
        sys.stderr.flush()
        COMM.Abort(1)
