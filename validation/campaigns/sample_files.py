"""Small sound files of every kind a scene may refer to: a box of 10-node tets, its superelement, measured forces, a way of axes."""

from pathlib import Path
from typing import Any

import numpy as np

from headstock.geometry.frames import Frame
from headstock.meshing.component_mesh import ComponentMesh
from headstock.pipeline.storage.superelements import write_superelement
from headstock.reduction.superelement import Attachment, Superelement
from headstock.validation.parts.structured_meshes import lattice_mesh, straight_lattice

SIZE = (0.04, 0.06, 0.2)
# the last two of a 10-node tet come in another order than gmsh's
TET10_ORDER = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
LINE = 8


def box_mesh() -> ComponentMesh:
    """A box of 10-node tets with its corner at the origin [m]."""
    return lattice_mesh(straight_lattice((1, 2, 4), SIZE), "tet10", straight=True)


def msh_text(mesh: ComponentMesh) -> str:
    """Text of a gmsh file of version 2.2."""
    nodes = [f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(_rows(mesh.points), 1)]
    cells = [f"{i} 11 2 99 99 {' '.join(str(n + 1) for n in cell)}" for i, cell in enumerate(_rows(mesh.cells), 1)]
    head = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "1", '3 99 "solid"', "$EndPhysicalNames"]
    return "\n".join(
        [*head, "$Nodes", str(len(nodes)), *nodes, "$EndNodes", "$Elements", str(len(cells)), *cells, "$EndElements", ""]
    )


def inp_text(mesh: ComponentMesh) -> str:
    """Text of an Abaqus deck."""
    nodes = [f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in enumerate(_rows(mesh.points), 1)]
    cells = [f"{i}, {', '.join(str(cell[n] + 1) for n in TET10_ORDER)}" for i, cell in enumerate(_rows(mesh.cells), 1)]
    return "\n".join(
        ["*Heading", "box", "*NODE, NSET=Nall", *nodes, "*Element, type=C3D10, elset=Eall", *cells, "*STEP", "*END STEP", ""]
    )


def bdf_text(mesh: ComponentMesh) -> str:
    """Text of a Nastran bulk data file."""
    lines = ["BEGIN BULK", "MAT1,1,2.1+11,,0.3"]
    for i, (x, y, z) in enumerate(_rows(mesh.points), 1):
        lines += [f"{'GRID*':<8}{i:<16}{'':16}{x:<16.9e}{y:<16.9e}{'*':<8}".rstrip(), f"{'*':<8}{z:<16.9e}"]
    for i, cell in enumerate(_rows(mesh.cells), 1):
        fields = [str(i), "1", *(str(cell[n] + 1) for n in TET10_ORDER)]
        first, rest = fields[:LINE], fields[LINE:]
        lines += [
            f"{'CTETRA':<8}" + "".join(f"{word:<8}" for word in first) + "+",
            f"{'+':<8}" + "".join(f"{word:<8}" for word in rest),
        ]
    return "\n".join([*lines, "ENDDATA", ""])


def forces_text() -> str:
    """Text of a file of measured forces, a hundred samples long."""
    rows = [f"{1e-3 * i!r},{(17 * i) % 50},{-3.5 * i},1e1" for i in range(100)]
    return "\n".join(["time [s],fx,fy,fz", *rows, ""])


def path_text() -> str:
    """Text of a file of forty waypoints of a linear and a rotary axis."""
    rows = [f"{1.5 * ((7 * i) % 40):g},{-90 + 4.5 * i:g}" for i in range(40)]
    return "\n".join(["X [mm],C [deg]", *rows, ""])


def box_superelement() -> Superelement:
    """A superelement of one interface and two modes of 100 and 200 Hz whose other numbers mean nothing."""
    numbers = np.arange(64.0).reshape(8, 8)
    numbers[6:, 6:] = np.diag(0.5 * (2.0 * np.pi * np.array([100.0, 200.0])) ** 2)
    labels = (*(("foot", dof) for dof in ("x", "y", "z", "rx", "ry", "rz")), ("mode", "1"), ("mode", "2"))
    return Superelement(
        name="column",
        labels=labels,
        frames=(Frame(),),
        attachments={"foot": Attachment(0, Frame())},
        stiffness=numbers + numbers.T,
        mass=np.eye(8),
        damping=None,
        recovery=None,
        recovery_points=None,
        constraints=np.zeros((0, 8)),
        modal_frequencies_hz=np.array([100.0, 200.0]),
        cutoff_hz=300.0,
        full_dofs=100,
        mass_kg=1.0,
        center_of_mass=np.zeros(3),
        inertia=np.eye(3),
        residual=1e-12,
    )


def write_samples(folder: Path) -> dict[str, bytes]:
    """Content of a sound file by its name; STEP files and targets are not among them."""
    mesh = box_mesh()
    texts = {
        "part.msh": msh_text(mesh),
        "part.inp": inp_text(mesh),
        "part.bdf": bdf_text(mesh),
        "forces.csv": forces_text(),
        "path.csv": path_text(),
    }
    write_superelement(folder / "sample.h5", box_superelement())
    return {**{name: text.encode() for name, text in texts.items()}, "part.h5": (folder / "sample.h5").read_bytes()}


def _rows(array: Any) -> list[list[Any]]:
    return list(array.tolist())
