"""Loads on the rigid bodies of a lumped mechanism move it as those on the same bodies put together by
joints, at rest, over frequency, over time and over its workspace.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.answers.transient import TransientAnswer
from headstock.pipeline.answers.volumetric import VolumetricAnswer
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.solvers.second_order import ComplexArray

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"
LOADS = [
    'loads.push={ at = "spindle.tip", force = ["100 N", "-40 N", "30 N"], moment = ["5 N m", "8 N m", "-3 N m"] }',
    'loads.side={ at = "platform.joint_2", force = ["0 N", "200 N", "50 N"] }',
    'loads.swing={ component = "beam_2", body = ["3 m/s^2", "-2 m/s^2", "1 m/s^2"] }',
    'loads.wind={ face = "wrist.y+", rect = { center = ["20 mm", "170 mm"], size = ["100 mm", "80 mm"] },'
    ' traction = ["0 Pa", "5e4 Pa", "2e4 Pa"] }',
]
SHAKE = 'loads.shake={ base = ["2 m/s^2", "-1 m/s^2", "3 m/s^2"] }'
NAMES = {"push", "side", "swing", "wind", "gravity", "shake"}
FRF = (
    'frf = { from = "5 Hz", up_to = "200 Hz", points = 40, adaptive = false, inputs = ["side", "wind", "swing", "shake"], '
    'outputs = [["tcp", "x"], ["tcp", "ry"]], poses = ["config_2"] }'
)
TRANSIENT = (
    'transient = { duration = "30 ms", up_to = "5 kHz", sampling = "20 kHz", poses = ["config_3"],'
    ' loads = { gust = { load = "wind", shape = "half_sine", time = "4 ms" },'
    ' let_go = { load = "side", shape = "release" }, quake = { load = "shake", shape = "sine", frequency = "40 Hz" } } }'
)


def run(variant: str, folder: Path, *overrides: str) -> Results:
    scene = load_scene(SCENE, variant=variant, overrides=[*LOADS, *overrides])
    results = run_scene(scene, folder / variant, comm=MPI.COMM_SELF)
    assert results.failures == ()
    return results


@pytest.fixture(scope="module", params=["false", "true"], ids=["plain", "stiffened"])
def pair(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Results, Results]:
    """The lumped mechanism, and the same of joined components."""
    overrides = (
        SHAKE,
        f"analyses={{ static = {{ at = ['tcp'] }}, {FRF}, {TRANSIENT} }}",
        f"effects={{ gravity = true, damping = {{ modal = '2 %' }}, gravity_stiffening = {request.param} }}",
    )
    folder = tmp_path_factory.mktemp("loads")
    return run("lumped", folder, *overrides), run("components", folder, *overrides)


def closely(found: FloatArray | ComplexArray, expected: FloatArray | ComplexArray) -> None:
    size = np.abs(expected).max()
    assert size > 0.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * size)


def test_loads_deflect_lumped_bodies_as_joined_ones(pair: tuple[Results, Results]) -> None:
    lumped, joined = (find_answers(each.answers, StaticAnswer) for each in pair)
    assert len(lumped) == 3
    for own, other in zip(lumped, joined, strict=True):
        moved, expected = own.points["tcp"].displacements, other.points["tcp"].displacements
        assert set(moved) == set(expected) == NAMES
        for name, motion in expected.items():
            closely(moved[name][:3], motion[:3])
            closely(moved[name][3:], motion[3:])


def test_a_wrench_at_the_tool_moves_it_by_its_compliance(pair: tuple[Results, Results]) -> None:
    answers = find_answers(pair[0].answers, StaticAnswer)
    assert answers
    for answer in answers:
        point = answer.points["tcp"]
        wrench = np.array([100.0, -40.0, 30.0, 5.0, 8.0, -3.0])
        np.testing.assert_allclose(point.displacements["push"], point.compliance @ wrench)
        total = point.displacement
        assert total is not None
        np.testing.assert_allclose(total, np.sum(list(point.displacements.values()), axis=0))


def test_loads_shake_lumped_bodies_as_joined_ones(pair: tuple[Results, Results]) -> None:
    (lumped,), (joined,) = (find_answers(each.answers, PoseResponse) for each in pair)
    assert lumped.curves.receptance.shape == (40, 2, 4)
    for column in range(4):
        for row in range(2):
            expected = joined.curves.receptance[:, row, column]
            found = lumped.curves.receptance[:, row, column]
            closely(found, expected)


def test_loads_over_time_move_lumped_bodies_as_joined_ones(pair: tuple[Results, Results]) -> None:
    (lumped,), (joined,) = (find_answers(each.answers, TransientAnswer) for each in pair)
    closely(lumped.curves.displacements, joined.curves.displacements)
    assert lumped.curves.loads == ("gust", "let_go", "quake")


def test_a_volumetric_map_has_the_loads_of_lumped_bodies(tmp_path: Path) -> None:
    more = (
        "effects={ gravity = true }",
        'sweeps.volume={ axes = { X = ["-100 mm", "100 mm", 3], Y = ["-100 mm", "100 mm", 2], Z = ["200 mm", "300 mm", 2] } }',
        "analyses={ volumetric = { sweep = 'volume', at = ['tcp'] } }",
    )
    (lumped,), (joined,) = (
        find_answers(run(variant, tmp_path, *more).answers, VolumetricAnswer)
        for variant in ("lumped", "components")
    )
    assert set(lumped.sources) == set(joined.sources) == {"gravity", "static forces"}
    for source, expected in joined.sources.items():
        closely(lumped.sources[source][..., :3], expected[..., :3])
        closely(lumped.sources[source][..., 3:], expected[..., 3:])
    for shares in lumped.budget.values():
        assert sum(shares.values()) == approx(1.0, rel=1e-9)


@pytest.mark.parametrize("variant", ["lumped", "components"])
def test_a_traction_is_its_resultant_at_the_middle_of_its_area(
    variant: str, tmp_path: Path
) -> None:
    area = 'face = "y+", rect = { center = ["20 mm", "170 mm"], size = ["100 mm", "80 mm"] }'
    results = run(
        variant,
        tmp_path,
        "analyses={ static = { at = ['tcp'], poses = ['config_2'] } }",
        "effects={}",
        f"components.wrist.interfaces.pad={{ {area} }}",
        # of 80 cm^2
        'loads.resultant={ at = "wrist.pad", force = ["0 N", "400 N", "160 N"] }',
    )
    (answer,) = find_answers(results.answers, StaticAnswer)
    moved = answer.points["tcp"].displacements
    closely(moved["wind"], moved["resultant"])


@pytest.mark.parametrize("coupling", ["", "; drives.leg_2.coupling = '1e5 N m/rad'"])
def test_a_load_under_control_moves_lumped_bodies_as_joined_ones(
    coupling: str, tmp_path: Path
) -> None:
    """A coupling that gives way brings motors coordinates of their own."""
    controlled = FRF.replace("outputs", 'motors = "controlled", outputs')
    controlled = controlled.replace('"shake"]', '"shake", ["q1", "command"]]')
    more = [
        SHAKE,
        f"analyses={{ {controlled} }}",
        "effects={ drive_control = true, damping = { modal = '2 %' } }",
    ]
    more += [text.strip().replace(" = ", "=", 1) for text in coupling.split(";")[1:]]
    (lumped,), (joined,) = (
        find_answers(run(variant, tmp_path, *more).answers, PoseResponse)
        for variant in ("lumped", "components")
    )
    closely(lumped.curves.receptance, joined.curves.receptance)


def test_what_rigid_bodies_without_joints_cannot_take_is_refused() -> None:
    def load(text: str) -> None:
        load_scene(SCENE, variant="lumped", overrides=[f"loads.odd={text}"])

    with pytest.raises(SceneError, match="a pressure acts on the faces of a mesh"):
        load('{ face = "wrist.y+", pressure = "1 bar" }')
    with pytest.raises(SceneError, match="no joints that could be displaced"):
        load('{ joint = "tip_1", displacement = ["0 um", "10 um", "0 um"] }')


def test_a_load_on_a_body_that_stands_still_is_warned_of() -> None:
    override = 'loads.odd={ at = "frame.hub", force = ["1 N", "0 N", "0 N"] }'
    scene = load_scene(SCENE, variant="lumped", overrides=[override])
    assert any("loads.odd: frame is carried by no body" in text for text in scene.warnings)
