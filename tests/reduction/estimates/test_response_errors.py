"""Bounds of frequency responses against direct solves of unreduced machines; every line of two
small ones.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from common import approx, make_box, make_component, present
from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    ResponseErrors,
    bound_response_errors,
    project_response,
)
from headstock.reduction.superelement import Superelement, most_participation
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import input_columns, output_rows
from headstock.validation.coverage.coverage_case import CHANNELS
from headstock.validation.machines.estimate_cases import (
    RESOLVED,
    SHIFT_HZ,
    Specimen,
    _compare_frequencies,
    clamped_beam,
    free_pair,
    keep_fewer,
    reduce_specimen,
    unreduced,
)
from headstock.validation.machines.monolithic_machines import monolithic_frequencies
from headstock.validation.machines.response_estimate_cases import (
    LINES,
    _compare_responses,
)
from reduced_parts import reduce_mesh


@pytest.fixture(scope="module")
def pair() -> Specimen:
    return free_pair()


def test_lines_of_a_free_machine_lie_within_their_bounds_and_these_are_sharp(
    pair: Specimen,
) -> None:
    pairs = _compare_responses(pair, LINES)
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
    pairs = _compare_frequencies(
        specimen, monolithic_frequencies(unreduced(specimen), 14, shift_hz=SHIFT_HZ)
    )
    assert (pairs.true <= pairs.estimated + RESOLVED)[pairs.given].all()
    assert np.median(pairs.estimated[pairs.clear] / pairs.true[pairs.clear]) < 1.1


SIZE = (0.1, 0.13, 0.4)
EVERY = 10**6
COUPLINGS = [("rigid", "rigid"), ("average", "rigid"), ("average", "average")]
Reduce = Callable[[tuple[str, str], int], Superelement]


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    return make_box((1, 2, 4), SIZE, {"foot": "z-", "tip": "z+"})


@pytest.fixture(scope="module")
def reduce(mesh: ComponentMesh) -> Reduce:
    made = {}

    def reduced(couplings: tuple[str, str], count: int) -> Superelement:
        key = (couplings, count)
        if key not in made:
            component = make_component(
                dict(zip(("foot", "tip"), couplings, strict=True)), size=SIZE
            )
            made[key] = reduce_mesh(component, mesh, modes=count)
        return made[key]

    return reduced


def participations(whole: Superelement, kept: int) -> tuple[FloatArray, FloatArray]:
    """Participation ``(n_b, k)`` and omega^2 ``(k,)`` of the modes after those kept."""
    boundary = whole.boundary_size
    return whole.mass[:boundary, boundary + kept :], (
        2.0 * np.pi * whole.modal_frequencies_hz[kept:]
    ) ** 2


@pytest.mark.parametrize("couplings", COUPLINGS)
@pytest.mark.parametrize("count", [0, 4, 11])
def test_moments_are_the_sums_over_the_modes_left_out(
    reduce: Reduce, couplings: tuple[str, str], count: int
) -> None:
    element = reduce(couplings, count)
    left, eigenvalues = participations(reduce(couplings, EVERY), element.modal_count)
    for found, power in (
        (present(element.errors.truncation).first, 1),
        (present(element.errors.truncation).second, 2),
    ):
        exact = (left / eigenvalues**power) @ left.T
        size = np.sqrt(exact.diagonal())
        np.testing.assert_allclose(
            found / np.outer(size, size), exact / np.outer(size, size), atol=1e-6
        )
    assert present(element.errors.truncation).limit == approx(
        eigenvalues[0], rel=1e-9 if count else 0.05
    )


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_the_modes_left_out_lie_between_the_two_sums(reduce: Reduce, share: float) -> None:
    element = reduce(("rigid", "average"), 4)
    left, eigenvalues = participations(reduce(("rigid", "average"), EVERY), element.modal_count)
    truncation, square = present(element.errors.truncation), share * eigenvalues[0]
    exact = (left / (eigenvalues - square)) @ left.T
    scale = 1.0 / np.sqrt(exact.diagonal())
    # two terms of the geometric series
    below = exact - (truncation.first + square * truncation.second)
    above = most_participation(truncation, square) - exact
    assert np.linalg.eigvalsh(scale[:, None] * below * scale)[0] > -1e-6
    assert np.linalg.eigvalsh(scale[:, None] * above * scale)[0] > -1e-6


def test_all_modes_kept_leave_nothing_out(reduce: Reduce) -> None:
    assert not present(reduce(("rigid", "rigid"), EVERY).errors.truncation).first.any()
    assert present(reduce(("rigid", "rigid"), EVERY).errors.truncation).limit == np.inf


def test_there_is_no_bound_beyond_the_lowest_mode_left_out(reduce: Reduce) -> None:
    truncation = present(reduce(("rigid", "rigid"), 4).errors.truncation)
    with pytest.raises(ValueError, match="beyond the lowest mode"):
        most_participation(truncation, truncation.limit)


def coupled_pair(elements: dict[str, Superelement]) -> CoupledMachine:
    """Two columns at right angles, tip on tip through a spring, the first one fixed at its foot."""
    turned = Frame(np.array([0.0, 0.0, 0.5]), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    parts = {
        name: make_component({"foot": "rigid", "tip": "rigid"}, name=name, size=SIZE)
        for name in ("a", "b")
    }
    parts["b"] = type(parts["b"])(**{**vars(parts["b"]), "placement": turned})
    spring = 1e9 * np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
    joints = {
        "clamp": Joint(
            "clamp", (JointEnd(), JointEnd("a", "foot")), "rigid", fixed=tuple(range(6))
        ),
        "bolt": Joint(
            "bolt", (JointEnd("a", "tip"), JointEnd("b", "foot")), "spring", stiffness=spring
        ),
    }
    return couple(elements, Machine("pair", parts, joints), Pose("reference"))


@pytest.mark.parametrize("counts", [(2, 2), (3, 9), (8, 8)])
def test_frequencies_of_two_coupled_columns_are_within_their_bounds_of_all_modes(
    reduce: Reduce, counts: tuple[int, int]
) -> None:
    couplings = [("rigid", "rigid"), ("average", "rigid")]
    whole = coupled_pair({n: reduce(c, EVERY) for n, c in zip("ab", couplings, strict=True)})
    machine = coupled_pair(
        {n: reduce(c, k) for n, c, k in zip("ab", couplings, counts, strict=True)}
    )
    modes = solve_modal(machine.system, count=8)
    exact = solve_modal(whole.system, count=8).frequencies_hz
    found = bound_frequency_errors(machine.system, truncated_parts(machine), modes)
    true = modes.frequencies_hz - exact
    known = np.isfinite(found.bounds_hz)
    assert known.sum() >= 4
    assert (true >= -1e-6 * exact).all()
    assert (found.bounds_hz[known] >= true[known] - 1e-6 * exact[known]).all()
    large = known & (true > 1e-5 * exact)
    assert large.any()
    assert np.median(found.bounds_hz[large] / true[large]) < 3.0


def test_the_shares_of_the_components_add_up_to_the_bound_where_it_is_small(reduce: Reduce) -> None:
    machine = coupled_pair(
        {"a": reduce(("rigid", "rigid"), 8), "b": reduce(("average", "rigid"), 8)}
    )
    modes = solve_modal(machine.system, count=4)
    found = bound_frequency_errors(machine.system, truncated_parts(machine), modes)
    np.testing.assert_allclose(sum(found.by_component.values()), found.bounds_hz, rtol=0.05)


def test_a_frequency_beyond_the_modes_of_a_component_has_no_bound_and_names_it(
    reduce: Reduce,
) -> None:
    machine = coupled_pair(
        {"a": reduce(("rigid", "rigid"), 1), "b": reduce(("average", "rigid"), 11)}
    )
    modes = solve_modal(machine.system)
    found = bound_frequency_errors(machine.system, truncated_parts(machine), modes)
    past = modes.frequencies_hz > reduce(("rigid", "rigid"), 1).cutoff_hz
    assert past.any() and np.isnan(found.bounds_hz[past]).all()
    assert all("a" in names for names, high in zip(found.beyond, past, strict=True) if high)
