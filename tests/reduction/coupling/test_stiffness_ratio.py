"""bolts up to 1e14 times as stiff as air springs cost the lowest frequency no digit, and
absurd ratios are warned of.
"""

import decimal
import math
from decimal import Decimal

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.machine.machine import Machine, Pose, orient_machine
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body

pytestmark = pytest.mark.hard("H01")

AIR = 1.0e3
HOME = Pose("home")
TURNED = Frame(np.array([0.3, -0.2, 0.5]), rotation_about(np.array([1.0, 2.0, -1.5]), 0.7))


def two_masses(ratio: float) -> tuple[dict[str, Superelement], Machine]:
    """Two bodies on a line: air spring to ground, bolt between; only z can move."""
    bodies = [
        rigid_body("low", 100.0, {"a": (0, 0, 0), "b": (0, 0, 0)}),
        rigid_body("high", 50.0, {"a": (0, 0, 0)}),
    ]
    fixed = (0, 1, 3, 4, 5)
    joints = [
        joint_between("air", "ground", "low.a", stiffness=(0, 0, AIR, 0, 0, 0), fixed=fixed),
        joint_between(
            "bolt", "low.b", "high.a", stiffness=(0, 0, ratio * AIR, 0, 0, 0), fixed=fixed
        ),
    ]
    return lumped_machine(bodies, joints, {"tcp": ("high.a", "ground")})


def exact_two_masses(ratio: float) -> list[float]:
    """Both frequencies [Hz] from the characteristic polynomial with 60 digits."""
    with decimal.localcontext(prec=60):
        k, bolt, m, n = Decimal(AIR), Decimal(ratio) * Decimal(AIR), Decimal(100), Decimal(50)
        p = (k + bolt) / m + bolt / n
        root = (p**2 - 4 * k * bolt / (m * n)).sqrt()
        return [float((value / 2).sqrt()) / (2.0 * math.pi) for value in (p - root, p + root)]


def machine_on_air(ratio: float) -> tuple[dict[str, Superelement], Machine]:
    """A block on four air springs that carries a second block on four corner bolts: stiff loops,
    six soft modes.
    """
    corners = {
        f"c{i}": (x, y, 0.3)
        for i, (x, y) in enumerate([(-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4)])
    }
    base = rigid_body("base", 230.0, corners, inertia=(14.0, 21.0, 31.4), center=(0.0, 0.0, 0.15))
    top = rigid_body("top", 60.0, corners, inertia=(2.0, 3.0, 4.0), center=(0.1, 0.0, 0.5))
    joints = [
        joint_between(
            f"air{i}",
            "ground",
            f"base.c{i}",
            stiffness=(1.2e4, 1.2e4, 1.8e4, 0, 0, 0),
            point=(x, y, 0.0),
        )
        for i, (x, y, _) in enumerate(corners.values())
    ]
    bolt = 1.2e4 * ratio
    joints += [
        joint_between(
            f"bolt{i}", f"base.c{i}", f"top.c{i}", stiffness=(bolt, bolt, 2 * bolt, 0, 0, 0)
        )
        for i in range(4)
    ]
    return lumped_machine([base, top], joints, {"tcp": ("top.c0", "ground")})


def frequencies(
    parts: tuple[dict[str, Superelement], Machine], *, frame: Frame | None = None
) -> FloatArray:
    superelements, machine = parts
    coupled = couple(
        superelements, machine if frame is None else orient_machine(machine, frame), HOME
    )
    return solve_modal(coupled.system).frequencies_hz


@pytest.mark.parametrize("exponent", range(15))
def test_both_frequencies_of_two_masses_are_exact_for_every_ratio(exponent: int) -> None:
    np.testing.assert_allclose(
        frequencies(two_masses(10.0**exponent)), exact_two_masses(10.0**exponent), rtol=1e-12
    )


@pytest.mark.parametrize("exponent", range(6, 15))
def test_soft_modes_of_a_machine_tend_to_those_with_rigid_bolts_and_lose_no_digits(
    exponent: int,
) -> None:
    rigid = frequencies(machine_on_air(1e15))[:6]
    found = frequencies(machine_on_air(10.0**exponent))[:6]
    # a bolt R times stiffer than the springs changes f by at most 1/R
    np.testing.assert_allclose(found, rigid, rtol=2.0 * 10.0**-exponent + 1e-12)


@pytest.mark.parametrize("exponent", [9, 12, 14])
def test_a_turned_machine_with_stiff_bolts_has_the_same_frequencies(exponent: int) -> None:
    parts = machine_on_air(10.0**exponent)
    np.testing.assert_allclose(frequencies(parts, frame=TURNED), frequencies(parts), rtol=1e-10)


def test_a_ratio_above_1e12_is_warned_of_with_joint_and_dof_and_one_of_1e8_is_not() -> None:
    assert couple(*machine_on_air(1e8), HOME).warnings == ()
    warnings = couple(*two_masses(1e13), HOME).warnings
    assert any("bolt, z" in text and "air, z" in text and "units" in text for text in warnings)


def test_the_budget_of_a_stiff_and_a_soft_spring_in_series_is_exact() -> None:
    budget = point_budget(couple(*two_masses(1e12), HOME), "tcp")
    assert budget.compliance[2, 2] == approx(1.0 / AIR * (1.0 + 1e-12), rel=1e-14, abs=0.0)
    assert budget.shares["z"]["bolt"] == approx(1e-12, rel=1e-6, abs=0.0)
