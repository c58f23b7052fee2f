"""a load that grows slowly moves a machine along its static path."""

from collections.abc import Callable

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.state_spaces.state_space import to_state_space
from headstock.solvers.state_spaces.time_response import solve_time_response
from headstock.validation.parts.line_elements import TIP, cantilever_system
from headstock.validation.references.beam_theory import PrismaticBeam

pytestmark = pytest.mark.hard("H33")

BEAM = PrismaticBeam(0.5, 0.1, 0.038, Material("steel", 210e9, 0.3, 7850.0))


STATIC = BEAM.length**3 / (3.0 * BEAM.bending_stiffness)


def deviation(
    shape: Callable[[FloatArray], FloatArray], periods: int, zeta: float, steps_per_period: float
) -> float:
    """Largest distance from the static path over the final static deflection."""
    system = cantilever_system(BEAM, 12)
    period = 1.0 / solve_modal(system).frequencies_hz[0]
    space = to_state_space(add_modal_damping(system, [zeta]), inputs=[TIP], outputs=[TIP])
    share = shape(np.linspace(0.0, 1.0, round(periods * steps_per_period) + 1, dtype=np.float64))
    found = solve_time_response(space, share[:, None], period / steps_per_period).outputs[:, 0]
    return float(np.abs(found / STATIC - share).max())


def soft_ramp(s: FloatArray) -> FloatArray:
    return 0.5 - 0.5 * np.cos(np.pi * s)


@pytest.mark.parametrize(("periods", "tolerance"), [(100, 1e-3), (1000, 1e-4)])
@pytest.mark.parametrize("zeta", [0.0, 0.02])
@pytest.mark.parametrize("steps_per_period", [7.3, 2.31])
def test_a_slow_ramp_is_the_static_path(
    periods: int, tolerance: float, zeta: float, steps_per_period: float
) -> None:
    assert deviation(soft_ramp, periods, zeta, steps_per_period) < tolerance


@pytest.mark.parametrize("periods", [100, 1000])
def test_a_ramp_with_a_corner_rings_as_much_as_a_corner_must(periods: int) -> None:
    # one mass: sin(omega t) / (omega T); the first mode has 97 % of the tip's compliance
    assert deviation(lambda s: s, periods, 0.0, 24.7) == approx(
        0.971 / (2.0 * np.pi * periods), rel=0.02
    )
