"""distorted elements: MacNeal and Harder's slender beam with trapezoids and parallelograms;
inverted ones are refused.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_component
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, Material, Patch
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.errors import MeshError
from headstock.validation.parts.component_models import full_displacement, full_model
from headstock.validation.parts.structured_meshes import (
    integrate_over_cells,
    lattice_mesh,
    refine_lattice,
    write_lattice,
)

pytestmark = pytest.mark.hard("H10")

COMM = MPI.COMM_SELF
LENGTH, DEPTH, WIDTH = 6.0, 0.2, 0.1
YOUNG, POISSON = 1e7, 0.3
# tip displacement by theory, source: MacNeal and Harder (1985), table 3
THEORY = {"x": 3.0e-5, "z": 0.1081, "y": 0.4321}


def beam(shape: str) -> FloatArray:
    """Six elements along x, straight, as trapezoids or as parallelograms with 45 degree sides."""
    slant = {
        "regular": np.zeros(7),
        "trapezoid": np.array([0, 1, -1, 1, -1, 1, 0.0]),
        "parallelogram": np.array([0, 1, 1, 1, 1, 1, 0.0]),
    }
    ends = np.linspace(0.0, LENGTH, 7)
    corners = np.zeros((7, 2, 2, 3))
    for i, x in enumerate(ends):
        for k, z in enumerate((0.0, DEPTH)):
            for j, y in enumerate((0.0, WIDTH)):
                corners[i, j, k] = x + slant[shape][i] * (z - DEPTH / 2), y, z
    return refine_lattice(corners)


def tip_ratio(shape: str, kind: CellKind, direction: str) -> float:
    mesh = lattice_mesh(beam(shape), kind, straight=True)
    fixed = np.repeat((mesh.points[:, 0] < 1e-9)[:, None], 3, axis=1)
    material = make_component().material
    model = full_model(mesh, type(material)("mh", YOUNG, POISSON, 1.0), comm=COMM, fixed=fixed)
    tip = np.flatnonzero(mesh.points[:, 0] > LENGTH - 1e-9)
    loads = np.zeros((len(mesh.points), 3))
    loads[tip, "xyz".index(direction)] = 1.0 / len(tip)
    return float(
        full_displacement(model, loads)[tip, "xyz".index(direction)].mean() / THEORY[direction]
    )


@pytest.mark.parametrize("direction", ["x", "y", "z"])
@pytest.mark.parametrize("shape", ["regular", "trapezoid", "parallelogram"])
@pytest.mark.parametrize("kind", ["hex27", "tet10"])
def test_second_order_elements_reach_nine_tenths_of_theory_however_slanted(
    kind: CellKind, shape: str, direction: str
) -> None:
    assert 0.9 < tip_ratio(shape, kind, direction) < 1.01


def test_first_order_trapezoids_lock() -> None:
    # what the row guards against: 0.05 and less of the theory
    assert tip_ratio("trapezoid", "hex8", "z") < 0.2


@pytest.mark.parametrize("kind", ["hex27", "tet10"])
def test_mass_and_volume_of_slanted_elements_are_exact(kind: CellKind) -> None:
    mesh = lattice_mesh(beam("trapezoid"), kind, straight=True)
    assert mesh.quality.volume == approx(LENGTH * DEPTH * WIDTH, rel=1e-12)
    model = full_model(mesh, make_component().material, comm=COMM)
    assert model.operators.scalar_mass is not None
    assert model.operators.scalar_mass.sum() == approx(7850.0 * LENGTH * DEPTH * WIDTH, rel=1e-12)
    moment = integrate_over_cells(mesh.points, mesh.cells, kind, lambda x: x[:, 0])
    assert moment == approx(LENGTH**2 / 2.0 * DEPTH * WIDTH, rel=1e-12)


@pytest.mark.parametrize(
    ("shift", "said"), [(1.1, "1 inverted"), (0.9995, "0 inverted")], ids=["inverted", "sliver"]
)
def test_an_inverted_element_or_a_sliver_in_a_file_is_refused_and_named(
    tmp_path: Path, shift: float, said: str
) -> None:
    corners = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 3)] * 3, indexing="ij"), axis=-1)
    # one corner of the body pushed along an edge through its neighbour, or up to it
    corners[0, 0, 0, 0] = 0.5 * shift
    write_lattice(tmp_path / "bad.msh", refine_lattice(corners))
    steel = Material("steel", 2.1e11, 0.3, 7850.0)
    top = {"top": Interface("top", (Patch("set:w+"),))}
    with pytest.raises(MeshError, match=rf"1 of 8 elements are unusable \({said}.*element 1 at"):
        mesh_component(Component("bad", MeshFile(tmp_path / "bad.msh"), steel, interfaces=top))
