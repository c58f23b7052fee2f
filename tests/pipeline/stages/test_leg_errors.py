"""Errors of the legs of a mechanism: lumped, and by its joints, against closed loops with other leg
lengths.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import close_chains
from headstock.geometry.mechanisms.exechon import LENGTHS, solve_pose
from headstock.geometry.mechanisms.kinematics import place_markers
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.volumetric import VolumetricAnswer
from headstock.pipeline.results.summary import RunSummary, summarise
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, keep_analyses

SCENE = Path(__file__).parents[3] / "machines" / "tripteor.toml"
WAVES = {1: (0.3, 20e-6), 2: (0.4, -15e-6), 3: (0.5, 10e-6)}


def profiles() -> dict[int, str]:
    """Profile of each leg as scenes write it."""
    return {
        leg: f"{{ waves = [{{ period = '{1e3 * period} mm', amplitude = '{1e6 * size} um' }}] }}"
        for leg, (period, size) in WAVES.items()
    }


COMMON = ["effects={ guide_errors = true }", "analyses={ static = { at = ['tcp'] } }"]
LUMPED = [*COMMON, *(f"mechanism.errors.leg_{leg}={text}" for leg, text in profiles().items())]
# positive is longer in both
BY_JOINTS = [
    *COMMON,
    *(f"joints.screw_{leg}.errors={{ axial = {text} }}" for leg, text in profiles().items()),
]


def run(scene: Scene, folder: Path) -> RunSummary:
    return summarise(run_scene(keep_analyses(scene, ("static",)), folder, comm=MPI.COMM_SELF))


def moved(summary: RunSummary) -> dict[str, FloatArray]:
    poses = summary.get("static_poses") or {"only": summary["static"]}
    return {
        pose: np.array(points["tcp"]["displacements"]["guide_errors"], dtype=float)
        for pose, points in poses.items()
    }


def kinematic_deviation(scene: Scene, pose: str) -> FloatArray:
    """Motion ``(3,)`` of the tool point when every leg gets its error: loops closed again."""
    mechanism = scene.mechanism
    assert mechanism is not None
    exechon, turn = mechanism.mounted.mechanism, mechanism.mounted.mounting.rotation
    state = solve_pose(mechanism, scene.poses[pose].positions)
    longer = state.copy()
    for number, name in enumerate(LENGTHS):
        period, size = WAVES[number + 1]
        index = exechon.index(name)
        longer[index] += size * np.sin(2.0 * np.pi * state[index] / period)
    tool = exechon.markers.index("tcp")
    before, after = (
        place_markers(exechon, each).positions[tool]
        for each in (state, close_chains(exechon, longer))
    )
    return np.asarray(turn @ (after - before))


def test_lumped_legs_move_the_tool_as_longer_legs_do(tmp_path: Path) -> None:
    scene = load_scene(SCENE, overrides=LUMPED)
    found = moved(run(scene, tmp_path))
    assert len(found) == 3
    for pose, motion in found.items():
        expected = kinematic_deviation(scene, pose)
        assert np.abs(expected).max() > 5e-6
        # products of two errors are left out: 20 um on legs of a metre
        assert motion[:3] == approx(expected, abs=1e-4 * np.abs(expected).max())


def test_errors_of_legs_need_legs_that_have_some() -> None:
    with pytest.raises(SceneError, match="legs of the lumped mechanism have no errors"):
        load_scene(SCENE, overrides=COMMON)
    with pytest.raises(SceneError, match="is not a length"):
        load_scene(SCENE, overrides=[*LUMPED, "mechanism.errors.leg_2={ polynomial = ['1 urad'] }"])


@pytest.mark.parametrize("stiffening", ["false", "true"])
def test_a_volumetric_map_of_lumped_legs_is_that_of_components(
    stiffening: str, tmp_path: Path
) -> None:
    """By source; the parts of each add up to it, with gravity stiffening too."""
    more = [
        f"effects={{ gravity = true, guide_errors = true, gravity_stiffening = {stiffening} }}",
        'sweeps.volume={ axes = { X = ["-100 mm", "100 mm", 3], Y = ["-100 mm", "100 mm", 2], Z = ["200 mm", "300 mm", 2] } }',
        "analyses={ volumetric = { sweep = 'volume', at = ['tcp'] } }",
    ]
    found: list[VolumetricAnswer] = []
    for variant, errors in (("lumped", LUMPED[2:]), ("components", BY_JOINTS[2:])):
        scene = load_scene(SCENE, variant=variant, overrides=[*errors, *more])
        results = run_scene(scene, tmp_path / variant, comm=MPI.COMM_SELF)
        assert results.failures == ()
        found += find_answers(results.answers, VolumetricAnswer)
    lumped, legs = found
    assert set(lumped.sources) == set(legs.sources) == {"geometry", "gravity"}
    for source, moved_by in legs.sources.items():
        for dofs, least in ((slice(0, 3), 5e-6), (slice(3, 6), 1e-9)):
            size = np.abs(moved_by[..., dofs]).max()
            assert size > least
            np.testing.assert_allclose(
                lumped.sources[source][..., dofs], moved_by[..., dofs], atol=1e-6 * size
            )
    for shares in lumped.budget.values():
        assert sum(shares.values()) == approx(1.0, rel=1e-9)
        assert sum("errors of" in part for part in shares) == 3
        assert ("gravity on own weight" in shares) == (stiffening == "true")
