"""A machine sampled along its way, against its exact response in poses between the samples."""

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.motion.plant import PlantChannels, PosedModes
from headstock.solvers.motion.sampling import ANCHORED, MISS_TOLERANCE, sample_motion, vary_motion
from headstock.solvers.second_order import Channel, SecondOrderSystem

TOOL: tuple[Channel, ...] = (("tcp", "x"), ("tcp", "y"), ("tcp", "z"))
KEPT_HZ = 1000.0
SIZE = 12


def place_crossing(time: float, softer: float = 0.0) -> PosedModes:
    """Masses on a lattice of springs; with time half its modes rise and half fall, through each
    other and through the highest frequency that is kept, and a weak spring makes them avoid it.

    A softer machine lacks a share of the stiffness against one motion, and has a further dof.
    """
    way = np.linspace(0.0, 1.0, SIZE)
    hz = np.where(
        np.arange(SIZE) % 2,
        300.0 + 1100.0 * way + 250.0 * time,
        500.0 + 1300.0 * way - 250.0 * time,
    )
    weak = 0.01 * (2.0 * np.pi * 800.0) ** 2 * (np.eye(SIZE, k=1) + np.eye(SIZE, k=-1))
    stiffness = np.diag((2.0 * np.pi * hz) ** 2) + weak
    mass = np.eye(SIZE)
    rows = np.random.default_rng(7).standard_normal((3, SIZE))
    damping = 0.04 * np.diag(2.0 * np.pi * hz)
    if softer:
        lost = stiffness @ np.cos(np.arange(SIZE))
        size = softer / float(np.cos(np.arange(SIZE)) @ lost)
        stiffness = np.pad(stiffness - size * np.outer(lost, lost), (0, 1))
        mass, damping, rows = (
            np.eye(SIZE + 1),
            np.pad(damping, (0, 1)),
            np.pad(rows, ((0, 0), (0, 1))),
        )
        stiffness[-1, -1] = (2.0 * np.pi * 4000.0) ** 2
        mass[-1, :-1] = mass[:-1, -1] = 0.2 * np.sin(np.arange(SIZE))
    channels = {channel: rows[number] for number, channel in enumerate(TOOL)}
    system = SecondOrderSystem(
        mass, damping, stiffness, channels, channels, tuple("abcdefghijklm"[: len(mass)])
    )
    modes = solve_modal(system)
    return PosedModes(system, modes, modes.shapes, mass @ modes.shapes)


def full_receptance(time: float, hz: float, softer: float = 0.0) -> FloatArray:
    system = place_crossing(time, softer).system
    assert system.damping is not None
    omega, rows = 2.0 * np.pi * hz, np.array([system.outputs[channel] for channel in TOOL])
    dynamic = system.stiffness + 1j * omega * system.damping - omega**2 * system.mass
    return np.asarray(rows @ np.linalg.solve(dynamic, rows.T))


def test_modes_that_cross_the_highest_frequency_fade_without_a_jump() -> None:
    sampled = sample_motion(place_crossing, [0.0, 1.0], PlantChannels(TOOL, TOOL, KEPT_HZ))
    assert sampled.poses < 100
    times: FloatArray = np.asarray(np.linspace(0.013, 0.987, 75), dtype=float)
    found = sampled.at(times)
    unit, missed = np.eye(sampled.modes), {0.0: 0.0, 250.0: 0.0}
    for hz in missed:
        omega = 2.0 * np.pi * hz
        for number, time in enumerate(times):
            dynamic = found.stiffness[number] + 1j * omega * found.damping[number] - omega**2 * unit
            mine = found.rows[number] @ np.linalg.solve(dynamic, found.loads[number])
            exact = full_receptance(float(time), hz)
            off = np.abs(mine + found.direct[number] - exact).max() / np.abs(exact).max()
            missed[hz] = max(missed[hz], float(off))
    # every mode is there statically, wherever it is on its way out
    assert missed[0.0] < MISS_TOLERANCE
    # a mode above 1 kHz that follows at once misses (f / 1 kHz)^2 of its own share at most
    assert missed[250.0] < (250.0 / KEPT_HZ) ** 2


def test_what_a_softer_machine_moves_more_is_found_in_a_few_poses() -> None:
    softer, channels = 0.04, PlantChannels(TOOL, TOOL, KEPT_HZ)
    base = sample_motion(place_crossing, [0.0, 1.0], channels)
    found = vary_motion(
        base, lambda time: place_crossing(time, softer), channels, np.arange(SIZE, dtype=np.intp)
    )
    assert found.poses == ANCHORED + 1 < base.poses / 3
    assert found.modes == base.modes
    times: FloatArray = np.asarray(np.linspace(0.013, 0.987, 75), dtype=float)
    unit = np.eye(base.modes)
    for hz, tolerance in ((0.0, 0.15), (250.0, 0.15)):
        omega, missed, changes = 2.0 * np.pi * hz, [], []
        before, after = base.at(times), found.at(times)
        for number, time in enumerate(times):
            mine = [
                plant.rows[number]
                @ np.linalg.solve(
                    plant.stiffness[number] + 1j * omega * plant.damping[number] - omega**2 * unit,
                    plant.loads[number],
                )
                + plant.direct[number]
                for plant in (before, after)
            ]
            change = full_receptance(float(time), hz, softer) - full_receptance(float(time), hz)
            missed.append(np.abs(mine[1] - mine[0] - change).max())
            changes.append(np.abs(change).max())
        # of what it moves more, anywhere on the way
        assert max(missed) < tolerance * max(changes)


@pytest.mark.parametrize("most", [3000.0, 900.0])
def test_modes_are_counted_while_they_are_kept(most: float) -> None:
    sampled = sample_motion(place_crossing, [0.0, 1.0], PlantChannels(TOOL, TOOL, most))
    assert (sampled.modes == SIZE) == (most == 3000.0)
    assert sampled.highest_hz < 1.25 * most
