"""Components as pyvista meshes, from the grids of a run or from its files."""

from pathlib import Path

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.loading import load_library
from headstock.pipeline.results.grids import COMPONENT, Grid

try:
    load_library("pyvista")
    import pyvista
except ImportError as missing:
    raise HeadstockError(
        "meshes of components are pyvista's: pip install pyvista, or ./headstock doctor"
    ) from missing


def make_mesh(grid: Grid) -> pyvista.UnstructuredGrid:
    """A grid as pyvista has it."""
    mesh = pyvista.UnstructuredGrid(
        {block.kind: block.cells for block in grid.blocks}, np.asarray(grid.points, dtype=float)
    )
    for there, data in (
        (mesh.point_data, grid.point_data),
        (mesh.cell_data, grid.cell_data),
        (mesh.field_data, grid.field_data),
    ):
        for name, values in data.items():
            there[name] = values
    return mesh


def read_component(path: Path, number: int) -> pyvista.UnstructuredGrid | None:
    """The cells of a component in a ``.vtu`` file of a run; None where it has none there.

    Args:
        number: Of the component, as the file has it over its points.
    """
    whole = pyvista.read(path)
    own = np.flatnonzero(whole.point_data[COMPONENT] == number)
    if not len(own):
        return None
    mesh = whole.extract_points(own, adjacent_cells=False)
    for data in (mesh.point_data, mesh.cell_data):
        for name in [name for name in data if name.startswith("vtkOriginal")]:
            data.pop(name)
    return mesh
