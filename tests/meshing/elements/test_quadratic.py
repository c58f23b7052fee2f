from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from common import STEEL, approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, Patch, Support
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.quadratic import complete_hexes
from headstock.validation.parts.structured_meshes import (
    _lattice_cells,
    integrate_over_cells,
    lattice_sides,
    straight_lattice,
    write_lattice,
)
from reduced_parts import reduce_mesh

SIZE = (0.2, 0.3, 0.5)


def bent(points: FloatArray) -> FloatArray:
    """A map whose coordinates are serendipity functions on every cell, so that nothing is lost with
    the inner nodes.
    """
    x, y, z = points.T
    return np.column_stack([x + 0.3 * z**2, y + 0.2 * x * z, z - 0.1 * y**2])


def without_inner_nodes(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    used, numbers = np.unique(cells[:, :20], return_inverse=True)
    return points[used], numbers.reshape(len(cells), 20)


@pytest.mark.parametrize("warp", [lambda points: points, bent], ids=["straight", "bent"])
def test_the_new_nodes_are_those_that_were_left_out(
    warp: Callable[[FloatArray], FloatArray],
) -> None:
    lattice = straight_lattice((2, 3, 2), SIZE)
    cells = _lattice_cells(lattice.shape[:3])
    whole = warp(lattice.reshape(-1, 3))
    points, completed = complete_hexes(*without_inner_nodes(whole, cells))
    assert len(points) == len(whole)
    np.testing.assert_allclose(points[completed], whole[cells], atol=1e-14)
    volumes = [
        integrate_over_cells(p, c, "hex27", lambda x: np.ones(len(x)))
        for p, c in ((points, completed), (whole, cells))
    ]
    assert volumes[0] == approx(volumes[1], rel=1e-13)


def write_serendipity(path: Path, lattice: FloatArray) -> None:
    """The file of a lattice with 20-node cells and 8-node facets."""
    cells, sides = _lattice_cells(lattice.shape[:3])[:, :20], lattice_sides(lattice.shape[:3])
    used, numbers = np.unique(cells, return_inverse=True)
    place = {int(node): number for number, node in enumerate(used, start=1)}
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(sides) + 1)]
    lines += [f'2 {number} "{name}"' for number, name in enumerate(sides, start=1)] + [
        '3 7 "body"',
        "$EndPhysicalNames",
    ]
    lines += ["$Nodes", str(len(used))]
    lines += [
        f"{n} " + " ".join(repr(float(value)) for value in np.ravel(point))
        for n, point in enumerate(lattice.reshape(-1, 3)[used], start=1)
    ]
    elements = [
        f"16 2 {number} {number} " + " ".join(str(place[int(node)]) for node in facet[:8])
        for number, facets in enumerate(sides.values(), start=1)
        for facet in facets
    ]
    elements += [
        "17 2 7 7 " + " ".join(map(str, cell + 1)) for cell in numbers.reshape(len(cells), 20)
    ]
    lines += [
        "$EndNodes",
        "$Elements",
        str(len(elements)),
        *(f"{n} {e}" for n, e in enumerate(elements, start=1)),
        "$EndElements",
        "",
    ]
    path.write_text("\n".join(lines))


def test_a_file_of_twenty_node_hexes_is_as_stiff_as_one_of_27_node_ones(tmp_path: Path) -> None:
    lattice = straight_lattice((2, 2, 3), SIZE)
    write_serendipity(tmp_path / "twenty.msh", lattice)
    write_lattice(tmp_path / "full.msh", lattice)
    stiffness, kinds = [], []
    for name in ("twenty", "full"):
        tip = {"tip": Interface("tip", (Patch("set:w+"),))}
        component = Component("body", MeshFile(tmp_path / f"{name}.msh"), STEEL, interfaces=tip)
        clamp = (Support("clamp", "body", (Patch("set:w-"),), ("x", "y", "z")),)
        mesh = mesh_component(component, clamp)
        kinds.append((mesh.kind, mesh.straight))
        stiffness.append(reduce_mesh(component, mesh, clamp).stiffness)
    assert kinds == [("hex27", True)] * 2
    np.testing.assert_allclose(
        stiffness[0], stiffness[1], rtol=1e-9, atol=1e-9 * np.abs(stiffness[1]).max()
    )
