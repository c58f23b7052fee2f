"""Responses at 1000 frequencies: the reduced column against direct solves of its whole model, and a
large system with few dampers, also its damped modes.

./headstock exec python3 benchmarks/frequency_response.py [ELEMENT SIZE IN MM]
"""

import itertools
import sys
import time
from dataclasses import replace

import numpy as np
import scipy.linalg
from mpi4py import MPI

from headstock.solvers.linear.damping import equivalent_viscous, solve_damped
from headstock.solvers.linear.frequency_response import evaluate_frf, find_peaks, prepare_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import SecondOrderSystem
from headstock.validation.parts.response_cases import (
    CHANNELS,
    TO_HZ,
    column_models,
    direct_response,
)

COUNT, TRIED, REPEATS = 1000, 3, 5
WANTED = (100, 200)  # damped modes


def damped_lattice(
    *, sides: tuple[int, int, int] = (10, 10, 12), dampers: int = 60
) -> SecondOrderSystem:
    """Masses on a grid of springs, the lowest layer on ground, with dashpots between some
    neighbours: one dof per mass.
    """
    random = np.random.default_rng(1)
    places = np.arange(np.prod(sides)).reshape(sides)
    links = np.vstack(
        [
            np.column_stack(
                [np.moveaxis(places, a, 0)[:-1].ravel(), np.moveaxis(places, a, 0)[1:].ravel()]
            )
            for a in range(3)
        ]
    )
    rows = np.zeros((len(links), places.size))
    rows[np.arange(len(links)), links[:, 0]], rows[np.arange(len(links)), links[:, 1]] = -1.0, 1.0
    stiffness = rows.T @ (1e8 * random.uniform(0.3, 3.0, len(links))[:, None] * rows)
    stiffness[places[:, :, 0].ravel(), places[:, :, 0].ravel()] += 1e8
    chosen = rows[random.choice(len(links), dampers, replace=False)]
    channels = {
        (name, "x"): np.eye(places.size)[place]
        for name, place in (("a", -1), ("b", 500), ("c", 900))
    }
    mass = np.diag(random.uniform(0.5, 2.0, places.size))
    return SecondOrderSystem(
        mass,
        2e3 * chosen.T @ chosen,
        stiffness,
        channels,
        channels,
        tuple(map(str, range(places.size))),
    )


def compare_with_eigenvalues() -> None:
    """CPU time of a damped response, peaks included, over that of the undamped eigenvalue problem
    of the same size.
    """
    system = damped_lattice()
    channels, times = tuple(system.inputs), []
    for _ in range(REPEATS):
        start = time.process_time()
        scipy.linalg.eigh(system.stiffness, system.mass)
        solved = time.process_time()
        modes = solve_modal(system)
        prepared = time.process_time()
        frequencies = np.linspace(1.0, float(modes.frequencies_hz[100]), COUNT, dtype=np.float64)
        model = prepare_frf(system, inputs=channels[:1], outputs=channels, modes=modes)
        answered = evaluate_frf(model, frequencies)
        done = time.process_time()
        find_peaks(model, float(frequencies[-1]))
        times.append(
            (solved - start, prepared - solved, done - prepared, time.process_time() - done)
        )
    eigenvalues, undamped, response, peaks = np.median(times, axis=0)
    probed = np.arange(0, COUNT, COUNT // 20)
    expected = model.direct.evaluate(2.0 * np.pi * frequencies[probed])
    error = (
        np.abs(answered.receptance[probed] - expected)
        / np.abs(expected).max(axis=(1, 2), keepdims=True)
    ).max()
    print(
        f"{len(system.mass)} dofs, 60 dampers that couple modes, {COUNT} frequencies x 3 entries, method {answered.method}"
    )
    print(
        f"eigh (LAPACK) {eigenvalues:.2f} s, all undamped modes {undamped:.2f} s, response {response:.2f} s, peaks {peaks:.2f} s of CPU"
    )
    print(
        f"response / eigh {response / eigenvalues:.1f}, with peaks {(response + peaks) / eigenvalues:.1f}, "
        f"with the undamped modes {(undamped + response + peaks) / eigenvalues:.1f}; against direct {error:.1e}"
    )


def lossy_lattice(loss: float) -> SecondOrderSystem:
    """The lattice with a loss factor between zero and twice the given one on each inner spring,
    as the viscous damping of equal losses, in place of its dashpots.
    """
    system, random = damped_lattice(), np.random.default_rng(2)
    springs = np.triu(-system.stiffness, 1)
    lost = springs * random.uniform(0.0, 2.0 * loss, springs.shape)
    lost += lost.T
    hysteretic = np.diag(lost.sum(axis=1)) - lost
    return equivalent_viscous(replace(system, damping=None, hysteretic=hysteretic))


def compare_damped_modes() -> None:
    """CPU time of all damped modes in the circle of the lowest undamped ones over that of the
    undamped eigenvalue problem, for dashpots of several strengths and for losses of every spring.
    """
    system = damped_lattice()
    modes = solve_modal(system)
    cases = {
        f"dashpots times {strength:g}": replace(system, damping=strength * system.damping)
        for strength in (1.0, 10.0, 100.0, 1e4)
        if system.damping is not None
    }
    cases |= {f"mean loss factor {loss:g}": lossy_lattice(loss) for loss in (0.025, 0.25)}
    for wanted, (name, damped) in itertools.product(WANTED, cases.items()):
        times = []
        for _ in range(REPEATS):
            start = time.process_time()
            scipy.linalg.eigh(system.stiffness, system.mass)
            solved = time.process_time()
            found = solve_damped(damped, modes, lowest=wanted)
            times.append((solved - start, time.process_time() - solved))
        eigenvalues, poles = np.median(times, axis=0)
        print(
            f"{wanted} damped modes of {len(system.mass)}, {name}: {poles:.2f} s of CPU for "
            f"{len(found.poles)} poles ({int((found.frequencies_hz == 0.0).sum())} real), over "
            f"eigh {poles / eigenvalues:.1f}"
        )


def main() -> None:
    compare_with_eigenvalues()
    compare_damped_modes()
    size = float(sys.argv[1]) / 1000.0 if len(sys.argv) > 1 else 0.025
    system, whole = column_models(MPI.COMM_SELF, size)
    frequencies = np.linspace(1.0, TO_HZ, COUNT, dtype=np.float64)
    reduced = []
    for _ in range(REPEATS):
        start = time.process_time()
        found = evaluate_frf(
            prepare_frf(system, inputs=CHANNELS, outputs=CHANNELS), frequencies
        ).receptance
        reduced.append(time.process_time() - start)
    picked = np.linspace(0, COUNT - 1, TRIED).astype(int)
    start = time.process_time()
    expected = np.array([direct_response(whole, float(hz)) for hz in frequencies[picked]])
    direct = (time.process_time() - start) / TRIED * COUNT
    size_of = np.abs(expected).max(axis=(1, 2))
    error = (np.abs(found[picked] - expected).max(axis=(1, 2)) / size_of).max()
    print(
        f"whole model {whole.stiffness.shape[0] - 6} dofs, reduced {len(system.mass)} dofs, {COUNT} frequencies x 9 entries"
    )
    print(
        f"reduced, preparation included   {np.median(reduced):9.4f} s of CPU (median of {REPEATS})"
    )
    print(f"direct, from {TRIED} frequencies       {direct:9.1f} s of CPU")
    print(f"ratio {direct / np.median(reduced):.0f}, largest difference {100 * error:.3f} %")


if __name__ == "__main__":
    main()
