"""The shipped three-axis machine against a monolithic finite element model of itself."""

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.geometry.parts.components import Component
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.storage.provenance import PROJECT
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.static_response import solve_static
from headstock.validation.machines.monolithic_machines import monolithic_compliance, monolithic_frequencies, monolithic_machine
from headstock.validation.references.rows import Target, ValidationRow, judge

MACHINES = PROJECT / "machines"
FREQUENCY_COUNT = 14
SHIFT_HZ = 20.0
# compliance is exact in a Craig-Bampton model; frequencies carry its truncation, far above their range here
COMPLIANCE_TOLERANCE = 1e-6
FREQUENCY_TOLERANCE = 1e-3
KIND = "monolithic FE"


def check_three_axis_machine(comm: MPI.Comm) -> list[ValidationRow]:
    """Compliance at the TCP and natural frequencies in every pose of the scene, reduced and unreduced."""
    scene = load_scene(MACHINES / "three_axis.toml")
    machine = scene.machine
    meshes = {name: _mesh_everywhere(part, comm) for name, part in machine.components.items() if part.fidelity == "elastic"}
    reduced = _reduce_all(machine, meshes, comm)
    rows: list[ValidationRow] = []
    for pose in scene.poses.values():
        coupled = couple(reduced, machine, pose)
        ports = [("tcp", dof) for dof in DOF_NAMES]
        inputs = np.column_stack([coupled.system.inputs[port] for port in ports])
        compliance = (
            np.vstack([coupled.system.outputs[port] for port in ports]) @ solve_static(coupled.system, inputs).displacements
        )
        frequencies = solve_modal(coupled.system, count=FREQUENCY_COUNT).frequencies_hz
        if comm.rank == 0:
            full = monolithic_machine(machine, meshes, pose)
            expected = monolithic_compliance(full, "tcp")
            references = monolithic_frequencies(full, FREQUENCY_COUNT, shift_hz=SHIFT_HZ)
            rows += _compare(pose.name, compliance, expected, frequencies, references)
    return list(comm.bcast(rows, root=0))


def _compare(
    pose: str, compliance: FloatArray, expected: FloatArray, frequencies: FloatArray, references: FloatArray
) -> list[ValidationRow]:
    case = "three-axis-machine"
    rows = [
        judge(
            case, f"{pose}: d{DOF_NAMES[i]}/F{DOF_NAMES[j]}", 1e9 * compliance[i, j],
            Target(1e9 * float(expected[i, j]), "um/kN", COMPLIANCE_TOLERANCE, KIND),
        )
        for i in range(3) for j in range(i + 1)
    ]  # fmt: skip
    rows += [
        judge(case, f"{pose}: f{number}", value, Target(float(right), "Hz", FREQUENCY_TOLERANCE, KIND))
        for number, (value, right) in enumerate(zip(frequencies, references, strict=True), start=1)
    ]
    return rows


def _mesh_everywhere(component: Component, comm: MPI.Comm) -> ComponentMesh:
    mesh: ComponentMesh = comm.bcast(mesh_component(component) if comm.rank == 0 else None, root=0)
    return mesh


def _reduce_all(machine: Machine, meshes: dict[str, ComponentMesh], comm: MPI.Comm) -> dict[str, Superelement]:
    return {
        name: reduce_elastic(part, meshes[name], comm=comm) if name in meshes else reduce_rigid(part, describe_component(part))
        for name, part in machine.components.items()
    }
