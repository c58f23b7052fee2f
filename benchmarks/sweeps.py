"""A sweep of the table on a long bed (242 reduced dofs): seconds of 1000 poses, and of many poses
on one rank and on two.

    ./headstock exec python3 benchmarks/sweeps.py [POSES]

Default of POSES: 10000. Beside the wall-clock time stands the processor time of the rank that
has most: on a machine that does other things besides, their ratio says what a second rank gives.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENE = Path(__file__).resolve().parents[1] / "machines" / "guideway.toml"
PROGRAM = """
import resource, sys
from pathlib import Path
from mpi4py import MPI
from headstock.scene.building.loader import load_scene
from headstock.studies.sweeps.files import write_sweep
from headstock.studies.sweeps.runs import SweepJob, gather_sweep, run_sweep, select_analyses

comm, out = MPI.COMM_WORLD, Path(sys.argv[2])
scene = load_scene(Path(sys.argv[1]))
job = SweepJob(select_analyses(scene), scene.sweeps["line"], out)
outcome = run_sweep(job, comm=comm)
if comm.rank == 0:
    write_sweep(out, gather_sweep(job, outcome))
usage = resource.getrusage(resource.RUSAGE_SELF)
seconds = comm.gather(usage.ru_utime + usage.ru_stime)
if comm.rank == 0:
    print(max(seconds))
"""


def main() -> None:
    """Print a table of poses, ranks and seconds."""
    poses = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, one BLAS thread per rank")
    print(f"{'poses':>7} {'ranks':>5} {'seconds':>8} {'CPU of busiest rank':>20}")
    _measure(2, 1)  # loads libraries, reduces the bed
    rows = {
        (count, ranks): _measure(count, ranks)
        for count, ranks in ((1000, 2), (poses, 1), (poses, 2))
    }
    for (count, ranks), (seconds, busiest) in rows.items():
        print(f"{count:7d} {ranks:5d} {seconds:8.1f} {busiest:20.1f}")
    (wall, busiest), (wall_2, busiest_2) = rows[poses, 1], rows[poses, 2]
    print(
        f"two ranks: {wall / wall_2:.2f} times as fast, {busiest / busiest_2:.2f} by the processor time of the busiest rank"
    )


def _measure(count: int, ranks: int) -> tuple[float, float]:
    """Wall-clock time and processor time of the busiest rank [s] of a sweep from an empty
    folder.
    """
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise SystemExit("there is no mpirun here")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "guideway.toml"
        scene.write_text(
            f'{SCENE.read_text()}\n[sweeps.line]\naxes = {{ X = ["-240 mm", "240 mm", {count}] }}\n'
        )
        command = [
            mpirun,
            "--oversubscribe",
            "--bind-to",
            "none",
            "-n",
            str(ranks),
            sys.executable,
            "-P",
            "-c",
            PROGRAM,
        ]
        start = time.perf_counter()
        done = subprocess.run(
            [*command, str(scene), folder],
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=True,
        )
        return time.perf_counter() - start, float(done.stdout.split()[-1])


if __name__ == "__main__":
    main()
