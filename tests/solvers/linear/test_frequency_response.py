"""The frequency response is the same by every method: sums over modes or poles, direct solves,
closed forms.
"""

import dataclasses

import numpy as np
import pytest

from common import approx, present
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear import damper_sum, quadratic_poles
from headstock.solvers.linear.damping import add_modal_damping, equivalent_viscous
from headstock.solvers.linear.frequency_response import (
    PEAK_MARGIN,
    FrequencyResponse,
    convert_receptance,
    evaluate_frf,
    find_peaks,
    find_stability_figures,
    prepare_frf,
    refine_grid,
    solve_frf,
)
from headstock.solvers.linear.quadratic_poles import state_eigenpairs
from headstock.solvers.linear.response_forms import narrow_band
from headstock.solvers.second_order import ComplexArray, Motion, SecondOrderSystem

CHANNELS = (("a", "x"), ("b", "x"))


def make_system(
    size: int = 12,
    *,
    seed: int = 0,
    damping: FloatArray | None = None,
    hysteretic: FloatArray | None = None,
) -> SecondOrderSystem:
    random = np.random.default_rng(seed)
    factor = random.standard_normal((size, size))
    stiffness = 1e6 * (factor @ factor.T + 0.1 * np.eye(size))
    mass = np.diag(random.uniform(0.5, 5.0, size))
    channels = {channel: np.eye(size)[i] for i, channel in enumerate(CHANNELS)}
    return SecondOrderSystem(
        mass, damping, stiffness, channels, channels, tuple(map(str, range(size))), hysteretic
    )


def make_oscillator(
    *, zeta: float = 0.0, eta: float = 0.0, hz: float = 80.0, mass: float = 3.0
) -> SecondOrderSystem:
    square = (2.0 * np.pi * hz) ** 2
    channel: dict[tuple[str, str], FloatArray] = {("a", "x"): np.ones(1)}
    damping = np.full((1, 1), 2.0 * zeta * mass * np.sqrt(square)) if zeta else None
    loss = np.full((1, 1), eta * mass * square) if eta else None
    return SecondOrderSystem(
        np.eye(1) * mass, damping, np.eye(1) * mass * square, channel, channel, ("q",), loss
    )


def dashpots(size: int = 12, seed: int = 1) -> FloatArray:
    lines = np.random.default_rng(seed).standard_normal((size, 3))
    return 80.0 * lines @ lines.T


def losses(system: SecondOrderSystem, seed: int = 2) -> FloatArray:
    lines = np.random.default_rng(seed).standard_normal((len(system.mass), 2))
    return 0.01 * system.stiffness + 5e4 * lines @ lines.T


def cases() -> dict[str, tuple[SecondOrderSystem, str]]:
    bare = make_system()
    return {
        "undamped": (bare, "modal"),
        "modal": (add_modal_damping(bare, [0.01, 0.03]), "modal"),
        "proportional": (
            dataclasses.replace(bare, damping=1e-5 * bare.stiffness + 3.0 * bare.mass),
            "modal",
        ),
        "uniform loss": (dataclasses.replace(bare, hysteretic=0.02 * bare.stiffness), "modal"),
        "dashpots": (dataclasses.replace(bare, damping=dashpots()), "poles"),
        "losses": (dataclasses.replace(bare, hysteretic=losses(bare)), "poles"),
        "both": (dataclasses.replace(bare, damping=dashpots(), hysteretic=losses(bare)), "poles"),
    }


def respond(system: SecondOrderSystem, *hz: float) -> FrequencyResponse:
    """Between the system's own channels."""
    return solve_frf(system, np.array(hz), inputs=list(system.inputs), outputs=list(system.outputs))


def few_dampers() -> dict[str, SecondOrderSystem]:
    """Systems of 60 dofs with few dampers: viscous ones, losses, rigid motions, damping of all
    modes besides; and a very strong one.
    """
    size = 60
    bare = make_system(size, seed=4)
    free = dataclasses.replace(
        bare,
        stiffness=np.diag([2e6] * size)
        - np.diag([1e6] * (size - 1), 1)
        - np.diag([1e6] * (size - 1), -1),
    )
    free.stiffness[0, 0] = free.stiffness[-1, -1] = 1e6
    return {
        "dashpots": dataclasses.replace(bare, damping=dashpots(size)),
        "locking": dataclasses.replace(bare, damping=1e6 * dashpots(size)),
        "dashpots and one ratio": add_modal_damping(
            dataclasses.replace(bare, damping=dashpots(size)), [0.02]
        ),
        "dashpots and a share of the stiffness": dataclasses.replace(
            bare, damping=dashpots(size) + 1e-5 * bare.stiffness
        ),
        "a brake and a shock absorber that pushes": dataclasses.replace(
            bare, damping=dashpots(size) - 0.1 * dashpots(size, seed=9)
        ),
        "losses": dataclasses.replace(bare, hysteretic=losses(bare)),
        "both": dataclasses.replace(bare, damping=dashpots(size), hysteretic=losses(bare)),
        "free, damped to ground": dataclasses.replace(
            free, damping=np.diag([300.0, *[0.0] * (size - 1)])
        ),
        "free, damped inside": dataclasses.replace(
            free, damping=40.0 * np.outer(*[np.eye(size)[3] - np.eye(size)[9]] * 2)
        ),
    }


@pytest.mark.parametrize("name", list(few_dampers()))
def test_few_dampers_cost_a_small_solve_per_frequency_and_the_answer_is_that_of_direct_solves(
    name: str,
) -> None:
    system = few_dampers()[name]
    model = prepare_frf(system, inputs=CHANNELS[:1], outputs=CHANNELS)
    undamped = np.linalg.eigvalsh(
        np.linalg.solve(np.diag(np.sqrt(np.diag(system.mass))), system.stiffness)
        / np.sqrt(np.diag(system.mass))
    )
    on_modes = np.sqrt(undamped[[5, 20]]) / (2.0 * np.pi)
    frequencies = np.concatenate([[0.3], np.linspace(3.0, 900.0, 150), on_modes, [1e5]])
    found = evaluate_frf(model, frequencies)
    expected = model.direct.evaluate(2.0 * np.pi * frequencies)
    assert found.method == "dampers"
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found.receptance / scale, expected / scale, atol=1e-8)


def test_a_mode_that_no_damper_reaches_is_singular_at_its_own_frequency_and_only_where_it_is_seen() -> (
    None
):
    system = few_dampers()["dashpots"]
    square = (2.0 * np.pi * 55.0) ** 2
    alone = np.zeros((62, 62))
    parts = {
        "mass": (system.mass, 1.0),
        "stiffness": (system.stiffness, square),
        "damping": (system.damping, 0.0),
    }
    grown = {}
    for name, (matrix, own) in parts.items():
        grown[name] = alone.copy()
        grown[name][:60, :60] = matrix
        grown[name][60, 60] = grown[name][61, 61] = own
    channels = {("a", "x"): np.eye(62)[0], ("alone", "x"): np.eye(62)[60]}
    whole = SecondOrderSystem(
        inputs=channels, outputs=channels, labels=tuple(map(str, range(62))), **grown
    )
    found = respond(whole, 55.0)
    assert found.method == "dampers"
    assert np.isnan(found.receptance[0]).tolist() == [[False, False], [False, True]]


def test_where_poles_are_too_near_each_other_many_dampers_take_a_small_solve_per_frequency() -> (
    None
):
    """A critically damped mass has one eigenvector for two poles; ten more dampers of sixty modes."""
    size = 60
    bare = make_system(size, seed=4)
    lines = np.random.default_rng(7).standard_normal((size, 10))
    lines[-1] = 0.0
    mass, stiffness, damping = bare.mass.copy(), bare.stiffness.copy(), 80.0 * lines @ lines.T
    for matrix, own in ((mass, 1.0), (stiffness, 1e6), (damping, 2e3)):
        matrix[-1] = matrix[:, -1] = 0.0
        matrix[-1, -1] = own
    system = dataclasses.replace(bare, mass=mass, stiffness=stiffness, damping=damping)
    model = prepare_frf(system, inputs=CHANNELS, outputs=CHANNELS)
    frequencies = np.asarray(np.linspace(3.0, 900.0, 80), dtype=float)
    found, expected = (
        evaluate_frf(model, frequencies),
        model.direct.evaluate(2.0 * np.pi * frequencies),
    )
    assert found.method == "dampers"
    np.testing.assert_allclose(found.receptance, expected, atol=1e-9 * np.abs(expected).max())


def test_many_dampers_that_differ_take_the_sum_over_poles() -> None:
    system = make_system(60, seed=4)
    damping = np.diag(np.random.default_rng(3).uniform(1.0, 90.0, 60))
    assert respond(dataclasses.replace(system, damping=damping), 10.0).method == "poles"


@pytest.mark.parametrize("name", list(cases()))
def test_every_sum_equals_a_direct_solve_per_frequency(name: str) -> None:
    system, method = cases()[name]
    frequencies = np.linspace(3.0, 2000.0, 150, dtype=np.float64)
    model = prepare_frf(system, inputs=CHANNELS, outputs=CHANNELS)
    found = evaluate_frf(model, frequencies)
    expected = model.direct.evaluate(2.0 * np.pi * frequencies)
    assert found.method == method
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found.receptance / scale, expected / scale, atol=1e-9)


@pytest.mark.parametrize(
    ("zeta", "eta"), [(0.0, 0.0), (0.02, 0.0), (0.0, 0.05), (0.01, 0.03), (0.7, 0.0), (3.0, 0.0)]
)
def test_one_mass_answers_as_the_textbook_says(zeta: float, eta: float) -> None:
    system = make_oscillator(zeta=zeta, eta=eta)
    ratio = np.array([0.1, 0.5, 0.99, 1.01, 2.0, 10.0, 1e4])
    found = respond(system, *(80.0 * ratio)).receptance[:, 0, 0]
    expected = 1.0 / (system.stiffness[0, 0] * (1.0 - ratio**2 + 1j * (2.0 * zeta * ratio + eta)))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("zeta", [0.02, 3.0])
def test_modes_far_above_the_range_are_a_polynomial_in_the_frequency_to_rounding(
    zeta: float,
) -> None:
    """Many frequencies at once, against one at a time, which sums over every mode; overdamped modes
    have a slow pole and are far only if that one is.
    """
    stiff = np.diag(np.geomspace(1e4, 1e12, 80))
    stiff[0, 1:] = stiff[1:, 0] = 1e3
    system = dataclasses.replace(make_system(80), stiffness=stiff)
    system = add_modal_damping(system, (0.01, 0.02, zeta))
    model = prepare_frf(system, inputs=CHANNELS, outputs=CHANNELS)
    poles = np.sort(np.abs(model.form.poles()))
    omega: FloatArray = np.asarray(np.linspace(0.1, 1.0, 90) * poles[30], dtype=float)
    assert (poles > 3.0 * omega[-1]).sum() >= 32
    single = np.concatenate([model.form.evaluate(each[None]) for each in omega])
    band = narrow_band(model.form, omega[-2])  # the last frequency is beyond it
    few = np.concatenate([band.evaluate(some) for some in np.split(omega, 30)])
    for found in (model.form.evaluate(omega), few):
        np.testing.assert_allclose(found, single, rtol=1e-10, atol=1e-12 * np.abs(single).max())


def test_critical_damping_falls_back_to_direct_solves_or_stays_right() -> None:
    bare = make_system(2, seed=5)
    mass, stiffness = np.eye(2), np.diag([1e4, 1e4])
    damping = np.array([[200.0, 50.0], [50.0, 200.0]])
    system = dataclasses.replace(bare, mass=mass, stiffness=stiffness, damping=damping)
    frequencies = np.linspace(1.0, 60.0, 30, dtype=np.float64)
    found = respond(system, *frequencies).receptance
    for hz, value in zip(frequencies, found, strict=True):
        omega = 2.0 * np.pi * hz
        np.testing.assert_allclose(
            value, np.linalg.inv(stiffness - omega**2 * mass + 1j * omega * damping), rtol=1e-8
        )


def test_a_dashpot_on_a_dof_without_mass_takes_the_direct_road() -> None:
    mass, stiffness = np.diag([2.0, 0.0]), np.array([[3e4, -1e4], [-1e4, 1e4]])
    bare = dataclasses.replace(make_system(2), mass=mass, stiffness=stiffness)
    undamped = respond(bare, 0.0, 7.0)
    damped = respond(dataclasses.replace(bare, damping=np.diag([0.0, 40.0])), 7.0)
    assert (undamped.method, damped.method) == ("modal", "direct")
    np.testing.assert_allclose(undamped.receptance[0], np.linalg.inv(stiffness), rtol=1e-12)
    omega = 14.0 * np.pi
    np.testing.assert_allclose(
        undamped.receptance[1], np.linalg.inv(stiffness - omega**2 * mass), rtol=1e-10
    )
    dynamic = stiffness - omega**2 * mass + 1j * omega * np.diag([0.0, 40.0])
    np.testing.assert_allclose(damped.receptance[0], np.linalg.inv(dynamic), rtol=1e-12)


def test_two_bodies_that_float_answer_elastically_between_them_and_rigidly_to_one_load() -> None:
    masses, spring = np.array([2.0, 6.0]), 5e6
    stiffness = spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    channels = {("a", "x"): np.array([1.0, 0.0]), ("gap", "x"): np.array([1.0, -1.0])}
    system = SecondOrderSystem(np.diag(masses), None, stiffness, channels, channels, ("a", "b"))
    found = respond(system, 0.0, 20.0)
    assert found.free_body[0].tolist() == [[True, False], [False, False]]
    assert not found.free_body[1].any()
    omega = 40.0 * np.pi
    reduced = masses.prod() / masses.sum()
    assert found.receptance[0, 1, 1] == approx(1.0 / spring, rel=1e-12)
    assert found.receptance[1, 1, 1] == approx(1.0 / (spring - omega**2 * reduced), rel=1e-9)
    expected = np.linalg.inv(stiffness - omega**2 * np.diag(masses))[0, 0]
    assert found.receptance[1, 0, 0] == approx(expected, rel=1e-9)


def test_a_dashpot_alone_holds_a_body_at_every_frequency_but_zero() -> None:
    channel: dict[tuple[str, str], FloatArray] = {("a", "x"): np.ones(1)}
    system = SecondOrderSystem(
        np.eye(1) * 4.0, np.eye(1) * 30.0, np.zeros((1, 1)), channel, channel, ("q",)
    )
    found = respond(system, 0.0, 2.0)
    omega = 4.0 * np.pi
    assert found.free_body[0, 0, 0]
    assert found.receptance[1, 0, 0] == approx(1.0 / (30j * omega - 4.0 * omega**2), rel=1e-12)


def test_mobility_and_accelerance_are_derivatives() -> None:
    frequencies = np.array([10.0, 300.0])
    found = respond(make_oscillator(zeta=0.02), *frequencies)
    rate = 2j * np.pi * frequencies
    powers: dict[Motion, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}
    for motion, power in powers.items():
        values = convert_receptance(found.receptance, frequencies, motion)
        np.testing.assert_allclose(
            values[:, 0, 0], found.receptance[:, 0, 0] * rate**power, rtol=1e-14
        )


def test_structural_damping_as_viscous_damping_gives_each_mode_half_its_loss_factor() -> None:
    bare = make_system()
    viscous = equivalent_viscous(dataclasses.replace(bare, hysteretic=0.04 * bare.stiffness))
    modal = add_modal_damping(bare, [0.02])
    np.testing.assert_allclose(
        present(viscous.damping),
        present(modal.damping),
        rtol=1e-8,
        atol=1e-9 * np.abs(present(modal.damping)).max(),
    )
    assert viscous.hysteretic is None


def test_equivalent_viscous_damping_takes_energy_out_of_every_motion() -> None:
    bare = make_system()
    damping = present(
        equivalent_viscous(dataclasses.replace(bare, hysteretic=losses(bare))).damping
    )
    assert np.linalg.eigvalsh(damping).min() > -1e-9 * np.abs(damping).max()


def test_the_grid_holds_the_even_points_and_the_top_of_every_peak() -> None:
    model = prepare_frf(add_modal_damping(make_system(), [1e-4]), inputs=CHANNELS, outputs=CHANNELS)
    base = np.linspace(0.0, 1000.0, 101, dtype=np.float64)
    poles = model.form.poles()
    grid = refine_grid(base, poles)
    assert np.isin(base, grid).all() and (np.diff(grid) > 0.0).all()
    inside = poles.imag[(poles.imag < 2000.0 * np.pi)] / (2.0 * np.pi)
    assert np.isin(inside, grid).all() and len(inside) > 3
    assert len(grid) < 101 + 60 * len(inside)


def test_the_worst_real_part_and_the_softest_frequency_are_those_of_one_mass() -> None:
    zeta = 0.03
    system = make_oscillator(zeta=zeta)
    model = prepare_frf(system, inputs=[("a", "x")], outputs=[("a", "x")])
    response = evaluate_frf(
        model, refine_grid(np.linspace(0.0, 200.0, 51, dtype=np.float64), model.form.poles())
    )
    (figures,) = find_stability_figures(model, response)
    stiffness = system.stiffness[0, 0]
    assert figures.most_negative_real == approx(
        -1.0 / (4.0 * zeta * (1.0 + zeta) * stiffness), rel=1e-9
    )
    assert figures.most_negative_real_hz == approx(80.0 * np.sqrt(1.0 + 2.0 * zeta), rel=1e-5)
    assert figures.chatter_limit == approx(2.0 * zeta * (1.0 + zeta) * stiffness, rel=1e-9)
    assert figures.minimum_dynamic_stiffness == approx(
        2.0 * zeta * np.sqrt(1.0 - zeta**2) * stiffness, rel=1e-9
    )
    assert figures.minimum_dynamic_stiffness_hz == approx(
        80.0 * np.sqrt(1.0 - 2.0 * zeta**2), rel=1e-5
    )


@pytest.mark.parametrize("hz", [np.nan, np.inf])
def test_a_frequency_that_is_no_number_is_refused(hz: float) -> None:
    with pytest.raises(ModelError, match="not finite"):
        respond(make_system(), 1.0, hz)


def test_an_unknown_port_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ModelError, match=r"no input 'c x'.*\['a', 'b'\]"):
        solve_frf(make_system(), np.array([1.0]), inputs=[("c", "x")], outputs=CHANNELS)


@pytest.mark.parametrize("ratios", [[], [-0.01], [np.nan]])
def test_modal_damping_needs_ratios_that_take_energy_out(ratios: list[float]) -> None:
    with pytest.raises(ModelError, match="modal damping"):
        add_modal_damping(make_system(), ratios)


@pytest.mark.parametrize("strength", [0.0, 1.0, 1e2, 1e3, 1e4])
def test_peaks_of_few_dampers_are_the_poles_of_the_whole_state_matrix_from_small_eigenproblems(
    strength: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(5)
    size, kept = 240, 25
    springs = 1e6 * random.uniform(0.5, 2.0, size + 1)
    stiffness = (
        np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    )
    damping = np.zeros((size, size))
    for place in random.choice(size - 1, 6, replace=False):
        damping[place : place + 2, place : place + 2] += strength * np.array(
            [[1.0, -1.0], [-1.0, 1.0]]
        )
    damping[0, 0] += 1.0
    channel = {("tip", "x"): np.eye(size)[-1]}
    system = SecondOrderSystem(np.eye(size), damping, stiffness, channel, channel, ("q",) * size)
    model = prepare_frf(system, inputs=[("tip", "x")], outputs=[("tip", "x")])
    solved: list[int] = []
    whole = state_eigenpairs

    def counted(eigenvalues: FloatArray, viscous: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        solved.append(len(viscous))
        return whole(eigenvalues, viscous)

    expected, _ = whole(stiffness, damping)
    monkeypatch.setattr(quadratic_poles, "state_eigenpairs", counted)
    monkeypatch.setattr(damper_sum, "state_eigenpairs", counted)
    omega = np.sqrt(np.linalg.eigvalsh(stiffness))
    found = find_peaks(model, float(omega[kept - 1]) / (2.0 * np.pi) / PEAK_MARGIN * (1.0 + 1e-9))
    # modes of the circle and a few more, and one motion for each damper that blocks it
    assert max(solved) < size / 4 + 6 and len(solved) <= 2
    distances = np.abs(found[:, None] - expected)
    assert (distances.min(axis=1) <= 1e-8 * np.abs(found)).all()
    # peaks with their flanks in the range are all there, each once
    sharp = expected[
        (expected.imag > 0.0)
        & (np.abs(expected) < omega[kept - 4])
        & (np.abs(expected.real) < 0.05 * np.abs(expected))
    ]
    assert len(sharp) > 10
    near = np.abs(sharp[:, None] - found) <= 1e-8 * np.abs(sharp)[:, None]
    assert (near.sum(axis=1) == 1).all()
