"""Supports of scenes along edges, normal to faces and in turned directions: a beam on two edges with
the frequency of its closed form, a tube held all around that slides and turns on springs.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from common import approx
from fixture_machines import machine
from headstock.pipeline.preview.rigid_view import view_rigid
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

BEAM = """
[materials.steel]
E = "210 GPa"
nu = 0.0
rho = "7850 kg/m^3"
[components.beam]
solid = { box = ["500 mm", "25 mm", "25 mm"] }
material = "steel"
mesh = { size = "25 mm", cells = "hex" }
[supports.left]
edge = ["beam.z-", "beam.x-"]
fix = ["z", [1, 0, 1]]
[supports.right]
edge = ["beam.x+", "beam.z-"]
fix = ["z"]
[supports.side]
face = "beam.y-"
fix = ["normal"]
[analyses.modal]
count = 1
"""


def test_a_beam_on_its_lower_edges_has_the_frequency_of_a_simply_supported_one(
    tmp_path: Path,
) -> None:
    """Timoshenko (1921) with shear and rotary inertia to first order, and the axial motion of the
    whole beam when the pinned edge turns at half of the height below its axis. What is left is the
    indentation of the edges.
    """
    results = compute(tmp_path, BEAM)
    length, height, wave = 0.5, 0.025, np.sqrt(210e9 / 7850.0)
    slim = np.pi / 2.0 / length**2 * wave * height / np.sqrt(12.0)
    ratio = (height / length) ** 2
    # kappa G = 5/6 E/2 without lateral contraction
    bending = 1.0 - 0.5 * np.pi**2 * ratio / 12.0 * (1.0 + 2.4)
    sliding = 1.0 / np.sqrt(1.0 + 0.5 * np.pi**2 * ratio)
    (hz,) = results.modal[0].frequencies_hz
    assert hz == approx(slim * bending * sliding, rel=2e-3)
    assert hz < slim * bending
    assert sum("holds an edge" in words for words in results.warnings) == 2
    scene = load_scene(tmp_path / "scene.toml")
    _, supports = view_rigid(scene, scene.poses["reference"])
    np.testing.assert_allclose(supports["left"].places, [[-0.25, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(supports["right"].places, [[0.25, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(supports["side"].directions, [[0.0, -1.0, 0.0]], atol=1e-12)


TUBE = machine("""
machine = "bar"
names = { bar = "quill", clamp = "stop", tip = "nose" }
without = ["points"]
components.quill.solid = { tube = { outer = "60 mm", inner = "40 mm", length = "25 mm" } }
components.quill.mesh = { size = "25 mm" }
components.quill.reduction = { modes = 0 }
components.quill.rotate = { axis = "y", angle = "30 deg" }
components.quill.interfaces = { nose = { face = "z+", coupling = "average" } }
supports.bore = { face = "quill.outer", fix = ["normal"] }
joints.stop.between = ["ground", "quill.nose"]
joints.stop.kind = "spring"
joints.stop.axis = [0.5, 0, 0.8660254037844386]
joints.stop.stiffness = { x = "1 N/um", rx = "500 N m/rad" }
analyses.modal = { count = 2 }
""")


def test_a_tube_held_all_around_slides_and_turns_on_its_springs(tmp_path: Path) -> None:
    results = compute(tmp_path, TUBE)
    mass = results.components["quill"].mass_kg
    turning = 0.5 * mass * (0.03**2 + 0.02**2)
    expected = np.sort(np.sqrt([1e6 / mass, 500.0 / turning])) / (2.0 * np.pi)
    # the mesh takes a little off the round faces, and the body is a little softer than a rigid one
    np.testing.assert_allclose(results.modal[0].frequencies_hz, expected, rtol=2e-3)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"face": "beam.z-", "fix": ["q"]}, "no direction that can be fixed"),
        ({"face": "beam.z-", "fix": [[0, 0, 0]]}, "needs a length above zero"),
        ({"edge": ["beam.z-", "beam.x-"], "fix": ["normal"]}, "an edge has no one normal"),
        ({"edge": ["beam.z-", "beam.q"], "fix": ["x"]}, "is not a face of this box"),
        ({"edge": ["beam.z-", "bed.x-"], "fix": ["x"]}, "two faces of one component"),
        ({"edge": ["beam.z-"], "fix": ["x"]}, "2"),
        ({"edge": ["beam.z-", "beam.x-"], "at": "beam.tip", "fix": ["x"]}, "two whole faces"),
    ],
)
def test_what_is_no_support_is_refused(tmp_path: Path, keys: dict[str, object], words: str) -> None:
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    path = tmp_path / "scene.toml"
    path.write_text("\n".join([BEAM, "[supports.other]", *lines]))
    with pytest.raises(SceneError, match=words):
        load_scene(path)
