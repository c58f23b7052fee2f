"""Measure how much faster than real time an FMU is, from a driver that sets three inputs, steps and gets
three outputs.

    ./headstock exec python3 benchmarks/fmu_speed.py [--states N] [--steps N]

Defaults: 200 states, 5000 steps of 1 ms. Printed are ratios of simulated time to processor time: of
blocks of two states, of one dense block, and of a machine whose axis rests or moves, without and with
1 % damping of the modes of each pose, which couples motions that are the same in all poses.
"""

import argparse
import ctypes
import dataclasses
import io
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np

from headstock.geometry.machine.machine import Pose
from headstock.pipeline.exchange.fmu_numbers import fixed_model, varying_model
from headstock.pipeline.exchange.fmus import FmuModel, encode_fmu
from headstock.pipeline.exchange.state_spaces import describe_space
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace, to_first_order
from headstock.solvers.state_spaces.varying_matrices import (
    FASTEST,
    Field,
    Knots,
    PosedMatrices,
    VaryingMatrices,
    VaryingSpring,
    lay_field,
    split_patterns,
)

STEP = 1e-3
HIGHEST_HZ = 400.0
CHANNELS = tuple(("tcp", axis) for axis in "xyz")
COUNT = len(CHANNELS)


def make_matrices(modes: int) -> PosedMatrices:
    """Modes up to the highest frequency, each with 2 % damping."""
    random = np.random.default_rng(0)
    omega = 2.0 * np.pi * np.linspace(10.0, HIGHEST_HZ, modes)
    loads = random.standard_normal((modes, COUNT))
    return PosedMatrices(np.diag(omega**2), np.diag(0.04 * omega), loads, loads.T)


def make_varying(modes: int, *, coupled: bool = False) -> VaryingStateSpace:
    """The same with ten springs that slide along an axis.

    Args:
        coupled: Modes of each pose are damped by 1 %, in place of those of the basis.
    """
    random, matrices = np.random.default_rng(1), make_matrices(modes)

    def constant(array: np.ndarray) -> Field:  # type: ignore[type-arg]
        return lay_field([array] * 3, [3], 1)

    springs = tuple(
        VaryingSpring(
            lay_field(list(random.standard_normal((3, 2, modes))), [3], 0),
            constant(1e3 * np.eye(2)),
            constant(np.eye(2)),
        )
        for _ in range(10)
    )
    knots = {"X": Knots(np.array([-0.1, 0.0, 0.1]))}
    varying = VaryingMatrices(
        (knots, knots),
        matrices.stiffness,
        matrices.damping,
        springs,
        np.zeros((0, modes, modes)),
        constant(np.zeros(0)),
        constant(matrices.loads.T),
        constant(matrices.rows),
    )
    if coupled:
        varying = couple_modes(varying)
    # exports have motions as fast as this
    matrices.stiffness[-1, -1] = (2.0 * np.pi * FASTEST * HIGHEST_HZ) ** 2
    rate = 1.1 * 2.0 * np.pi * FASTEST * HIGHEST_HZ
    return VaryingStateSpace(
        varying,
        (CHANNELS, CHANNELS),
        (),
        ("m",),
        {"X": 0.0},
        rate,
        STEP,
        0.0,
        HIGHEST_HZ,
        0.01,
        0,
        0,
    )


def couple_modes(varying: VaryingMatrices) -> VaryingMatrices:
    """Damp the modes at each knot by 1 %, and nothing else."""
    dampings = []
    for positions in varying.grid:
        squares, shapes = np.linalg.eigh(varying.at(positions).stiffness)
        dampings.append((shapes * (0.02 * np.sqrt(squares))) @ shapes.T)
    amounts, patterns = split_patterns(np.array(dampings), np.ones(len(varying.stiffness)))
    springs = (
        dataclasses.replace(spring, damping=lay_field([np.zeros((2, 2))] * 3, [3], 0))
        for spring in varying.springs
    )
    return dataclasses.replace(
        varying,
        damping=np.zeros_like(varying.damping),
        springs=tuple(springs),
        patterns=patterns,
        further=lay_field(list(amounts), [3], 1),
    )


def measure(model: FmuModel, steps: int, travel: float | None = None) -> float:
    """Return simulated over processor time.

    Args:
        travel: Of the axis per step [m]; None without an axis.
    """
    with tempfile.TemporaryDirectory() as folder:
        zipfile.ZipFile(io.BytesIO(encode_fmu(model, 3))).extractall(folder)
        calls = ctypes.CDLL(str(next(Path(folder).glob("binaries/*/*.so"))))
        create = calls.fmi3InstantiateCoSimulation
        create.restype = ctypes.c_void_p
        none, no = ctypes.c_void_p(), (ctypes.c_bool(False),) * 4
        machine = ctypes.c_void_p(
            create(
                b"it", model.token.encode(), b"", *no, none, ctypes.c_size_t(0), none, none, none
            )
        )
        given = COUNT + (travel is not None)
        size = ctypes.c_size_t(given)
        inputs, outputs = (ctypes.c_double * given)(), (ctypes.c_double * COUNT)()
        inputs[:COUNT] = [1.0] * COUNT
        set_at = (ctypes.c_uint * given)(*range(1, 1 + given))
        get_at = (ctypes.c_uint * COUNT)(*range(1 + given, 1 + given + COUNT))
        flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
        last, count = ctypes.byref(ctypes.c_double()), ctypes.c_size_t(COUNT)
        step, refused = ctypes.c_double(STEP), 0
        start = time.process_time()
        for number in range(steps):
            if travel is not None:
                inputs[COUNT] = travel * (number % 1000)
            calls.fmi3SetFloat64(machine, set_at, size, inputs, size)
            now = ctypes.c_double(number * STEP)
            refused += calls.fmi3DoStep(machine, now, step, ctypes.c_bool(True), *flags, last)
            calls.fmi3GetFloat64(machine, get_at, count, outputs, count)
        spent = time.process_time() - start
        if refused or not np.isfinite(outputs[0]):
            raise RuntimeError("a step was refused, or the machine is unstable")
        return steps * STEP / spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=200)
    parser.add_argument("--steps", type=int, default=5000)
    options = parser.parse_args()
    modes = options.states // 2
    space = to_first_order(make_matrices(modes), 2.0 * np.pi * HIGHEST_HZ, (CHANNELS, CHANNELS))
    blocks = describe_space(space, pose=Pose("reference"), step_s=STEP)
    varying = varying_model("moving", make_varying(modes))
    coupled = varying_model("coupled", make_varying(modes, coupled=True))
    ratios = {
        "blocks of two states": measure(fixed_model("blocks", blocks), options.steps),
        "one dense block": measure(
            fixed_model("dense", dataclasses.replace(blocks, pairs=0)), options.steps
        ),
        "axis at rest": measure(varying, options.steps, 0.0),
        "axis that moves": measure(varying, max(1, options.steps // 10), 1e-5),
        "with coupled damping": measure(coupled, max(1, options.steps // 10), 1e-5),
    }
    for name, ratio in ratios.items():
        print(f"{name:22s}{ratio:8.3g} x real time")


if __name__ == "__main__":
    main()
