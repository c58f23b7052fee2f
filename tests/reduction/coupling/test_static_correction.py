"""at 0 Hz stands the static compliance, however few modes are kept; the share
that a plain modal sum lacks is reported.
"""

import numpy as np
import pytest

from common import approx, present
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Material
from headstock.reduction.coupling.coupling import couple
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_coordinates import keep_modes, to_modal_coordinates
from headstock.solvers.linear.response_forms import sum_over_modes
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.second_order import SecondOrderSystem, input_columns, output_rows
from headstock.validation.parts.line_elements import TIP, cantilever_system
from headstock.validation.references.beam_theory import PrismaticBeam
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

pytestmark = pytest.mark.hard("H25")

BEAM = PrismaticBeam(1.0, 1.0, 12.0 ** (1.0 / 3.0), Material("unit", 1.0, 0.3, 1.0))
# 12 / lambda^4 with cos cosh = -1, summed
FRACTIONS = (0.970688, 0.995404, 0.998556, 0.999377, 0.999678)
VERY_LOW = 1e-9


def a_machine() -> SecondOrderSystem:
    """Bodies on springs between 1e4 and 1e10 N/m, so that frequencies spread over four decades."""
    base = rigid_body("base", 500.0, {"low": (0, 0, 0), "top": (0.1, 0.2, 0.3)})
    column = two_node_body("column", 40.0, 0.8, (2e7, 3e7, 4e8, 5e6, 5e6, 3e6))
    head = rigid_body("head", 12.0, {"seat": (0, 0, 0), "tool": (0.2, 0.0, -0.1)})
    joints = [
        joint_between("mounts", "ground", "base.low", stiffness=(1e4, 1e4, 3e4, 2e3, 2e3, 1e3)),
        joint_between(
            "bolts", "base.top", "column.foot", stiffness=(1e10, 1e10, 1e10, 1e8, 1e8, 1e8)
        ),
        joint_between(
            "guide", "column.head", "head.seat", stiffness=(5e7, 5e7, 8e7, 1e5, 2e5, 1e5)
        ),
    ]
    return couple(
        *lumped_machine([base, column, head], joints, {"tcp": ("head.tool", "base.top")}),
        Pose("home"),
    ).system


@pytest.mark.parametrize("count", range(1, 6))
def test_the_plain_sum_of_a_beam_misses_what_theory_says_and_the_corrected_one_nothing(
    count: int,
) -> None:
    coordinates = present(to_modal_coordinates(cantilever_system(BEAM, 60), [TIP], [TIP]))
    kept = keep_modes(coordinates, count)
    assert kept.elastic[0, 0] == approx(1.0 / 3.0, rel=1e-9)
    assert 1.0 - kept.residual[0, 0] / kept.elastic[0, 0] == approx(FRACTIONS[count - 1], abs=1e-6)
    at_rest = sum_over_modes(kept).evaluate(np.array([VERY_LOW]))[0, 0, 0]
    assert at_rest == approx(1.0 / 3.0, rel=1e-9)


def test_the_correction_makes_the_kept_range_right_too() -> None:
    system = cantilever_system(BEAM, 60)
    coordinates = present(to_modal_coordinates(system, [TIP], [TIP]))
    omega = 0.5 * coordinates.omega[1] * np.ones(1)
    exact = sum_over_modes(coordinates).evaluate(omega)[0, 0, 0].real
    corrected = sum_over_modes(keep_modes(coordinates, 2)).evaluate(omega)[0, 0, 0].real
    plain = corrected - keep_modes(coordinates, 2).residual[0, 0]
    assert abs(corrected / exact - 1.0) < 0.05 * abs(plain / exact - 1.0)


def test_the_response_of_a_machine_at_rest_is_its_static_compliance() -> None:
    system = a_machine()
    channels = [("tcp", dof) for dof in ("x", "y", "z", "rx", "ry", "rz")]
    static = (
        output_rows(system, channels)
        @ solve_static(system, input_columns(system, channels)).displacements
    )
    for damped in (system, add_modal_damping(system, [0.03])):
        found = solve_frf(
            damped, np.array([0.0, 1e-7]), inputs=channels, outputs=channels
        ).receptance
        np.testing.assert_array_equal(found[0], static)
        np.testing.assert_allclose(
            found[1].real, static, rtol=1e-8, atol=1e-8 * np.abs(static).max()
        )
