"""Reduction of large parts by factors and by iteration: seconds, memory, and how both grow.

    ./headstock exec python3 benchmarks/large_parts.py [--sizes 100k,300k,1M,3M]
    [--methods direct,iterative] [--entries] [--json FILE]

The steel column of `benchmarks/reduction.py`, 12 constraint modes and 20 fixed-interface modes,
second-order tetrahedra, error estimates left out. Each run has a process of its own, whose peak
memory is its own; meshing is not counted. `--entries` instead factorises bars, blocks and plates and
prints predicted and counted entries of the factors.
"""

import argparse
import contextlib
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from unittest import mock

import numpy as np
from column_job import EXTENT, SIZES, column, read_mesh, write_mesh
from mpi4py import MPI

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import SolverMethod
from headstock.geometry.parts.solids import Box
from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.planning.resources import measure
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.solver_choice import predict_factor_entries
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.factorization import Factorization

MODES = 20
METHODS: tuple[SolverMethod, ...] = ("direct", "iterative")
SHAPES = {
    "column": (EXTENT, (0.0145, 0.0075, 0.0055)),
    "block": ((0.2, 0.2, 0.2), (0.0235, 0.0128, 0.0105)),
    "plate": ((0.6, 0.6, 0.02), (0.015, 0.009)),
    "rod": ((0.05, 0.05, 1.0), (0.012, 0.007)),
}


@dataclass(frozen=True, eq=False)
class Reduced:
    """What one run gave.

    Attributes:
        size: Name of the mesh.
        method: How it was solved.
        dofs: Displacement dofs.
        seconds: By the clock [s].
        cpu_seconds: Of all threads [s].
        gigabytes: Peak memory [GB].
        factor_seconds: Of ordering and factorisation by the clock [s]; 0 where nothing is factorised.
        stiffness: ``(n, n)`` reduced stiffness; its first 12 rows are the boundary's.
    """

    size: str
    method: SolverMethod
    dofs: int
    seconds: float
    cpu_seconds: float
    gigabytes: float
    factor_seconds: float
    stiffness: FloatArray


def main(arguments: list[str] | None = None) -> int:
    """Run the sizes and print their table."""
    options = _parse(arguments)
    if options.child:
        _reduce(Path(options.child), options.methods[0])
        return 0
    threads = os.environ.get("OMP_NUM_THREADS", "?")
    print(f"{os.cpu_count()} cores, {threads} threads, load {os.getloadavg()[0]:.1f} before\n")
    if options.entries:
        _print_entries()
        return 0
    print("| dofs | method | s | over its factorisation | CPU s | GB | frequencies | K_bb |")
    print(f"|{' --- |' * 8}", flush=True)
    runs: list[Reduced] = []
    for size in options.sizes:
        with tempfile.TemporaryDirectory(prefix="headstock-large-") as folder:
            write_mesh(size, Path(folder))
            for method in options.methods:
                run = _run(size, method, Path(folder))
                if run is not None:
                    print(_row(run, runs), flush=True)
                    runs.append(run)
    print()
    for method in options.methods:
        for before, after in pairwise([run for run in runs if run.method == method]):
            print(_growth(method, before, after))
    if options.json is not None:
        options.json.write_text(json.dumps([_numbers(run) for run in runs], indent=1) + "\n")
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", default="100k,300k", help=f"of {', '.join(SIZES)} [100k,300k]")
    parser.add_argument(
        "--methods", default=",".join(METHODS), help="direct, iterative or both [both]"
    )
    parser.add_argument("--entries", action="store_true", help="entries of factors instead")
    parser.add_argument("--json", type=Path, help="write every number")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    options.sizes, options.methods = options.sizes.split(","), options.methods.split(",")
    unknown = sorted(set(options.sizes) - set(SIZES)) + sorted(set(options.methods) - set(METHODS))
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}")
    return options


def _reduce(folder: Path, method: SolverMethod) -> None:
    """Reduce the column that is in a folder, in this process."""
    part = column("20k", MODES)
    part = dataclasses.replace(part, reduction=dataclasses.replace(part.reduction, solver=method))
    mesh = read_mesh(folder)
    request = ReductionRequest(modes=ModeTarget(count=MODES), errors=False)
    with _clock_factors() as factor_seconds, measure() as cost:
        found = reduce_elastic(part, mesh, comm=MPI.COMM_SELF, request=request)
    numbers = (cost.seconds, cost.cpu_seconds, cost.peak_rss_mb / 1e3, sum(factor_seconds))
    np.savez(
        folder / f"{method}.npz",
        stiffness=found.stiffness,
        cost=np.array([3 * len(mesh.points), *numbers]),
    )


@contextlib.contextmanager
def _clock_factors() -> Iterator[list[float]]:
    """Clocks every factorisation of a component [s], in the run that is measured."""
    seconds: list[float] = []
    factorise = Factorization.__init__

    def clocked(self: Factorization, operators: ElasticOperators, fixed: BoolArray) -> None:
        start = time.perf_counter()
        factorise(self, operators, fixed)
        seconds.append(time.perf_counter() - start)

    with mock.patch.object(Factorization, "__init__", clocked):
        yield seconds


def _run(size: str, method: SolverMethod, folder: Path) -> Reduced | None:
    """A run in a process of its own; None where it failed, which is said."""
    command = [sys.executable, str(Path(__file__)), "--child", str(folder), "--methods", method]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        tail = (done.stderr.strip().splitlines() or [f"ended by signal {-done.returncode}"])[-1]
        print(f"| {size} | {method} | failed: {tail} |", flush=True)
        return None
    with np.load(folder / f"{method}.npz") as file:
        dofs, seconds, cpu_seconds, gigabytes, factor_seconds = map(float, file["cost"])
        return Reduced(
            size=size,
            method=method,
            dofs=int(dofs),
            seconds=seconds,
            cpu_seconds=cpu_seconds,
            gigabytes=gigabytes,
            factor_seconds=factor_seconds,
            stiffness=file["stiffness"],
        )


def _row(run: Reduced, runs: list[Reduced]) -> str:
    """A line of the table; what iterates is compared with the factors of its size, where they are."""
    direct = next((one for one in runs if one.size == run.size and one.method == "direct"), None)
    errors = "| |"
    if direct is not None and run.method != "direct":
        boundary = len(run.stiffness) - MODES
        values, exact = (np.diag(one.stiffness)[boundary:] for one in (run, direct))
        difference = np.abs(run.stiffness - direct.stiffness)[:boundary, :boundary]
        size = np.sqrt(np.diag(direct.stiffness)[:boundary])
        frequencies = np.abs(np.sqrt(values / exact) - 1.0).max()
        errors = f"| {frequencies:.1g} | {(difference / np.outer(size, size)).max():.1g} |"
    over = f"{run.seconds / run.factor_seconds:.2f}" if run.factor_seconds else ""
    return (
        f"| {run.dofs} | {run.method} | {run.seconds:.1f} | {over} | {run.cpu_seconds:.1f} | "
        f"{run.gigabytes:.2f} {errors}"
    )


def _growth(method: SolverMethod, before: Reduced, after: Reduced) -> str:
    larger = np.log(after.dofs / before.dofs)
    time = np.log(after.cpu_seconds / before.cpu_seconds) / larger
    memory = np.log(after.gigabytes / before.gigabytes) / larger
    return (
        f"{method}, {before.size} to {after.size}: CPU seconds grow like dofs^{time:.2f}, memory like "
        f"dofs^{memory:.2f}"
    )


def _numbers(run: Reduced) -> dict[str, object]:
    return {name: value for name, value in vars(run).items() if name != "stiffness"}


def _print_entries() -> None:
    """Entries of factors, predicted and counted."""
    print("| part | dofs | predicted | counted | ratio |\n| --- | --- | --- | --- | --- |")
    for name, (extent, sizes) in SHAPES.items():
        for size in sizes:
            part = column("20k", 0)
            part = dataclasses.replace(
                part, solid=Box(extent), mesh=dataclasses.replace(part.mesh, size=size)
            )
            mesh = mesh_component(part)
            operators = assemble_elasticity(
                mesh, part.material, comm=MPI.COMM_SELF, with_mass=False
            )
            heights = operators.points[:, 2]
            ends = (heights < heights.min() + 1e-9) | (heights > heights.max() - 1e-9)
            dofs = int((~np.repeat(ends, 3)).sum())
            predicted = predict_factor_entries(dofs, extent)
            with Factorization(operators, np.repeat(ends, 3)) as factors:
                counted = factors.factors.getPC().getFactorMatrix().getInfo()["nz_used"]
            print(
                f"| {name} | {dofs} | {predicted:.3g} | {counted:.3g} | {predicted / counted:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    sys.exit(main())
