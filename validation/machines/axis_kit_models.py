"""The calibrated three-axis machine of Kono, Lorenzer, Weikert and Wegener (section 4, tables 2 and
3), segmented and with finite elements.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

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
from headstock.solvers.mpi import MPI

Direction = Literal["X", "Y", "Z", "A", "B", "C"]
VARIANTS = ("R", "BE", "CE", "YE", "YCE")
# table 3, Axis Construction Kit: all natural frequencies below 300 Hz [Hz] but those of the machine
# on its air springs
TABLE_3: dict[str, tuple[float, ...]] = {
    "R": (146.0, 233.0, 254.0, 302.0),
    "BE": (78.6, 146.0, 239.0, 249.0, 288.0),
    "CE": (84.5, 145.0, 225.0, 236.0, 254.0, 297.0),
    "YCE": (76.9, 143.0, 150.0, 160.0, 237.0, 247.0, 272.0),
}
# which of them the authors put beside measured mode 9, the Y-translation of the sliders: a number
# of table 3, from 1
MODE_9 = {"R": 4, "BE": 5, "YCE": 7}
# YCE with the finite element method [Hz]
TABLE_3_FEM = (
    78.2,
    144.0,
    153.0,
    172.0,
    237.0,
    250.0,
    276.0,
)
MEASURED_COMPLIANCE = {
    "x": 9.3,
    "y": 11.5,
    "z": 151.0,
}  # size of dz per force along each axis [um/kN]
LISTED_TO_HZ = 300.0
SCENE = PROJECT / "machines" / "three_axis.toml"
KitFidelity = Literal["segmented", "elastic"]
FLOOR_HZ = 15.0  # above the machine on its air springs
SEARCHED_TO_HZ = 1.1 * LISTED_TO_HZ  # the paper lists 302 Hz


@dataclass(frozen=True)
class Motion:
    """Bodies that move alike; ``sense`` -1: against those of the first motion of the mode with a
    sense.
    """

    bodies: tuple[str, ...]
    direction: Direction
    sense: int = 1


@dataclass(frozen=True)
class MeasuredMode:
    """A mode of table 2.

    Attributes:
        frequency_hz: Measured [Hz].
        paired: The YCE mode that the authors put beside it (from 1 in table 3), None where there is
            none.
    """

    number: int
    frequency_hz: float
    words: str
    motions: tuple[Motion, ...]
    paired: int | None


GANTRY = ("y_base", "y_slider", "z_slider")


SLIDERS = ("y_slider", "z_slider")


MEASURED_MODES = (
    MeasuredMode(
        1, 80.0, "columns bend: B of the gantry against B of base and X-slider",
        (Motion(GANTRY, "B"), Motion(("base", "x_slider"), "B", -1)), 1,
    ),
    MeasuredMode(2, 141.0, "C of the gantry against C of the X-slider", (Motion(GANTRY, "C"), Motion(("x_slider",), "C", -1)), 2),
    MeasuredMode(3, 154.0, "C of the gantry with C of the X-slider", (Motion(GANTRY, "C"), Motion(("x_slider",), "C")), 3),
    MeasuredMode(4, 163.0, "Y-base twists: B of Y- and Z-slider", (Motion(SLIDERS, "B"),), 4),
    MeasuredMode(
        6, 203.0, "B and A of Y- and Z-slider, X of base and X-slider",
        (Motion(SLIDERS, "B"), Motion(SLIDERS, "A"), Motion(("x_slider",), "X")), 5,
    ),
    MeasuredMode(
        8, 261.0, "A of Y- and Z-slider, Y of the X-slider against Y of the Y-base",
        (Motion(("x_slider",), "Y"), Motion(("y_base",), "Y", -1), Motion(SLIDERS, "A")), 6,
    ),
    MeasuredMode(
        9, 274.0, "A of Y- and Z-slider, Y of Y-, Z- and X-slider against Y of the Y-base",
        (Motion((*SLIDERS, "x_slider"), "Y"), Motion(("y_base",), "Y", -1), Motion(SLIDERS, "A")), 7,
    ),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class KitModel:
    """A variant at one fidelity.

    Attributes:
        frequencies_hz: ``(m,)`` above the air springs.
        field: ``(k, m)`` mode shapes at places that all models share, weighted by mass.
        motions: Rigid part of each body's motion ``(6, m)`` at its centre of mass, machine axes.
        compliance: dz at the sensor, relative to the X-slider, per force along x, y, z at the tool
            post's corner, Y at 30 mm [m/N].
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
        """Modes at Y = 0 and compliances at Y = 30 mm of a variant whose elastic bodies are
        segmented or finite elements.
        """
        name = "+".join(
            ["calibrated", *(["segmented"] if fidelity == "segmented" else []), variant]
        )
        meshes = ("column_left", "column_right", "y_base") if self.mesh_size else ()
        scene = load_scene(
            SCENE,
            variant=name,
            overrides=[f"components.{part}.mesh.size={self.mesh_size}" for part in meshes],
        )
        parts = {
            key: self._reduce(component) for key, component in scene.machine.components.items()
        }
        for key, part in parts.items():
            self._places.setdefault(key, choose_places(part))
        coupled = couple(parts, scene.machine, scene.poses["reference"])
        modal = solve_modal(coupled.system, up_to_hz=SEARCHED_TO_HZ)
        shapes = modal.shapes[:, modal.frequencies_hz > FLOOR_HZ]
        return KitModel(
            frequencies_hz=modal.frequencies_hz[modal.frequencies_hz > FLOOR_HZ],
            field=machine_field(coupled, self._places, shapes),
            motions=_body_motions(coupled, shapes),
            compliance=_measure_compliance(
                couple(parts, scene.machine, scene.poses["measured"]), scene.machine
            ),
        )

    def _reduce(self, component: Component) -> Superelement:
        key = component.name, component.fidelity
        if key not in self._reduced:
            self._reduced[key] = self._reduce_anew(component)
        return self._reduced[key]

    def _reduce_anew(self, component: Component) -> Superelement:
        if component.fidelity == "elastic":
            mesh = self.comm.bcast(
                mesh_component(component) if self.comm.rank == 0 else None, root=0
            )
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
    return np.asarray(
        coupled.system.outputs["tcp", "z"] @ solve_static(coupled.system, forces).displacements
    )
