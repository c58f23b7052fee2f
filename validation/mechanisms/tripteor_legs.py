"""The shipped Tripteor of components: reduced, coupled in its poses, and as a frame of beam
elements.
"""

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Pose, place_components
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.geometry.mechanisms.tool_mechanism import solve_pose
from headstock.geometry.parts.components import Component
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.planning.reductions import choose_reduction
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.tripod_beams import ElasticLeg, RigidPart, solve_tripod
from headstock.validation.mechanisms.tripteor_machine import SCENE

PLATFORM_PARTS = ("platform", "wrist", "spindle")


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
        return np.asarray(
            mounting.origin + mounting.rotation @ placed.positions[markers.index(marker)]
        )

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
    return (
        reduce_rigid(component, properties)
        if component.fidelity == "rigid"
        else reduce_segmented(component, properties)
    )
