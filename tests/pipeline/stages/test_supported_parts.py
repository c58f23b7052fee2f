"""Parts that supports alone hold, or leave free in some motions, from a scene: static answers,
natural modes, free motions by name.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.preview.rigid_view import view_rigid
from headstock.pipeline.results.summary import RunSummary
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]
PART = stored_scene("supported_parts_part")
MODES = "[analyses.modal]\ncount = COUNT\n"


def part(
    size: tuple[int, int, float], mesh: int, *sections: str, free: bool = False, count: int = 8
) -> str:
    text = PART.replace("SIZE", ", ".join(f'"{value} mm"' for value in size)).replace(
        "MESH", str(mesh)
    )
    return text.replace("FREE", str(free).lower()) + "\n".join(sections).replace(
        "COUNT", str(count)
    )


def support(name: str, face: str, *directions: str) -> str:
    return f'[supports.{name}]\nface = "part.{face}"\nfix = {json.dumps(directions)}\n'


def run(tmp_path: Path, text: str, name: str = "scene") -> RunSummary:
    compute(tmp_path, text, name=name, into=name)
    return read_summary(tmp_path / name)


def test_a_column_on_supports_without_any_interface_is_pressed_by_force_over_stiffness(
    tmp_path: Path,
) -> None:
    loads = '[loads.p]\nface = "part.z+"\npressure = "1 MPa"\n[probes.top]\ncomponent = "part"\nat = ["0 mm", "0 mm", "100 mm"]\n'
    found = run(
        tmp_path,
        part(
            (100, 100, 100), 50, support("foot", "z-", "x", "y", "z"), loads, "[analyses.static]\n"
        ),
    )
    (probe,) = found["probes"]["reference"].values()
    np.testing.assert_allclose(
        probe["displacement_um"], [0.0, 0.0, -1e6 * 0.1 / 210e9 * 1e6], rtol=1e-9, atol=1e-9
    )


def test_a_pressure_over_the_area_of_an_averaging_interface_gives_its_force_over_stiffness(
    tmp_path: Path,
) -> None:
    interfaces = (
        '[components.part.interfaces]\nfoot = { face = "z-" }\ntop = { face = "z+", coupling = "average" }\n'
        '[joints.clamp]\nbetween = ["ground", "part.foot"]\nkind = "rigid"\n[points]\ntop = { tool = "part.top", work = "ground" }\n'
        '[loads.p]\nface = "part.z+"\npressure = "1 MPa"\n'
        '[probes.top]\ncomponent = "part"\nat = ["0 mm", "0 mm", "100 mm"]\n[analyses.static]\nat = "top"\n'
    )
    found = run(tmp_path, part((100, 100, 100), 50, interfaces))
    (probe,) = found["probes"]["reference"].values()
    assert probe["displacement_um"][2] == approx(-1e6 * 0.1 / 210e9 * 1e6, rel=1e-9)


def test_half_and_quarter_of_a_free_plate_have_its_symmetric_modes_and_the_motions_their_planes_leave(
    tmp_path: Path,
) -> None:
    whole = run(tmp_path, part((400, 400, 20), 50, MODES, free=True, count=14), "whole")
    half = run(
        tmp_path,
        part((200, 400, 20), 50, support("x", "x-", "x"), MODES, free=True, count=6),
        "half",
    )
    planes = support("x", "x-", "x") + support("y", "y-", "y")
    quarter = run(tmp_path, part((200, 200, 20), 50, planes, MODES, free=True, count=4), "quarter")
    assert len(quarter["modal"][0]["frequencies_hz"]) >= 3
    for found, names in (
        (half, {"Y translation", "Z translation", "A rotation"}),
        (quarter, {"Z translation"}),
    ):
        (modes,), (all_modes,) = found["modal"], whole["modal"]
        rigid = len(names)
        assert {
            name.removeprefix("free ").removesuffix(" of part")
            for name in modes["mode_names"][:rigid]
        } == names
        assert all(frequency == 0.0 for frequency in np.round(modes["frequencies_hz"][:rigid], 6))
        for frequency in modes["frequencies_hz"][rigid : rigid + 2]:
            assert np.abs(np.array(all_modes["frequencies_hz"]) / frequency - 1.0).min() < 1e-6


def test_an_interface_beside_a_symmetry_plane_changes_no_frequency(tmp_path: Path) -> None:
    plane = support("x", "x-", "x")
    tip = '[components.part.interfaces]\ntip = { face = "x+", coupling = "average" }\n'
    (plain,) = run(tmp_path, part((200, 400, 20), 50, plane, MODES, free=True, count=6), "plain")[
        "modal"
    ]
    (fixed,) = run(
        tmp_path, part((200, 400, 20), 50, tip, plane, MODES, free=True, count=6), "fixed"
    )["modal"]
    np.testing.assert_allclose(fixed["frequencies_hz"][3:], plain["frequencies_hz"][3:], rtol=1e-2)
    assert len(fixed["mode_names"]) == 6 and all("free" in name for name in fixed["mode_names"][:3])


@pytest.mark.parametrize("thickness", [8.0, 0.4], ids=["1:50", "1:1000"])
def test_a_simply_supported_sheet_has_the_frequencies_of_plate_theory(
    tmp_path: Path, thickness: float
) -> None:
    edges = "".join(
        support(face[0] + "mp"[face[1] == "+"], face, *("yz" if face[0] == "x" else "xz"))
        for face in ("x-", "x+", "y-", "y+")
    )
    (modes,) = run(tmp_path, part((400, 300, thickness), 25, edges, MODES, count=3))["modal"]
    rigidity, mass = 210e9 * (1e-3 * thickness) ** 3 / 12.0, 7850.0 * 1e-3 * thickness
    exact = [
        0.5 * np.pi * (m * m / 0.16 + n * n / 0.09) * np.sqrt(rigidity / mass)
        for m, n in ((1, 1), (2, 1), (1, 2))
    ]
    np.testing.assert_allclose(modes["frequencies_hz"], exact, rtol=0.01)


BEAM = stored_scene("supported_parts_beam")


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


TUBE = stored_scene("supported_parts_tube")


def test_a_tube_held_all_around_slides_and_turns_on_its_springs(tmp_path: Path) -> None:
    results = compute(tmp_path, TUBE)
    mass = results.components["quill"].mass_kg
    turning = 0.5 * mass * (0.03**2 + 0.02**2)
    expected = np.sort(np.sqrt([1e6 / mass, 500.0 / turning])) / (2.0 * np.pi)
    # the mesh takes a little off the round faces, and the body is a little softer than a rigid one
    np.testing.assert_allclose(results.modal[0].frequencies_hz, expected, rtol=2e-3)


@cases
def test_what_is_no_support_is_refused(tmp_path: Path, keys: dict[str, object], words: str) -> None:
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    path = write_scene(tmp_path, "\n".join([BEAM, "[supports.other]", *lines]))
    with pytest.raises(SceneError, match=words):
        load_scene(path)
