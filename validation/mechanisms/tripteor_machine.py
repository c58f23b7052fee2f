"""The shipped Tripteor: the lumped machine in its poses, and that of components, reduced, coupled and
as a frame of beam elements.
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Pose, place_components
from headstock.geometry.mechanisms.exechon import LENGTHS, solve_pose, survey_tool_poses
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.geometry.parts.components import Component
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.planning.reductions import choose_reduction
from headstock.pipeline.stages.lumped_machine import build_compliant_mechanism
from headstock.pipeline.storage.provenance import PROJECT
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, SceneMechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.motion import DriveLaw
from headstock.validation.mechanisms.tripod_beams import ElasticLeg, RigidPart, solve_tripod

SCENE = PROJECT / "machines" / "tripteor.toml"
GRAVITY = (0.0, 0.0, -9.80665)
# the plane of the paper's map, 200 mm above the table [m]
PLANE_HALF = (0.35, 0.40)
PLANE_HEIGHT = 0.2

PLATFORM_PARTS = ("platform", "wrist", "spindle")


@dataclass(frozen=True, eq=False)
class Tripteor:
    """The lumped machine of the scene.

    Attributes:
        model: Bodies, springs, gravity.
        poses: Pose name to coordinates ``(n,)``.
    """

    scene: SceneMechanism
    model: CompliantMechanism
    poses: dict[str, FloatArray]


def load_tripteor(overrides: Sequence[str] = ()) -> Tripteor:
    """Load the machine as shipped, with gravity."""
    scene = load_scene(SCENE, variant="lumped", overrides=overrides)
    if scene.mechanism is None:
        raise ValueError(f"{SCENE} has no mechanism")
    parts = {
        name: dataclasses.replace(part, fidelity="rigid")
        for name, part in scene.machine.components.items()
    }
    rigid = {name: reduce_rigid(part, describe_component(part)) for name, part in parts.items()}
    placements = {name: part.placement for name, part in parts.items()}
    model = build_compliant_mechanism(scene.mechanism, rigid, placements, np.array(GRAVITY))
    return Tripteor(
        scene.mechanism,
        model,
        {name: solve_pose(scene.mechanism, pose.positions) for name, pose in scene.poses.items()},
    )


def plane_states(tripteor: Tripteor, count: int) -> FloatArray:
    """Coordinates ``(count, count, n)`` over the plane above the table, rows along x."""
    x, y = (np.linspace(-half, half, count) for half in PLANE_HALF)
    grid = np.stack(
        [*np.meshgrid(x, y, indexing="ij"), np.full((count, count), PLANE_HEIGHT)], axis=-1
    )
    return survey_tool_poses(tripteor.scene.mounted, grid, tripteor.scene.tool).states


def oscillating_drive(start: FloatArray) -> DriveLaw:
    """Return every driven coordinate on a sine of its own, tens of millimetres and several hertz:
    nothing in the equations stays small.
    """
    amplitude = np.array([0.05, 0.04, -0.06, 0.3, 0.2])
    omega = np.array([9.0, 7.0, 11.0, 6.0, 8.0])
    phase = 0.3

    def law(time: float) -> Drive:
        sine, cosine = np.sin(omega * time + phase), np.cos(omega * time + phase)
        return Drive(
            start + amplitude * (sine - np.sin(phase)),
            amplitude * omega * cosine,
            -amplitude * omega**2 * sine,
        )

    return law


def steady_force(time: float) -> FloatArray:
    """Return a force on the tool that comes on smoothly and turns [N]."""
    grown = 1.0 - np.exp(-50.0 * time)
    return 500.0 * grown * np.array([np.cos(90.0 * time), np.sin(70.0 * time), -0.5])


@dataclass(frozen=True, eq=False)
class LeggedTripteor:
    """A variant of the machine of components with its superelements."""

    scene: Scene
    superelements: dict[str, Superelement]

    def couple(self, pose: str) -> CoupledMachine:
        """Couple the machine in one of the scene's poses."""
        return couple(self.superelements, self.scene.machine, self.scene.poses[pose])


@functools.cache
def load_legs(variant: str, overrides: tuple[str, ...] = ()) -> LeggedTripteor:
    """Load a variant and reduce its components; of equal ones that are meshed one stands for
    all.
    """
    scene = load_scene(SCENE, variant=variant, overrides=overrides)
    reduced: dict[str, Superelement] = {}
    meshed: list[tuple[Component, Superelement]] = []
    for name, component in scene.machine.components.items():
        if component.fidelity != "elastic":
            reduced[name] = _reduce_unmeshed(component)
            continue
        alike = next(
            (
                part
                for known, part in meshed
                if (known.solid, known.mass) == (component.solid, component.mass)
            ),
            None,
        )
        if alike is None:
            settings, _ = choose_reduction(component, scene.analyses)
            chosen = dataclasses.replace(component, reduction=settings)
            alike = reduce_elastic(chosen, mesh_component(chosen), comm=MPI.COMM_SELF)
            meshed.append((component, alike))
        reduced[name] = dataclasses.replace(alike, name=name)
    return LeggedTripteor(scene, reduced)


def solve_beams(tripteor: LeggedTripteor, pose: str, count: int) -> FloatArray:
    """Return the lowest frequencies ``(count,)`` [Hz] of the same machine by beam elements
    (``tripod_beams``).

    Args:
        tripteor: The machine with segmented legs.

    Raises:
        ValueError: The machine has no mechanism.
    """
    machine, positions = tripteor.scene.machine, tripteor.scene.poses[pose].positions
    if machine.mechanism is None:
        raise ValueError("the machine has no mechanism")
    mounted = machine.mechanism.mounted
    markers, mounting = mounted.mechanism.markers, mounted.mounting
    state = solve_pose(machine.mechanism, positions)
    placed = place_markers(mounted.mechanism, state)

    def locate(marker: str) -> FloatArray:
        return mounting.origin + mounting.rotation @ placed.positions[markers.index(marker)]

    frames = place_components(machine, Pose(pose, positions))
    lengths = {leg: float(state[mounted.mechanism.index(LENGTHS[leg - 1])]) for leg in (1, 2, 3)}
    legs = tuple(
        _leg(tripteor, frames, leg, (locate(f"leg_{leg}"), locate(f"tip_{leg}")), lengths[leg])
        for leg in (1, 2, 3)
    )
    platform = tuple(_rigid_part(tripteor, frames, name) for name in PLATFORM_PARTS)
    columns = machine.joints["columns"]
    stiffness = np.array(
        [np.inf if dof in columns.fixed else columns.stiffness[dof, dof] for dof in range(3)]
    )
    return solve_tripod(
        legs,
        platform,
        _rigid_part(tripteor, frames, "frame"),
        frame_stiffness=stiffness,
        count=count,
    )


def _leg(
    tripteor: LeggedTripteor,
    frames: dict[str, Frame],
    number: int,
    ends: tuple[FloatArray, FloatArray],
    length: float,
) -> ElasticLeg:
    machine = tripteor.scene.machine
    tip, screw = machine.joints[f"tip_{number}"], machine.joints[f"screw_{number}"]
    base, slide = machine.joints[f"base_{number}"], machine.joints[f"slide_{number}"]
    if screw.screw is None or slide.length is None:
        raise ValueError("a leg needs its screw and the length of its slide")
    free = 0 if tip.stiffness[0, 0] == 0.0 else 1
    along = 1.0 / (1.0 / screw.stiffness[0, 0] + length / screw.screw.axial)
    return ElasticLeg(
        tube=machine.components[f"beam_{number}"],
        placement=frames[f"beam_{number}"],
        sleeve=_rigid_part(tripteor, frames, f"sleeve_{number}"),
        base=ends[0],
        tip=ends[1],
        carriage=slide.length,
        free_rotation=free,
        second_axis=base.second_axis,
        springs=(float(tip.stiffness[1 - free, 1 - free]), along),
    )


def _rigid_part(tripteor: LeggedTripteor, frames: dict[str, Frame], name: str) -> RigidPart:
    body, frame = tripteor.superelements[name], frames[name]
    center = np.asarray(frame.origin + frame.rotation @ body.center_of_mass)
    return RigidPart(
        body.mass_kg, center, np.asarray(frame.rotation @ body.inertia @ frame.rotation.T)
    )


def _reduce_unmeshed(component: Component) -> Superelement:
    properties = describe_component(component)
    if component.fidelity == "rigid":
        return reduce_rigid(component, properties)
    return reduce_segmented(component, properties)
