"""The model of a measured machine in a pose, with a sensor at every measured point."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, Sensor
from headstock.geometry.parts.skins import Skin
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.results.views import component_skin
from headstock.pipeline.stages.machine import DAMPING
from headstock.pipeline.stages.mechanism import pose_machine
from headstock.pipeline.stages.modal import solve_pose_modes
from headstock.pipeline.stages.run_state import Announcer, Observer, PoseModel
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.store import Store
from headstock.reduction.coupling.channels import place_rows
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.scene import Analyses, Scene
from headstock.scene.test_data.records import MeasuredModes, TestChannel
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.linear.damped_mode import follow_damped_mode
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import Field
from headstock.solvers.pairing.shape_expansion import expand_by_modes, expand_by_stiffness

type Expansion = Literal["serep", "static", "dynamic"]
REACH = 1.5  # a computed partner may lie so many times above the highest measured frequency


@dataclass(frozen=True, eq=False)
class PreparedMachine:
    """A machine in the pose of a test.

    Attributes:
        skins: Surface of each component in its frame.
    """

    scene: Scene
    machine: PoseModel
    skins: dict[str, Skin]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservedMachine(PreparedMachine):
    """A machine in the pose of a test whose measured points are known.

    Attributes:
        modes: Up to ``REACH`` times the highest measured frequency.
        sensors: Measured point to its sensor in the model.
        rotation: ``(3, 3)`` from the axes of the test to those of the machine.
    """

    modes: PoseModes
    sensors: Mapping[str, Sensor]
    rotation: FloatArray

    @cached_property
    def dofs(self) -> FloatArray:
        """Superelement dofs per coordinate of the system ``(n_all, n)``."""
        return self.machine.expand(np.eye(len(self.machine.system.mass)))

    @cached_property
    def coordinates(self) -> FloatArray:
        """The modes in coordinates of the system ``(n, m)``."""
        return np.asarray(np.linalg.lstsq(self.dofs, self.modes.shapes)[0], dtype=float)

    @cached_property
    def damped_shapes(self) -> Field:
        """The modes with the damping of joints and materials ``(n_all, m)``, complex where that is not
        in proportion to stiffness and mass; a mode that is damped too strongly stays real.
        """
        system, frequencies = self.machine.system, self.modes.frequencies_hz
        undamped = system.damping is None and system.hysteretic is None
        if undamped or DAMPING not in self.scene.effects:
            return self.modes.shapes
        shapes = self.modes.shapes.astype(np.complex128)
        for mode in range(self.modes.rigid_count, len(frequencies)):
            omega = 2.0 * np.pi * float(frequencies[mode])
            try:
                damped = follow_damped_mode(system, omega, self.coordinates[:, mode])
            except ConvergenceError:
                continue
            shapes[:, mode] = self.dofs @ damped.shape
        return shapes

    def expand_shapes(self, measured: MeasuredModes, rows: FloatArray, kind: Expansion) -> Field:
        """Return measured shapes in coordinates of the system ``(n, k)``.

        Args:
            rows: ``(c, n)`` motion of each channel per coordinate.
        """
        system = self.machine.system
        if kind == "serep":
            return expand_by_modes(measured.shapes, rows, self.coordinates)
        return expand_by_stiffness(
            measured.shapes,
            rows,
            system.stiffness,
            system.mass,
            frequencies_hz=measured.frequencies_hz,
            dynamic=kind == "dynamic",
        )

    def observe(self, channels: Sequence[TestChannel]) -> FloatArray:
        """Return the motion ``(c, n_all)`` of channels per superelement dof."""
        machine = self.machine
        elements = machine.parts.superelements
        rows = np.zeros((len(channels), len(self.dofs)))
        for row, channel in zip(rows, channels, strict=True):
            sensor = self.sensors[channel.point]
            name = sensor.component
            moved = place_rows(elements[name], machine.placements[name], sensor)
            row[machine.offsets[name]] = self.rotation @ np.array(channel.direction) @ moved
        return rows


def request_modes(scene: Scene, highest_hz: float) -> Scene:
    """Return a scene that asks for the modes up to a measured frequency and beyond, and for nothing
    else that a test has not.
    """
    modes = ModalRequest(up_to_hz=REACH * highest_hz, stated=False)
    # the responses of the scene keep more modes: what is reduced for a run serves here too
    return dataclasses.replace(
        scene, analyses=Analyses(modes, scene.analyses.get(FrfRequest)), accuracy=None
    )


def prepare_machine(
    scene: Scene,
    pose: Pose,
    comm: MPI.Comm,
    store: Store,
    *,
    announce: Announcer = lambda stage: None,
    observer: Observer = lambda record: None,
) -> PreparedMachine | None:
    """Return the machine of a scene in a pose; None but on rank 0; collective.

    Raises:
        HeadstockError: A component or the machine cannot be computed.
    """
    state = start_run(scene, comm, store)
    make_superelements(state, announce=announce, observer=observer)
    if not state.is_root:
        return None
    skins = {
        name: component_skin(state.plan.components[name], part.superelement, part.skin)
        for name, part in state.reduced.items()
    }
    machine = pose_machine(state.parts, pose)
    return PreparedMachine(scene, machine, skins, tuple(state.warnings))


def observe_machine(
    prepared: PreparedMachine, sensors: Mapping[str, Sensor], rotation: FloatArray
) -> ObservedMachine:
    """Solve the modes of a machine whose sensors are placed.

    Args:
        sensors: Measured point to its sensor.
        rotation: ``(3, 3)`` from the axes of the test to those of the machine.
    """
    solved = solve_pose_modes(prepared.machine, prepared.scene.analyses[ModalRequest])
    return ObservedMachine(
        prepared.scene,
        prepared.machine,
        prepared.skins,
        (*prepared.warnings, *solved.warnings),
        modes=solved.answer,
        sensors=sensors,
        rotation=rotation,
    )
