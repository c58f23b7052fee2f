"""Rigid bodies in six dofs each answer as their coupling does."""

import dataclasses
from pathlib import Path

import numpy as np

from headstock.geometry.parts.mass_properties import closed_form_properties
from headstock.pipeline.preview.rigid_bodies import place_rigid
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.channels import GRAVITY
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.body_motions import find_free_motions
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import choose_poses
from headstock.solvers.linear.static_response import solve_static

THREE_AXIS = Path(__file__).parents[3] / "machines/three_axis.toml"


def test_weight_stretches_joints_as_in_a_coupling() -> None:
    scene = load_scene(THREE_AXIS)
    pose, machine = next(iter(choose_poses(scene).values())), scene.machine
    described = {name: closed_form_properties(part) for name, part in machine.components.items()}
    parts = {name: one for name, one in described.items() if one is not None}
    assert len(parts) == len(machine.components)
    rigid = place_rigid(machine, parts, pose)
    stretched = rigid.stretch_by_weight(np.array(machine.gravity))

    bodies = {name: reduce_rigid(machine.components[name], one) for name, one in parts.items()}
    bare = dataclasses.replace(machine, loads={})
    coupled = couple(bodies, bare, pose, gravity=np.array(machine.gravity))
    moved = solve_static(coupled.system, coupled.loads[GRAVITY]).displacements
    expected = {spring.name: (spring.rows @ moved)[:3] for spring in coupled.joint_springs}
    largest = max(np.abs(one).max() for one in expected.values())
    assert stretched.keys() == expected.keys()
    for name, one in expected.items():
        np.testing.assert_allclose(stretched[name], one, atol=1e-7 * largest)


def test_what_no_joint_holds_is_free_and_bears_no_weight() -> None:
    scene = load_scene(THREE_AXIS)
    pose = next(iter(choose_poses(scene).values()))
    loose = {
        name: dataclasses.replace(joint, stiffness=np.diag([0.0, *np.diag(joint.stiffness)[1:]]))
        if joint.kind == "ball_screw"
        else joint
        for name, joint in scene.machine.joints.items()
    }
    machine = dataclasses.replace(scene.machine, joints=loose)
    parts = {
        name: one
        for name, part in machine.components.items()
        if (one := closed_form_properties(part)) is not None
    }
    rigid = place_rigid(machine, parts, pose)
    coupled = couple(rigid.layout.superelements, dataclasses.replace(machine, loads={}), pose)
    assert rigid.held == len(find_free_motions(coupled)) > 0
