"""Bodies that turn on their way: gyroscopic coupling comes out of modes carried with the matter."""

import dataclasses
import math

import numpy as np
import pytest
import scipy
from scipy.integrate import solve_ivp

from headstock.geometry.frames import FloatArray, rotation_about
from headstock.reduction.coupling.path_loads import (
    TurningBody,
    bound_gyroscopic_shift,
    turn_with_bodies,
)
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.motion.alpha import integrate_linear
from headstock.solvers.motion.plant import PlantChannels, PosedModes
from headstock.solvers.motion.plant_motion import TrajectoryLoads, follow_motion
from headstock.solvers.motion.sampling import sample_motion
from headstock.solvers.second_order import Channel, SecondOrderSystem

ACROSS, AXIAL = 0.8, 1.2  # moments of inertia of the rotor [kg m^2]
OMEGA = 2.0 * math.pi * 30.0  # of its tilting on springs [rad/s]
SPIN = 0.04 * OMEGA  # it whirls by 0.03 of that to and fro
REACH, WHOLE = 0.5, 0.2  # of its tip [m], seconds
TIP = tuple(("tip", dof) for dof in "xyz")
WEIGHT: Channel = ("gravity", "load")


def place_rotor(angle: float, *, turns: bool) -> PosedModes:
    """A rotor about z that tilts about x and y, its dofs in fixed axes."""
    tilt = np.zeros((6, 2))
    tilt[3, 0] = tilt[4, 1] = 1.0
    rows: dict[Channel, FloatArray] = {
        TIP[0]: np.array([0.0, REACH]),
        TIP[1]: np.array([-REACH, 0.0]),
        TIP[2]: np.zeros(2),
    }
    mass = ACROSS * np.eye(2)
    system = SecondOrderSystem(
        mass, None, OMEGA**2 * mass, rows | {WEIGHT: np.zeros(2)}, rows, ("rx", "ry")
    )
    modes = solve_modal(system)
    whole = np.diag([1.0, 1.0, 1.0, ACROSS, ACROSS, AXIAL])
    motions = tilt @ modes.shapes
    posed = PosedModes(system, modes, motions, whole @ motions)
    body = TurningBody(
        rows=slice(0, 6),
        travel=np.eye(6),
        mass=whole,
        rotation=rotation_about(np.array([0.0, 0.0, 1.0]), angle),
        kilograms=1.0,
        inertia=np.diag([ACROSS, ACROSS, AXIAL]),
    )
    return turn_with_bodies(posed, [body]) if turns else posed


def push(times: FloatArray | float) -> FloatArray:
    """Force on the tip along x [N]."""
    return np.asarray(
        np.where(np.asarray(times) < 0.02, np.sin(math.pi * np.asarray(times) / 0.02), 0.0)
    )


def whirl(*, turns: bool) -> FloatArray:
    """Motion of the tip ``(n, 2)`` by steps along the way that spinning is."""
    times: FloatArray = np.asarray(np.arange(0.0, WHOLE, 2e-4), dtype=float)
    channels = PlantChannels((*TIP, WEIGHT), TIP, up_to_hz=500.0)
    sampled = sample_motion(
        lambda angle: place_rotor(angle, turns=turns), [0.0, SPIN * WHOLE], channels
    )
    sampled = dataclasses.replace(sampled, along=lambda now: SPIN * now)
    loads = TrajectoryLoads((WEIGHT,), lambda now: np.ones((len(now), 1)), WEIGHT)
    motion = follow_motion(sampled, times, loads, TIP, node_spacing=2e-3)
    force = np.zeros((len(times), 3))
    force[:, 0] = push(times)
    history = integrate_linear(motion, motion.load + motion.tool_load(force))
    return motion.tool_motion(history.compliant)[:, :2]


def test_a_spinning_rotor_whirls_as_its_gyroscopic_equations_say() -> None:
    def rate(time: float, state: FloatArray) -> FloatArray:
        tilt, speed = state[:2], state[2:]
        moment = np.array([0.0, REACH * float(push(time))]) - ACROSS * OMEGA**2 * tilt
        moment += AXIAL * SPIN * np.array([-speed[1], speed[0]])
        return np.concatenate([speed, moment / ACROSS])

    times: FloatArray = np.asarray(np.arange(0.0, WHOLE, 2e-4), dtype=float)
    found = solve_ivp(
        rate, (0.0, WHOLE), np.zeros(4), t_eval=times, rtol=1e-8, atol=1e-14, max_step=1e-3
    )
    exact = REACH * np.stack([found.y[1], -found.y[0]], axis=1)
    size = np.abs(exact).max()
    # terms with the square of the spin are left out: (0.03)^2 / 2 of an angle, over 38 rad
    assert np.abs(whirl(turns=True) - exact).max() < 2e-2 * size
    assert np.abs(whirl(turns=False) - exact).max() > 0.5 * size


@pytest.mark.parametrize("lean", [1.0, 1.5])
def test_a_chain_on_a_spinning_hub_is_split_no_further_than_the_bound_which_twins_reach(
    lean: float,
) -> None:
    """Masses on springs along the axis of spin, as stiff across it in x as in y or stiffer there;
    exact: their equations of motion in axes that turn.
    """
    count, kilograms, hub, spin = 4, 2.0, 1e10, 3.0
    chain = 4e5 * (2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    stiffness = np.kron(chain, np.diag([1.0, lean]))
    mass = kilograms * np.eye(2 * count)
    system = SecondOrderSystem(
        mass, None, stiffness, {}, {}, tuple(f"q{k}" for k in range(2 * count))
    )
    modes = solve_modal(system)
    # six dofs of the hub, which stands still, and two of each mass
    whole = np.diag([hub] * 6 + [kilograms] * (2 * count))
    motions = np.vstack([np.zeros((6, 2 * count)), modes.shapes])
    heights = np.arange(1, count + 1)
    travel = np.zeros((6 + 2 * count, 6))
    travel[:6] = np.eye(6)
    travel[6::2, 0] = travel[7::2, 1] = 1.0
    travel[6::2, 4], travel[7::2, 3] = heights, -heights
    body = TurningBody(
        slice(0, len(whole)), travel, whole, np.eye(3), hub + kilograms * count, hub * np.eye(3)
    )
    bound = bound_gyroscopic_shift(
        PosedModes(system, modes, motions, whole @ motions), [body], [spin]
    )
    turning = 2.0 * spin * kilograms * np.kron(np.eye(count), [[0.0, -1.0], [1.0, 0.0]])
    softened = stiffness - spin**2 * mass
    first_order = np.block(
        [[np.zeros_like(mass), np.eye(2 * count)], [-softened / kilograms, -turning / kilograms]]
    )
    exact = np.sort(np.abs(scipy.linalg.eigvals(first_order).imag))[::2]
    omega = 2.0 * np.pi * modes.frequencies_hz
    shift = float((np.abs(exact - omega) / omega).max())
    assert shift < bound
    assert (bound < 1.001 * shift) == (lean == 1.0)
