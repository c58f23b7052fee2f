"""The volume meshes of the elastic components in a pose as ``.vtu``: modes, static responses, and
the stresses in them.
"""

import importlib
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.topology import CORNERS, cell_family
from headstock.pipeline.results.mode_files import (
    AnyArray,
    CellBlock,
    Grid,
    encode_grid,
    file_stem,
    mode_array,
    mode_numbers,
    push_array,
)
from headstock.pipeline.stages.components import stored_mesh
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.storage.outputs import replace_outputs
from headstock.reduction.coupling.dof_layout import turn_dofs

VOLUME_FOLDER = "volume"
# loaded only where volumes are asked for: it needs the element library
STRESS_MODULE = "headstock.solvers.elastic.patch_recovery"
CELLS_AT_ONCE = 20_000
VTK_KINDS: dict[CellKind, int] = {"tet4": 10, "tet10": 24, "hex8": 12, "hex20": 25, "hex27": 29}
_HEX20 = [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
# position in VTK's cell to position in gmsh's
VTK_ORDER: dict[CellKind, list[int]] = {
    "tet4": list(range(4)),
    "tet10": [*range(8), 9, 8],
    "hex8": list(range(8)),
    "hex20": _HEX20,
    "hex27": [*_HEX20, 22, 23, 21, 24, 20, 25, 26],
}


def write_volumes(state: RunState, folder: Path, *, wanted: bool) -> list[str]:
    """Write ``volume/POSE.vtu`` for every pose with modes or static responses, and remove those of
    an earlier run.

    Point data: ``component``, ``mode_01`` and so on [m/sqrt(kg)], ``static_POINT_x`` [m/N]. Cell
    data at the middle of each cell: ``strain_energy_density_mode_01`` [J/(kg m^5), of the mode at
    unit amplitude], ``von_mises_static_POINT_x`` [Pa/N].

    Args:
        state: Of a finished run, on rank 0.
        folder: Folder of results.
        wanted: Else only those of an earlier run are removed.

    Returns:
        Remarks for the user: elastic components without a volume, and files that were kept.

    Raises:
        OutputError: A file cannot be written.
    """
    contents: dict[str, bytes] = {}
    remarks: list[str] = []
    if wanted:
        meshes = _find_meshes(state)
        missing = [
            name
            for name in state.reduced
            if name not in meshes and state.plan.components[name].fidelity == "elastic"
        ]
        if missing:
            remarks.append(
                f"no volume of {', '.join(missing)}: there is no mesh or no shape of the interior in the store"
            )
        contents = {
            f"{file_stem(pose)}.vtu": _encode_pose(state, pose, meshes)
            for pose in state.motions
            if meshes
        }
    return [*remarks, *replace_outputs(folder, VOLUME_FOLDER, contents)]


def von_mises(material: Material, scaled: AnyArray) -> AnyArray:
    """Equivalent stress ``(...)`` [Pa] of scaled stresses ``(..., 6)``, half of whose square is the
    density of strain energy.

    Args:
        material: Isotropic.
        scaled: As ``stress_operators`` makes them: the deviator over sqrt(2 G) and the pressure on
            the diagonal.
    """
    diagonal, shear = scaled[..., :3], scaled[..., 3:]
    deviator = diagonal - diagonal.mean(axis=-1, keepdims=True)
    modulus = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    return np.asarray(
        np.sqrt(3.0 * modulus * ((deviator**2).sum(axis=-1) + (shear**2).sum(axis=-1)))
    )


def cell_stresses(mesh: ComponentMesh, material: Material, displacement: FloatArray) -> AnyArray:
    """Scaled stresses ``(n_cells, 6, k)`` in the middle of each cell.

    Args:
        mesh: The component's mesh.
        material: Its material.
        displacement: ``(3 n_points, k)``.
    """
    stresses = importlib.import_module(STRESS_MODULE)
    middle = CORNERS[cell_family(mesh.kind)].mean(axis=0)[None]
    found = []
    for begin in range(0, len(mesh.cells), CELLS_AT_ONCE):
        cells: IntArray = np.arange(begin, min(begin + CELLS_AT_ONCE, len(mesh.cells)))
        operators = stresses.stress_operators(mesh, material, middle, cells)
        found.append(np.matmul(operators.table, stresses.local_motions(mesh, displacement, cells)))
    return np.concatenate(found)


def _find_meshes(state: RunState) -> dict[str, tuple[ComponentMesh, FloatArray]]:
    """Meshes of elastic components, with the recovery basis of their points."""
    found = {}
    for name, reduced in state.reduced.items():
        recovery = reduced.superelement.recovery
        if recovery is None or state.plan.components[name].fidelity != "elastic":
            continue
        mesh = state.meshes.get(name) or stored_mesh(state, state.plan.components[name])
        if mesh is not None and len(mesh.points) == len(recovery.points):
            found[name] = mesh, recovery.basis
    return found


def _encode_pose(
    state: RunState, pose: str, meshes: dict[str, tuple[ComponentMesh, FloatArray]]
) -> bytes:
    modes = next((modes for modes in state.modal if modes.pose.name == pose), None)
    motions = state.motions[pose]
    names = [] if modes is None else [mode_array(index) for index in range(modes.shapes.shape[1])]
    names += [push_array(push) for push in motions.motions]
    columns = ([] if modes is None else [modes.shapes]) + [
        motion[:, None] for motion in motions.motions.values()
    ]
    stacked = np.hstack(columns)
    count = 0 if modes is None else modes.shapes.shape[1]
    points, blocks, numbers, moved, over_cells = [], [], [], [], []
    start = 0
    for number, name in enumerate(state.reduced):
        if name not in meshes:
            continue
        (mesh, basis), superelement, frame = (
            meshes[name],
            state.reduced[name].superelement,
            state.views[pose].placements[name],
        )
        own = basis @ (turn_dofs(superelement, frame) @ stacked[motions.offsets[name]])
        points.append(mesh.points @ frame.rotation.T + frame.origin)
        blocks.append(CellBlock(VTK_KINDS[mesh.kind], mesh.cells[:, VTK_ORDER[mesh.kind]] + start))
        numbers.append(np.full(len(mesh.points), number, dtype=np.int32))
        moved.append(
            np.einsum("ij,njk->nik", frame.rotation, own.reshape(len(mesh.points), 3, -1)).astype(
                np.float32
            )
        )
        over_cells.append(_cell_numbers(mesh, state.plan.components[name].material, own, count))
        start += len(mesh.points)
    together, cells = np.concatenate(moved), np.concatenate(over_cells)
    labels = [
        f"{'strain_energy_density' if place < count else 'von_mises'}_{name}"
        for place, name in enumerate(names)
    ]
    return encode_grid(
        Grid(
            np.vstack(points),
            tuple(blocks),
            {"component": np.concatenate(numbers)}
            | {name: together[:, :, place] for place, name in enumerate(names)},
            {label: cells[:, place] for place, label in enumerate(labels)},
            {} if modes is None else mode_numbers(list(modes.frequencies_hz), modes.damping_ratio),
        )
    )


def _cell_numbers(
    mesh: ComponentMesh, material: Material, displacement: FloatArray, count: int
) -> AnyArray:
    """Density of strain energy of the first ``count`` motions and equivalent stress of the others,
    ``(n_cells, k)``.
    """
    scaled = cell_stresses(mesh, material, displacement)
    energies = 0.5 * (scaled[:, :, :count] ** 2).sum(axis=1)
    return np.hstack([energies, von_mises(material, scaled[:, :, count:].swapaxes(1, 2))]).astype(
        np.float32
    )
