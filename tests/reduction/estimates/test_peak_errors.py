"""Errors of peaks of responses: the rule of first order for one mode, a softened machine solved
whole, and modes left out.
"""

import dataclasses

import numpy as np

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.reduction.estimates.figure_errors import _PeakErrors, find_peak_errors
from headstock.reduction.estimates.frequency_errors import TruncatedPart
from headstock.reduction.estimates.mesh_errors import MeshedPart
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    SystemChange,
    project_response,
)
from headstock.reduction.superelement import Truncation
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import FrfModel, prepare_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.pairing.response_peaks import ResponsePeak, find_levels, find_response_peaks
from headstock.solvers.second_order import Channel, SecondOrderSystem, input_columns, output_rows

SIZE, RATIO = 8, 0.02
CHANNELS: tuple[Channel, ...] = (("a", "x"), ("b", "x"))


def make_system(seed: int = 3) -> SecondOrderSystem:
    """Masses, springs to the ground and to each other."""
    random = np.random.default_rng(seed)
    lines = random.standard_normal((SIZE, SIZE))
    stiffness: FloatArray = 2e5 * (lines @ lines.T) + np.diag(np.geomspace(1e6, 4e7, SIZE))
    channels = {CHANNELS[0]: np.eye(SIZE)[0], CHANNELS[1]: np.eye(SIZE)[1]}
    return SecondOrderSystem(
        np.eye(SIZE), None, stiffness, channels, channels, tuple(map(str, range(SIZE)))
    )


def missing(scale: float, first: int) -> FloatArray:
    """Energy that a mesh misses in some dofs."""
    lines = np.random.default_rng(first).standard_normal((SIZE, 3))
    lines[:first] *= 0.3
    return scale * 1e5 * lines @ lines.T


def meshed(energy: FloatArray, reach_hz: float = np.inf) -> MeshedPart:
    silent = np.zeros(SIZE, dtype=bool)
    return MeshedPart(energy, np.eye(SIZE), np.eye(SIZE), silent, reach_hz)


def respond(system: SecondOrderSystem) -> FrfModel:
    return prepare_frf(add_modal_damping(system, (RATIO,)), inputs=CHANNELS, outputs=CHANNELS)


def estimate(
    system: SecondOrderSystem, sources: ErrorSources
) -> tuple[list[ResponsePeak], _PeakErrors]:
    model = respond(system)
    peaks = find_response_peaks(model, 0.0, 1500.0)
    channels = input_columns(system, CHANNELS), output_rows(system, CHANNELS)
    space = project_response(system, sources, solve_modal(system), channels, 1500.0)

    def changed(change: SystemChange | None) -> FrfModel:
        return respond(space.changed_system(CHANNELS, CHANNELS, change))

    return peaks, find_peak_errors(space, changed, peaks, find_levels(model, 0.0))


def test_a_peak_moves_by_its_mode_and_its_frequency_to_first_order() -> None:
    """dH/H = dphi_i/phi_i + dphi_o/phi_o - 2 domega/omega, with what all other modes add."""
    system, energy = make_system(), missing(0.01, 2)
    peaks, errors = estimate(system, ErrorSources(meshed={"body": meshed(energy)}))
    before, after = (
        np.linalg.eigh(stiffness) for stiffness in (system.stiffness, system.stiffness - energy)
    )
    sharp = [
        number
        for number, peak in enumerate(peaks)
        if np.min(np.abs(np.delete(before[0], peak.mode) / before[0][peak.mode] - 1.0)) > 0.2
    ]
    assert len(sharp) >= 2
    for number in sharp:
        peak = peaks[number]
        heights = []
        for squares, shapes in (before, after):
            place = int(np.argmax(np.abs(shapes.T @ before[1][:, peak.mode])))
            omega = np.sqrt(squares[place])
            products = shapes[peak.output] * shapes[peak.given]
            bare = squares - omega**2 + 2j * RATIO * np.sqrt(squares) * omega
            heights.append(abs(np.sum(products / bare)))
        assert errors.finer["body"][number] == approx(
            abs(heights[1] - heights[0]), rel=0.03, abs=1e-5 * peak.height
        )


def test_every_body_and_every_level_is_that_of_the_softened_system() -> None:
    """Whose flexibility is larger by what meshes miss under given loads."""
    system = make_system()
    energies = {"base": missing(0.3, 1), "column": missing(0.1, 4)}
    parts = {name: meshed(energy) for name, energy in energies.items()}
    peaks, errors = estimate(system, ErrorSources(meshed=parts))
    flexibility = np.linalg.inv(system.stiffness)
    static = flexibility[:2, :2]
    assert peaks and errors.finer.keys() >= energies.keys()
    for name, energy in energies.items():
        stiffness = np.linalg.inv(flexibility + flexibility @ energy @ flexibility)
        softer = dataclasses.replace(system, stiffness=stiffness)
        whole = np.abs(
            respond(softer).form.evaluate(2.0 * np.pi * np.linspace(1.0, 1500.0, 200_000))
        )
        for number, peak in enumerate(peaks):
            off = errors.finer[name][number]
            entry = whole[:, peak.output, peak.given]
            # one of both signs is a maximum of the softened response
            wanted = [peak.height - off, peak.height + off]
            inner = entry[1:-1][(entry[1:-1] > entry[:-2]) & (entry[1:-1] > entry[2:])]
            assert min(np.abs(inner / each - 1.0).min() for each in wanted) < 2e-3
        soft = np.linalg.inv(softer.stiffness)[:2, :2]
        levels = errors.finer[name][len(peaks) :]
        assert len(levels)
        np.testing.assert_allclose(
            sorted(levels), sorted(np.abs(soft - static).ravel()), rtol=1e-6, atol=0.0
        )


def test_a_mesh_that_misses_more_energy_than_the_machine_stores_still_has_an_error() -> None:
    peaks, errors = estimate(
        make_system(), ErrorSources(meshed={"body": meshed(missing(100.0, 2))})
    )
    assert (errors.finer["body"][len(peaks) :] > 1e-8).any()


def test_beyond_what_a_mesh_tells_and_the_modes_kept_nobody_knows() -> None:
    system = make_system()
    limit = (2.0 * np.pi * 350.0) ** 2
    truncation = Truncation(1e-13 * np.eye(SIZE), 1e-20 * np.eye(SIZE), limit)
    sources = ErrorSources(
        {"body": TruncatedPart(truncation, np.eye(SIZE))},
        {"body": meshed(missing(0.1, 1), reach_hz=300.0)},
    )
    peaks, errors = estimate(system, sources)
    hz = np.array([peak.hz for peak in peaks])
    own = errors.modes["body"][: len(peaks)]
    assert (hz > 350.0).any() and (hz < 300.0).any()
    np.testing.assert_array_equal(np.isnan(own), hz >= 350.0)
    np.testing.assert_array_equal(np.isnan(errors.finer["body"][: len(peaks)]), hz >= 300.0)
    assert (own[hz < 350.0] > 0.0).all() and not errors.modes["body"][len(peaks) :].any()


def test_modes_left_out_change_a_peak_as_the_mass_that_they_add() -> None:
    system = make_system()
    first = 2e-9 * np.eye(SIZE)
    truncation = Truncation(first, np.zeros((SIZE, SIZE)), 1e12)
    parts = {"body": TruncatedPart(truncation, np.eye(SIZE))}
    peaks, errors = estimate(system, ErrorSources(parts))
    peak = peaks[0]
    square = (2.0 * np.pi * peak.hz) ** 2
    # lambda^2 R in the dynamic stiffness is lambda R more mass, twice that where it grows with lambda
    heavier = dataclasses.replace(
        system,
        mass=system.mass + 2.0 * square * first,
        stiffness=system.stiffness + square**2 * first,
    )
    (moved,) = [
        other
        for other in find_response_peaks(respond(heavier), 0.0, 1500.0)
        if (other.output, other.given, other.mode) == (peak.output, peak.given, peak.mode)
    ]
    assert errors.modes["body"][0] == approx(abs(moved.height - peak.height), rel=0.02)
