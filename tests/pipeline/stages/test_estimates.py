"""What a run says of its errors: interfaces whose kind matters, numbers that are no more than
guesses.
"""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from mpi4py import MPI

import scene_runs
from common import present
from fixture_machines import machine, stored_scene
from headstock.pipeline.answers.frf import PoseResponse, ResponseCurves
from headstock.pipeline.answers.modal import DAMPED_FREQUENCY, DAMPING_RATIO
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer, compliance_key
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.numbers.numbers import Number, make_key
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.stages.warnings import find_warnings
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.solvers.pairing.response_peaks import ResponsePeak

pytestmark = [pytest.mark.fem, pytest.mark.process]

SCENE = machine("""
machine = "halves"
name = "two halves"
components.lower.interfaces = { foot = { face = "z-", coupling = "average" }, top = { face = "z+" } }
components.upper.interfaces = { foot = { face = "z-" }, top = { face = "z+", coupling = "average" } }
analyses.modal = { count = 6, spread = true }
""")


def test_interfaces_whose_kind_matters_are_named_with_about_the_range_that_both_kinds_span(
    tmp_path: Path,
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    store = Store(tmp_path / "store")
    results = run_scene(
        load_scene(tmp_path / "scene.toml"), tmp_path / "out", comm=MPI.COMM_SELF, store=store
    )
    modes = results.modal[0]
    words = next(words for words in modes.list_errors()[-1].left_out if "interfaces" in words)
    assert "lower.top" in words
    assert "upper.foot" in words
    assert "upper.top" not in words  # a free end passes no force on
    named = float(words.split("about ")[1].split(" Hz")[0])
    widest = max(high - low for low, high in map(present, modes.spread_hz))
    assert widest / 3.0 < named < 3.0 * widest


def _make_response(pose: str, error: Estimate) -> PoseResponse:
    """A response with one peak [m/N], and its ±."""
    tcp = (("tcp", "x"),)
    curves = ResponseCurves(pose, tcp, tcp, np.array([10.0]), np.ones((1, 1, 1), dtype=complex))
    response = PoseResponse(
        curves,
        "modal",
        damped=True,
        free_body=(),
        singular_hz=(),
        figures=(),
        peaks=(ResponsePeak(0, 0, 0, 10.0, 1e-9),),
    )
    (peak,) = response.heights
    return dataclasses.replace(response, errors={response.key(peak): error})


def test_a_number_that_is_less_than_twice_its_error_is_warned_of_with_its_owner_and_a_remedy() -> (
    None
):
    def guess(source: str, size: float) -> Estimate:
        return Estimate({source: size}, (), {source: {"column": size, "base": 0.1 * size}})

    point = PointCompliance(np.diag([1.0, 0.885, 1.0, 1.0, 1.0, 1.0]), {})
    static = StaticAnswer(
        "reference",
        {"tcp": point},
        errors={
            compliance_key("reference", "tcp", "x"): guess(DISCRETISATION, 0.1),
            compliance_key("reference", "tcp", "y"): guess(DISCRETISATION, 8.0),
        },
    )
    modes = SimpleNamespace(
        frequencies_hz=np.array([0.0, 50.0]),
        rigid_count=1,
        list_numbers=lambda: [
            Number(
                make_key("frequency", pose="reference", mode=2), 50.0, "Hz", guess(REDUCTION, 30.0)
            )
        ],
    )
    state = SimpleNamespace(
        scene=SimpleNamespace(
            analyses=SimpleNamespace(frf=None, get=lambda kind: None),
            machine=SimpleNamespace(joints={}),
        ),
        plan=SimpleNamespace(components={}, poses={"reference": None, "far": None}),
        reduced={},
        modal=[modes],
        static=[static],
        answers=(_make_response("far", guess(DISCRETISATION, 9.9e-9)),),
    )
    found = find_warnings(cast(RunState, state))
    assert len(found) == 2
    assert all(word in found[0] for word in ("'column'", "frequency 2", "50 Hz"))
    assert "reduction.modes_to" in found[0]
    # the worst of this component, a compliance of the other pose and a peak of this one
    assert "peak of tcp x under tcp x at mode 1 in pose far" in found[1]
    assert "9.9 times its value" in found[1]
    assert "smaller mesh size" in found[1]


ROD = stored_scene("estimates_rod")
SPEED = np.sqrt(210e9 / 7850.0)
IMPEDANCE = 0.0025 * np.sqrt(210e9 * 7850.0)
Rods = Callable[[str, float], Results]


@pytest.fixture(scope="module")
def rods(tmp_path_factory: pytest.TempPathFactory) -> Rods:
    folder = tmp_path_factory.mktemp("rod")

    @functools.cache
    def run(modes: str, share: float) -> Results:
        (folder / "scene.toml").write_text(
            ROD.replace("MODES", modes).replace("DASHPOT", repr(float(share * IMPEDANCE)))
        )
        return scene_runs.run(load_scene(folder / "scene.toml"), folder)

    return run


def damping_warnings(results: Results) -> list[str]:
    return [words for words in results.warnings if "damp" in words]


@pytest.mark.parametrize("modes", ["15", "30"])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.8, 1.25, 20.0])
def test_damping_of_a_rod_on_a_dashpot_lies_within_its_error_of_the_closed_form(
    rods: Rods, modes: str, share: float
) -> None:
    # coth(s L / c) = -share: every standing wave loses as much per round trip
    found = rods(modes, share)
    decay = -0.5 * np.log(abs((1.0 + share) / (1.0 - share)))
    orders = np.arange(8) + (0.5 if share < 1.0 else 0.0)
    poles = (decay + 1j * np.pi * orders) * SPEED
    stretching = [
        mode for mode, name in enumerate(found.modal[0].mode_names) if "stretches" in name
    ]
    judged = 0
    for mode in stretching:
        one = found.modal[0]
        hz, ratio, hz_error, ratio_error = (
            values[mode]
            for values in (
                one.damped_hz,
                one.damping_ratio,
                [each.total for each in one.list_errors(DAMPED_FREQUENCY)],
                [each.total for each in one.list_errors(DAMPING_RATIO)],
            )
        )
        if hz and hz_error is not None:
            nearest = poles[np.argmin(np.abs(poles.imag / (2.0 * np.pi) - hz))]
            assert abs(nearest.imag / (2.0 * np.pi) - hz) <= hz_error < 0.02 * hz
            assert (
                abs(-nearest.real / abs(nearest) - present(ratio))
                <= present(ratio_error)
                < 0.1 * present(ratio)
            )
            judged += 1
    assert judged == len(stretching) - (share > 1.0)
    assert len(damping_warnings(found)) == (share > 1.0)


@pytest.mark.parametrize("modes", ["15", "30"])
def test_a_dashpot_that_swallows_every_wave_leaves_no_damping_ratio_that_is_believed(
    rods: Rods, modes: str
) -> None:
    found = rods(modes, 1.0)
    stretching = [
        mode for mode, name in enumerate(found.modal[0].mode_names) if "stretches" in name
    ]
    assert stretching
    assert all(found.modal[0].list_errors(DAMPING_RATIO)[mode].total is None for mode in stretching)
    assert all(
        found.modal[0].list_errors(DAMPED_FREQUENCY)[mode].total is None for mode in stretching
    )
    (words,) = damping_warnings(found)
    assert "by joint dashpot" in words
    assert all(f"{mode + 1} (rod stretches X)" in words for mode in stretching)


def test_equal_modes_with_light_damping_have_an_error_and_no_warning(rods: Rods) -> None:
    found = rods("30", 0.01)
    bending = [mode for mode, name in enumerate(found.modal[0].mode_names) if "bends" in name]
    assert np.ptp(found.modal[0].frequencies_hz[bending[:2]]) < 1e-6  # of a square section
    for mode in bending:
        assert (
            0.0
            < present(found.modal[0].list_errors(DAMPING_RATIO)[mode].total)
            < 0.1 * present(found.modal[0].damping_ratio[mode])
        )
        assert present(found.modal[0].list_errors(DAMPED_FREQUENCY)[mode].total) >= 0.999 * present(
            found.modal[0].error_hz[mode]
        )
    assert not damping_warnings(found)


def test_an_overdamped_mode_is_named_with_its_damper(rods: Rods) -> None:
    (words,) = damping_warnings(rods("30", 20.0))
    assert "overdamped" in words and "joint dashpot" in words
