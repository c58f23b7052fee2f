"""Our mesh and matrices of the cantilever's column in CalculiX 2.20 and Exudyn, and CalculiX's in a
scene: ``./headstock test -m neighbours tests/neighbours``.
"""

import functools
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from mpi4py import MPI

from common import Shell, approx, read_json
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.elements.topology import EDGES
from headstock.pipeline.stages.components import load_or_make_mesh
from headstock.pipeline.stages.shared_components import start_run
from headstock.reduction.components.elastic import reduce_elastic
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.solvers.elastic.elasticity import assemble_elasticity

pytestmark = [pytest.mark.neighbours, pytest.mark.filterwarnings("ignore")]
CANTILEVER = Path(__file__).parents[2] / "machines" / "cantilever.toml"
FINE, COARSE = "12.5 mm", "60 mm"
ABAQUS_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
Sparse = Any


@functools.cache
def column(size: str) -> tuple[Scene, ComponentMesh]:
    scene = load_scene(CANTILEVER, overrides=(f"components.column.mesh.size={size}",))
    state = start_run(scene, MPI.COMM_SELF)
    return scene, load_or_make_mesh(state, state.plan.components["column"])[0]


@functools.cache
def own_matrices(size: str) -> tuple[Sparse, Sparse]:
    """Stiffness and mass ``(3 n, 3 n)``, x y z of each mesh point."""
    scene, mesh = column(size)
    material = scene.machine.components["column"].material
    operators = assemble_elasticity(mesh, material, comm=MPI.COMM_SELF, with_mass=True)
    rows = (3 * operators.nodes[:, None] + np.arange(3)).ravel()
    order = scipy.sparse.csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))))
    assert operators.scalar_mass is not None
    mass = scipy.sparse.kron(operators.scalar_mass, np.eye(3))
    return tuple(
        scipy.sparse.csc_matrix(order @ matrix @ order.T) for matrix in (operators.stiffness, mass)
    )


def write_deck(name: str, size: str, *, clamped: bool) -> None:
    """Write the mesh as CalculiX reads it, with its matrices as the result."""
    scene, mesh = column(size)
    material = scene.machine.components["column"].material
    edges = [frozenset(edge) for edge in EDGES["tet"]]
    order = [0, 1, 2, 3, *(4 + edges.index(frozenset(edge)) for edge in ABAQUS_EDGES)]
    nodes = [f"{n}, {x:.13g}, {y:.13g}, {z:.13g}" for n, (x, y, z) in enumerate(mesh.points, 1)]
    cells = [
        f"{n}, {', '.join(map(str, cell))}" for n, cell in enumerate(mesh.cells[:, order] + 1, 1)
    ]
    foot = np.flatnonzero(np.abs(mesh.points[:, 2]) < 1e-9) + 1
    lines = ["*NODE, NSET=ALL", *nodes, "*ELEMENT, TYPE=C3D10, ELSET=ALL", *cells]
    lines += [
        "*MATERIAL, NAME=STEEL",
        "*ELASTIC",
        f"{material.youngs_modulus!r}, {material.poisson_ratio!r}",
    ]
    lines += ["*DENSITY", repr(material.density), "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL"]
    lines += ["*BOUNDARY", *(f"{node}, 1, 3" for node in foot)] if clamped else []
    lines += ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "10", "*END STEP", ""]
    Path(f"{name}.inp").write_text("\n".join(lines))


def run_calculix(name: str) -> None:
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is installed into the private root's groups only")
    done = subprocess.run(["ccx", "-i", name], capture_output=True, text=True, check=False)
    assert Path(f"{name}.sti").is_file(), done.stdout[-500:]


def read_calculix(name: str, ending: str, size: int) -> Sparse:
    """A matrix by nodes, whichever dofs its list leaves out."""
    dofs = [line.split(".") for line in Path(f"{name}.dof").read_text().split()]
    rows = np.array([3 * (int(node) - 1) + int(dof) - 1 for node, dof in dofs])
    table = np.loadtxt(f"{name}{ending}")
    i, j = rows[table[:, 0].astype(int) - 1], rows[table[:, 1].astype(int) - 1]
    half = scipy.sparse.csc_matrix((table[:, 2], (i, j)), (size, size))
    return half + half.T - scipy.sparse.diags(half.diagonal())


def free_frequencies(stiffness: Sparse, mass: Sparse, count: int) -> FloatArray:
    """The lowest elastic ones of a free body [Hz]."""
    squares = scipy.sparse.linalg.eigsh(
        stiffness, count + 6, mass, sigma=-1e4, return_eigenvectors=False, tol=1e-13
    )
    return np.sqrt(np.sort(squares)[6:]) / (2.0 * np.pi)


def test_calculix_finds_our_stiffness_and_frequencies(
    shell: Shell, capsys: pytest.CaptureFixture[str]
) -> None:
    write_deck("column", FINE, clamped=False)
    run_calculix("column")
    stiffness, mass = own_matrices(FINE)
    theirs, their_mass = (
        read_calculix("column", end, stiffness.shape[0]) for end in (".sti", ".mas")
    )
    gap = np.abs(theirs - stiffness).max() / np.abs(stiffness).max()
    assert gap <= 1e-8
    given = free_frequencies(stiffness, mass, 10)
    assert free_frequencies(theirs, mass, 10) == approx(given, rel=1e-8)
    found = free_frequencies(theirs, their_mass, 10)
    assert found == approx(given, rel=1e-4)
    entries = np.abs(their_mass - mass).max() / np.abs(mass).max()
    with capsys.disabled():
        print(f"\nK {gap:.1e}, frequencies {np.abs(found / given - 1).max():.1e}, M {entries:.2f}")


def test_exudyn_has_the_frequencies_of_our_reduced_body(shell: Shell) -> None:
    import exudyn
    from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface

    scene, mesh = column(COARSE)
    body = reduce_elastic(scene.machine.components["column"], mesh, comm=MPI.COMM_SELF)
    assert body.recovery is not None
    squares, vectors = scipy.linalg.eigh(body.stiffness, body.mass)
    stiffness, mass = own_matrices(COARSE)
    fem = FEMinterface()
    fem.nodes = {"Position": mesh.points}
    fem.stiffnessMatrix, fem.massMatrix = (scipy.sparse.csr_matrix(m) for m in (stiffness, mass))
    fem.modeBasis = {"matrix": body.recovery.basis @ vectors[:, 6:], "type": "NormalModes"}
    system = exudyn.SystemContainer().AddSystem()
    reduced = ObjectFFRFreducedOrderInterface(
        fem, rigidBodyNodeType="NodeType.RotationRxyz", roundMassMatrix=0, roundStiffnessMatrix=0
    )
    reduced.AddObjectFFRFreducedOrder(system)
    system.Assemble()
    values, _ = system.ComputeODE2Eigenvalues()
    found = np.sqrt(np.sort(values)[6:16])
    assert found == approx(np.sqrt(squares[6:16]), rel=1e-8)


DECK = """
[components.column]
solid = { superelement = "column.sti", points = "column.inp", supported = true }
[points.tcp]
tool = "column.node_%d"
work = "ground"
[analyses.modal]
count = 6
"""


def test_a_foreign_deck_gives_our_frequencies(shell: Shell) -> None:
    write_deck("column", COARSE, clamped=True)
    run_calculix("column")
    _, mesh = column(COARSE)
    stiffness, mass = own_matrices(COARSE)
    top = int(np.argmax(mesh.points[:, 2])) + 1
    shell(f"run {shell.write(DECK % top)} --json taken.json --no-figures")
    found = read_json(Path("taken.json"))["modal"][0]["frequencies_hz"]
    free = np.repeat(np.abs(mesh.points[:, 2]) > 1e-9, 3)
    size = len(free)
    theirs = [
        read_calculix("column", end, size).tocsc()[free][:, free].toarray()
        for end in (".sti", ".mas")
    ]
    exact = np.sqrt(scipy.linalg.eigvalsh(*theirs)[:6]) / (2.0 * np.pi)
    assert found == approx(
        exact, rel=1e-8
    )  # rounding of the largest eigenvalues shows in the lowest
    ours = [matrix[free][:, free].toarray() for matrix in (stiffness, mass)]
    assert exact == approx(np.sqrt(scipy.linalg.eigvalsh(*ours)[:6]) / (2.0 * np.pi), rel=2e-3)
