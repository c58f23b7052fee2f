"""The volume meshes of the elastic components in a pose: modes, static responses, and the stresses
in them; as ``.vtu`` files, and for ``Results.mesh``.
"""

import importlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.topology import CORNERS, cell_family, cell_order
from headstock.pipeline.results.grids import (
    COMPONENT,
    VOLUME,
    AnyArray,
    CellBlock,
    Grid,
    Part,
    Quantity,
    encode_grid,
    harmonic_array,
    merge_grids,
    mode_array,
    pose_numbers,
    push_array,
)
from headstock.pipeline.results.mode_files import VOLUME_FOLDER, file_stem, with_collection
from headstock.pipeline.stages.components import stored_mesh
from headstock.pipeline.stages.run_state import PoseMotions, RunState
from headstock.pipeline.storage.outputs import replace_outputs
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.solvers.second_order import ComplexArray
from headstock.solvers.stresses import largest_von_mises, pack_tensor, true_stresses

# loaded only where volumes are requested: it needs the element library
STRESS_MODULE = "headstock.solvers.recovery.patch_recovery"
PLACES_AT_ONCE = 40_000
# what complex amplitudes are written of, and their parts
TRACED: tuple[Quantity, Quantity] = ("shape", "stress")
PARTS: tuple[Part, ...] = (" Re", " Im")
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
    Of harmonic loads: complex displacements and stresses, and the largest equivalent stress over a
    cycle.

    Args:
        state: Of a finished run, on rank 0.
    """
    if pose not in state.motions or state.plan.components[component].fidelity != "elastic":
        return None
    mesh = _find_mesh(state, component)
    return None if mesh is None else _pose_grid(state, pose, component, mesh)


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
    size = max(rows.stop for rows in motions.offsets.values())
    stacked = np.column_stack([np.zeros((size, 0)), *shapes, *motions.motions.values()])
    own = found.basis @ (
        turn_dofs(state.reduced[name].superelement, frame) @ stacked[motions.offsets[name]]
    )
    mesh, real = found.mesh, own.shape[1]
    swings = _harmonic_fields(state, motions, name, frame, found)
    own = np.hstack([own, swings.real, swings.imag])
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
            "von Mises stress": largest_von_mises(pack_tensor(stress)),
        }
        over_cells |= {
            title(column, quantity): values.astype(np.float32)
            for quantity, values in numbers.items()
        }
    swung = _harmonic_arrays(motions, name, moved[:, :, real:], stresses[:, real:])
    over_points |= swung[0]
    over_cells |= swung[1]
    return Grid(
        mesh.points @ frame.rotation.T + frame.origin,
        (CellBlock(VTK_KINDS[mesh.kind], mesh.cells[:, VTK_ORDER[mesh.kind]]),),
        over_points,
        over_cells,
        pose_numbers(state.modal, pose),
    )


def _harmonic_fields(
    state: RunState, motions: PoseMotions, name: str, frame: Frame, found: _Mesh
) -> ComplexArray:
    """Displacement ``(3 n_points, k)`` of a component's mesh under harmonic loads, in its own axes;
    loads inside it move it as at rest beyond what its reduced dofs show.
    """
    element = state.reduced[name].superelement
    fields = np.zeros((len(found.basis), len(motions.harmonic)), dtype=complex)
    for number, swing in enumerate(motions.harmonic):
        turned = turn_dofs(element, frame) @ swing.motion[motions.offsets[name]]
        fields[:, number] = found.basis @ turned
        for key, factor in swing.inside.get(name, {}).items():
            particular = element.loads[key].particular
            if particular is not None:
                fields[:, number] += factor / swing.lossy[name] * particular.ravel()
    return fields


def _harmonic_arrays(
    motions: PoseMotions, name: str, moved: FloatArray, stresses: FloatArray
) -> tuple[dict[str, AnyArray], dict[str, AnyArray]]:
    """Arrays over points and over cells of ``k`` harmonic loads.

    Args:
        moved: ``(n_points, 3, 2 k)`` real parts of all displacements, then imaginary ones.
        stresses: ``(n_cells, 2 k, 3, 3)`` as the modulus alone makes them of these.
    """
    over_points: dict[str, AnyArray] = {}
    over_cells: dict[str, AnyArray] = {}
    count = len(motions.harmonic)
    for number, swing in enumerate(motions.harmonic):
        shape = moved[:, :, number], moved[:, :, count + number]
        strained = stresses[:, number] + 1j * stresses[:, count + number]
        stress = swing.lossy[name] * strained
        peak = harmonic_array(swing.given, swing.hz, "von Mises stress")
        over_cells[peak] = largest_von_mises(pack_tensor(stress)).astype(np.float32)
        for part, displaced, tensor in zip(PARTS, shape, (stress.real, stress.imag), strict=True):
            point_name, cell_name = (
                harmonic_array(swing.given, swing.hz, quantity, part) for quantity in TRACED
            )
            over_points[point_name] = displaced.astype(np.float32)
            over_cells[cell_name] = tensor[:, *SYMMETRIC].astype(np.float32)
    return over_points, over_cells


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
