"""What single tetrahedra through a section miss, which only its free sides tell."""

import dataclasses

import numpy as np

from common import make_box, make_component
from headstock.meshing.elements.surface import extract_surface
from headstock.solvers.recovery.discretisation_error import (
    estimate_mesh_errors,
    find_resolved_step,
)
from headstock.solvers.recovery.free_sides import find_free_sides

SIDE, LENGTH = 0.02, 0.2
# torsion constants of a square with and without warping, over the fourth power of its side
PLANE, WARPED = 1.0 / 6.0, 0.1406


def test_sides_tell_the_warping_of_a_twisted_square_bar_of_single_tets() -> None:
    mesh, material = (
        make_box((1, 1, 10), (SIDE, SIDE, LENGTH), kind="tet10"),
        make_component().material,
    )
    x, y, z = (mesh.points - [*mesh.points.mean(axis=0)[:2], 0.0]).T
    twist = np.column_stack([-y * z, x * z, 0.0 * z]).reshape(-1, 1)
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    true = shear * (PLANE - WARPED) * SIDE**4 * LENGTH
    facets = extract_surface(mesh.cells, mesh.kind).facets
    heights = mesh.points[facets, 2]
    held = np.isclose(np.abs(heights - 0.5 * LENGTH), 0.5 * LENGTH, rtol=0.0, atol=1e-9).all(axis=1)
    mesh = dataclasses.replace(mesh, patches={"ends": facets[held]})
    sides = find_free_sides(mesh)
    assert sides is not None
    assert sides.alone[np.unique(mesh.cells[:, :4])].all()
    seen = estimate_mesh_errors(mesh, material, twist, sides=sides).missing_energy[0, 0]
    unseen = estimate_mesh_errors(mesh, material, twist).missing_energy[0, 0]
    assert unseen < 0.01 * true < 0.5 * true < seen


def test_sides_are_asked_where_single_tets_fill_a_bar_and_not_in_blocks_and_sheets() -> None:
    block = make_box((4, 4, 4), (0.1, 0.1, 0.1), kind="tet10")
    sides = find_free_sides(block)
    assert sides is None or sides.alone.sum() < 0.1 * len(np.unique(block.cells[:, :4]))
    assert find_free_sides(make_box((6, 6, 1), (0.3, 0.3, 0.01), kind="tet10")) is None


def test_walls_of_single_tets_wider_than_thick_show_their_errors_on_smaller_ones_only() -> None:
    wall = make_box((8, 8, 1), (0.12, 0.12, 0.01), kind="tet10")
    assert 0.45 < find_resolved_step(wall) < 0.7
    bar = make_box((1, 1, 10), (SIDE, SIDE, LENGTH), kind="tet10")
    block = make_box((4, 4, 4), (0.1, 0.1, 0.1), kind="tet10")
    sheet = make_box((6, 6, 1), (0.3, 0.3, 0.01), kind="tet10")
    assert [find_resolved_step(mesh) for mesh in (bar, block, sheet)] == [1.0, 1.0, 1.0]
