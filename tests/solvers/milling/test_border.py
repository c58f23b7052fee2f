"""Floquet multipliers by collocation in the cut and the border they draw, compared with
semi-discretisation, closed forms and a plain scan.
"""

import dataclasses
import math

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.milling import border
from headstock.solvers.milling.border import Limit, find_border
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.collocation import (
    Multiplier,
    PeriodicCut,
    _dominant_pair,
    safe_depth,
)
from headstock.solvers.milling.forces import EndMill, MillingCut, Sense, chip_stiffness
from headstock.solvers.milling.tip_poles import (
    TipDynamics,
    TipPoles,
    _find_poles,
    settle_fastest,
    tip_dynamics,
)
from headstock.solvers.milling.windows import divide_period
from headstock.validation.mechanisms.semi_discretisation import largest_multiplier, milling_gains

TURN = 2.0 * np.pi
CHIP = CuttingCoefficients((6e8, 2e8, 5e7), (0.0, 0.0, 0.0), "Insperger and Stepan (2004)")
ONE_MODE = ((922.0, 0.011, 0.03993 * (TURN * 922.0) ** 2),)
PUBLISHED = ((603.0, 0.039, 5.59e6), (666.0, 0.035, 5.715e6))


def tip_of(modes: tuple[tuple[float, float, float], ...]) -> TipDynamics:
    """A mode along, then one away."""
    hz, zeta, stiffness = (np.array(column) for column in zip(*modes, strict=True))
    rows = np.eye(3)[:, : len(modes)]
    mass, damping = stiffness / (TURN * hz) ** 2, 2.0 * zeta * stiffness / (TURN * hz)
    return tip_dynamics(
        np.diag(mass), np.diag(damping), np.diag(stiffness), forced=rows, seen=rows[:2]
    )


def machine_tip(count: int) -> TipDynamics:
    """A tip with many modes in all directions, most of which matter little."""
    draw = np.random.default_rng(7)
    hz: FloatArray = np.asarray(np.geomspace(40.0, 2500.0, count), dtype=float)
    stiffness = 40.0 * (TURN * hz) ** 2
    rows = draw.standard_normal((3, count))
    rows[:, count // 2 :] *= 0.3
    damping = np.diag(2.0 * 0.03 * 40.0 * TURN * hz)
    mass = np.diag(np.full(count, 40.0))
    return tip_dynamics(mass, damping, np.diag(stiffness), forced=rows, seen=rows[:2])


def poles_of(tip: TipDynamics) -> TipPoles:
    poles = _find_poles(tip)
    assert poles is not None
    return poles


@pytest.mark.parametrize("sense", ["down", "up"])
@pytest.mark.parametrize(
    ("radial_depth", "helix", "teeth"),
    [(0.001, 0.0, 2), (0.001, 0.5, 4), (0.01, -0.5, 3), (0.02, 0.0, 2), (0.02, 0.3, 3)],
)
def test_multipliers_are_those_of_semi_discretisation(
    radial_depth: float, helix: float, teeth: int, sense: Sense
) -> None:
    tip = tip_of(PUBLISHED)
    mill = EndMill(0.02, teeth, helix)
    cut = MillingCut(mill, CHIP, 700.0, 2e-3, radial_depth, slices=60, sense=sense)
    expected = largest_multiplier(tip, milling_gains(cut, 200), cut.tooth_period)
    found = PeriodicCut(poles_of(tip), cut).largest(cut.axial_depth)
    assert abs(found.value) == approx(expected, rel=1e-3)


def test_windows_are_where_a_tooth_cuts() -> None:
    draw = np.random.default_rng(0)
    tried = 0
    for _ in range(60):
        mill = EndMill(0.02, int(draw.integers(1, 7)), float(draw.choice([0.0, 0.3, -0.4, 1.2])))
        sense: Sense = "up" if draw.random() < 0.5 else "down"
        radial_depth, depth = draw.uniform(5e-4, 0.02), 10.0 ** draw.uniform(-5.0, -1.5)
        cut = MillingCut(mill, CHIP, draw.uniform(50.0, 3000.0), 0.0, radial_depth, sense=sense)
        start, windows = divide_period(cut, depth, 500.0)
        times = draw.uniform(0.0, cut.tooth_period, 40)
        cuts = np.abs(chip_stiffness(cut, start + times, depth)).max(axis=(1, 2))
        inside = np.array([any(w.begin < time < w.end for w in windows) for time in times])
        assert ((cuts > 1e-9 * depth * 6e8) == inside).all()
        tried += len(times)
    assert tried == 2400


def test_poles_that_matter_and_dominant_multipliers_are_all_there_is() -> None:
    """Thirty modes of which few matter, against exponentials of all states and all eigenvalues."""
    tip = machine_tip(30)
    stable = []
    for radial_depth, helix, teeth, speed in (
        (0.001, 0.0, 2, 500.0),
        (0.012, 0.5, 4, 320.0),
        (0.02, 0.0, 4, 700.0),
    ):
        for depth in (0.3e-3, 3e-3, 20e-3):
            mill = EndMill(0.02, teeth, helix)
            cut = MillingCut(mill, CHIP, speed, depth, radial_depth, slices=40)
            slow = largest_multiplier(tip, milling_gains(cut, 110), cut.tooth_period)
            fast = abs(PeriodicCut(poles_of(tip), cut).largest(depth, 3).value)
            assert fast == approx(slow, rel=4e-3), cut
            stable.append(slow < 1.0)
    assert 0 < sum(stable) < len(stable)


def test_the_dominant_eigenvalue_is_the_largest_of_all() -> None:
    draw = np.random.default_rng(3)
    matrix = draw.standard_normal((90, 90)) / 12.0
    value, vector = _dominant_pair(np.asarray(matrix))
    assert abs(value) == approx(np.abs(np.linalg.eigvals(matrix)).max(), rel=1e-4)
    np.testing.assert_allclose(matrix @ vector, value * vector, atol=1e-3)


def test_a_mode_that_moves_at_once_cannot_chatter_and_keeps_its_flexibility() -> None:
    slow, fast = PUBLISHED[0], (9000.0, 0.02, 4e8)
    both = poles_of(tip_of((slow, fast)))
    settled = settle_fastest(both, 1)
    assert len(settled.values) == 1
    assert settled.static[1, 1] == approx(1.0 / fast[2], rel=1e-6)
    cut = MillingCut(EndMill(0.02, 3), CHIP, 700.0, 0.0, 0.02)
    near, whole = (abs(PeriodicCut(tip, cut).largest(1e-3, 3).value) for tip in (settled, both))
    assert near == approx(whole, rel=5e-3)


def border_of(
    tip: TipDynamics, mill: EndMill, radial_depth: float, rpm: FloatArray, deepest: float
) -> list[Limit]:
    poles = poles_of(tip)
    cuts = [
        PeriodicCut(poles, MillingCut(mill, CHIP, speed * TURN / 60.0, 0.0, radial_depth))
        for speed in rpm
    ]
    safe = safe_depth(poles, cuts[0].cut)
    return find_border(cuts, np.full(len(rpm), np.nan), safe=safe, deepest=deepest)


def test_zeroth_order_is_exact_where_the_engagement_is_constant() -> None:
    """Four teeth in a full slot cut the same at every angle: a = 1 / (2 A Re G) of one mode."""
    _, zeta, stiffness = ONE_MODE[0]
    mill = EndMill(0.02, 4)
    found = border_of(
        tip_of(ONE_MODE), mill, 0.02, np.linspace(3000.0, 3700.0, 71, dtype=np.float64), 0.05
    )
    # the mean of a full slot: half of the radial coefficient of each tooth in the cut
    lowest = 2.0 * stiffness * zeta * (1.0 + zeta) / (0.5 * CHIP.chip[1] * mill.teeth * 0.5)
    depths = np.array([limit.depth for limit in found])
    assert (depths > 0.999 * lowest).all()
    assert depths.min() == approx(lowest, rel=0.02)


def test_flip_lobes_of_a_low_immersion_are_where_theory_has_them() -> None:
    """Near half the tooth frequency the multiplier that leaves the circle is -1 (Davies et al. 2002)."""
    mill = EndMill(0.02, 2)
    rpm = 60.0 * 2.0 * 0.98 * 922.0 / mill.teeth
    (limit,) = border_of(tip_of(ONE_MODE), mill, 0.001, np.array([rpm]), 0.05)
    assert limit.omega == approx(TURN * rpm * mill.teeth / 120.0, rel=1e-6)
    cut = MillingCut(mill, CHIP, rpm * TURN / 60.0, 0.0, 0.001)
    largest = PeriodicCut(poles_of(tip_of(ONE_MODE)), cut).largest(limit.depth, 3)
    assert abs(largest.value + 1.0) < 1e-3


@pytest.mark.parametrize("radial_depth", [0.001, 0.01, 0.02])
def test_below_the_safe_depth_nothing_chatters_and_the_search_begins_there(
    radial_depth: float,
) -> None:
    poles = poles_of(tip_of(PUBLISHED))
    cut = MillingCut(EndMill(0.02, 3, 0.4), CHIP, 500.0, 0.0, radial_depth)
    safe = safe_depth(poles, cut)
    sizes = [
        abs(PeriodicCut(poles, dataclasses.replace(cut, spindle=speed)).largest(safe).value)
        for speed in np.linspace(150.0, 1500.0, 12)
    ]
    assert max(sizes) < 1.0


@dataclasses.dataclass
class Grown:
    """A cut whose growth over the depth is known."""

    cut: MillingCut
    grow: "object"
    tried: list[float]

    def largest(self, depth: float, more: int = 0) -> Multiplier:
        self.tried.append(depth)
        assert callable(self.grow)
        return Multiplier(complex(math.exp(self.grow(depth))), 0)

    def frequency(self, multiplier: Multiplier) -> float:
        return 1000.0

    def waves(self, depth: float) -> float:
        return 1.0

    def rows(self, depth: float) -> int:
        return 9


def limit_of(grow: object, *, expected: float = math.nan) -> tuple[Limit, list[float]]:
    cut = Grown(MillingCut(EndMill(0.02, 2), CHIP, 700.0, 0.0, 0.01), grow, [])
    (limit,) = find_border([cut], np.array([expected]), safe=1e-4, deepest=0.02)  # type: ignore[list-item]
    return limit, cut.tried


def test_a_border_is_found_by_few_secants_though_another_multiplier_is_larger_below_it() -> None:
    """The largest multiplier stays what it is up to a depth, then grows nearly as a line."""

    def grow(depth: float) -> float:
        ratio = depth / 1.07e-3
        return max(-7e-4, 0.02 * (ratio - 1.0) + 0.01 * (ratio - 1.0) ** 2)

    limit, tried = limit_of(grow, expected=1.05e-3)
    assert limit.depth == approx(1.07e-3, rel=1e-4)
    assert abs(limit.depth - 1.07e-3) < limit.error < 3e-6
    assert len(tried) < 36


def test_an_island_below_the_border_is_the_limit() -> None:
    def grow(depth: float) -> float:
        island = 0.05 - 10.0 * math.log(depth / 0.7e-3) ** 2
        return max(island, 0.02 * (depth / 2e-3 - 1.0))

    limit, _ = limit_of(grow)
    assert limit.depth == approx(0.7e-3 * math.exp(-math.sqrt(0.05 / 10.0)), rel=1e-3)


def test_no_limit_up_to_the_deepest_cut_is_none() -> None:
    limit, tried = limit_of(lambda depth: -0.1)
    assert not limit.limited and limit.depth == 0.02
    assert max(tried) == 0.02


def test_an_island_of_one_speed_is_followed_to_its_neighbours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A thin island that only the depths of the last speed meet."""
    monkeypatch.setattr(border, "STAGGER", (0.5, 0.5, 0.0))
    monkeypatch.setattr(border, "ISLANDS", ())

    island = 0.99e-4 * border.DENSE_FACTOR**4

    def grow(depth: float) -> float:
        return 0.02 if island < depth < 1.02 * island or depth > 2e-3 else -0.02

    cuts = [
        Grown(MillingCut(EndMill(0.02, 2), CHIP, speed, 0.0, 0.01), grow, [])
        for speed in (700.0, 710.0, 720.0)
    ]
    found = find_border(cuts, np.full(3, math.nan), safe=1e-4, deepest=0.02)  # type: ignore[arg-type]
    assert [limit.depth for limit in found] == approx([island] * 3, rel=1e-3)


def test_a_dense_border_takes_few_multipliers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits are confirmed between those on either side, and islands looked for on the way there."""
    tried: list[float] = []
    largest = PeriodicCut.largest

    def count(cut: PeriodicCut, depth: float, more: int = 0) -> Multiplier:
        tried.append(depth)
        return largest(cut, depth, more)

    monkeypatch.setattr(PeriodicCut, "largest", count)
    rpm = np.linspace(9000.0, 11000.0, 160, dtype=np.float64)
    found = border_of(tip_of(PUBLISHED), EndMill(0.02, 3, 0.4), 0.012, rpm, 0.05)
    assert all(limit.limited and limit.error < 1.1e-3 * limit.depth for limit in found)
    assert len(tried) < 10 * len(rpm)


@pytest.mark.parametrize("helix", [0.0, 0.4])
def test_more_nodes_change_no_multiplier_of_a_fast_pole(helix: float) -> None:
    """Long windows with many waves, several of them in a row, against twice as many nodes."""
    tip = poles_of(tip_of((PUBLISHED[0], (9000.0, 0.02, 2e7))))
    cut = PeriodicCut(tip, MillingCut(EndMill(0.02, 2, helix), CHIP, 300.0, 0.0, 0.015))
    few, many = (abs(cut.largest(1.5e-3, more).value) for more in (0, 25))
    assert cut.rows(1.5e-3) > 150
    assert few == approx(many, rel=2e-4)
