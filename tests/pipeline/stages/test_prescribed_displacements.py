"""Displacements and rotations that joints are given: beams on supports that move, against closed
forms and against the compliance of the same beam.
"""

from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.results.results import Results
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

LENGTH, STIFFNESS = 0.4, 2e5
BEAM = stored_scene("prescribed_displacements_beam")


def at_tip(results: Results) -> PointCompliance:
    (answer,) = find_answers(results.answers, StaticAnswer)
    return answer.points["tip"]


def displaced(results: Results) -> dict[str, FloatArray]:
    """Motion of the point by load."""
    point = at_tip(results)
    assert point.displacement is not None
    return {"all": point.displacement, **point.displacements}


def tip_compliance() -> float:
    """Of a cantilever by Timoshenko [m/N]; its shear area is 5/6 of the section."""
    inertia, shear = 0.01**4 / 12.0, 210e9 / 2.6 * 0.01**2 * 5.0 / 6.0
    return LENGTH**3 / (3.0 * 210e9 * inertia) + LENGTH / shear


def test_a_propped_cantilever_follows_its_wall_and_its_prop(tmp_path: Path) -> None:
    found = displaced(compute(tmp_path, BEAM))
    give = STIFFNESS * tip_compliance()
    turned, lifted = 1e-3 * LENGTH / (1.0 + give), 50e-6 * give / (1.0 + give)
    # the segments bend as a Timoshenko beam does, to their own order
    assert found["turn"][0] == approx(turned, rel=2e-3)
    assert found["lift"][0] == approx(lifted, rel=2e-3)
    # nothing of the prop acts along y
    assert abs(found["lift"][1]) < 1e-15
    np.testing.assert_allclose(found["all"], found["turn"] + found["lift"], rtol=1e-12)
    # the same from the compliance of the beam itself, without its closed form
    free = BEAM.partition("[loads.turn]")[0] + "[analyses.static]\n"
    own = at_tip(compute(tmp_path, free, 'joints.prop.stiffness.x="1e-9 N/um"')).compliance[0, 0]
    share = STIFFNESS * own / (1.0 + STIFFNESS * own)
    assert found["lift"][0] == approx(50e-6 * share, rel=1e-7)


def test_both_ends_of_a_fixed_beam_may_be_displaced(tmp_path: Path) -> None:
    """What is fixed to ground goes where its ground goes, whichever end is named first; the middle
    of a fixed beam goes half of the way, and 1/8 of its length times the turn of an end.
    """
    found = displaced(compute(tmp_path, stored_scene("prescribed_displacements_two_beams")))
    np.testing.assert_allclose(found["lift"][:3], [25e-6, 3.5e-6, 0.0], atol=1e-12)
    assert found["turn"][0] == approx(1e-3 * 2.0 * LENGTH / 8.0, rel=1e-9)


def test_parts_of_a_machine_may_be_pushed_apart(tmp_path: Path) -> None:
    """A joint without ground: its second end relative to the first, in machine axes whatever its
    own.
    """
    found = displaced(compute(tmp_path, stored_scene("prescribed_displacements_head")))
    # springs that carry nothing take all of it
    np.testing.assert_allclose(found["lift"][:3], [50e-6, 7e-6, 0.0], atol=1e-12)


@cases
def test_what_cannot_be_displaced_is_refused(tmp_path: Path, setting: str, words: str) -> None:
    path = write_scene(tmp_path, BEAM)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=(setting,))


def test_a_displacement_that_a_support_holds_is_named_with_it(tmp_path: Path) -> None:
    results = compute(tmp_path, stored_scene("prescribed_displacements_held"))
    (warning,) = [each for each in results.warnings if "moves nothing" in each or "'lift'" in each]
    assert "joint 'wall' along z" in warning and "support 'floor'" in warning
    moved = displaced(results)["all"]
    assert moved[:3] == approx([0.0, 7e-6, 0.0], abs=1e-9)
