"""What one part split over ranks takes: seconds and peak memory of every rank in every step of its
reduction, and whether the answers are those of the first number of ranks.

    HEADSTOCK_THREADS=1 ./headstock exec python3 benchmarks/split_part.py [--sizes 20k,100k] [--ranks 1,2,4]

The part is the column of `reduction.py` with 20 fixed-interface modes; it is meshed beforehand, and
rank 0 alone reads the mesh. `peak` is the largest resident memory of a rank at any time, of
which the libraries take what stands in the line `start`; `rank 0` is its peak over the mean.
"""

import argparse
import contextlib
import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from column_job import SIZES, column, read_mesh, write_mesh
from mpi4py import MPI

from headstock.meshing.components.skins import mesh_skin
from headstock.reduction.components import elastic
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver

MODES = 20
STEPS = {
    "assembly": (elastic, "assemble_elasticity"),
    "factors": (ConstrainedSolver, "__init__"),
    "constraint modes": (elastic, "find_constraint_modes"),
    "modes": (elastic, "find_fixed_interface_modes"),
    "projection": (elastic, "project_component"),
    "truncation": (elastic, "measure_truncation"),
    "recovery": (elastic, "_gather_recovery"),
    "mesh errors": (elastic, "_estimate_errors"),
}


class Watch:
    """Seconds and peak memory [MB] of the steps of this rank."""

    def __init__(self) -> None:
        self.peaks = {"start": _restart_peak()}
        self.seconds = {"start": 0.0}

    @contextlib.contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Count what happens inside; steps do not lie in each other."""
        self.peaks["rest"] = max(self.peaks.get("rest", 0.0), _restart_peak())
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
        self.peaks[name] = max(self.peaks.get(name, 0.0), _restart_peak())

    def watch(self, owner: Any, attribute: str, name: str) -> None:
        """Count every call of a function."""
        function: Callable[..., Any] = getattr(owner, attribute)

        @functools.wraps(function)
        def watched(*arguments: Any, **options: Any) -> Any:
            with self.step(name):
                return function(*arguments, **options)

        setattr(owner, attribute, watched)


def _restart_peak() -> float:
    """Peak resident memory since the last call [MB]."""
    match = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return int(match[1]) / 1024.0 if match else 0.0


def reduce_on_ranks(folder: Path) -> None:
    """On every rank: reduce the column; rank 0 prints the table and keeps the matrices."""
    comm, part, watch = MPI.COMM_WORLD, column("20k", MODES), Watch()
    for name, (owner, attribute) in STEPS.items():
        watch.watch(owner, attribute, name)
    begin = time.perf_counter()
    with watch.step("mesh"):
        mesh = read_mesh(folder) if comm.rank == 0 else None
    element = elastic.reduce_elastic(part, mesh, comm=comm)
    if mesh is not None:
        with watch.step("skin"):
            mesh_skin(mesh)
    total = time.perf_counter() - begin
    watch.peaks["rest"] = max(watch.peaks.get("rest", 0.0), _restart_peak())
    gathered = comm.gather((watch.seconds, watch.peaks))
    if gathered is not None:
        print(f"{comm.size} ranks, {element.full_dofs} dofs, {total:.1f} s")
        for name in watch.peaks:
            seconds = max(times.get(name, 0.0) for times, _ in gathered)
            peaks = "".join(f" {memory.get(name, 0.0):8.0f}" for _, memory in gathered)
            print(f"  {name:18} {seconds:7.1f} s {peaks} MB")
        most = [max(memory.values()) for _, memory in gathered]
        peaks = "".join(f" {peak:8.0f}" for peak in most)
        print(f"  {'peak':18} {'':9} {peaks} MB, rank 0 {most[0] / np.mean(most):.2f} x mean")
        _compare(folder, element)


def _compare(folder: Path, element: Any) -> None:
    """Largest differences from the first number of ranks, which is kept."""
    free = np.linalg.inv(element.stiffness[6:12, 6:12])
    found = {
        "frequencies": element.modal_frequencies_hz,
        "compliance": free,
        "missing energy": element.errors.missing_energy.diagonal(),
    }
    first = folder / "first.npz"
    if not first.exists():
        np.savez(first, **found)
        return
    with np.load(first) as file:
        scale = np.sqrt(np.outer(file["compliance"].diagonal(), file["compliance"].diagonal()))
        off = {
            "frequencies": np.abs(found["frequencies"] / file["frequencies"] - 1.0),
            "compliance": np.abs(free - file["compliance"]) / scale,
            "missing energy": np.abs(found["missing energy"] / file["missing energy"] - 1.0),
        }
    print("  differs by", ", ".join(f"{name} {value.max():.1e}" for name, value in off.items()))


def main() -> None:
    """Mesh each size once and reduce it on each number of ranks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", default="20k,100k", help=f"of {', '.join(SIZES)}")
    parser.add_argument("--ranks", default="1,2,4")
    parser.add_argument("--mesh", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.mesh is not None:
        reduce_on_ranks(options.mesh)
        return
    print(f"{len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}")
    for size in options.sizes.split(","):
        with tempfile.TemporaryDirectory(prefix="headstock-benchmark-") as place:
            write_mesh(size, Path(place))
            for count in map(int, options.ranks.split(",")):
                program = [sys.executable, "-P", "-m", "mpi4py", __file__, "--mesh", place]
                launcher = [shutil.which("mpirun") or "mpirun", "--oversubscribe", "-n", str(count)]
                paths = os.pathsep.join(filter(None, [str(Path(__file__).parent), *sys.path]))
                subprocess.run(
                    [*launcher, "--bind-to", "none", *program],
                    env={**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
                    check=True,
                )


if __name__ == "__main__":
    main()
