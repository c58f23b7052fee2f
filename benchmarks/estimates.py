"""What error estimates cost of a run, in one run: CPU seconds inside them over those of the whole, with an empty store and again.

HEADSTOCK_THREADS=1 ./headstock exec python3 benchmarks/estimates.py [SCENE[:VARIANT] ...]

The mesher, which is a child process, counts for the whole; the report and its pictures do not. Imports are apart.
"""

import os
import resource
import sys
import tempfile
from pathlib import Path

from mpi4py import MPI
from stage_clock import StageClock

from headstock.pipeline import frf_stages, machine_stages
from headstock.pipeline.runner import run_scene
from headstock.pipeline.scene_loader import load_scene
from headstock.pipeline.store import Store
from headstock.reduction import elastic_reduction

MACHINES = Path(__file__).resolve().parents[1] / "machines"
SCENES = ("cantilever", "fixed_beam", "guideway", "three_axis", "three_axis:frf", "step_column")
WATCHED = (
    (elastic_reduction, "measure_truncation", "modes left out"),
    (elastic_reduction, "estimate_missing_energy", "mesh"),
    (machine_stages, "estimate_mode_errors", "frequencies"),
    (machine_stages, "estimate_compliance_errors", "compliances"),
    (frf_stages, "estimate_response_errors", "responses"),
)


def main() -> None:
    """Run the scenes and print a row for each, cold and warm."""
    clock = StageClock()
    for module, function, name in WATCHED:
        clock.watch(module, function, name)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {os.environ.get('OMP_NUM_THREADS', '?')} BLAS thread(s)")
    print(f"{'scene':<18}{'store':<7}{'CPU s':>7}" + "".join(f"{name:>16}" for _, _, name in WATCHED) + f"{'all':>9}")
    for name in sys.argv[1:] or SCENES:
        file, _, variant = name.partition(":")
        with tempfile.TemporaryDirectory() as folder:
            for store in ("empty", "full"):
                clock.stages.clear()
                start = _cpu_seconds()
                scene = load_scene(MACHINES / f"{file}.toml", variant=variant or None)
                run_scene(scene, Path(folder) / "out", comm=MPI.COMM_SELF, store=Store(Path(folder) / "store"))
                total = _cpu_seconds() - start
                parts = [clock.stages.get(what, {"cpu": 0.0})["cpu"] for _, _, what in WATCHED]
                cells = "".join(f"{100 * part / total:>14.1f} %" for part in parts)
                print(f"{name:<18}{store:<7}{total:>7.2f}{cells}{100 * sum(parts) / total:>7.1f} %", flush=True)


def _cpu_seconds() -> float:
    """User and system seconds of this process and of its children that have ended."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


if __name__ == "__main__":
    main()
