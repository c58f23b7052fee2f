"""frequencies above the reach of a reduction or of a mesh carry a warning, and no error
estimate where there is no bound.
"""

import math
import re
from collections.abc import Callable

import numpy as np
import pytest

import headstock as hs
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import Box
from headstock.pipeline.numbers.estimates import REDUCTION
from headstock.pipeline.results.results import Results
from headstock.pipeline.stages.warnings import _node_spacing, _shortest_wave
from scene_runs import compute

pytestmark = [pytest.mark.hard("H52"), pytest.mark.fem, pytest.mark.process]

SCENE = stored_scene("reach")
Sheet = Callable[[str], tuple[FloatArray, list[str], list[str]]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, int, int], Results]:
    folder = tmp_path_factory.mktemp("h52")

    def go(size: str, modes: int, count: int) -> Results:
        text = SCENE.replace("SIZE", size).replace('"MODES"', str(modes))
        return compute(folder, text.replace('"COUNT"', str(count)))

    return go


def test_frequencies_beyond_the_modes_kept_have_a_warning_and_no_estimate(
    run: Callable[[str, int, int], Results],
) -> None:
    results = run("25 mm", 3, 9)
    (modes,), cutoff = results.modal, results.components["strip"].cutoff_hz
    beyond = modes.frequencies_hz > cutoff
    assert beyond.any() and not beyond.all()
    assert [error is None for error in modes.error_hz] == beyond.tolist()
    (warning,) = [text for text in results.warnings if "fixed-interface modes" in text]
    assert "no error estimate, and some may be missing" in warning and "modes_to" in warning


def test_the_estimate_grows_towards_the_cut_off(run: Callable[[str, int, int], Results]) -> None:
    fewer, more = run("25 mm", 3, 5).modal[0], run("25 mm", 24, 5).modal[0]
    bounds = [error.shares[REDUCTION] for error in fewer.list_errors()]
    known = np.array([bound for bound in bounds if bound is not None])
    shares = known / fewer.frequencies_hz[: len(known)]
    assert shares[-1] > 10.0 * shares[0]
    true = fewer.frequencies_hz[: len(known)] - more.frequencies_hz[: len(known)]
    assert (known >= true - 1e-9 * more.frequencies_hz[0]).all()


def test_within_the_modes_kept_nothing_is_said(run: Callable[[str, int, int], Results]) -> None:
    results = run("25 mm", 24, 5)
    errors = results.modal[0].error_hz
    assert len(errors) == 5 and all(error is not None for error in errors)
    assert not [
        text
        for text in results.warnings
        if "fixed-interface modes" in text or "nodes of its mesh" in text
    ]


def test_waves_shorter_than_six_nodes_are_told_with_their_length(
    run: Callable[[str, int, int], Results],
) -> None:
    results = run("100 mm", 12, 8)
    (warning,) = [text for text in results.warnings if "nodes of its mesh" in text]
    assert "'strip'" in warning and "too high" in warning
    finer = run("25 mm", 12, 8)
    # it is true: the coarse mesh is stiffer there by percents
    assert results.modal[0].frequencies_hz[-1] > 1.02 * finer.modal[0].frequencies_hz[-1]


def test_the_wave_of_a_thin_strip_is_that_of_its_eigenfrequency() -> None:
    # half a wave of a simply supported plate that bends cylindrically: f = pi/2 sqrt(D / rho h) /
    # L^2
    steel = Material("steel", 2.1e11, 0.3, 7850.0)
    rigidity = 2.1e11 * 0.008**3 / (12.0 * (1.0 - 0.09))
    hz = math.pi / 2.0 * math.sqrt(rigidity / (7850.0 * 0.008)) / 0.4**2
    strip = Component("strip", Box((0.4, 0.04, 0.008)), steel)
    assert _shortest_wave(strip, 0.008, hz) == approx(0.8, rel=1e-12)
    assert _shortest_wave(strip, 10.0, 1e4) == approx(
        math.sqrt(2.1e11 / 2.6 / 7850.0) / 1e4, rel=1e-12
    )


@pytest.mark.parametrize(("length", "width", "step"), [(0.4, 0.04, 0.01), (0.4, 0.4, 0.02)])
def test_nodes_along_a_wall_are_as_far_apart_as_in_its_mesh(
    length: float, width: float, step: float
) -> None:
    nodes = round(length / step) * round(width / step) * 3
    assert _node_spacing(nodes, length * width * 0.008, 0.008) == approx(step, rel=0.02)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Sheet:
    folder = tmp_path_factory.mktemp("sheet")

    def go(mesh: str) -> tuple[FloatArray, list[str], list[str]]:
        text = SCENE.replace('"400 mm", "40 mm", "8 mm"', '"200 mm", "60 mm", "0.4 mm"')
        text = text.replace('mesh = { size = "SIZE", cells = "hex" }', mesh)
        text = text.replace('"MODES"', "12").replace('"COUNT"', "2")
        checked = hs.check(write_scene(folder, text))
        results = compute(folder, text)
        return (
            results.modal[0].frequencies_hz,
            [text for text in results.warnings if "lock" in text],
            [text for text in checked if "lock" in text],
        )

    return go


def test_tets_that_lock_across_a_sheet_are_named_with_a_mesh_that_does_not(sheet: Sheet) -> None:
    """Also before the run; the mesh keeps every key that was there."""
    true, *silent = sheet('mesh = { size = "10 mm", cells = "hex" }')
    locked, (warning,), (foreseen,) = sheet('mesh = { size = "20 mm", across_patches = 3 }')
    assert silent == [[], []]
    assert locked[1] > 1.1 * true[1]
    for text in (warning, foreseen):
        assert "'strip'" in text and "walls of 0.4 mm" in text and 'cells = "hex"' in text
    (remedy,) = re.findall(r"mesh = { .* }", warning)
    assert "across_patches = 3" in remedy
    right, *nothing = sheet(remedy)
    assert nothing == [[], []]
    assert np.abs(right / true - 1.0).max() < 0.02
