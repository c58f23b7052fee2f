"""Nine responses at 1000 frequencies: the reduced column against direct solves of its whole model, in one run.

./headstock exec python3 benchmarks/frequency_response.py [ELEMENT SIZE IN MM]
"""

import sys
import time

import numpy as np
from mpi4py import MPI

from headstock.solvers.frequency_response import evaluate_frf, prepare_frf
from headstock.validation.frequency_cases import PORTS, TO_HZ, column_models, direct_response

COUNT, TRIED, REPEATS = 1000, 3, 5


def main() -> None:
    size = float(sys.argv[1]) / 1000.0 if len(sys.argv) > 1 else 0.025
    system, whole = column_models(MPI.COMM_SELF, size)
    frequencies = np.linspace(1.0, TO_HZ, COUNT)
    reduced = []
    for _ in range(REPEATS):
        start = time.process_time()
        found = evaluate_frf(prepare_frf(system, inputs=PORTS, outputs=PORTS), frequencies).receptance
        reduced.append(time.process_time() - start)
    picked = np.linspace(0, COUNT - 1, TRIED).astype(int)
    start = time.process_time()
    expected = np.array([direct_response(whole, float(hz)) for hz in frequencies[picked]])
    direct = (time.process_time() - start) / TRIED * COUNT
    size_of = np.abs(expected).max(axis=(1, 2))
    error = (np.abs(found[picked] - expected).max(axis=(1, 2)) / size_of).max()
    print(f"whole model {whole.stiffness.shape[0] - 6} dofs, reduced {len(system.mass)} dofs, {COUNT} frequencies x 9 entries")
    print(f"reduced, preparation included   {np.median(reduced):9.4f} s of CPU (median of {REPEATS})")
    print(f"direct, from {TRIED} frequencies       {direct:9.1f} s of CPU")
    print(f"ratio {direct / np.median(reduced):.0f}, largest difference {100 * error:.3f} %")


if __name__ == "__main__":
    main()
