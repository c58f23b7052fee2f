"""Equations of motion of the shipped Tripteor, for the cases that compare them with independent
methods.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import survey_tool_poses
from headstock.geometry.mechanisms.tool_mechanism import solve_pose
from headstock.meshing.components.meshing import describe_component
from headstock.pipeline.stages.lumped_machine import build_compliant_mechanism
from headstock.pipeline.storage.provenance import PROJECT
from headstock.reduction.components.rigid import reduce_rigid
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.partitioning import Drive
from headstock.validation.mechanisms.motion import DriveLaw

SCENE = PROJECT / "machines" / "tripteor.toml"
GRAVITY = (0.0, 0.0, -9.80665)
# the plane of the paper's map, 200 mm above the table [m]
PLANE_HALF = (0.35, 0.40)
PLANE_HEIGHT = 0.2


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
    amplitude, omega, phase = (
        np.array([0.05, 0.04, -0.06, 0.3, 0.2]),
        np.array([9.0, 7.0, 11.0, 6.0, 8.0]),
        0.3,
    )

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
    return np.asarray(500.0 * grown * np.array([np.cos(90.0 * time), np.sin(70.0 * time), -0.5]))
