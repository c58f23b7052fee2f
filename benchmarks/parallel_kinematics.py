"""What the Tripteor costs: modes of a pose, a map, and its contour by each model, in one run,
beside the seconds its paper gives.

./headstock exec python3 benchmarks/parallel_kinematics.py [SECONDS OF THE NONLINEAR CONTOUR, all of
it without]
"""

import dataclasses
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from headstock.pipeline.motion.lumped_contour import run_lumped_contour
from headstock.pipeline.stages.map import _map_workspace
from headstock.scene.analyses.map import MapRequest
from headstock.solvers.mechanisms.modes import linearise_poses, solve_lumped_modes
from headstock.validation.mechanisms.contouring_cases import contour_request
from headstock.validation.mechanisms.tripteor_machine import PLANE_HALF, PLANE_HEIGHT, load_tripteor

PAPER_MODES, PAPER_CONTOUR, WHOLE = 0.5, 6 * 3600.0, 10.7


def measure(action: Callable[[], object], repeats: int) -> tuple[float, float, float]:
    """Seconds by the wall clock, and processor seconds: median, and most over least."""
    walls, processor = [], []
    for _ in range(repeats):
        wall, used = time.perf_counter(), time.process_time()
        action()
        walls.append(time.perf_counter() - wall)
        processor.append(time.process_time() - used)
    return statistics.median(walls), statistics.median(processor), max(processor) / min(processor)


def machine_name() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    model = next(
        (line.split(":")[1].strip() for line in lines if line.startswith("model name")),
        platform.machine(),
    )
    return f"{model}, {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}"


def main() -> None:
    until = float(sys.argv[1]) if len(sys.argv) > 1 else WHOLE
    tripteor, request = load_tripteor(), contour_request("al7075-t6")
    state = tripteor.poses["config_1"]
    x, y = (np.linspace(-half, half, 100, dtype=np.float64) for half in PLANE_HALF)
    grid = MapRequest((("X", x), ("Y", y)), {"Z": PLANE_HEIGHT})
    nonlinear = dataclasses.replace(request, model="nonlinear")
    waves = dataclasses.replace(request, regeneration=True)
    still = dataclasses.replace(tripteor.model, velocity_terms=False)
    jobs = [
        (
            "modes of one configuration",
            lambda: solve_lumped_modes(linearise_poses(tripteor.model, state)),
            200,
            1.0,
            PAPER_MODES,
        ),
        (
            "map of 100 x 100, one rank",
            lambda: _map_workspace(tripteor.scene, tripteor.model, grid),
            3,
            1.0,
            0.0,
        ),
        (
            "contour, linear",
            lambda: run_lumped_contour(tripteor.scene, tripteor.model, request),
            3,
            1.0,
            PAPER_CONTOUR,
        ),
        (
            "contour, linear, no Coriolis terms",
            lambda: run_lumped_contour(tripteor.scene, still, request),
            3,
            1.0,
            PAPER_CONTOUR,
        ),
        (
            "contour with regeneration",
            lambda: run_lumped_contour(tripteor.scene, tripteor.model, waves),
            1,
            1.0,
            0.0,
        ),
        (
            "contour, nonlinear"
            if until >= WHOLE
            else f"contour, nonlinear, from {until:g} s of it",
            lambda: run_lumped_contour(tripteor.scene, tripteor.model, nonlinear, until=until),
            1,
            WHOLE / min(until, WHOLE),
            PAPER_CONTOUR,
        ),
    ]
    print(machine_name())
    print(
        "| what | seconds | CPU seconds | spread | the paper | paper over CPU |\n| --- | --- | --- | --- | --- | --- |"
    )
    for name, action, repeats, scale, paper in jobs:
        wall, used, spread = measure(action, repeats)
        beside = (f"{paper:g} s", f"{paper / (used * scale):.0f}") if paper else ("", "")
        print(
            f"| {name} | {wall * scale:.4g} | {used * scale:.4g} | {spread:.2f} | {beside[0]} | {beside[1]} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
