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

from common import present
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    CouplingKind,
    Interface,
    LinearSolver,
    Load,
    Material,
    Patch,
    ReductionSettings,
    Support,
)
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import CellKind, ComponentMesh, SurfaceGaps
from headstock.meshing.elements.quality import facet_places
from headstock.meshing.elements.surface import extract_surface
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.validation.parts.component_models import full_displacement, full_model, full_modes
from headstock.validation.parts.structured_meshes import lattice_mesh, straight_lattice

COMM = MPI.COMM_WORLD
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
OIL = Load("oil", "body", "pressure", (Patch("x+"),), magnitude=1e6)


def box(
    counts: Sequence[int], size: Sequence[float], kind: CellKind, **groups: str
) -> ComponentMesh:
    mesh = lattice_mesh(straight_lattice(counts, size), kind, straight=True)
    surface = extract_surface(mesh.cells, mesh.kind)
    centers = mesh.points[surface.facets[:, : surface.corners]].mean(axis=1)
    patches = {}
    for name, side in groups.items():
        axis = "xyz".index(side[0])
        level = 0.0 if side[1] == "-" else size[axis]
        patches[name.replace("__", ":")] = surface.facets[np.abs(centers[:, axis] - level) < 1e-9]
    return dataclasses.replace(mesh, patches=patches)


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
    component = Component(
        "body",
        Box((1.0, 1.0, 1.0)),
        STEEL,
        interfaces=interfaces,
        reduction=ReductionSettings(modes=count, solver=solver),
    )
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
    found[f"{name}.frequencies"] = np.sqrt(
        np.abs(scipy.linalg.eigvalsh(element.stiffness, element.mass))
    )[6:] / (2.0 * np.pi)
    free = np.arange(6, count)
    found[f"{name}.compliance"] = np.linalg.inv(element.stiffness[np.ix_(free, free)])[:6, :6]
    if element.errors.missing_energy is not None and element.errors.missing_energy.any():
        found[f"{name}.missing energy"] = element.errors.missing_energy[:12, :12]
    if element.errors.shape_stiffness is not None and element.errors.shape_mass is not None:
        found[f"{name}.shape stiffness"] = element.errors.shape_stiffness[:12, :12]
        found[f"{name}.shape mass"] = element.errors.shape_mass[:12, :12]
    found[f"{name}.mass"] = np.array(
        [element.mass_kg, *element.center_of_mass, *np.diag(element.inertia)]
    )
    if COMM.rank == 0:
        for load, vector in element.loads.items():
            answer = np.zeros(count)
            answer[6:] = np.linalg.solve(element.stiffness[np.ix_(free, free)], vector.vector[6:])
            found[f"{name}.moved by {load}"] = (
                present(element.recovery).basis @ answer + present(vector.particular).ravel()
            )


def main(path: Path, iterative: bool) -> None:
    found: dict[str, FloatArray] = {}
    column = box((2, 3, 8), (0.04, 0.1, 0.5), "tet10", foot="z-", tip="z+", load__oil="x+")
    oiled = column.patches["load:oil"]
    places = facet_places(column.points, oiled)
    gaps = SurfaceGaps(oiled, 1e-8 * (0.1 + places[:, :, 2]))
    column = dataclasses.replace(column, gaps=gaps)
    report("rigid", reduced(column, {"foot": "rigid", "tip": "rigid"}, 10, loads=(OIL,)), found)
    report(
        "average", reduced(column, {"foot": "average", "tip": "average"}, 10, loads=(OIL,)), found
    )
    mixed: dict[str, CouplingKind] = {"foot": "rigid", "tip": "average"}
    if iterative:
        report("iterative", reduced(column, mixed, 10, loads=(OIL,), solver="iterative"), found)
    report(
        "one cell",
        reduced(
            box((1, 1, 1), (0.1, 0.1, 0.1), "hex27", foot="z-", tip="z+"),
            {"foot": "rigid", "tip": "rigid"},
            9,
        ),
        found,
    )
    two = box((1, 1, 2), (0.1, 0.12, 0.2), "hex27", foot="z-", tip="z+")
    report("two cells", reduced(two, {"foot": "rigid", "tip": "average"}, 10_000), found)
    slide = (Support("slide", "body", (Patch("y-"),), ("y",)),)
    half = box((2, 2, 4), (0.1, 0.1, 0.3), "hex27", foot="z-", tip="z+", support__slide="y-")
    plane = reduced(half, {"foot": "average", "tip": "average"}, 5, slide)
    found["plane.frequencies"] = plane.modal_frequencies_hz
    square = box((2, 2, 5), (0.1, 0.1, 0.5), "hex27")
    model = full_model(square, STEEL, comm=COMM)
    modes = full_modes(model, 6)
    found["free.frequencies"] = modes.frequencies_hz
    below = 0.5 * (modes.frequencies_hz[1] + modes.frequencies_hz[2])
    found["free.count"] = np.array(
        [count_frequencies_below(model.operators, model.owned_fixed, below)]
    )
    # bending twins: only the plane they span is defined, so its projector is compared
    equals = model.everywhere(modes.shapes[:, :2]).reshape(-1, 2)
    found["free.plane"] = (equals @ equals.T)[:60, :60] / np.linalg.norm(equals) ** 2
    fixed = np.repeat((square.points[:, 2] < 1e-9)[:, None], 3, axis=1)
    loads = np.zeros((len(square.points), 3))
    loads[-1] = [1.0, 2.0, 3.0]
    found["fixed.displacement"] = full_displacement(
        full_model(square, STEEL, comm=COMM, fixed=fixed), loads
    )
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
