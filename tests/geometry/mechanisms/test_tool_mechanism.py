"""A mechanism places what it carries where its marks stand, and what it does not carry stays."""

from pathlib import Path

import numpy as np

from headstock.geometry.machine.machine import Pose, place_components
from headstock.geometry.mechanisms.exechon import solve_pose, tool_pose
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.scene.building.loader import load_scene

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"


def test_the_spindle_points_where_the_pose_says_and_every_leg_runs_to_its_platform_joint() -> None:
    machine = load_scene(SCENE, variant="components").machine
    assert machine.mechanism is not None
    known = machine.mechanism.mounted
    for positions in ({"Z": 0.2}, {"X": -0.1, "Y": 0.3, "Z": 0.25, "A": 0.2, "B": -0.1}):
        frames = place_components(machine, Pose("here", positions))
        point, direction = tool_pose(machine.mechanism, positions)
        spindle = frames["spindle"]
        assert np.allclose(spindle.rotation[:, 2], direction, atol=1e-12)
        tip = spindle.origin + 0.48 * spindle.rotation[:, 2]
        assert np.allclose(tip, point, atol=1e-12)
        markers = place_markers(known.mechanism, solve_pose(machine.mechanism, positions))
        for number in (1, 2, 3):
            sleeve, beam = frames[f"sleeve_{number}"], frames[f"beam_{number}"]
            assert np.allclose(sleeve.rotation, beam.rotation, atol=1e-12)
            joint = markers.positions[known.mechanism.markers.index(f"joint_{number}")]
            at_tip = beam.origin + 1.8 * beam.rotation[:, 2]
            assert np.allclose(
                at_tip, known.mounting.origin + known.mounting.rotation @ joint, atol=1e-12
            )
