"""Joint kinds hold, free and spring the dofs they are named for."""

from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.pipeline.preview.doubts import free_motion_warnings
from headstock.scene.building.joints import KINDS, _joint_rotation, build_joint, find_joint_faults
from headstock.scene.building.loader import load_scene
from headstock.scene.schema.joints import JointTable

K = "1 N/um"


def make_table(kind: str, **keys: object) -> JointTable:
    return JointTable.model_validate({"between": ["a.b", "ground"], "kind": kind, **keys})


@cases
def test_a_kind_holds_and_springs_its_dofs(
    kind: str, keys: dict[str, object], fixed: tuple[int, ...], diagonal: tuple[float, ...]
) -> None:
    table = make_table(kind, **keys)
    assert find_joint_faults(table) == []
    joint = build_joint("j", table)
    assert joint.fixed == fixed
    np.testing.assert_array_equal(joint.stiffness, np.diag(np.array(diagonal, dtype=float)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("axis", "normal"), [("x", "z"), ("-y", "x"), ([1, 2, 2], [0, 0, 1]), ("z", [1, 1, 0])]
)
def test_joint_axes_are_right_handed_and_point_where_the_scene_says(
    kind: str, axis: object, normal: object
) -> None:
    table = make_table(kind, axis=axis, normal=normal)
    rotation = _joint_rotation(table)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == approx(1.0, abs=1e-14)
    column = 2 if KINDS[kind].axis_is == "z" else 0
    np.testing.assert_allclose(rotation[:, column], np.array(table.axis), atol=1e-15)
    assert rotation[:, 2 - column] @ np.array(table.normal) > 0.0


@pytest.mark.parametrize("kind", ["bolted", "mount", "spring", "rigid"])
def test_joints_without_directions_have_the_machine_s_axes(kind: str) -> None:
    np.testing.assert_array_equal(_joint_rotation(make_table(kind)), np.eye(3))


def test_damping_stands_beside_stiffness() -> None:
    keys = {"stiffness": {"axial": K}, "damping": {"axial": "20 N s/m", "torsion": "3 N m s/rad"}}
    joint = build_joint("j", make_table("ball_screw", axis="x", **keys))
    assert joint.damping.diagonal().tolist() == [20.0, 0.0, 0.0, 3.0, 0.0, 0.0]


def test_negative_values_need_to_be_allowed() -> None:
    keys = {"stiffness": {"x": "-1 N/um"}, "damping": {"x": "-1 N s/m"}}
    assert [fault.key for fault in find_joint_faults(make_table("spring", **keys))] == [
        ("stiffness", "x"),
        ("damping", "x"),
    ]
    table = make_table("spring", allow_negative=True, **keys)
    assert find_joint_faults(table) == []
    assert build_joint("j", table).stiffness[0, 0] == -1e6


def test_damping_of_a_fixed_dof_is_refused() -> None:
    table = make_table("spring", stiffness={"x": "rigid"}, damping={"x": "1 N s/m"})
    assert "damping" in find_joint_faults(table)[0].message


SPINDLE = stored_scene("joints_spindle")


@cases
def test_a_spindle_that_may_turn_is_known_before_any_mesh(
    fixed: str, offset: int, free: str, tmp_path: Path
) -> None:
    path = write_scene(
        tmp_path, SPINDLE.replace('REST = "REST"', "%s") % (fixed, offset), name="spindle"
    )
    found = free_motion_warnings(load_scene(path))
    assert len(found) == bool(free)
    if free:
        assert free in found[0] and "static" in found[0]
