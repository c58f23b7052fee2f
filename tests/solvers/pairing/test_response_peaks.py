"""Peaks of responses: the closed form of an oscillator, dense grids of larger systems, and the same
peaks of a changed system.
"""

import dataclasses

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import FrfModel, prepare_frf
from headstock.solvers.pairing.response_peaks import (
    COUNTED,
    find_levels,
    find_response_peaks,
    follow_peaks,
    measure_levels,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem

CHANNELS: tuple[Channel, ...] = (("a", "x"), ("b", "x"))


def make_chain(ratio: float | None, *, stiffer: float = 1.0, size: int = 6) -> SecondOrderSystem:
    """Masses in a row on springs, the first one on a wall."""
    springs = stiffer * np.linspace(4e6, 1e6, size)
    stiffness: FloatArray = np.diag(springs + np.append(springs[1:], 0.0))
    stiffness -= np.diag(springs[1:], 1) + np.diag(springs[1:], -1)
    inputs = {CHANNELS[0]: np.eye(size)[-1], CHANNELS[1]: np.eye(size)[1]}
    bare = SecondOrderSystem(
        2.0 * np.eye(size), None, stiffness, inputs, inputs, tuple(map(str, range(size)))
    )
    return bare if ratio is None else add_modal_damping(bare, (ratio,))


def respond(system: SecondOrderSystem) -> FrfModel:
    return prepare_frf(system, inputs=CHANNELS, outputs=CHANNELS)


@pytest.mark.parametrize("ratio", [0.001, 0.03, 0.2])
def test_the_peak_of_an_oscillator_is_the_closed_form(ratio: float) -> None:
    channel: dict[Channel, FloatArray] = {CHANNELS[0]: np.ones(1)}
    stiffness, mass = 5e6, 3.0
    omega = np.sqrt(stiffness / mass)
    system = SecondOrderSystem(
        mass * np.eye(1),
        np.full((1, 1), 2.0 * ratio * mass * omega),
        stiffness * np.eye(1),
        channel,
        channel,
        ("q",),
    )
    model = prepare_frf(system, inputs=CHANNELS[:1], outputs=CHANNELS[:1])
    (peak,) = find_response_peaks(model, 0.0, 1e4)
    height = 1.0 / (2.0 * ratio * np.sqrt(1.0 - ratio**2) * stiffness)
    assert peak.height == approx(height, rel=1e-5)
    place = omega * np.sqrt(1.0 - 2.0 * ratio**2) / (2.0 * np.pi)
    assert peak.hz == approx(place, rel=0.05 * ratio)


def test_peaks_are_the_tallest_maxima_of_a_dense_grid() -> None:
    model = respond(make_chain(0.02))
    hz = np.linspace(1.0, 700.0, 400_000)
    sizes = np.abs(model.form.evaluate(2.0 * np.pi * hz))
    inner = sizes[1:-1]
    maxima = (inner > sizes[:-2]) & (inner > sizes[2:])
    found = find_response_peaks(model, 0.0, 700.0)
    for entry in np.ndindex(2, 2):
        own_sizes = inner[:, entry[0], entry[1]]
        heights = own_sizes[maxima[:, entry[0], entry[1]]]
        counted = sorted(heights[heights >= COUNTED * heights.max()])
        own = sorted(peak.height for peak in found if (peak.output, peak.given) == entry)
        np.testing.assert_allclose(own, counted, rtol=1e-5, atol=0.0)
    assert {peak.mode for peak in found} < set(range(6))
    assert not find_response_peaks(model, 0.0, 1.0)


@pytest.mark.parametrize("ratio", [None, 0.5])
def test_a_resonance_without_damping_or_with_much_has_no_peak(ratio: float | None) -> None:
    assert not find_response_peaks(respond(make_chain(ratio)), 0.0, 700.0)


def test_levels_are_static_compliances_and_end_half_way_to_the_lowest_resonance() -> None:
    system = make_chain(0.02)
    model = respond(system)
    static = np.linalg.inv(system.stiffness)[np.ix_([5, 1], [5, 1])]
    levels = find_levels(model, 0.0)
    assert {(level.output, level.given) for level in levels} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    for level in levels:
        assert level.height == approx(static[level.output, level.given], rel=1e-9)
    first = np.sqrt(np.linalg.eigvalsh(0.5 * system.stiffness)[0]) / (2.0 * np.pi)
    assert find_levels(model, 0.45 * first) and not find_levels(model, 0.55 * first)


def test_peaks_of_a_stiffer_system_are_lower_and_found_where_their_modes_went() -> None:
    model, stiffer = respond(make_chain(0.02)), respond(make_chain(0.02, stiffer=1.3))
    peaks = find_response_peaks(model, 0.0, 700.0)
    lines = np.sqrt(np.linalg.eigvalsh(0.5 * make_chain(None).stiffness)) / (2.0 * np.pi)
    own = [peak.mode for peak in peaks]
    moved = follow_peaks(stiffer, peaks, own, lines[own])
    for before, after in zip(peaks, moved, strict=True):
        # with a damping ratio of its own every mode goes as its stiffness
        assert after.height == approx(before.height / 1.3, rel=3e-6)
        assert after.hz == approx(before.hz * np.sqrt(1.3), rel=1e-4)
    levels = find_levels(model, 0.0)
    heights = np.array([level.height for level in levels])
    np.testing.assert_allclose(measure_levels(stiffer, levels), heights / 1.3, rtol=1e-9, atol=0.0)
    lost = follow_peaks(stiffer, peaks, [-1] * len(peaks), lines[own])
    assert np.isnan([peak.height for peak in lost]).all()


def test_of_two_resonances_at_one_place_one_peak_is_told() -> None:
    system = make_chain(0.02, size=2)
    repeated = dataclasses.replace(system, stiffness=2e6 * np.eye(2), damping=None)
    model = respond(dataclasses.replace(add_modal_damping(repeated, (0.02,)), inputs=system.inputs))
    peaks = find_response_peaks(model, 0.0, 700.0)
    assert len({(peak.output, peak.given) for peak in peaks}) == len(peaks)
