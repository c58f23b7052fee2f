"""Loads of a scene as inputs of a frequency response: a pressure on a beam against the modal sum of
its closed form, forces against those at points, units, and what is refused.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from mpi4py import MPI
from scipy.optimize import brentq

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.app.report.report import render_report
from headstock.app.tables.frf import tabulate_response
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.state_space_export import export_state_space
from headstock.scene.building.loader import load_scene
from headstock.scene.exports import Export
from headstock.scene.reading.findings import SceneError
from headstock.solvers.second_order import ComplexArray
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

LENGTH, WIDTH, HEIGHT, MODULUS, DENSITY, RATIO = 0.5, 0.02, 0.01, 210e9, 7850.0, 0.02
BEAM = stored_scene("load_responses_beam")


def modal_sum(omega: FloatArray, force_per_length: float, count: int = 8) -> ComplexArray:
    """Tip of a cantilever under an even load, Euler and Bernoulli: every mode with its damping
    ratio.
    """
    total = np.zeros(len(omega), dtype=complex)
    heavy, stiff = DENSITY * WIDTH * HEIGHT, MODULUS * WIDTH * HEIGHT**3 / 12.0
    for n in range(count):
        middle = (n + 0.5) * np.pi
        root = brentq(lambda x: np.cos(x) + 1.0 / np.cosh(x), middle - 0.8, middle + 0.8)
        weight = (np.sinh(root) - np.sin(root)) / (np.cosh(root) + np.cos(root))
        # shapes with the mean square 1 are 2 at the tip, in turns up and down, and 2 weight / root in the mean
        tip, mean = 2.0 * (-1.0) ** n, 2.0 * weight / root
        own = (root / LENGTH) ** 2 * np.sqrt(stiff / heavy)
        total += (
            tip * mean * force_per_length / heavy
            / (own**2 - omega**2 + 2j * RATIO * own * omega)
        )  # fmt: skip
    return total


def test_loads_of_a_scene_are_inputs_as_large_as_they_are(tmp_path: Path) -> None:
    results = compute(tmp_path, BEAM)
    (response,) = find_answers(results.answers, PoseResponse)
    curves = response.curves
    omega = 2.0 * np.pi * curves.frequencies_hz
    wind, shake, push, along_y, along_z = np.moveaxis(curves.receptance, 2, 0)
    # a force acts as it does at the point, in both directions
    np.testing.assert_allclose(push, 2.0 * along_y + 3.0 * along_z, rtol=1e-9, atol=1e-18)
    # at rest both are the static answer, which another solve gives
    static = results.static["reference"]["tip"].displacements
    for name, found in (("wind", wind), ("shake", shake)):
        assert found[0, 0].real == approx(static[name][2], rel=1e-9)
    # a pressure of p b per length, an acceleration of a rho A per length; shear takes 0.2 % of the
    # first frequency, so that lines near peaks are left out
    first, second = results.modal[0].frequencies_hz[:2]
    away = (np.abs(curves.frequencies_hz / first - 1.0) > 0.3) & (curves.frequencies_hz < 200.0)
    assert away.sum() > 20
    expected = modal_sum(omega, 1e3 * WIDTH)
    np.testing.assert_allclose(wind[away, 0], expected[away], rtol=1e-2)
    weight = 10.0 * DENSITY * HEIGHT / 1e3
    np.testing.assert_allclose(shake[:, 0], weight * wind[:, 0], rtol=2e-4)
    assert np.abs(wind[:, 1]).max() < 1e-9 * np.abs(wind[:, 0]).max()
    assert second > first
    assert any("wind, shake would excite directly" in words for words in response.error_left_out)
    headings = tabulate_response(curves).headings
    assert "Re tip z / wind load [m]" in headings and "Re tip z / tip z [m per N]" in headings
    page = render_report(results)
    assert "tip z / wind load" in page
    text = (tmp_path / "out" / "summary.json").read_text()
    assert json.loads(text)["frf"]["reference"]["inputs"][0] == ["wind", "load"]


def test_loads_are_inputs_of_an_exported_state_space_too(tmp_path: Path) -> None:
    path = write_scene(tmp_path, BEAM)
    scene = load_scene(path, overrides=("components.beam.fidelity=segmented",
                                        'loads.wind={ at = "beam.tip", force = ["0 N", "0 N", "5 N"] }',
                                        'analyses.frf.inputs=["wind", ["tip", "z"]]'))  # fmt: skip
    export_state_space(scene, Export("mat", hz=400.0), tmp_path / "beam.mat", comm=MPI.COMM_SELF)
    found = scipy.io.loadmat(tmp_path / "beam.mat")
    assert [str(name[0]) for name in found["inputs"].ravel()] == ["wind load", "tip z"]
    np.testing.assert_allclose(found["B"][:, 0], 5.0 * found["B"][:, 1], rtol=1e-12)


@cases
def test_what_is_no_input_is_refused(tmp_path: Path, setting: str, words: str) -> None:
    path = write_scene(tmp_path, BEAM)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=(setting,))
