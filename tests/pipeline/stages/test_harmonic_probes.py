"""Displacement and stress at probes, from a scene."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from cases import cases
from common import approx, present
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.probes import ProbeCurves
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import RunSummary
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.solvers.second_order import ComplexArray
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]
BEAM_LENGTH, SIDE, PRESSURE, YOUNG = 0.4, 0.02, 0.1e6, 210e9
SCENE = stored_scene("harmonic_probes")


def _run(tmp_path: Path, text: str) -> RunSummary:
    compute(tmp_path, text, name="beam")
    return read_summary(tmp_path / "out")


def test_bending_stress_and_tip_deflection_follow_beam_theory(tmp_path: Path) -> None:
    summary = _run(tmp_path, SCENE)
    line, inertia = PRESSURE * SIDE, SIDE**4 / 12.0
    bending = line * (BEAM_LENGTH / 2) ** 2 / 2 * (SIDE / 2) / inertia
    probe = summary["probes"]["reference"]["middle"]
    assert probe["stress_mpa"]["zz"] == approx(-bending * 1e-6, rel=0.01)
    deflection = line * BEAM_LENGTH**4 / (8 * YOUNG * inertia)
    assert summary["static"]["tcp"]["displacement"][0] == approx(deflection, rel=0.01)


def test_a_turned_component_shows_the_same_stress_in_turned_axes(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    straight = _run(tmp_path / "a", SCENE)["probes"]["reference"]["middle"]
    turned = SCENE.replace(
        "[components.beam]\n", '[components.beam]\nrotate = { axis = "y", angle = "90 deg" }\n'
    )
    lying = _run(tmp_path / "b", turned)["probes"]["reference"]["middle"]
    assert lying["stress_mpa"]["xx"] == approx(straight["stress_mpa"]["zz"], rel=1e-9)
    assert lying["displacement_um"][2] == approx(-straight["displacement_um"][0], rel=1e-9)


def test_a_second_run_recovers_the_same_stress_from_the_store(tmp_path: Path) -> None:
    first = _run(tmp_path, SCENE)
    second = _run(tmp_path, SCENE)
    assert second["probes"] == first["probes"]
    reductions = [stage for stage in second["stages"] if stage["stage"] == "reduce"]
    assert reductions and all(stage["cached"] for stage in reductions)


def test_a_probe_without_loads_is_refused_with_the_remedy(tmp_path: Path) -> None:
    scene = tmp_path / "beam.toml"
    text = SCENE.replace('[loads.side]\nface = "beam.x-"\npressure = "0.1 MPa"\n', "")
    scene.write_text(text)
    with pytest.raises(SceneError, match=r"\[loads\.NAME\].*gravity"):
        load_scene(scene)


LENGTH, WIDTH, MODULUS, DENSITY, LOSS = 0.2, 0.02, 210e9, 7850.0, 0.04
BAR = stored_scene("harmonic_probes_bar")


def traced(results: Results) -> dict[str, ProbeCurves]:
    (response,) = find_answers(results.answers, PoseResponse)
    return {probe.name: probe for probe in response.curves.probes}


def bar_under_end_load(
    place: float, frequencies_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Displacement and stress of a clamped bar under a unit stress at its end, with a complex
    modulus: ``u'' = -k^2 u``.
    """
    modulus = MODULUS * (1.0 + 1j * LOSS)
    k = 2.0 * np.pi * frequencies_hz * np.sqrt(DENSITY / modulus)
    return (
        np.sin(k * place) / (modulus * k * np.cos(k * LENGTH)),
        np.cos(k * place) / np.cos(k * LENGTH),
    )


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Results]:
    folder = tmp_path_factory.mktemp("bar")
    return folder, compute(folder, BAR)


@pytest.mark.parametrize(("name", "place"), [("inside", 0.063), ("middle", 0.1)])
def test_stress_along_a_damped_bar_is_that_of_its_closed_form_within_its_error(
    bar: tuple[Path, Results], name: str, place: float
) -> None:
    probe = traced(bar[1])[name]
    assert probe.frequencies_hz[-1] == 8000.0 and len(probe.frequencies_hz) > 41
    moved, stress = bar_under_end_load(place, probe.frequencies_hz)
    area, force = WIDTH**2, probe.inputs.index(("tip", "x"))
    for column, unit in ((probe.inputs.index(("pull", "load")), 1e6), (force, 1.0 / area)):
        for found, exact, shares in (
            (probe.displacement[:, 0, column], unit * moved, probe.displacement_error_share),
            (probe.stress[:, 0, column], unit * stress, probe.stress_error_share),
        ):
            off = np.abs(found - exact)
            # near the resonance at 6465 Hz the modes left out count most
            assert (off < 0.02 * np.abs(exact)).all()
            assert (off < 1e-5 * np.abs(exact))[probe.frequencies_hz < 200.0].all()
            errors = np.sum([size[:, 0, column] for size in shares.values()], axis=0)
            covered = off <= errors + 1e-6 * np.abs(exact)
            assert covered.mean() > 0.95
            assert np.median(errors / np.abs(exact)) < 0.01
    mises = np.abs(unit * stress)
    np.testing.assert_allclose(probe.von_mises[:, force], mises, rtol=0.02)


def test_a_cantilever_at_its_resonance_has_the_bending_stress_of_its_shape(
    bar: tuple[Path, Results],
) -> None:
    results = bar[1]
    foot, middle = traced(results)["foot"], traced(results)["top"]
    column = foot.inputs.index(("push", "load"))
    low = foot.frequencies_hz < 1000.0
    peak = int(np.argmax(np.abs(foot.stress[low, 0, column])))
    hz = foot.frequencies_hz[peak]
    inertia = WIDTH**4 / 12.0
    root, heavy, stiff = 1.8751, DENSITY * WIDTH**2, MODULUS * inertia
    # Euler and Bernoulli; shear and the inertia of rotation take 1.5 % of the frequency
    slender = root**2 * np.sqrt(stiff / heavy) / LENGTH**2 / (2.0 * np.pi)
    assert hz == approx(slender, rel=0.02)
    weight = (np.sinh(root) - np.sin(root)) / (np.cosh(root) + np.cos(root))

    def curvature(place: float) -> float:
        x = root * place / LENGTH
        shape = np.cosh(x) + np.cos(x) - weight * (np.sinh(x) + np.sin(x))
        return float(shape * (root / LENGTH) ** 2)

    # the shape has the mean square 1, and 2 weight / root in the mean; at resonance the loss factor
    # alone holds it
    mean = 2.0 * weight / root
    amplitude = 1e3 * WIDTH * mean / (heavy * LOSS * (2.0 * np.pi * hz) ** 2)
    for probe, place in ((foot, 0.0), (middle, 0.1)):
        bending = MODULUS * WIDTH / 2.0 * curvature(place) * amplitude
        assert np.abs(probe.stress[peak, 0, column]) == approx(bending, rel=0.02)
    assert foot.singular == "the rim of support 'clamp'" and not middle.singular
    assert np.isnan(present(foot.von_mises_error)).all()
    assert np.isfinite(present(middle.von_mises_error)).all()
    assert any("probe 'foot'" in message for message in results.warnings)


def test_volume_meshes_hold_the_complex_fields_of_a_damped_bar(bar: tuple[Path, Results]) -> None:
    grid = bar[1].mesh("bar")
    middles = grid.cell_centers().points[:, 0] + LENGTH / 2.0
    # 24 modes; what is left out counts most at the loaded end
    for hz, allowed in ((900.0, 2e-3), (6465.0, 0.06)):
        _, stress = bar_under_end_load(middles, np.full(len(middles), hz))
        moved, _ = bar_under_end_load(grid.points[:, 0] + LENGTH / 2.0, np.full(grid.n_points, hz))
        for exact, data, name, size in (
            (stress, grid.cell_data, f"frf pull at {hz:g} Hz stress", 1e6),
            (moved, grid.point_data, f"frf pull at {hz:g} Hz shape", 1e6),
        ):
            unit = "Pa" if "stress" in name else "m"
            found = data[f"{name} Re [{unit}]"][:, 0] + 1j * data[f"{name} Im [{unit}]"][:, 0]
            largest = np.abs(exact).max()
            np.testing.assert_allclose(found / size, exact, rtol=0.0, atol=allowed * largest)
            inner = slice(None) if "shape" in name else middles < 0.15
            assert np.abs(found / size - exact)[inner].max() < 0.4 * allowed * largest
        cycle = grid.cell_data[f"frf tip x at {hz:g} Hz von Mises stress [Pa/N]"] * WIDTH**2
        np.testing.assert_allclose(cycle, np.abs(stress), atol=allowed * np.abs(stress).max())
    # at the damped resonance displacement and stress come a quarter of a cycle after the force
    late = stress[middles < 0.1]
    assert (np.abs(np.angle(late, deg=True) + 90.0) < 5.0).all()


def test_files_hold_what_probes_see(bar: tuple[Path, Results]) -> None:
    folder, results = bar
    probe = traced(results)["middle"]
    with h5py.File(folder / "out" / "results.h5") as file:
        group = file["frf/reference/probes/middle"]
        np.testing.assert_array_equal(group["stress"][:], probe.stress)
        np.testing.assert_array_equal(group["von_mises"][:], probe.von_mises)
        assert {"discretisation", "reduction"} <= set(group["von_mises_error_share"])
    curves = open_results(folder / "out").frf["reference"].curves
    again = {each.name: each for each in curves.probes}["middle"]
    np.testing.assert_array_equal(again.von_mises, probe.von_mises)
    np.testing.assert_array_equal(again.von_mises_error, probe.von_mises_error)
    summary = read_summary(folder / "out")["frf"]["reference"]["probes"]["middle"]
    pull = summary["inputs"][0]
    assert pull["input"] == ["pull", "load"] and pull["unit"] == "MPa"
    assert pull["peak_von_mises"] == approx(1e-6 * probe.von_mises[:, 0].max())
    assert pull["peak_hz"] == approx(6465.0, rel=0.01)
    assert pull["peak_von_mises_error"] is not None


@cases
def test_what_no_probe_can_show_is_refused(tmp_path: Path, setting: str, words: str) -> None:
    path = write_scene(tmp_path, BAR)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=(setting,))
