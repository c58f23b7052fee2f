"""Volume meshes in files: whole cells in VTK's order, the motions of the run, and stresses of beam
theory.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import pyvista
from mpi4py import MPI

from common import approx
from fixture_machines import stored_scene
from headstock.app.command_line import main
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import read_mesh
from headstock.pipeline.results.mode_files import write_mode_files
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.outputs import OutputError
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.solvers.stresses import largest_von_mises, pack_tensor, true_stresses

WIDTH, LENGTH = 0.02, 0.2
SCENE = stored_scene("volume_files")


FORCE, FIRST = "static tcp x", "mode 01"
PER_FORCE, PER_MODE = "[J/(m^3 N^2)]", "[J/(kg m^3)]"
Run = tuple[RunSummary, pyvista.UnstructuredGrid, Path]


@pytest.fixture(scope="module", params=["tet", "hex"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp(request.param)
    (folder / "beam.toml").write_text(SCENE.replace("CELLS", request.param))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADSTOCK_STORE", str(folder / "store"))
        options = ["-o", str(folder / "out"), "--volume", "--no-figures"]
        assert main(["run", str(folder / "beam.toml"), *options]) == 0
        grid = pyvista.read(folder / "out" / "volume" / "reference.vtu")
        summary = read_summary(folder / "out")
        assert (
            main(["run", str(folder / "beam.toml"), "-o", str(folder / "out"), "--no-figures"]) == 0
        )
    return summary, grid, folder


def cell_volumes(grid: pyvista.UnstructuredGrid) -> FloatArray:
    """Of cells with straight edges."""
    ((kind, cells),) = grid.cells_dict.items()
    linear = {10: cells[:, :4]} if kind in (10, 24) else {12: cells[:, :8]}
    corners = pyvista.UnstructuredGrid(linear, grid.points)
    return np.asarray(corners.compute_cell_sizes(length=False, area=False)["Volume"])


def test_the_cells_fill_the_part_where_it_stands(run: Run) -> None:
    _, grid, _ = run
    sizes = cell_volumes(grid)
    assert (sizes > 0.0).all()
    assert sizes.sum() == approx(WIDTH**2 * LENGTH, rel=1e-9)
    np.testing.assert_allclose(np.array(grid.bounds)[4:], [0.02, 0.22], atol=1e-12)
    # nodes of an edge stand in its middle: gmsh's order would put them elsewhere
    cell = grid.get_cell(0)
    for edge in cell.edges:
        np.testing.assert_allclose(edge.points[2], edge.points[:2].mean(axis=0), atol=1e-9)


def test_motions_are_those_of_the_run(run: Run) -> None:
    summary, grid, _ = run
    matrix = np.array(summary["static"]["tcp"]["compliance_um_per_kN"])
    tip = grid.points[:, 2] > 0.22 - 1e-9
    np.testing.assert_allclose(
        1e9 * grid.point_data[f"{FORCE} shape [m/N]"][tip].mean(axis=0)[0], matrix[0, 0], rtol=1e-3
    )
    np.testing.assert_allclose(
        grid.field_data["frequencies [Hz]"], summary["modal"][0]["frequencies_hz"]
    )
    assert grid.point_data["mode 02 shape [m/sqrt(kg)]"].shape == (grid.n_points, 3)


def test_stresses_are_those_of_a_beam(run: Run) -> None:
    _, grid, _ = run
    middles = np.array(
        [
            grid.get_cell(index).points[: 4 if grid.celltypes[0] == 24 else 8].mean(axis=0)
            for index in range(grid.n_cells)
        ]
    )
    found = grid.cell_data[f"{FORCE} von Mises stress [Pa/N]"]
    inside = (middles[:, 2] > 0.06) & (middles[:, 2] < 0.16) & (np.abs(middles[:, 0]) > 0.004)
    bending = (0.22 - middles[inside, 2]) * np.abs(middles[inside, 0]) / (WIDTH**4 / 12.0)
    assert inside.sum() > 20
    np.testing.assert_allclose(found[inside], bending, rtol=0.06)
    # fibres along z, in the order that ParaView labels: xx, yy, zz, xy, yz, xz
    tensor = grid.cell_data[f"{FORCE} stress [Pa/N]"][inside]
    np.testing.assert_allclose(np.abs(tensor[:, 2]), bending, rtol=0.06)
    assert np.abs(tensor[:, [0, 1, 3, 4]]).max() < 0.1 * np.abs(tensor[:, 2]).max()
    # the force in x is carried in xz; a parabola across two cells, seen in their middles
    middle = (middles[:, 2] > 0.06) & (middles[:, 2] < 0.16)
    shear = np.average(
        grid.cell_data[f"{FORCE} stress [Pa/N]"][middle], axis=0, weights=cell_volumes(grid)[middle]
    )
    assert shear[5] == approx(1.0 / WIDTH**2, rel=0.08)
    assert np.abs(shear[3:5]).max() < 0.02 / WIDTH**2


def test_energies_of_the_cells_sum_up_to_those_of_the_run(run: Run) -> None:
    summary, grid, _ = run
    volumes = grid.cell_data["volume [m^3]"]
    np.testing.assert_allclose(volumes, cell_volumes(grid), rtol=1e-6)
    compliance = np.array(summary["static"]["tcp"]["compliance_um_per_kN"])[0, 0] * 1e-9
    # the beam is all that is elastic: the work of the force is its energy
    energy = volumes @ grid.cell_data[f"{FORCE} strain energy density {PER_FORCE}"]
    assert energy == approx(0.5 * compliance, rel=1e-3)
    for index in range(2):
        omega = 2.0 * np.pi * summary["modal"][0]["frequencies_hz"][index]
        density = grid.cell_data[f"mode {index + 1:02d} strain energy density {PER_MODE}"]
        assert volumes @ density == approx(0.5 * omega**2, rel=1e-4)


def test_mode_shapes_have_unit_modal_mass(run: Run) -> None:
    _, grid, _ = run
    corners = 4 if grid.celltypes[0] == 24 else 8
    shape = np.array(grid.point_data[f"{FIRST} shape [m/sqrt(kg)]"], dtype=float)
    cells = next(iter(grid.cells_dict.values()))
    # all nodes of a cell alike: a quadrature of second order in the size of the cells
    weights = np.full(cells.shape[1], 1.0 / cells.shape[1])
    if corners == 4:
        weights = np.where(np.arange(10) < 4, -1.0 / 20.0, 1.0 / 5.0)
    squares = (shape[cells] ** 2).sum(axis=2) @ weights
    mass = 7850.0 * (cell_volumes(grid) @ squares)
    assert mass == approx(1.0, rel=0.03)


def test_a_result_hands_out_the_mesh_that_its_files_hold(tmp_path: Path) -> None:
    (tmp_path / "beam.toml").write_text(SCENE.replace("CELLS", "tet"))
    scene = load_scene(tmp_path / "beam.toml")
    out = tmp_path / "out"
    result = run_scene(scene, out, comm=MPI.COMM_SELF, store=Store(tmp_path / "store"), volume=True)
    beam, read = result.mesh("beam"), read_mesh(out, "beam", "reference")
    for name in beam.point_data:
        order = np.lexsort(np.round(beam.points, 9).T), np.lexsort(np.round(read.points, 9).T)
        np.testing.assert_allclose(beam[name][order[0]], read[name][order[1]])
    assert beam.cell_data.keys() == read.cell_data.keys() and beam.n_cells == read.n_cells
    assert beam.field_data.keys() == read.field_data.keys() == ["frequencies [Hz]"]
    block = result.mesh("block", "reference")
    assert set(block.celltypes) == {5} and "mode 02 shape [m/sqrt(kg)]" in block.point_data
    assert block.points[:, 2].max() == approx(0.02)
    with pytest.raises(OutputError, match=r"'block'.*volume/reference\.vtu"):
        read_mesh(out, "block")
    write_mode_files(out, result.modal, result.view)
    assert set(read_mesh(out, "block").celltypes) == {5}
    for wrong in ({"component": "beem"}, {"component": "beam", "pose": "far"}):
        with pytest.raises(KeyError, match=r"there are: (beam, block|reference)"):
            result.mesh(**wrong)
    check_surfaces(result)


def check_surfaces(result: Results) -> None:
    """After a run whose meshes are gone components have their surface."""
    beam = dataclasses.replace(result, volumes=None).mesh("beam")
    assert set(beam.celltypes) == {5} and beam.n_points == len(result.view.skins["beam"].points)


def test_a_run_without_volumes_removes_those_of_an_earlier_run(run: Run) -> None:
    assert not list((run[2] / "out").glob("volume/*"))


def test_the_equivalent_stress_of_pull_and_of_shear() -> None:
    material = Material("steel", 210e9, 0.3, 7850.0)
    shear, bulk = 210e9 / 2.6, 210e9 / 1.2
    pull = 1e6
    diagonal = np.array([2.0, -1.0, -1.0]) * pull / 3.0 / np.sqrt(
        2.0 * shear
    ) + pull / 3.0 / np.sqrt(bulk) / np.sqrt(3.0)
    pulled = true_stresses(material, np.array([*diagonal, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(pulled, np.diag([pull, 0.0, 0.0]), atol=1e-6 * pull)
    assert largest_von_mises(pack_tensor(pulled)) == approx(pull)
    sheared = true_stresses(material, np.array([0.0, 0.0, 0.0, 0.0, 0.0, pull / np.sqrt(shear)]))
    assert sheared[0, 1] == sheared[1, 0] == approx(pull)
    assert largest_von_mises(pack_tensor(sheared)) == approx(np.sqrt(3.0) * pull)
