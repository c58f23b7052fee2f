"""Published static benchmarks on imported meshes: MacNeal and Harder's straight cantilever and
NAFEMS LE10.
"""

import dataclasses
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, Load, Material, Patch
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.components.nodal_loads import assemble_loads
from headstock.solvers.elastic.stress_recovery import find_point_rows
from headstock.solvers.mpi import MPI
from headstock.solvers.stresses import STRESS_NAMES
from headstock.validation.parts.component_models import full_displacement, full_model, shared_mesh
from headstock.validation.parts.structured_meshes import refine_lattice, write_lattice
from headstock.validation.references.prismatic_beams import PrismaticBeam
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_value,
    compare_values,
    show,
)
from headstock.validation.references.torsion import cantilever_twist
from headstock.validation.references.values import reference_case

STRAIGHT = PrismaticBeam(6.0, 0.1, 0.2, Material("macneal", 1e7, 0.3, 1.0))
ELEMENTS = 6
TILT = {"regular": (0.0, 0.0), "parallelogram": (1.0, 1.0), "trapezoid": (1.0, -1.0)}
LOWEST, HIGHEST = 0.90, 1.01
PLATE_MATERIAL = Material("le10", 210e9, 0.3, 7850.0)
PLATE_CELLS = ((4, 6, 2), (8, 12, 4), (12, 18, 6))
THICKNESS = 0.6
PRESSURE = 1e6
POINT_D = np.array([2.0, 0.0, THICKNESS])


def check_straight_cantilever(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """MacNeal and Harder's cantilever of six imported elements, regular and slanted by 45 degrees,
    under four end loads.
    """
    reference = reference_case("straight-cantilever")
    for shape in TILT:
        found = _end_motions(shape, comm)
        for row in compare_values(reference, found, tolerance=1.0 - LOWEST):
            ratio = row.value / row.reference
            note = f"{ratio:.3f} of the published value, good second-order elements give {LOWEST:.2f} to {HIGHEST:.2f}"
            passed = LOWEST <= ratio <= HIGHEST
            yield dataclasses.replace(
                row, quantity=f"{shape} {row.quantity}", passed=passed, note=note
            )
        theory = Target(cantilever_twist(STRAIGHT, 1.0), "-", math.nan, "shown only")
        yield compare_value(f"{shape} twist against Saint-Venant", found[3], theory)


def check_thick_plate(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """LE10: stress at a point of a thick elliptic plate under pressure, on imported curved
    meshes.
    """
    stresses = [_plate_stress(cells, comm) for cells in PLATE_CELLS]
    for (a, b, c), value in zip(PLATE_CELLS[:-1], stresses[:-1], strict=True):
        quantity = f"sigma_yy at D, {a} x {b} x {c} hex27"
        yield show(quantity, value, "MPa", "falls towards the published value")
    yield from compare_values(
        reference_case("le10"), stresses[-1:], notes=["the finest of three meshes"]
    )


def _imported_mesh(
    lattice: FloatArray, component: Component, loads: Sequence[Load], comm: MPI.Comm
) -> tuple[Component, ComponentMesh]:
    """Write a lattice as a mesh file and read it back the way a scene does."""
    with tempfile.TemporaryDirectory(prefix="headstock-") as folder:
        path = Path(folder) / "lattice.msh"
        if comm.rank == 0:
            write_lattice(path, lattice)
        imported = dataclasses.replace(component, solid=MeshFile(path))
        return imported, shared_mesh(imported, (), loads, comm=comm)


def _end_motions(shape: str, comm: MPI.Comm) -> FloatArray:
    """Extension, in-plane and out-of-plane deflection and twist of the end under unit loads."""
    interface = Interface("tip", (Patch("set:u+"),), "average")
    component = Component(
        "cantilever", MeshFile(Path()), STRAIGHT.material, interfaces={"tip": interface}
    )
    _, mesh = _imported_mesh(_straight_lattice(shape), component, (), comm)
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    x, y, z = mesh.points.T
    root = x < 1e-9
    # the root may contract sideways: only its middle lines are fixed
    fixed[:, 0] = root
    fixed[:, 1] = root & (np.abs(y - STRAIGHT.depth / 2.0) < 1e-9)
    fixed[:, 2] = root & (np.abs(z - STRAIGHT.width / 2.0) < 1e-9)
    model = full_model(mesh, STRAIGHT.material, comm=comm, fixed=fixed)
    patch = measure_patch(mesh, "tip")
    means = np.zeros((len(mesh.points), 3, 6))
    means[patch.nodes] = patch.average_operator().reshape(len(patch.nodes), 3, 6)
    found = []
    for motion in (0, 1, 2, 3):
        displacement = full_displacement(model, means[:, :, motion])
        found.append(float(np.sum(means[:, :, motion] * displacement)))
    return np.array(found)


def _straight_lattice(shape: str) -> FloatArray:
    corners = np.zeros((ELEMENTS + 1, 2, 2, 3))
    even, odd = TILT[shape]
    for number in range(ELEMENTS + 1):
        lean = (
            0.0 if number in (0, ELEMENTS) else (even if number % 2 else odd) * STRAIGHT.depth / 2.0
        )
        for j in range(2):
            corners[number, j, :, 0] = STRAIGHT.length * number / ELEMENTS + (lean if j else -lean)
            corners[number, j, :, 1] = j * STRAIGHT.depth
            corners[number, j, :, 2] = [0.0, STRAIGHT.width]
    return refine_lattice(corners)


def _plate_stress(cells: tuple[int, int, int], comm: MPI.Comm) -> float:
    """Stress sigma_yy [MPa] at D."""
    load = Load("press", "plate", "pressure", (Patch("set:w+"),), magnitude=PRESSURE)
    component = Component("plate", MeshFile(Path()), PLATE_MATERIAL)
    component, mesh = _imported_mesh(_plate_lattice(cells), component, (load,), comm)
    x, y, z = mesh.points.T
    outer = np.abs((x / 3.25) ** 2 + (y / 2.75) ** 2 - 1.0) < 1e-9
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[:, 0] = (np.abs(x) < 1e-9) | outer
    fixed[:, 1] = (np.abs(y) < 1e-9) | outer
    fixed[:, 2] = outer & (np.abs(z - THICKNESS / 2.0) < 1e-9)
    model = full_model(mesh, PLATE_MATERIAL, comm=comm, fixed=fixed)
    vector = assemble_loads(component, mesh, model.operators, (load,), gravity=False)[load.name]
    displacement = full_displacement(model, model.everywhere(vector[:, None])[:, :, 0])
    seen = find_point_rows(mesh, PLATE_MATERIAL, POINT_D).apply(displacement.reshape(-1, 1))
    return float(seen[3 + STRESS_NAMES.index("yy"), 0]) / 1e6


def _plate_lattice(cells: tuple[int, int, int]) -> FloatArray:
    """Nodes on ellipses between (2, 1) and (3.25, 2.75), from the x axis to the y axis, through the
    thickness.
    """
    across, along, through = (np.linspace(0.0, 1.0, 2 * count + 1) for count in cells)
    r, t, z = np.meshgrid(across, np.pi / 2.0 * along, THICKNESS * through, indexing="ij")
    return np.stack([(2.0 + 1.25 * r) * np.cos(t), (1.0 + 1.75 * r) * np.sin(t), z], axis=-1)
