"""Predicted factors against those that were measured, and the choice they lead to."""

from cases import cases
from common import approx
from headstock.geometry.parts.components import LinearSolver, ReductionSettings
from headstock.reduction.components.solver_choice import choose_method, predict_factor_entries

COLUMN, BLOCK, ROD = (0.1, 0.038, 0.5), (0.2, 0.2, 0.2), (0.05, 0.05, 1.0)


@cases
def test_predicted_entries_are_near_those_of_metis(
    extents: tuple[float, ...], dofs: int, measured: float
) -> None:
    assert predict_factor_entries(dofs, extents) == approx(measured, rel=0.12)


def test_an_unknown_shape_counts_as_a_cube() -> None:
    cube = predict_factor_entries(10**6, BLOCK)
    assert predict_factor_entries(10**6, None) == approx(cube, rel=1e-9)
    assert predict_factor_entries(10**6, ROD) < 0.6 * predict_factor_entries(10**6, None)


@cases
def test_factors_are_left_where_they_cannot_be_numbered_or_do_not_fit(
    solver: LinearSolver, entries: float, memory_mb: float, method: str
) -> None:
    settings = ReductionSettings(modes=20, solver=solver)
    choice = choose_method(settings, entries, direct_mb=17e3, memory_mb=memory_mb)
    assert choice.method == method
    assert choice.reason.startswith(method)


def test_modes_that_are_to_be_counted_take_factors() -> None:
    assert choose_method(ReductionSettings(modes=20, verify=True), 1e10).method == "direct"
