"""Meshes whose sizes follow where the error of a coarser mesh lies."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from cases import cases
from common import approx, make_box, make_faced
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import (
    Component,
    MeshSettings,
    ReductionSettings,
)
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.error_sizes import (
    EDGE_OVER_SIZE,
    LEAST_TIMES,
    MOST_TIMES,
    SMOOTH_RATE,
    _find_singular,
    _mean_edges,
    spread_error,
)
from headstock.meshing.elements.surface import extract_surface
from headstock.meshing.errors import MeshError
from headstock.meshing.process.job import MeshJob, format_job, parse_job
from headstock.meshing.size_files import encode_sizes, parse_sizes
from headstock.pipeline.accuracy.settings import give_sizes
from headstock.reduction.components.elastic import find_cell_errors, reduce_elastic

BEAM = make_faced(
    "beam",
    Box((0.4, 0.1, 0.1)),
    {"root": "x-", "tip": "average x+"},
    mesh=MeshSettings(size=0.05),
    reduction=ReductionSettings(modes=2),
)


def missed_at_tip(part: Component, mesh: ComponentMesh) -> tuple[FloatArray, float]:
    """What each cell and the whole mesh miss of the energy of a load across the tip, root fixed."""
    element = reduce_elastic(part, mesh, comm=MPI.COMM_WORLD)
    root, tip = (6 * element.interface_maps[name].node for name in ("root", "tip"))
    free = np.delete(np.arange(len(element.stiffness)), np.arange(root, root + 6))
    motion = np.zeros((len(element.stiffness), 1))
    load = (free == tip + 2).astype(float)
    motion[free, 0] = np.linalg.solve(element.stiffness[np.ix_(free, free)], load)
    compliance = motion[tip + 2, 0]
    cells = find_cell_errors(part, mesh, element, motion)[:, 0] / compliance
    assert element.errors.missing_energy is not None
    whole = element.errors.mesh_safety * motion[:, 0] @ element.errors.missing_energy @ motion[:, 0]
    return cells, float(whole / compliance)


def test_a_mesh_by_its_error_misses_less_with_fewer_points_than_an_even_one() -> None:
    coarse = mesh_component(BEAM)
    cells, whole = missed_at_tip(BEAM, coarse)
    assert cells.sum() == approx(whole, rel=1e-4)
    adapted = mesh_component(give_sizes(BEAM, spread_error(coarse, cells, 0.4)))
    even = mesh_component(dataclasses.replace(BEAM, mesh=MeshSettings(size=0.025)))
    assert len(adapted.points) < 0.65 * len(even.points)
    assert missed_at_tip(BEAM, adapted)[1] < missed_at_tip(BEAM, even)[1]


def test_sizes_shrink_evenly_where_every_cell_misses_the_same_per_volume() -> None:
    mesh = make_box((3, 3, 3), (1.0, 1.0, 1.0), kind="tet10")
    corners, cells = np.unique(mesh.cells[:, :4], return_inverse=True)
    field = SizeField(mesh.points[corners], cells.reshape(-1, 4), np.ones(len(corners)))
    old = _mean_edges(field) / EDGE_OVER_SIZE
    energies = field.volumes * old**SMOOTH_RATE
    shrunk = spread_error(mesh, energies, 0.5)
    expected = (0.5 * energies.sum() / field.volumes.sum()) ** (1.0 / SMOOTH_RATE)
    assert shrunk.sizes == approx(expected, rel=1e-3)


def test_where_little_is_missed_sizes_stay_and_elsewhere_shrink_as_far_as_the_estimate_reaches() -> (
    None
):
    mesh = make_box((3, 3, 3), (1.0, 1.0, 1.0), kind="tet10")
    energies = np.ones(len(mesh.cells))
    whole, finest = (spread_error(mesh, energies, share) for share in (1.0, 1e-9))
    assert finest.sizes / whole.sizes == approx(
        (MOST_TIMES / LEAST_TIMES) ** (-1.0 / 3.0), rel=1e-3
    )
    corner = np.linalg.norm(mesh.points[mesh.cells[:, :4]].mean(axis=1), axis=1)
    local = spread_error(mesh, np.exp(-10.0 * corner), 0.2)
    change = local.sizes / whole.sizes * LEAST_TIMES ** (-1.0 / 3.0)
    assert change.min() < 0.6 and change.max() == approx(1.0, rel=1e-3)


def test_a_mesh_whose_error_is_small_enough_gets_the_fewest_more_cells() -> None:
    graded = mesh_component(
        dataclasses.replace(BEAM, mesh=MeshSettings(0.05, growth=0.4, rim_size=0.008))
    )
    same = spread_error(graded, np.ones(len(graded.cells)), 1.0)
    again = mesh_component(give_sizes(BEAM, same))
    # as many where gmsh makes cells of EDGE_OVER_SIZE; a beam takes a quarter more
    assert 0.9 * LEAST_TIMES < len(again.cells) / len(graded.cells) < 1.3 * LEAST_TIMES
    assert same.cells == approx(len(again.cells), rel=0.35)


def test_sizes_that_were_given_never_grow_though_the_mesh_came_out_coarser() -> None:
    mesh = make_box((3, 3, 3), (1.0, 1.0, 1.0), kind="tet10")
    energies = np.ones(len(mesh.cells))
    alone = spread_error(mesh, energies, 1.0)
    given = dataclasses.replace(alone, sizes=0.7 * alone.sizes)
    assert spread_error(mesh, energies, 1.0, given).sizes == approx(given.sizes, rel=1e-5)


def test_stresses_are_singular_at_an_inner_edge_and_at_the_rim_of_a_patch() -> None:
    box = make_box((4, 4, 4), (1.0, 1.0, 1.0), kind="tet10")
    middles = box.points[box.cells[:, :4]].mean(axis=1)
    middle = box.points.mean(axis=0)
    kept = ~(middles[:, ::2] > middle[::2]).all(axis=1)
    angle = dataclasses.replace(box, cells=box.cells[kept], patches={})
    corners = angle.points[angle.cells[:, :4]]
    at_edge = (np.abs(corners - middle)[:, :, ::2] < 1e-9).all(axis=2).any(axis=1)
    assert at_edge.any() and np.array_equal(_find_singular(angle), at_edge)
    surface = extract_surface(box.cells, box.kind)
    foot = surface.facets[(box.points[surface.facets][:, :, 2] < 1e-9).all(axis=1)]
    held = dataclasses.replace(box, patches={"foot": foot})
    places = box.points[box.cells[:, :4]]
    low, high = box.points.min(axis=0)[:2], box.points.max(axis=0)[:2]
    outer = ((places[:, :, :2] == low) | (places[:, :, :2] == high)).any(axis=2)
    at_rim = (outer & (places[:, :, 2] < 1e-9)).any(axis=1)
    assert np.array_equal(_find_singular(held), at_rim)


def test_cells_follow_the_sizes_of_a_field() -> None:
    coarse = mesh_component(BEAM)
    corners, cells = np.unique(coarse.cells[:, :4], return_inverse=True)
    where = coarse.points[corners]
    along = (where[:, 0] - where[:, 0].min()) / np.ptp(where[:, 0])
    field = SizeField(where, cells.reshape(-1, 4), 0.008 + 0.03 * along)
    mesh = mesh_component(give_sizes(BEAM, field))
    places = mesh.points[mesh.cells[:, :4]].mean(axis=1)[:, 0]
    share = (places - mesh.points[:, 0].min()) / np.ptp(mesh.points[:, 0])
    assert (share < 0.25).sum() > 8 * (share > 0.75).sum()


def test_a_job_carries_its_sizes() -> None:
    field = SizeField(np.eye(4, 3), np.array([[0, 1, 2, 3]]), np.array([0.1, 0.2, 0.3, 0.4]))
    found = parse_job(format_job(MeshJob("mesh", Box((1.0, 1.0, 1.0)), sizes=field))).sizes
    assert found is not None
    for name, array in vars(field).items():
        assert np.array_equal(getattr(found, name), array)
    assert parse_job(format_job(MeshJob("mesh", Box((1.0, 1.0, 1.0))))).sizes is None


def test_a_grid_of_hexahedra_takes_no_sizes() -> None:
    field = SizeField(np.eye(4, 3), np.array([[0, 1, 2, 3]]), np.full(4, 0.05))
    part = dataclasses.replace(BEAM, mesh=MeshSettings(0.05, cells="hex", sizes=field))
    with pytest.raises(MeshError, match="tetrahedra"):
        mesh_component(part)


def test_sizes_come_out_of_their_file_as_they_went_in(tmp_path: Path) -> None:
    mesh = make_box((2, 2, 2), (0.1, 0.1, 0.1), kind="tet10")
    field = spread_error(mesh, np.asarray(np.linspace(1.0, 2.0, len(mesh.cells))), 0.3)
    path = tmp_path / "part.pos"
    path.write_bytes(encode_sizes(field))
    np.testing.assert_equal(vars(SizeField(**parse_sizes(path))), vars(field))


@cases
def test_a_file_of_other_things_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "part.pos"
    path.write_text(text)
    with pytest.raises(MeshError, match=said):
        parse_sizes(path)
