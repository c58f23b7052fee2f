"""Compliance, its budget, and what doubling a stiffness changes, against springs in series."""

import dataclasses

import numpy as np
import pytest

from common import approx, present
from headstock.geometry.frames import DOF_NAMES, Frame
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.compliance_budget import (
    energy_shares,
    find_weakest_link,
    point_budget,
)
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

HOME = Pose("home")
FOOT = np.array([2e7, 3e7, 5e7, 1e6, 2e6, 3e6])
NECK = np.array([4e7, 1e7, 2e7, 3e6, 1e6, 2e6])
COLUMN = np.array([1e8, 2e8, 5e8, 2e6, 3e6, 1e6])
LENGTH = 0.5


@pytest.fixture
def series() -> tuple[dict[str, Superelement], Machine]:
    """Foot spring, sprung column, neck spring and a rigid head, all on one vertical line; the tool
    at the neck.
    """
    column = two_node_body("column", 40.0, LENGTH, COLUMN)
    head = rigid_body(
        "head", 12.0, {"seat": (0, 0, LENGTH), "tool": (0, 0, LENGTH)}, center=(0.1, 0.05, 0.6)
    )
    joints = [
        joint_between("foot", "ground", "column.foot", stiffness=FOOT),
        joint_between("neck", "column.head", "head.seat", stiffness=NECK),
    ]
    return lumped_machine([column, head], joints, {"tcp": ("head.tool", "ground")})


def by_hand() -> dict[str, dict[str, float]]:
    """Compliance at the tool of each part: its own spring plus its rotation times the lever
    squared.
    """
    x = {
        "foot": 1 / FOOT[0] + LENGTH**2 / FOOT[4], "column": 1 / COLUMN[0] + (LENGTH / 2) ** 2 / COLUMN[4], "neck": 1 / NECK[0],
    }  # fmt: skip
    z = {"foot": 1 / FOOT[2], "column": 1 / COLUMN[2], "neck": 1 / NECK[2]}
    return {"x": x, "z": z}


@pytest.mark.parametrize("direction", ["x", "z"])
def test_compliance_and_shares_are_those_of_springs_in_series(
    series: tuple[dict[str, Superelement], Machine], direction: str
) -> None:
    budget, parts = point_budget(couple(*series, HOME), "tcp"), by_hand()[direction]
    axis = DOF_NAMES.index(direction)
    assert budget.compliance[axis, axis] == approx(sum(parts.values()), rel=1e-12)
    shares = budget.shares[direction]
    assert shares == approx(
        {name: value / sum(parts.values()) for name, value in parts.items()}, rel=1e-10
    )
    assert sum(shares.values()) == approx(1.0, abs=1e-9)


def test_the_weakest_link_and_the_gain_of_doubling_it_are_exact(
    series: tuple[dict[str, Superelement], Machine],
) -> None:
    link = present(find_weakest_link(couple(*series, HOME), "tcp", "x"))
    parts = by_hand()["x"]
    assert link.name == "foot"
    assert link.share == approx(parts["foot"] / sum(parts.values()), rel=1e-10)
    assert link.change == approx(-0.5 * link.share, rel=1e-8)
    assert "foot contributes 76 %" in str(link) and "x compliance" in str(link)


def test_doubling_a_component_is_recomputed_too(
    series: tuple[dict[str, Superelement], Machine],
) -> None:
    superelements, machine = series
    soft = dataclasses.replace(
        superelements["column"], stiffness=1e-2 * superelements["column"].stiffness
    )
    link = present(
        find_weakest_link(couple(superelements | {"column": soft}, machine, HOME), "tcp", "z")
    )
    assert link.name == "column" and link.change == approx(-0.5 * link.share, rel=1e-8)


def test_a_direction_in_which_nothing_gives_has_no_shares_and_no_weakest_link() -> None:
    body = rigid_body("body", 5.0, {"foot": (0, 0, 0)})
    joint = joint_between(
        "foot", "ground", "body.foot", stiffness=(1e6, 1e6, 0, 1e4, 1e4, 1e4), fixed=(2,)
    )
    coupled = couple(*lumped_machine([body], [joint], {"tcp": ("body.foot", "ground")}), HOME)
    assert point_budget(coupled, "tcp").shares["z"] == {}
    assert find_weakest_link(coupled, "tcp", "z") is None
    assert point_budget(coupled, "tcp").shares["x"] == approx({"foot": 1.0}, abs=1e-12)


def test_strain_and_kinetic_shares_of_modes_sum_to_one(
    series: tuple[dict[str, Superelement], Machine],
) -> None:
    coupled = couple(*series, HOME)
    modal = solve_modal(coupled.system)
    for shares in energy_shares(coupled, modal.shapes):
        np.testing.assert_allclose([sum(share.values()) for share in shares], 1.0, atol=1e-12)
    strain, kinetic = energy_shares(coupled, modal.shapes)
    assert set(strain[0]) == {"column", "foot", "neck"} and set(kinetic[0]) == {"column", "head"}


def test_an_unknown_point_is_refused_with_the_known_ones(
    series: tuple[dict[str, Superelement], Machine],
) -> None:
    with pytest.raises(ModelError, match=r"no point 'tpc'.*'tcp'"):
        point_budget(couple(*series, HOME), "tpc")


@pytest.mark.parametrize("count", [10, 120])
def test_the_budget_of_a_long_slender_machine_is_not_refused_for_what_rounding_leaves(
    count: int,
) -> None:
    """Equal short bodies one above the other, clamped together: the tip moves ten thousand times as
    far as a body is bent.
    """
    height, stiff = 0.04, np.array([1e12, 1e12, 1e12, 2e6, 3e6, 1e6])
    bodies = [
        two_node_body(
            f"body_{i}", 0.5, height, stiff, placement=Frame(np.array([0.0, 0.0, height * i]))
        )
        for i in range(count)
    ]
    joints = [joint_between("clamp_0", "ground", "body_0.foot", fixed=range(6))]
    joints += [
        joint_between(f"clamp_{i}", f"body_{i - 1}.head", f"body_{i}.foot", fixed=range(6))
        for i in range(1, count)
    ]
    coupled = couple(
        *lumped_machine(bodies, joints, {"tcp": (f"body_{count - 1}.head", "ground")}), HOME
    )
    budget = point_budget(coupled, "tcp")
    levers = height * (count - 0.5 - np.arange(count))
    expected = (1.0 / stiff[0] + levers**2 / stiff[4]).sum()
    assert budget.compliance[0, 0] == approx(expected, rel=1e-6)
    assert sum(budget.shares["x"].values()) == approx(1.0, abs=1e-6)
