"""Both releases of dolfinx compute the same on the same meshes, and what agrees within ± on others: the
one of these tests, and the one that ``./headstock --with dolfinx-new`` brings, which is installed here
where it is missing.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import basix
import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from common import make_box, make_component, run_process
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.elasticity import (
    CELL_TYPES,
    RELEASE,
    assemble_elasticity,
    gmsh_cell_order,
)
from headstock.validation.parts.structured_meshes import node_places

ROOT = Path(__file__).resolve().parents[3]
KINDS: tuple[CellKind, ...] = ("tet4", "tet10", "hex8", "hex27")


def measure(kind: CellKind) -> dict[str, list[float]]:
    """Numbers of a block on its foot that hang on every entry of stiffness and mass: all its
    eigenvalues [rad²/s²], and how its nodes give way to a load, by place [m].
    """
    mesh = make_box((2, 2, 3), (0.2, 0.3, 0.5), kind=kind)
    operators = assemble_elasticity(
        mesh, make_component().material, comm=MPI.COMM_SELF, with_mass=True
    )
    order = np.lexsort(np.round(operators.points, 9).T)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    unit = np.eye(len(dofs))
    stiffness, mass = operators.apply_stiffness(unit), operators.apply_mass(unit)
    free = ~fixed
    values = scipy.linalg.eigh(
        stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], eigvals_only=True
    )
    load = np.tile([1.0e3, -2.0e3, 3.0e3], len(order))[:, None]
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        moved = solver.solve(load)
    return {"eigenvalues": values.tolist(), "displacements": moved[dofs, 0].tolist()}


@pytest.mark.trials
@pytest.mark.process
def test_numbers_of_every_cell_are_those_of_the_newest_dolfinx() -> None:
    here = {kind: measure(kind) for kind in KINDS}
    done = run_process(
        [ROOT / "headstock", "--with", "dolfinx-new", "exec", "python3", "-P", __file__],
        env=os.environ | {"PYTHONPATH": str(ROOT / "tests")},
    )
    assert done.returncode == 0, done.stderr
    there = json.loads(done.stdout)
    assert there.pop("release") > list(RELEASE)
    for kind, numbers in here.items():
        assert len(numbers["eigenvalues"]) > 50, kind
        for name, values in numbers.items():
            other = np.array(there[kind][name])
            scale = np.abs(values) if name == "eigenvalues" else np.abs(values).max()
            assert np.max(np.abs(other - values) / scale) < 1e-8, f"{name} of {kind}"


class Bounded(NamedTuple):
    """Frequencies [Hz] and compliances along each force [µm/kN] of a run, with their ±."""

    values: FloatArray
    errors: FloatArray


def run_scene(folder: Path, scene: Path, *words: str, newest: bool) -> Bounded:
    """What a run with a store of its own finds, so that it meshes."""
    start = ["--with", "dolfinx-new"] if newest else []
    results = folder / "results"
    subprocess.run(
        [ROOT / "headstock", *start, "run", scene, "--no-figures", "-o", results, *words],
        env=os.environ | {"HEADSTOCK_STORE": str(folder / "store")},
        capture_output=True,
        check=True,
    )
    found = json.loads((results / "summary.json").read_text())
    (modes,), (point,) = found["modal"], found["static"].values()
    return Bounded(
        np.array([*modes["frequencies_hz"], *np.diag(point["compliance_um_per_kN"])]),
        np.array([*modes["error_hz"], *(point["error_um_per_kN"][axis] for axis in "xyz")]),
    )


@pytest.mark.trials
@pytest.mark.process
@pytest.mark.parametrize(
    ("scene", "component", "sizes"),
    [
        ("machines/cantilever.toml", "column", ("12 mm", "10 mm")),
        ("tests/data/support.toml", "support", ("4 mm", "3.3 mm")),
    ],
)
def test_numbers_of_new_meshes_agree_within_their_bounds(
    tmp_path: Path, scene: str, component: str, sizes: tuple[str, str]
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    meshed = [f"--set=components.{component}.mesh={{ size = '{size}' }}" for size in sizes]
    here = run_scene(tmp_path / "here", ROOT / scene, meshed[0], newest=False)
    there = run_scene(tmp_path / "there", ROOT / scene, meshed[1], newest=True)
    difference = np.abs(there.values - here.values)
    assert np.all(difference > 1e-9 * np.abs(here.values))  # the meshes are two
    assert np.all(here.errors < 0.1 * here.values)
    assert np.all(difference <= here.errors + there.errors), difference / (
        here.errors + there.errors
    )


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_of_a_cell_in_this_order_lie_where_dolfinx_has_them(kind: CellKind) -> None:
    shape, order = CELL_TYPES[kind]
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType[shape], order, basix.LagrangeVariant.equispaced
    )
    places = node_places(kind)
    np.testing.assert_allclose(
        places[gmsh_cell_order(shape, len(places))], element.points, rtol=0.0, atol=1e-15
    )


if __name__ == "__main__":
    sys.stdout.write(
        json.dumps({"release": list(RELEASE), **{kind: measure(kind) for kind in KINDS}})
    )
