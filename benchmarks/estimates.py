"""What error estimates cost, in one run: CPU seconds inside them over those of the stages and of
the whole command.

Each scene is run with an empty store and again with a full one.

HEADSTOCK_THREADS=1 ./headstock exec python3 benchmarks/estimates.py [SCENE[:VARIANT] ...]

Child processes (the mesher, the renderer of pictures) count. The stages end with results.h5; the
command adds report and pictures. Imports are apart.
"""

import contextlib
import io
import os
import resource
import sys
import tempfile
from pathlib import Path
from typing import Any

from mpi4py import MPI
from stage_clock import StageClock

from headstock.app.actions import running
from headstock.app.actions.running import run_command
from headstock.app.commands.scene_commands import RunOptions
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages import frf as frf_stages
from headstock.pipeline.stages import machine
from headstock.reduction.components import elastic

MACHINES = Path(__file__).resolve().parents[1] / "machines"
SCENES = ("cantilever", "fixed_beam", "guideway", "three_axis", "three_axis:frf", "step_column")
WATCHED = (
    (elastic, "measure_truncation", "modes left out"),
    (elastic, "estimate_split_errors", "mesh"),
    (machine, "estimate_mode_errors", "frequencies"),
    (machine, "estimate_compliance_errors", "compliances"),
    (frf_stages, "estimate_response_errors", "responses"),
)


def main() -> None:
    """Run the scenes and print a row for each, cold and warm."""
    clock, marks = StageClock(), list[float]()

    def counted(*arguments: Any, **options: Any) -> Any:
        start = _cpu_seconds()
        results = run_scene(*arguments, **options)
        marks.append(_cpu_seconds() - start)
        return results

    setattr(running, "run_scene", counted)  # noqa: B010
    for module, function, name in WATCHED:
        clock.watch(module, function, name)
    print(
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {os.environ.get('OMP_NUM_THREADS', '?')} BLAS thread(s)"
    )
    names = "".join(f"{name:>16}" for _, _, name in WATCHED)
    print(f"{'scene':<18}{'store':<7}{'CPU s':>7}{names}{'of stages':>12}{'of command':>12}")
    for name in sys.argv[1:] or SCENES:
        file, _, variant = name.partition(":")
        with tempfile.TemporaryDirectory() as folder:
            os.environ["HEADSTOCK_STORE"] = f"{folder}/store"
            scene, out = MACHINES / f"{file}.toml", Path(folder) / "out"
            options = RunOptions(scene=scene, variant=variant or None, output=out)
            for store in ("empty", "full"):
                clock.stages.clear()
                marks.clear()
                start = _cpu_seconds()
                with contextlib.redirect_stdout(io.StringIO()):
                    run_command(options, MPI.COMM_SELF)
                whole, stages = _cpu_seconds() - start, marks[0]
                parts = [clock.stages.get(what, {"cpu": 0.0})["cpu"] for _, _, what in WATCHED]
                cells = "".join(f"{100 * part / stages:>14.1f} %" for part in parts)
                shares = "".join(
                    f"{100 * sum(parts) / total:>10.1f} %" for total in (stages, whole)
                )
                print(f"{name:<18}{store:<7}{stages:>7.2f}{cells}{shares}", flush=True)


def _cpu_seconds() -> float:
    """User and system seconds of this process and of its children that have ended."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


if __name__ == "__main__":
    main()
