"""The volume meshes of the elastic components in a pose: modes, static responses, and the stresses
in them; as ``.vtu`` files, and for ``Results.mesh``.
"""

import importlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.topology import CORNERS, cell_family, cell_order
from headstock.pipeline.results.grids import (
    COMPONENT,
    VOLUME,
    AnyArray,
    CellBlock,
    Grid,
    Quantity,
    encode_grid,
    merge_grids,
    mode_array,
    pose_numbers,
    push_array,
)
from headstock.pipeline.results.mode_files import VOLUME_FOLDER, file_stem, with_collection
from headstock.pipeline.stages.components import stored_mesh
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.storage.outputs import replace_outputs
from headstock.reduction.coupling.dof_layout import turn_dofs

# loaded only where volumes are requested: it needs the element library
STRESS_MODULE = "headstock.solvers.elastic.patch_recovery"
PLACES_AT_ONCE = 40_000
SHEAR_PAIRS = ((1, 2), (0, 2), (0, 1))  # as in the stress module
# order in which ParaView reads and labels the six numbers of a symmetric tensor
SYMMETRIC = ([0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2])
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


@dataclass(frozen=True, eq=False)
class _Mesh:
    """A component's mesh and the recovery basis ``(3 n_points, dofs)`` of its points."""

    mesh: ComponentMesh
    basis: FloatArray


@dataclass(frozen=True, eq=False)
class _Strained:
    """Cells strained by ``k`` motions.

    Attributes:
        volumes: ``(n_cells,)`` [m^3].
        densities: ``(n_cells, k)`` mean density of strain energy.
        stresses: ``(n_cells, k, 3, 3)`` in the middle of each cell, in the component's axes.
    """

    volumes: FloatArray
    densities: FloatArray
    stresses: FloatArray


def write_volumes(state: RunState, folder: Path, *, wanted: bool) -> list[str]:
    """Write ``volume/POSE.vtu`` for every pose with modes or static responses, and remove those of
    an earlier run.

    What the arrays hold: ``volume_grid``; ``poses.pvd`` collects the files.

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
        elastic = [
            name for name, part in state.plan.components.items() if part.fidelity == "elastic"
        ]
        meshes = {name: mesh for name in elastic if (mesh := _find_mesh(state, name)) is not None}
        missing = [name for name in elastic if name not in meshes]
        if missing:
            remarks.append(
                f"no volume of {', '.join(missing)}: there is no mesh or no shape of the interior in the store"
            )
        for pose in state.motions if meshes else ():
            grids = [_pose_grid(state, pose, name, mesh) for name, mesh in meshes.items()]
            contents[f"{file_stem(pose)}.vtu"] = encode_grid(merge_grids(grids))
    return [*remarks, *replace_outputs(folder, VOLUME_FOLDER, with_collection(contents))]


def volume_grid(state: RunState, pose: str, component: str) -> Grid | None:
    """The mesh of an elastic component in a pose [m]; None where there is no mesh or no shape of the
    interior.

    Over points: mode shapes and responses to unit forces. Over cells, of each of them: mean density
    of strain energy, whose sum over ``volume`` is the strain energy of the component, and in the
    middle of the cell the stress (xx, yy, zz, xy, yz, xz in machine axes) and the equivalent stress.

    Args:
        state: Of a finished run, on rank 0.
        pose: Which one.
        component: Which one.
    """
    if pose not in state.motions or state.plan.components[component].fidelity != "elastic":
        return None
    mesh = _find_mesh(state, component)
    return None if mesh is None else _pose_grid(state, pose, component, mesh)


def true_stresses(material: Material, scaled: AnyArray) -> AnyArray:
    """Stress tensors ``(..., 3, 3)`` [Pa] of scaled stresses ``(..., 6)``, half of whose square is
    the density of strain energy.

    Args:
        material: Isotropic.
        scaled: As ``stress_operators`` makes them: the deviator over sqrt(2 G) and the pressure on
            the diagonal, shear yz, xz, xy over sqrt(G).
    """
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    bulk = material.youngs_modulus / (3.0 * (1.0 - 2.0 * material.poisson_ratio))
    mean = scaled[..., :3].mean(axis=-1, keepdims=True)
    found = np.zeros((*scaled.shape[:-1], 3, 3))
    for position, (row, column) in enumerate(SHEAR_PAIRS):
        found[..., row, column] = found[..., column, row] = (
            np.sqrt(shear) * scaled[..., 3 + position]
        )
    # a pressure p stands as p / sqrt(3 K) at each of the three places
    diagonal = np.sqrt(2.0 * shear) * (scaled[..., :3] - mean) + np.sqrt(3.0 * bulk) * mean
    for axis in range(3):
        found[..., axis, axis] = diagonal[..., axis]
    return found


def von_mises(stress: AnyArray) -> AnyArray:
    """Equivalent stress ``(...)`` [Pa] of stress tensors ``(..., 3, 3)`` [Pa]."""
    deviator = stress - np.eye(3) * (np.trace(stress, axis1=-2, axis2=-1) / 3.0)[..., None, None]
    return np.asarray(np.sqrt(1.5 * (deviator**2).sum(axis=(-2, -1))))


def _find_mesh(state: RunState, name: str) -> _Mesh | None:
    """Mesh of an elastic component, with the recovery basis of its points."""
    recovery = state.reduced[name].superelement.recovery
    if recovery is None:
        return None
    mesh = state.meshes.get(name) or stored_mesh(state, state.plan.components[name])
    if mesh is None or len(mesh.points) != len(recovery.points):
        return None
    return _Mesh(mesh, recovery.basis)


def _pose_grid(state: RunState, pose: str, name: str, found: _Mesh) -> Grid:
    modes = next((modes for modes in state.modal if modes.pose.name == pose), None)
    motions, frame = state.motions[pose], state.views[pose].placements[name]
    shapes, below = ([], 0) if modes is None else (list(modes.shapes.T), modes.below)
    stacked = np.column_stack([*shapes, *motions.motions.values()])
    own = found.basis @ (
        turn_dofs(state.reduced[name].superelement, frame) @ stacked[motions.offsets[name]]
    )
    mesh = found.mesh
    moved = np.einsum("ij,njk->nik", frame.rotation, own.reshape(len(mesh.points), 3, -1))
    cells = _strain_cells(mesh, state.plan.components[name].material, own)
    stresses = np.einsum("ai,ckij,bj->ckab", frame.rotation, cells.stresses, frame.rotation)
    body = np.full(len(mesh.points), list(state.skins).index(name), dtype=np.int32)
    over_points: dict[str, AnyArray] = {COMPONENT: body}
    over_cells: dict[str, AnyArray] = {VOLUME: cells.volumes}

    def title(column: int, quantity: Quantity) -> str:
        count = len(shapes)
        if column < count:
            return mode_array(below + column, quantity)
        return push_array(list(motions.motions)[column - count], quantity)

    for column in range(stacked.shape[1]):
        stress = stresses[:, column]
        over_points[title(column, "shape")] = moved[:, :, column].astype(np.float32)
        numbers: dict[Quantity, AnyArray] = {
            "strain energy density": cells.densities[:, column],
            "stress": stress[:, *SYMMETRIC],
            "von Mises stress": von_mises(stress),
        }
        over_cells |= {
            title(column, quantity): values.astype(np.float32)
            for quantity, values in numbers.items()
        }
    return Grid(
        mesh.points @ frame.rotation.T + frame.origin,
        (CellBlock(VTK_KINDS[mesh.kind], mesh.cells[:, VTK_ORDER[mesh.kind]]),),
        over_points,
        over_cells,
        pose_numbers(state.modal, pose),
    )


def _strain_cells(mesh: ComponentMesh, material: Material, displacement: FloatArray) -> _Strained:
    recovery = importlib.import_module(STRESS_MODULE)
    # the rule integrates the energy of cells with straight edges exactly
    degree = 2 * cell_order(mesh.kind) - (2 if cell_family(mesh.kind) == "tet" else 0)
    places, weights = recovery.gauss_places(mesh.kind, max(1, degree))
    middle = CORNERS[cell_family(mesh.kind)].mean(axis=0)[None]
    parts = []
    step = max(1, PLACES_AT_ONCE // len(places))
    for begin in range(0, len(mesh.cells), step):
        cells: IntArray = np.arange(begin, min(begin + step, len(mesh.cells)))
        motions = recovery.local_motions(mesh, displacement, cells)
        rule = recovery.stress_operators(mesh, material, places, cells)
        samples = np.matmul(rule.table, motions).reshape(len(cells), len(places), 6, -1)
        shares = rule.measures * weights
        volumes = shares.sum(axis=1)
        energies = 0.5 * np.einsum("cp,cpsk->ck", shares, samples.astype(float) ** 2)
        central = np.matmul(
            recovery.stress_operators(mesh, material, middle, cells).table, motions
        ).swapaxes(1, 2)
        parts.append(
            _Strained(volumes, energies / volumes[:, None], true_stresses(material, central))
        )
    return _Strained(
        np.concatenate([part.volumes for part in parts]),
        np.concatenate([part.densities for part in parts]),
        np.concatenate([part.stresses for part in parts]),
    )
