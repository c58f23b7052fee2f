"""Joint kinds hold, free and spring the dofs they are named for."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from fixture_machines import machine, write_scene
from headstock.pipeline.preview.doubts import free_motion_warnings
from headstock.scene.building.joints import KINDS, _joint_rotation, build_joint, find_joint_faults
from headstock.scene.building.loader import load_scene
from headstock.scene.schema.joints import JointTable

K = "1 N/um"
R = "5 N m/rad"


def make_table(kind: str, **keys: object) -> JointTable:
    return JointTable.model_validate({"between": ["a.b", "ground"], "kind": kind, **keys})


@pytest.mark.parametrize(
    ("kind", "keys", "fixed", "diagonal"),
    [
        ("rigid", {}, (0, 1, 2, 3, 4, 5), [0, 0, 0, 0, 0, 0]),
        ("spring", {"stiffness": {"x": K, "rz": R}}, (), [1e6, 0, 0, 0, 0, 5]),
        ("spring", {"stiffness": {"x": "rigid", "z": K}}, (0,), [0, 0, 1e6, 0, 0, 0]),
        (
            "linear_guide",
            {"axis": "y", "stiffness": {"lateral": K, "normal": "2 N/um", "yaw": R}},
            (),
            [0, 1e6, 2e6, 0, 0, 5],
        ),
        (
            "linear_guide",
            {
                "axis": "y",
                "stiffness": {"lateral": K, "normal": K, "roll": R, "pitch": "6 N m/rad"},
            },
            (),
            [0, 1e6, 1e6, 5, 6, 0],
        ),
        (
            "ball_screw",
            {"axis": "z", "stiffness": {"axial": K, "torsion": R}},
            (),
            [1e6, 0, 0, 5, 0, 0],
        ),
        (
            "bearing",
            {"axis": "z", "stiffness": {"radial": K, "axial": "3 N/um", "tilt": R}},
            (),
            [3e6, 1e6, 1e6, 0, 5, 5],
        ),
        (
            "bearing",
            {"axis": "z", "stiffness": {"radial": K, "torsion": "rigid"}},
            (3,),
            [0, 1e6, 1e6, 0, 0, 0],
        ),
        (
            "bearing",
            {"axis": "z", "stiffness": {"radial": K, "torsion": R}},
            (),
            [0, 1e6, 1e6, 5, 0, 0],
        ),
        (
            "bolted",
            {"stiffness": {"normal": K, "shear": "2 N/um", "torsion": R}},
            (),
            [2e6, 2e6, 1e6, 0, 0, 5],
        ),
        (
            "mount",
            {"stiffness": {"vertical": K, "horizontal": "2 N/um", "tilt": R}},
            (),
            [2e6, 2e6, 1e6, 5, 5, 0],
        ),
        ("revolute", {"axis": "z"}, (0, 1, 2, 4, 5), [0, 0, 0, 0, 0, 0]),
        ("revolute", {"axis": "z", "stiffness": {"rx": R}}, (0, 1, 2, 4, 5), [0, 0, 0, 5, 0, 0]),
        ("universal", {"axis": "x", "normal": "y"}, (0, 1, 2, 4), [0, 0, 0, 0, 0, 0]),
        ("spherical", {}, (0, 1, 2), [0, 0, 0, 0, 0, 0]),
        ("prismatic", {"axis": "y"}, (1, 2, 3, 4, 5), [0, 0, 0, 0, 0, 0]),
    ],
)
def test_a_kind_holds_and_springs_its_dofs(
    kind: str, keys: dict[str, object], fixed: tuple[int, ...], diagonal: list[float]
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


SPINDLE = machine("""
machine = "bar"
names = { bar = "shaft", clamp = "front" }
name = "spindle"
components.shaft.at = ["0 mm", "0 mm", "0 mm"]
components.shaft.interfaces = { nose = { face = "z-" }, rear = { face = "z+" } }
points.tcp.tool = "shaft.nose"
joints.front.between = ["ground", "shaft.rear"]
joints.front.kind = "bearing"
joints.front.axis = "z"
joints.front.at = ["0 mm", "0 mm", "60 mm"]
joints.front.stiffness = { radial = "300 N/um", axial = "200 N/um", REST = "REST" }
[joints.back]
between = ["ground", "shaft.rear"]
kind = "bearing"
axis = "z"
at = ["%s mm", "0 mm", "180 mm"]
stiffness = { radial = "200 N/um" }
[analyses.static]
""")


@pytest.mark.parametrize(
    ("fixed", "offset", "free"),
    [
        ('tilt = "1 N m/rad"', 0, "C rotation of shaft"),
        ('torsion = "rigid"', 0, None),
        ('torsion = "1 N m/rad"', 0, None),
        # bearings that do not lie on one axis hold each other's turn
        ('tilt = "1 N m/rad"', 5, None),
    ],
)
def test_a_spindle_that_may_turn_is_known_before_any_mesh(
    fixed: str, offset: int, free: str | None, tmp_path: Path
) -> None:
    path = write_scene(
        tmp_path, SPINDLE.replace('REST = "REST"', "%s") % (fixed, offset), name="spindle"
    )
    found = free_motion_warnings(load_scene(path))
    assert len(found) == (0 if free is None else 1)
    if free is not None:
        assert free in found[0] and "static" in found[0]
