"""Paths of the tool of a mechanism, lumped and of components, against the linear equations of its
contours, stepped in time.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.meshing.components.meshing import describe_component
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.path import run_path_stage
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.pipeline.storage.store import Store
from headstock.reduction.components.rigid import reduce_rigid
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import keep_analyses
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling import contouring
from headstock.solvers.milling.contouring import linear_motion
from headstock.solvers.milling.path_drives import follow_path
from headstock.solvers.milling.tool_path import PathPoints
from headstock.solvers.paths.linear_motion import interpolate_nodes, march_linear
from headstock.solvers.paths.set_points import sample_move
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR
from headstock.validation.mechanisms.tripteor_machine import load_tripteor

START, END = np.array([-0.01, 0.045, 0.205]), np.array([0.01, 0.055, 0.215])
PATH = (
    'analyses.path={from={X="-10 mm",Y="45 mm",Z="205 mm"},to={X="10 mm",Y="55 mm",Z="215 mm"},feeds=["3 m/min"],'
    'time_constant="50 ms",ramp="s_curve",jerk_time="20 ms",residual_time="50 ms",sampling="10 kHz"}'
)


def solve(folder: Path, variant: str, *settings: str) -> PathResult:
    scene = keep_analyses(
        load_scene(TRIPTEOR, variant=variant, overrides=[PATH, *settings]), ["path"]
    )
    plan = plan_scene(scene)
    reduced = {
        name: ReducedComponent(reduce_rigid(part, describe_component(part)))
        for name, part in plan.components.items()
    }
    state = RunState(scene, plan, MPI.COMM_SELF, Store(folder / "store"), reduced=reduced)
    (found,) = run_path_stage(state, Stage("path", None, "")).answers
    assert isinstance(found, PathResult)
    assert any("Coriolis" in text for text in state.warnings)
    return found


def step_contour(found: PathResult) -> FloatArray:
    """Deviation by the equations of contours, without their velocity terms."""
    tripteor, move = load_tripteor(), found.runs[0].curves
    scene = tripteor.scene
    request = load_scene(TRIPTEOR, variant="lumped", overrides=[PATH]).analyses.path
    assert request is not None
    times = move.deviation.times
    nodes: FloatArray = np.asarray(np.linspace(0.0, times[-1], 500), dtype=float)
    motion = sample_move(request.moves[0], nodes)
    along = (END - START) / np.linalg.norm(END - START)
    means = 0.5 * (motion.accelerations[1:] + motion.accelerations[:-1])
    velocities = np.append(0.0, np.cumsum(means)) * (nodes[1] - nodes[0])
    path = PathPoints(
        START + motion.positions[:, None] * along,
        velocities[:, None] * along,
        motion.accelerations[:, None] * along,
    )
    drive = follow_path(scene.mounted, nodes, path, scene.tool)
    model = dataclasses.replace(tripteor.model, velocity_terms=False)
    linear = linear_motion(model, drive, times, PoseDamping((0.02,)))
    history = march_linear(linear, linear.load)
    rest = interpolate_nodes(times, linear.nodes, linear.gravity_deflection)
    return np.asarray(
        linear.tool_motion(history.compliant - rest) @ scene.mounted.mounting.rotation.T
    )


def test_a_tool_leaves_its_line_as_the_equations_of_contours_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # their matrices and loads are linear between nodes
    monkeypatch.setattr(contouring, "NODE_SPACING", 5e-3)
    monkeypatch.setattr(contouring, "LOAD_SPACING", 2e-4)
    found = solve(tmp_path, "lumped")
    mine = found.runs[0].curves.deviation.total[:, :3]
    expected = step_contour(found)
    size = np.abs(expected).max()
    assert size > 5e-6
    # legs are accelerated by speeds there, which is 0.2 %
    assert np.abs(mine - expected).max() < 5e-3 * size
    frozen = found.runs[0].curves.frozen[:, :3]
    assert np.abs(frozen - expected).max() > 1e-2 * size


def test_rigid_legs_of_components_leave_it_as_lumped_ones_with_gravity_stiffening(
    tmp_path: Path,
) -> None:
    stiffening = "effects.gravity_stiffening=true"
    lumped, legs, plain = (
        solve(tmp_path, variant, *settings, 'analyses.path.pose_model="frozen"')
        .runs[0]
        .curves.deviation.total[:, :3]
        for variant, settings in (
            ("lumped", (stiffening,)),
            ("components", (stiffening,)),
            ("components", ()),
        )
    )
    change = np.abs(plain - legs).max()
    assert change > 1e-6 * np.abs(legs).max()
    assert np.abs(legs - lumped).max() < 1e-2 * change


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ('analyses.path.to={X="9 m"}', "outside 600 to 1600 mm"),
        ('analyses.path.to={q1="1 m"}', "along X, Y and Z"),
        ('analyses.path.to={X="9 deg"}', "measured as"),
        ('analyses.path.outputs=[["platform","z"]]', "knows points only"),
        ("effects.drive_control=true", "on contours of a mechanism"),
    ],
)
def test_what_a_tool_path_cannot_have_is_refused(setting: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        load_scene(TRIPTEOR, variant="lumped", overrides=[PATH, setting])
