"""Volume meshes in files: whole cells in VTK's order, the motions of the run, and stresses of beam
theory.
"""

from pathlib import Path

import numpy as np
import pytest
import pyvista

from headstock.app.command_line import main
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.pipeline.results.files import read_summary
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.stages.volume_files import von_mises

WIDTH, LENGTH = 0.02, 0.2
SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.block]
solid = { box = ["20 mm", "20 mm", "20 mm"] }
material = "steel"
fidelity = "rigid"
[components.block.interfaces]
top = { face = "z+" }
low = { face = "z-" }
[components.beam]
solid = { box = ["20 mm", "20 mm", "200 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "20 mm"]
mesh = { size = "10 mm", cells = "CELLS" }
[components.beam.interfaces]
foot = { face = "z-" }
tip = { face = "z+" }
[joints.ground]
between = ["ground", "block.low"]
kind = "rigid"
[joints.clamp]
between = ["block.top", "beam.foot"]
kind = "rigid"
[points]
tcp = { tool = "beam.tip", work = "ground" }
[analyses.static]
[analyses.modal]
count = 2
"""


Run = tuple[RunSummary, pyvista.UnstructuredGrid, Path]


@pytest.fixture(scope="module", params=["tet", "hex"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp(request.param)
    (folder / "beam.toml").write_text(SCENE.replace("CELLS", request.param))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADSTOCK_STORE", str(folder / "store"))
        assert (
            main(
                [
                    "run",
                    str(folder / "beam.toml"),
                    "-o",
                    str(folder / "out"),
                    "--volume",
                    "--no-figures",
                ]
            )
            == 0
        )
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
    assert sizes.sum() == pytest.approx(WIDTH**2 * LENGTH, rel=1e-9)
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
        1e9 * grid.point_data["static_tcp_x"][tip].mean(axis=0)[0], matrix[0, 0], rtol=1e-3
    )
    np.testing.assert_allclose(
        grid.field_data["frequencies_hz"], summary["modal"][0]["frequencies_hz"]
    )
    assert grid.point_data["mode_02"].shape == (grid.n_points, 3)


def test_stress_and_energy_are_those_of_a_beam(run: Run) -> None:
    summary, grid, _ = run
    middles = np.array(
        [
            grid.get_cell(index).points[: 4 if grid.celltypes[0] == 24 else 8].mean(axis=0)
            for index in range(grid.n_cells)
        ]
    )
    found = grid.cell_data["von_mises_static_tcp_x"]
    inside = (middles[:, 2] > 0.06) & (middles[:, 2] < 0.16) & (np.abs(middles[:, 0]) > 0.004)
    bending = (0.22 - middles[inside, 2]) * np.abs(middles[inside, 0]) / (WIDTH**4 / 12.0)
    assert inside.sum() > 20
    np.testing.assert_allclose(found[inside], bending, rtol=0.06)
    sizes = cell_volumes(grid)
    energy = (sizes * grid.cell_data["strain_energy_density_mode_01"]).sum()
    omega = 2.0 * np.pi * summary["modal"][0]["frequencies_hz"][0]
    # one place per cell: a quarter of the energy of linear bending across a cell is between the
    # places
    assert 0.6 * 0.5 * omega**2 < energy < 1.01 * 0.5 * omega**2


def test_a_run_without_volumes_removes_those_of_an_earlier_run(run: Run) -> None:
    assert not list((run[2] / "out").glob("volume/*"))


def test_the_equivalent_stress_of_pull_and_of_shear() -> None:
    material = Material("steel", 210e9, 0.3, 7850.0)
    shear, bulk = 210e9 / 2.6, 210e9 / 1.2
    pull = 1e6
    diagonal = np.array([2.0, -1.0, -1.0]) * pull / 3.0 / np.sqrt(
        2.0 * shear
    ) + pull / 3.0 / np.sqrt(bulk) / np.sqrt(3.0)
    assert von_mises(material, np.array([*diagonal, 0.0, 0.0, 0.0])) == pytest.approx(pull)
    assert von_mises(
        material, np.array([0.0, 0.0, 0.0, 1e6 / np.sqrt(shear), 0.0, 0.0])
    ) == pytest.approx(np.sqrt(3.0) * 1e6)
