"""Shipped machines against unreduced finite element models of themselves: the three-axis machine,
and a table along its guideway.
"""

import time
from collections.abc import Iterator, Mapping

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine, Pose
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
from headstock.solvers.mpi import MPI
from headstock.validation.machines.monolithic_machines import (
    MonolithicMachine,
    fix_carriages,
    monolithic_compliance,
    monolithic_frequencies,
    monolithic_machine,
    view_carriages,
)
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
)

SCENE = PROJECT / "machines" / "guideway.toml"
REACH = 0.24
COUNT = 10
POSITIONS = 50  # against fresh meshes
SAME_MESH_POSITIONS = 8
LARGEST, MEDIAN = 1e-2, 1e-3
RIPPLE = 5e-4
MACHINES = PROJECT / "machines"
FREQUENCY_COUNT = 14
SHIFT_HZ = 20.0
# compliance is exact in a Craig-Bampton model; frequencies carry its truncation, far above their
# range here
COMPLIANCE_TOLERANCE = 1e-6
FREQUENCY_TOLERANCE = 1e-3
KIND = "monolithic FE"

Answer = tuple[FloatArray, FloatArray]  # compliance along x, y, z [m/N]; ten frequencies [Hz]


def check_three_axis_machine(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Compliance at the TCP and natural frequencies in every pose, reduced and unreduced."""
    scene = load_scene(MACHINES / "three_axis.toml")
    machine = scene.machine
    elastic = {
        name: part for name, part in machine.components.items() if part.fidelity == "elastic"
    }
    meshes = comm.bcast(
        {name: mesh_component(part) for name, part in elastic.items()} if comm.rank == 0 else None,
        root=0,
    )
    reduced = _reduce_parts(machine, meshes, comm)
    for pose in scene.poses.values():
        coupled = couple(reduced, machine, pose)
        channels = [("tcp", dof) for dof in DOF_NAMES]
        inputs = np.column_stack([coupled.system.inputs[channel] for channel in channels])
        compliance = (
            np.vstack([coupled.system.outputs[channel] for channel in channels])
            @ solve_static(coupled.system, inputs).displacements
        )
        frequencies = solve_modal(coupled.system, count=FREQUENCY_COUNT).frequencies_hz
        if comm.rank == 0:
            full = monolithic_machine(machine, meshes, pose)
            expected = monolithic_compliance(full, "tcp")
            references = monolithic_frequencies(full, FREQUENCY_COUNT, shift_hz=SHIFT_HZ)
            yield from _compare(pose.name, compliance, expected, frequencies, references)


def _compare(
    pose: str,
    compliance: FloatArray,
    expected: FloatArray,
    frequencies: FloatArray,
    references: FloatArray,
) -> Iterator[ValidationRow]:
    for i, j in zip(*np.tril_indices(3), strict=True):
        target = Target(1e9 * expected[i, j], "um/kN", COMPLIANCE_TOLERANCE, KIND)
        yield compare_value(
            f"{pose}: d{DOF_NAMES[i]}/F{DOF_NAMES[j]}", 1e9 * compliance[i, j], target
        )
    for number, (value, right) in enumerate(zip(frequencies, references, strict=True), start=1):
        target = Target(right, "Hz", FREQUENCY_TOLERANCE, KIND)
        yield compare_value(f"{pose}: f{number}", value, target)


def check_guideway() -> list[ValidationRow]:
    """Compliance and frequencies at 50 places against fresh meshes, at 8 against the same mesh;
    ripple; what a pose costs.
    """
    machine = load_scene(SCENE).machine
    mesh = mesh_component(machine.components["bed"])
    parts = _reduce_parts(machine, {"bed": mesh}, MPI.COMM_SELF)
    ripple = compare_bound(
        "ripple of ten frequencies over the control points", _find_ripple(machine, parts), RIPPLE
    )
    return [*_compare_meshes(machine, mesh, parts), ripple, *_measure_cost(machine, parts)]


def _reduce_parts(
    machine: Machine, meshes: Mapping[str, ComponentMesh], comm: MPI.Comm
) -> dict[str, Superelement]:
    """Superelements of meshed components, and of the others from their mass properties; collective."""
    return {
        name: reduce_elastic(part, meshes[name], comm=comm)
        if name in meshes
        else reduce_rigid(part, describe_component(part))
        for name, part in machine.components.items()
    }


def _answer_reduced(machine: Machine, parts: dict[str, Superelement], place: float) -> Answer:
    """Compliances along x, y and z at the TCP [m/N] and lowest frequencies [Hz] of the coupled
    superelements.

    Args:
        machine: With an axis X along the rails.
        place: Position of the axis [m].
    """
    system = couple(parts, machine, Pose("p", {"X": place})).system
    channels = np.column_stack([system.inputs["tcp", dof] for dof in DOF_NAMES])
    compliance = channels.T @ solve_static(system, channels).displacements
    return np.diag(compliance)[:3], solve_modal(system, count=COUNT).frequencies_hz


def _answer_same_mesh(machine: Machine, mesh: ComponentMesh, place: float) -> Answer:
    """Answer the same from the unreduced model on the mesh that was reduced, its carriages weighted
    alike.

    Args:
        machine: With an axis X along the rails.
        place: Position of the axis [m].
    """
    pose = Pose("p", {"X": place})
    views = view_carriages(machine, {"bed": mesh}, pose)
    model = monolithic_machine(fix_carriages(machine, pose), {"bed": mesh}, pose, views=views)
    return _answer_unreduced(model)


def _answer_fresh_mesh(machine: Machine, place: float) -> Answer:
    """Answer the same on a mesh of its own, an evenly averaging patch under every carriage."""
    pose = Pose("p", {"X": place})
    fixed = fix_carriages(machine, pose)
    model = monolithic_machine(fixed, {"bed": mesh_component(fixed.components["bed"])}, pose)
    return _answer_unreduced(model)


def _answer_unreduced(model: MonolithicMachine) -> Answer:
    frequencies = monolithic_frequencies(model, COUNT, shift_hz=0.0)
    return np.diag(monolithic_compliance(model, "tcp"))[:3], frequencies


def _relative_deviations(found: Answer, expected: Answer) -> FloatArray:
    """Of the three compliances and of the frequencies ``(13,)``."""
    return np.concatenate([np.abs(a / b - 1.0) for a, b in zip(found, expected, strict=True)])


def _find_ripple(machine: Machine, parts: dict[str, Superelement], samples: int = 41) -> float:
    """Return the largest relative departure of a frequency from a quartic in the position, over two
    spline intervals around the middle [-].

    Args:
        machine: With an axis X along the rails.
    """
    spacing = next(iter(parts["bed"].rails.values())).blur
    places = np.linspace(-spacing, spacing, samples)
    frequencies = np.array([_answer_reduced(machine, parts, float(place))[1] for place in places])
    smooth = np.polynomial.chebyshev.chebvander(places / spacing, 4)
    rest = frequencies - smooth @ np.linalg.lstsq(smooth, frequencies, rcond=None)[0]
    return float(np.abs(rest / frequencies).max())


def _compare_meshes(
    machine: Machine, mesh: ComponentMesh, parts: dict[str, Superelement]
) -> Iterator[ValidationRow]:
    fresh, same, apart = [], [], []
    for index, place in enumerate(np.linspace(-REACH, REACH, POSITIONS)):
        found = _answer_reduced(machine, parts, float(place))
        expected = _answer_fresh_mesh(machine, float(place))
        fresh.append(_relative_deviations(found, expected))
        if index % (POSITIONS // SAME_MESH_POSITIONS) == 0:
            alike = _answer_same_mesh(machine, mesh, float(place))
            same.append(_relative_deviations(found, alike))
            apart.append(_relative_deviations(alike, expected))
    for name, errors in (
        ("same mesh, same weight", np.array(same)),
        ("fresh mesh, even patch", np.array(fresh)),
    ):
        for what, part in (("compliance", errors[:, :3]), ("frequencies", errors[:, 3:])):
            note = f"{len(errors)} places"
            yield compare_bound(f"{what}, {name}: largest", part.max(), LARGEST, note)
            yield compare_bound(f"{what}, {name}: median", np.median(part), MEDIAN, note)
    yield show(
        "between the two unreduced models: largest", np.max(apart), "-", "what mesh and weight make"
    )


def _measure_cost(machine: Machine, parts: dict[str, Superelement]) -> list[ValidationRow]:
    places = np.linspace(-REACH, REACH, 20)
    _answer_reduced(machine, parts, 0.0)
    start = time.process_time()
    for place in places:
        _answer_reduced(machine, parts, float(place))
    seconds = 1000.0 * (time.process_time() - start) / len(places)
    return [
        show("reduced dofs", sum(len(part.labels) for part in parts.values()), "-"),
        show(
            "1000 poses: couple, compliance, ten modes",
            seconds,
            "s",
            "CPU; half of it on two cores",
        ),
    ]
