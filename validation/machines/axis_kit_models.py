"""The calibrated three-axis machine in every variant of its paper, segmented and with finite elements: modes and compliances."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.geometry.parts.components import Component
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.storage.provenance import PROJECT
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, machine_field
from headstock.reduction.motions.body_motions import split_motions
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.static_response import solve_static
from headstock.validation.machines.axis_kit_paper import LISTED_TO_HZ

SCENE = PROJECT / "machines" / "three_axis.toml"
KitFidelity = Literal["segmented", "elastic"]
FLOOR_HZ = 15.0  # above the machine on its air springs
SEARCHED_TO_HZ = 1.1 * LISTED_TO_HZ  # the paper lists 302 Hz


@dataclass(frozen=True, eq=False)
class KitModel:
    """A variant at one fidelity.

    Attributes:
        frequencies_hz: ``(m,)`` above the air springs.
        field: ``(k, m)`` mode shapes at places that all models share, weighted by mass.
        motions: Rigid part of each body's motion ``(6, m)`` at its centre of mass, machine axes.
        compliance: dz at the sensor, relative to the X-slider, per force along x, y, z at the tool post's corner, Y at 30 mm [m/N].
    """

    frequencies_hz: FloatArray
    field: FloatArray
    motions: Mapping[str, FloatArray]
    compliance: FloatArray


@dataclass(eq=False)
class KitWorkshop:
    """Makes models and keeps the superelements: a component is reduced once per fidelity."""

    comm: MPI.Comm
    mesh_size: str | None = None
    _reduced: dict[tuple[str, str], Superelement] = field(default_factory=dict)
    _places: dict[str, BodyPlaces] = field(default_factory=dict)

    def solve(self, variant: str, fidelity: KitFidelity) -> KitModel:
        """Modes at Y = 0 and compliances at Y = 30 mm of a variant whose elastic bodies are segmented or finite elements."""
        name = "+".join(["calibrated", *(["segmented"] if fidelity == "segmented" else []), variant])
        meshes = ("column_left", "column_right", "y_base") if self.mesh_size else ()
        scene = load_scene(SCENE, variant=name, overrides=[f"components.{part}.mesh.size={self.mesh_size}" for part in meshes])
        parts = {key: self._reduce(component) for key, component in scene.machine.components.items()}
        for key, part in parts.items():
            self._places.setdefault(key, choose_places(part))
        coupled = couple(parts, scene.machine, scene.poses["reference"])
        modal = solve_modal(coupled.system, up_to_hz=SEARCHED_TO_HZ)
        shapes = modal.shapes[:, modal.frequencies_hz > FLOOR_HZ]
        return KitModel(
            frequencies_hz=modal.frequencies_hz[modal.frequencies_hz > FLOOR_HZ],
            field=machine_field(coupled, self._places, shapes),
            motions=_body_motions(coupled, shapes),
            compliance=_measure_compliance(couple(parts, scene.machine, scene.poses["measured"]), scene.machine),
        )

    def _reduce(self, component: Component) -> Superelement:
        key = component.name, component.fidelity
        if key not in self._reduced:
            self._reduced[key] = self._reduce_anew(component)
        return self._reduced[key]

    def _reduce_anew(self, component: Component) -> Superelement:
        if component.fidelity == "elastic":
            mesh = self.comm.bcast(mesh_component(component) if self.comm.rank == 0 else None, root=0)
            return reduce_elastic(component, mesh, comm=self.comm)
        reduce = reduce_segmented if component.fidelity == "segmented" else reduce_rigid
        return reduce(component, describe_component(component))


def _body_motions(coupled: CoupledMachine, shapes: FloatArray) -> dict[str, FloatArray]:
    found: dict[str, list[FloatArray]] = {}
    for column in (coupled.basis @ shapes).T:
        for motion in split_motions(coupled, column):
            found.setdefault(motion.component, []).append(motion.rigid)
    return {name: np.column_stack(columns) for name, columns in found.items()}


def _measure_compliance(coupled: CoupledMachine, machine: Machine) -> FloatArray:
    if not {"tcp", "push"} <= set(machine.points):
        raise ValueError("the scene has no points tcp and push")
    forces = np.column_stack([coupled.system.inputs["push", axis] for axis in "xyz"])
    return np.asarray(coupled.system.outputs["tcp", "z"] @ solve_static(coupled.system, forces).displacements)
