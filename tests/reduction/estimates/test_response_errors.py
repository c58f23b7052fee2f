"""Bounds of frequency responses against direct solves of unreduced machines; every line of two
small ones.
"""

import dataclasses

import numpy as np
import pytest

from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.frequency_errors import truncated_parts
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    ResponseErrors,
    bound_response_errors,
    project_response,
)
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import input_columns, output_rows
from headstock.validation.machines.estimate_cases import (
    RESOLVED,
    SHIFT_HZ,
    Specimen,
    clamped_beam,
    compare_frequencies,
    free_pair,
    keep_fewer,
    reduce_specimen,
    unreduced,
)
from headstock.validation.machines.monolithic_machines import monolithic_frequencies
from headstock.validation.machines.response_estimate_cases import CHANNELS, LINES, compare_responses


@pytest.fixture(scope="module")
def pair() -> Specimen:
    return free_pair()


def test_lines_of_a_free_machine_lie_within_their_bounds_and_these_are_sharp(
    pair: Specimen,
) -> None:
    pairs = compare_responses(pair, LINES)
    assert (pairs.true <= pairs.estimated + RESOLVED)[pairs.given].mean() > 0.95
    assert 0.98 < np.median(pairs.estimated[pairs.clear] / pairs.true[pairs.clear]) < 1.5
    assert pairs.true[pairs.given].max() > 0.1


def respond(
    specimen: Specimen, counts: tuple[int, int], hz: list[float]
) -> tuple[CoupledMachine, ResponseErrors]:
    whole = reduce_specimen(specimen, max(counts))
    parts = {
        name: keep_fewer(element, count)
        for (name, element), count in zip(whole.items(), counts, strict=True)
    }
    coupled = couple(parts, specimen.machine, specimen.pose)
    modes = solve_modal(coupled.system)
    system = dataclasses.replace(coupled.system, damping=None)
    channels = (input_columns(system, CHANNELS), output_rows(system, CHANNELS))
    space = project_response(
        system, ErrorSources(truncated_parts(coupled)), modes, channels, max(hz)
    )
    return coupled, bound_response_errors(space, np.array(hz))


def test_at_rest_nothing_is_off_and_beyond_the_modes_there_is_no_bound(pair: Specimen) -> None:
    coupled, errors = respond(pair, (2, 9), [0.0, 300.0, 1e5])
    assert not errors.bounds[0].any()
    assert np.isfinite(errors.bounds[1]).all() and errors.bounds[1].max() > 0.0
    assert np.isnan(errors.bounds[2]).all()
    assert (
        min(part.truncation.limit for part in truncated_parts(coupled).values())
        < (2e5 * np.pi) ** 2
    )


def test_frequencies_of_a_beam_lie_within_their_bounds_whatever_modes_are_kept() -> None:
    specimen = clamped_beam()
    pairs = compare_frequencies(
        specimen, monolithic_frequencies(unreduced(specimen), 14, shift_hz=SHIFT_HZ)
    )
    assert (pairs.true <= pairs.estimated + RESOLVED)[pairs.given].all()
    assert np.median(pairs.estimated[pairs.clear] / pairs.true[pairs.clear]) < 1.1
