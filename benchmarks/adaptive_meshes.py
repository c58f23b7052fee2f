"""A STEP part meshed by where its error lies, beside even and graded meshes of it.

./headstock exec python3 benchmarks/adaptive_meshes.py [PERCENT ...]

The bracket of ``tests/data/support.step``, fixed at its flange: four natural frequencies and three
compliances of its bore. Errors are relative, of the worst number; the true ones are taken from a mesh
that is finer than all others.
"""

import dataclasses
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.linalg
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    MeshSettings,
    Patch,
)
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.error_sizes import spread_error
from headstock.meshing.size_field import SizeField
from headstock.reduction.components.elastic import find_cell_errors, reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.elastic.eigenpairs import ModeTarget

PART = Path(__file__).resolve().parent.parent / "tests" / "data" / "support.step"
SUPPORT = Component(
    "support",
    StepFile(PART),
    Material("aluminium", 70e9, 0.33, 2700.0),
    interfaces={
        "flange": Interface("flange", (Patch("z+"),)),
        "bore": Interface("bore", (Patch("face:12"), Patch("face:22")), "average"),
    },
)
FIRST_SIZE, REFERENCE = 12e-3, MeshSettings(size=2e-3, growth=0.25, rim_size=0.25e-3)
EVEN_SIZES = (12e-3, 8e-3, 6e-3, 4e-3)
GRADED_SIZES = ((12e-3, 1.5e-3), (8e-3, 1e-3), (5e-3, 0.5e-3))
FREQUENCIES, MODES, ROUNDS = 4, 20, 2


@dataclasses.dataclass(frozen=True, eq=False)
class Answer:
    """What one mesh gives.

    Attributes:
        mesh: The mesh.
        numbers: ``(7,)`` squares of frequencies and inverse compliances, which meshes make too
            large.
        cells: ``(n_cells, 7)`` estimated share of each that each cell adds.
        seconds: Processor time of mesh and superelement [s].
    """

    mesh: ComponentMesh
    numbers: FloatArray
    cells: FloatArray
    seconds: float

    @property
    def estimate(self) -> float:
        """Of the worst frequency or compliance."""
        halves = np.where(np.arange(len(self.numbers)) < FREQUENCIES, 0.5, 1.0)
        return float((halves * self.cells.sum(axis=0)).max())

    def true_error(self, reference: "Answer") -> float:
        """Of the worst frequency or compliance."""
        powers = np.where(np.arange(len(self.numbers)) < FREQUENCIES, 0.5, 1.0)
        return float(np.abs((self.numbers / reference.numbers) ** powers - 1.0).max())


def answer(settings: MeshSettings, sizes: SizeField | None = None) -> Answer:
    """Mesh and reduce the part, and look at its numbers."""
    began = _processor_seconds()
    part = dataclasses.replace(SUPPORT, mesh=settings)
    mesh = mesh_component(part, sizes=sizes)
    element = reduce_elastic(
        part, mesh, comm=MPI.COMM_WORLD, request=ReductionRequest(ModeTarget(count=MODES))
    )
    flange, bore = (6 * element.interface_maps[name].node for name in ("flange", "bore"))
    free = np.delete(np.arange(len(element.stiffness)), np.arange(flange, flange + 6))
    stiffness, mass = (whole[np.ix_(free, free)] for whole in (element.stiffness, element.mass))
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    bends = np.linalg.solve(
        stiffness, np.eye(len(free))[:, np.searchsorted(free, bore + np.arange(3))]
    )
    soft = np.einsum("im,ij,jm->m", bends, stiffness, bends)
    numbers = np.concatenate([squares[:FREQUENCIES], 1.0 / soft])
    motions = np.zeros((len(element.stiffness), len(numbers)))
    motions[free] = np.hstack([shapes[:, :FREQUENCIES], bends])
    missed = find_cell_errors(part, mesh, element, motions)
    shares = missed / np.concatenate([squares[:FREQUENCIES], soft])
    return Answer(mesh, numbers, shares, _processor_seconds() - began)


def refine(found: Answer, error: float) -> SizeField:
    """Sizes with which the worst number is to be off by no more than asked."""
    halves = np.where(np.arange(len(found.numbers)) < FREQUENCIES, 0.5, 1.0)
    shares = halves * found.cells
    # numbers that are better already than asked need no cells of their own
    shares = shares[:, shares.sum(axis=0) > error / 10.0]
    totals = shares.sum(axis=0)
    return spread_error(found.mesh, shares.sum(axis=1), error * float(totals.sum() / totals.max()))


def main(percents: Sequence[float]) -> None:
    reference = answer(REFERENCE)
    tried = {f"even {1e3 * size:g} mm": MeshSettings(size=size) for size in EVEN_SIZES}
    tried |= {
        f"graded {1e3 * size:g} mm": MeshSettings(size=size, growth=0.3, rim_size=rim)
        for size, rim in GRADED_SIZES
    }
    found_by_name = {name: answer(settings) for name, settings in tried.items()}
    rows = [("reference", reference, reference.seconds)]
    rows += [(name, found, found.seconds) for name, found in found_by_name.items()]
    for percent in percents:
        found = answer(MeshSettings(size=FIRST_SIZE))
        spent = found.seconds
        for number in range(1, ROUNDS + 1):
            found = answer(MeshSettings(), refine(found, percent / 100.0))
            spent += found.seconds
            rows.append((f"{percent:g} %, mesh {number + 1}", found, spent))
            if found.estimate <= percent / 100.0:
                break
    print(f"{'mesh':<20} {'dofs':>8} {'estimate':>9} {'true':>8} {'CPU s':>7} {'in all':>7}")
    for name, found, spent in rows:
        print(
            f"{name:<20} {3 * len(found.mesh.points):>8} {found.estimate:>9.2%}"
            f" {found.true_error(reference):>8.2%} {found.seconds:>7.1f} {spent:>7.1f}"
        )


def _processor_seconds() -> float:
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


if __name__ == "__main__":
    main([float(word) for word in sys.argv[1:]] or [5.0, 1.0])
