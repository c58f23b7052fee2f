"""Errors of guides as preload of joint springs, against rigid-body kinematics and least squares."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.guide_errors import average_profile
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS
from headstock.reduction.motions.tool_deviation import GEOMETRY, solve_deviation
from headstock.scene.building.loader import load_scene
from headstock.solvers.errors import ModelError
from scene_runs import couple_parts

SCENE = Path(__file__).parents[2] / "data" / "three_rigid_axes.toml"
POSES = (
    Pose("a", {"X": 0.21, "Y": -0.13, "Z": 0.08}),
    Pose("b", {"X": -0.17, "Y": 0.11, "Z": -0.12}),
    Pose("c", {}),
)


def couple_rigid(machine: Machine, pose: Pose) -> CoupledMachine:
    return couple_parts(machine, pose, gravity=np.array([0.0, 0.0, -9.81]))


def body_motion(machine: Machine, axis: str, position: float, *, full: bool) -> FloatArray:
    """Homogeneous transformation ``(4, 4)`` of what an axis moves, machine frame."""
    errors, direction = machine.axes[axis].errors, machine.axes[axis].direction
    assert errors is not None and errors.point is not None
    at = np.array([position])
    six = np.array([errors.motions[dof].sample(at)[0] for dof in range(6)])
    six[:3] += np.cross(errors.squareness, position * direction)
    a, b, c = six[3:]
    turn = np.array([[1, -c, b], [c, 1, -a], [-b, a, 1]])
    if full:
        about = [np.eye(3) for _ in range(3)]
        for k, angle in enumerate((a, b, c)):
            i, j = (k + 1) % 3, (k + 2) % 3
            about[k][i, i] = about[k][j, j] = np.cos(angle)
            about[k][i, j], about[k][j, i] = -np.sin(angle), np.sin(angle)
        turn = about[0] @ about[1] @ about[2]
    moved = np.eye(4)
    moved[:3, :3] = turn
    moved[:3, 3] = errors.point + position * direction + six[:3] - turn @ errors.point
    return moved


def kinematic_deviation(machine: Machine, pose: Pose, tool: FloatArray) -> FloatArray:
    """Deviation ``(3,)`` of the tool in the frame of the work, by full transformations."""
    place = {axis: pose.positions.get(axis, 0.0) for axis in "XYZ"}
    home = np.append(tool, 1.0)
    held = body_motion(machine, "Y", place["Y"], full=True) @ body_motion(
        machine, "Z", place["Z"], full=True
    )
    work = body_motion(machine, "X", place["X"], full=True)
    nominal = tool + np.array([-place["X"], place["Y"], place["Z"]])
    return np.asarray((np.linalg.solve(work, held @ home))[:3] - nominal)


def linear_deviation(machine: Machine, pose: Pose, tool: FloatArray) -> FloatArray:
    """Deviation ``(6,)``, every transformation linear in its errors (Schwenke and others 2008)."""
    place = {axis: pose.positions.get(axis, 0.0) for axis in "XYZ"}
    now = tool + np.array([0.0, place["Y"], place["Z"]])
    found = np.zeros(6)
    for axis, sign in (("X", -1.0), ("Y", 1.0), ("Z", 1.0)):
        errors, direction = machine.axes[axis].errors, machine.axes[axis].direction
        assert errors is not None and errors.point is not None
        at = np.array([place[axis]])
        six = np.array([errors.motions[dof].sample(at)[0] for dof in range(6)])
        point = errors.point + place[axis] * direction
        if axis == "Z":
            point = point + np.array([0.0, place["Y"], 0.0])
        found[:3] += sign * (six[:3] + np.cross(errors.squareness, place[axis] * direction))
        found[:3] += sign * np.cross(six[3:], now - point)
        found[3:] += sign * six[3:]
    return found


def tool_home(machine: Machine) -> FloatArray:
    return np.asarray(machine.components["head"].placement.origin)


@pytest.mark.parametrize("pose", POSES, ids=lambda pose: pose.name)
@pytest.mark.parametrize("guides", ["springs", "rigid"])
def test_axis_errors_on_rigid_bodies_are_homogeneous_transformations(
    pose: Pose, guides: str
) -> None:
    scene = load_scene(SCENE, variant=None if guides == "springs" else "rigid_guides")
    machine = scene.machine
    found = solve_deviation(couple_rigid(machine, pose), machine, "tcp")
    own = found.sources[GEOMETRY]
    expected = linear_deviation(machine, pose, tool_home(machine))
    assert np.abs(expected).max() > 1e-6
    # 1e-9 of the errors, which are 20 um and 20 urad
    assert np.abs(own - expected).max() < 1e-9 * 20e-6
    full = kinematic_deviation(machine, pose, tool_home(machine))
    assert np.abs(own[:3] - full).max() < 2e-9


def test_contributions_add_up_to_each_source() -> None:
    machine = load_scene(SCENE).machine
    found = solve_deviation(couple_rigid(machine, POSES[0]), machine, "tcp")
    assert set(found.sources) == {"geometry", "gravity", "static forces"}
    for source, moved in found.sources.items():
        parts = np.sum(list(found.parts[source].values()), axis=0)
        assert parts == approx(moved, abs=1e-9 * np.abs(moved).max())


def test_each_source_is_what_the_loads_move_the_tool_by() -> None:
    machine = load_scene(SCENE).machine
    coupled = couple_rigid(machine, POSES[1])
    found = solve_deviation(coupled, machine, "tcp")
    total = np.sum(list(coupled.loads.values()), axis=0)
    moved = np.linalg.solve(coupled.system.stiffness, total)
    rows = [coupled.system.outputs["tcp", dof] @ moved for dof in ("x", "y", "z", "rx", "ry", "rz")]
    assert found.total == approx(rows, rel=1e-8, abs=1e-14)


def test_a_rigid_table_takes_the_least_squares_plane_of_its_carriages() -> None:
    """Equal springs average: Ekinci and Mayer (2007) for two rails with two carriages each."""
    machine = load_scene(SCENE, variant="profiles").machine
    pose = Pose("p", {"X": 0.05})
    coupled = couple_rigid(machine, pose)
    moved = np.linalg.solve(coupled.system.stiffness, coupled.loads[GUIDE_ERRORS])
    names = [name for name in machine.joints if name.startswith("x_guide")]
    points, heights = [], []
    for name in names:
        joint = machine.joints[name]
        assert joint.errors is not None and joint.point is not None
        place = joint.point + np.array([0.05, 0.0, 0.0])
        bed = machine.components["bed"].placement.origin
        averaged = average_profile(
            joint.errors.profiles[2], np.array([place[0] - bed[0]]), joint.errors.length
        )
        points.append(place)
        heights.append(averaged.mean[0])
    assert len(points) == 4 and np.ptp(heights) > 1e-7
    places = np.array(points)
    plane = np.column_stack([np.ones(4), places[:, 0], places[:, 1]])
    fitted, slope_x, slope_y = np.linalg.lstsq(plane, np.array(heights))[0]
    out = [coupled.system.outputs["table_top", dof] @ moved for dof in ("z", "rx", "ry")]
    top = coupled.placements["table"].origin
    assert out[0] == approx(fitted + slope_x * top[0] + slope_y * top[1], rel=1e-9)
    assert out[1] == approx(slope_y, rel=1e-9)
    assert out[2] == approx(-slope_x, rel=1e-9)


def test_rigid_guides_that_contradict_each_other_are_refused() -> None:
    machine = load_scene(SCENE, variant="profiles+rigid_guides").machine
    with pytest.raises(ModelError, match="contradict"):
        couple_rigid(machine, POSES[0])


def test_errors_do_nothing_without_their_effect() -> None:
    machine = load_scene(SCENE, overrides=["effects.guide_errors=false"]).machine
    coupled = couple_rigid(machine, POSES[0])
    assert coupled.errors is None and GUIDE_ERRORS not in coupled.loads
