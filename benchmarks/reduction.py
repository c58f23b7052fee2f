"""Craig-Bampton reduction of a steel column against other programs, in one run on one machine.

    ./headstock exec --with benchmarks python3 benchmarks/reduction.py [--sizes 20k,100k,300k]
    [--repeats 3] [--json FILE]

Column 100 x 38 x 500 mm, both end faces rigid with 6 dofs each, 20 fixed-interface modes,
second-order tetrahedra. Each contender runs in a process of its own, one after the other, with as
many BLAS threads as the launcher gives (HEADSTOCK_THREADS) and one rank. The peers are given the
assembled matrices; Headstock's assembly is counted.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from benchmark_tables import (
    Run,
    agreement_table,
    environment_lines,
    pose_lines,
    ratio_lines,
    stage_table,
    summary_table,
)
from column_job import SIZES, write_mesh, write_scene

MODES = 20
MANY_MODES = 60
MANY_MODES_SIZE = "100k"
PEERS = ("scipy + CHOLMOD", "scipy + SuperLU", "Exudyn")
OWN = ("headstock", "headstock, Krylov-Schur", "reduce stage", "minimum")
# eigsh to machine precision on another solver: the reference of the frequencies
TIGHT = "scipy + CHOLMOD"
SPARE_BYTES = 1 << 30


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print its tables."""
    options = _parse(arguments)
    print(*environment_lines(_machine()), sep="\n", flush=True)
    runs: list[Run] = []
    for size in options.sizes:
        with tempfile.TemporaryDirectory(prefix="headstock-benchmark-") as folder:
            runs += _run_size(size, Path(folder), options)
            print(
                "",
                f"### {size}",
                "",
                *summary_table(runs, size),
                "",
                *stage_table(runs, size),
                sep="\n",
            )
            print(
                "",
                *ratio_lines(runs, size),
                "",
                *agreement_table(runs, size, TIGHT),
                sep="\n",
                flush=True,
            )
    poses = _run("poses", "-", Path.cwd(), 0, options.timeout)
    print("", *pose_lines(poses), sep="\n", flush=True)
    if options.json is not None:
        content = {"machine": _machine(), "runs": [vars(run) for run in (*runs, poses)]}
        options.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--sizes",
        default="20k,100k,300k",
        help=f"comma-separated, of {', '.join(SIZES)} [20k,100k,300k]",
    )
    parser.add_argument(
        "--repeats",
        type=int,
        default=3,
        help="repeats of Headstock and the minimum, median taken [3]",
    )
    parser.add_argument(
        "--peers", default=",".join(PEERS), help=f"comma-separated, of {', '.join(PEERS)} [all]"
    )
    parser.add_argument(
        "--peer-repeats", type=int, default=1, help="repeats of the peers [1]; 0 leaves them out"
    )
    parser.add_argument(
        "--timeout", type=float, default=480.0, help="seconds a contender may take [480]"
    )
    parser.add_argument("--json", type=Path, help="write every number of every repeat")
    options = parser.parse_args(arguments)
    options.sizes = options.sizes.split(",")
    options.peers = [name for name in options.peers.split(",") if name]
    unknown = sorted((set(options.sizes) - set(SIZES)) | (set(options.peers) - set(PEERS)))
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}")
    if options.repeats < 1 or options.peer_repeats < 0:
        parser.error("repeats must be at least 1, peer repeats at least 0")
    return options


def _run_size(size: str, folder: Path, options: argparse.Namespace) -> list[Run]:
    dofs = write_mesh(size, folder)
    write_scene(size, MODES, folder)
    print(f"\n{size}: {dofs} dofs", file=sys.stderr, flush=True)
    _run("matrices", size, folder, MODES, options.timeout)
    runs = []
    for repeat in range(max(options.repeats, options.peer_repeats)):
        names = [
            *(OWN if repeat < options.repeats else ()),
            *(options.peers if repeat < options.peer_repeats else ()),
        ]
        runs += [_run(name, size, folder, MODES, options.timeout) for name in names]
        if size == MANY_MODES_SIZE and repeat < options.repeats:
            runs.append(_run("headstock", size, folder, MANY_MODES, options.timeout))
    for run in runs:
        run.dofs = dofs
    return runs


def _run(name: str, size: str, folder: Path, modes: int, timeout: float) -> Run:
    """Run a contender in its own process; a failure is a result too."""
    script = Path(__file__).with_name("contenders.py")
    print(f"  {name}, {modes} modes", file=sys.stderr, end="", flush=True)
    try:
        done = subprocess.run(
            [sys.executable, str(script), name, str(folder), str(modes)],
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            preexec_fn=_limit_memory,
        )
    except subprocess.TimeoutExpired:
        print(f": more than {timeout:g} s", file=sys.stderr, flush=True)
        return Run(name, size, modes, failure=f"> {timeout:g} s")
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines or not lines[-1].startswith("{"):
        tail = (done.stderr.strip().splitlines() or ["no output"])[-1]
        print(f": {tail}", file=sys.stderr, flush=True)
        return Run(
            name,
            size,
            modes,
            failure="out of memory" if "Memory" in tail else f"failed ({done.returncode})",
        )
    content: dict[str, Any] = json.loads(lines[-1])
    print(f": {content['total']['seconds']:.2f} s", file=sys.stderr, flush=True)
    return Run(name, size, modes, **content)


def _limit_memory() -> None:
    """No more than what is free, so that one contender cannot end its neighbours."""
    with Path("/proc/meminfo").open() as file:
        available = (
            next(int(line.split()[1]) for line in file if line.startswith("MemAvailable")) * 1024
        )
    limit = max(available - SPARE_BYTES, SPARE_BYTES)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


def _machine() -> dict[str, Any]:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next(
        (line.split(":")[1].strip() for line in lines if line.startswith("model name")), "unknown"
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "memory_gib": round(memory, 1),
        "threads": int(os.environ.get("OMP_NUM_THREADS", "0")),
        "ranks": 1,
        "load_before": round(os.getloadavg()[0], 2),
        "system": platform.platform(),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


if __name__ == "__main__":
    sys.exit(main())
