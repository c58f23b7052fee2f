"""The job of the reduction benchmark: a steel column with two rigid end faces, its mesh and its
matrices as plain files.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse
from mpi4py import MPI

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    MeshSettings,
    Patch,
    ReductionSettings,
)
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh, IntArray, MeshQuality
from headstock.meshing.components.meshing import mesh_component
from headstock.solvers.elastic.elasticity import assemble_elasticity

# element sizes [m] that give about this many dofs
SIZES = {"20k": 0.0145, "100k": 0.0075, "300k": 0.005, "1M": 0.0033, "3M": 0.00226}
EXTENT = (0.1, 0.038, 0.5)


SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.column]
solid = {{ box = ["{extent[0]} m", "{extent[1]} m", "{extent[2]} m"] }}
material = "steel"
mesh = {{ size = "{size} m" }}
reduction = {{ modes = {modes} }}
interfaces = {{ foot = {{ face = "z-" }}, tip = {{ face = "z+" }} }}
[joints]
clamp = {{ between = ["ground", "column.foot"], kind = "rigid" }}
[points]
tcp = {{ tool = "column.tip", work = "ground" }}
[analyses]
modal = {{ count = 6 }}
"""


def write_scene(size: str, modes: int, folder: Path) -> None:
    """The column on rigid ground as a scene, for a run of it."""
    text = SCENE.format(extent=EXTENT, size=SIZES[size], modes=modes)
    (folder / "column.toml").write_text(text)


def column(size: str, modes: int) -> Component:
    """The column as a component."""
    return Component(
        name="column",
        solid=Box(EXTENT),
        material=Material(name="steel", youngs_modulus=210e9, poisson_ratio=0.3, density=7850.0),
        interfaces={
            "foot": Interface("foot", (Patch("z-"),)),
            "tip": Interface("tip", (Patch("z+"),)),
        },
        mesh=MeshSettings(size=SIZES[size]),
        reduction=ReductionSettings(modes=modes),
    )


def write_mesh(size: str, folder: Path) -> int:
    """Mesh the column; returns the number of dofs."""
    mesh = mesh_component(column(size, 0))
    quality = mesh.quality
    np.savez(
        folder / "mesh.npz",
        points=mesh.points,
        cells=mesh.cells,
        foot=mesh.patches["foot"],
        tip=mesh.patches["tip"],
        scalars=np.array(
            [quality.minimum_scaled_jacobian, quality.repaired, quality.volume, quality.cad_volume]
        ),
        kind=np.array(mesh.kind),
        straight=np.array(mesh.straight),
    )
    return 3 * len(mesh.points)


def read_mesh(folder: Path) -> ComponentMesh:
    """The mesh as it was written."""
    with np.load(folder / "mesh.npz") as file:
        jacobian, repaired, volume, cad_volume = file["scalars"]
        return ComponentMesh(
            points=file["points"],
            cells=file["cells"],
            kind=str(file["kind"]),  # type: ignore[arg-type]
            straight=bool(file["straight"]),
            patches={"foot": file["foot"], "tip": file["tip"]},
            quality=MeshQuality(float(jacobian), int(repaired), float(volume), float(cad_volume)),
        )


def write_matrices(folder: Path) -> None:
    """Stiffness and mass of the whole column for the peers, in mesh point order; compiles the
    element kernels on the way.
    """
    mesh = read_mesh(folder)
    operators = assemble_elasticity(
        mesh, column("20k", 0).material, comm=MPI.COMM_SELF, with_mass=True
    )
    place = np.argsort(operators.nodes)
    dofs = (3 * place[:, None] + np.arange(3)).ravel()
    assert operators.scalar_mass is not None  # asked for with the stiffness
    stiffness = operators.stiffness.tocsr()[dofs][:, dofs]
    mass = scipy.sparse.kron(operators.scalar_mass[place][:, place], np.eye(3), format="csr")
    for name, matrix in (("stiffness", stiffness), ("mass", mass)):
        matrix.sort_indices()
        scipy.sparse.save_npz(folder / f"{name}.npz", matrix, compressed=False)


@dataclass(frozen=True, eq=False)
class MatrixJob:
    """What the peers are given.

    Attributes:
        points: ``(n, 3)`` [m].
        faces: Points of the two end faces.
        stiffness: ``(3n, 3n)``.
        mass: ``(3n, 3n)``.
    """

    points: FloatArray
    faces: tuple[IntArray, IntArray]
    stiffness: scipy.sparse.csr_matrix
    mass: scipy.sparse.csr_matrix

    @property
    def free(self) -> IntArray:
        """Dofs outside the end faces."""
        fixed = np.zeros(3 * len(self.points), dtype=bool)
        for face in self.faces:
            fixed[(3 * face[:, None] + np.arange(3)).ravel()] = True
        return np.flatnonzero(~fixed)

    def face_motions(self) -> FloatArray:
        """``(3n, 12)`` unit motions of the faces about their centroids, zero elsewhere."""
        motions = np.zeros((3 * len(self.points), 12))
        for number, face in enumerate(self.faces):
            center = np.array([EXTENT[0] / 2, EXTENT[1] / 2, number * EXTENT[2]])
            center[:2] = 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))[:2]
            center[2] = self.points[face[0], 2]
            dofs = (3 * face[:, None] + np.arange(3)).ravel()
            motions[dofs, 6 * number : 6 * number + 6] = rigid_map(self.points[face], center)
        return motions


def read_matrices(folder: Path) -> MatrixJob:
    """The matrices as they were written."""
    mesh = read_mesh(folder)
    faces = (np.unique(mesh.patches["foot"]), np.unique(mesh.patches["tip"]))
    stiffness, mass = (
        scipy.sparse.csr_matrix(scipy.sparse.load_npz(folder / f"{name}.npz"))
        for name in ("stiffness", "mass")
    )
    return MatrixJob(mesh.points, faces, stiffness, mass)
