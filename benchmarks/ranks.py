"""What a second and a fourth rank bring: seconds of commands from an empty store on one rank and on
several, medians of alternating runs.

    ./headstock exec python3 benchmarks/ranks.py [REPEATS] [--ranks 2,4] [--only WORDS]

Default of REPEATS: 5; WORDS are in the names of the work to measure. One rank has as many BLAS threads as there are cores; several ranks have the
threads that the program gives them. The start of the processes is counted.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HEAD = """name = "ranks"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[points]
tcp = {{ tool = "{tool}", work = "ground" }}
[analyses.static]
at = "tcp"
[analyses.modal]
count = 10
[joints.clamp]
between = ["ground", "a.foot"]
kind = "rigid"
[components.a]
material = "steel"
solid.box = ["0.2 m", "0.3 m", "1 m"]
mesh.size = "{size}"
reduction.modes = 20
interfaces.foot.face = "z-"
interfaces.tip.face = "z+"
"""
SECOND = """[components.b]
material = "steel"
solid.box = ["0.8 m", "0.3 m", "0.2 m"]
at = ["0 m", "0 m", "1 m"]
mesh.size = "{size}"
reduction.modes = 20
interfaces.seat = {{ face = "z-", rect = {{ size = ["0.2 m", "0.3 m"] }} }}
interfaces.tip.face = "x+"
[joints.flange]
between = ["a.tip", "b.seat"]
kind = "rigid"
"""
STUDY = """[studies.meshes]
watch = ["modal.frequencies_hz[0]"]
[studies.meshes.families.sizes]
vary = {{ "components.a.mesh.size" = [{sizes}] }}
"""
SIZES = ", ".join(f'"{size:.1f} mm"' for size in (75.0 * 0.95**number for number in range(16)))
MPI_OPTIONS = ("--oversubscribe", "--bind-to", "none")


@dataclass(frozen=True)
class Work:
    """A command on a scene.

    Attributes:
        name: For the table.
        scene: Text of the scene.
        words: Of the command line before and after the scene.
    """

    name: str
    scene: str
    words: tuple[tuple[str, ...], tuple[str, ...]]


def list_work() -> list[Work]:
    """One part, two parts of about 100k dofs, and 16 meshes of a part."""
    run: tuple[tuple[str, ...], tuple[str, ...]] = (("run",), ("--no-figures",))
    fine, coarse = (HEAD.format(tool="a.tip", size=size) for size in ("25 mm", "45 mm"))
    two = HEAD.format(tool="b.tip", size="25 mm") + SECOND.format(size="22 mm")
    study = f"{HEAD.format(tool='a.tip', size='40 mm')}{STUDY.format(sizes=SIZES)}"
    return [
        Work("one part, about 20k dofs", coarse, run),
        Work("one part, about 100k dofs", fine, run),
        Work("two parts of about 100k dofs", two, run),
        Work("16 meshes of one part", study, (("study",), ("meshes",))),
    ]


def main() -> None:
    """Print a table of work and ranks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("repeats", nargs="?", type=int, default=5)
    parser.add_argument("--ranks", default="2")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    repeats, ranks = options.repeats, [int(count) for count in options.ranks.split(",")]
    cores = len(os.sched_getaffinity(0))
    print(f"{cores} cores, load {os.getloadavg()[0]:.1f}, medians of {repeats} alternating runs")
    print(
        f"{'':30} {'1 rank':>8}"
        + "".join(f" {f'{count} ranks':>8} {'ratio':>6}" for count in ranks)
    )
    for work in (work for work in list_work() if options.only in work.name):
        _measure(work, 1, cores)  # loads libraries and compiles kernels
        seconds: dict[int, list[float]] = {count: [] for count in (1, *ranks)}
        for _ in range(repeats):
            for count, found in seconds.items():
                found.append(_measure(work, count, cores))
        middle = {count: statistics.median(found) for count, found in seconds.items()}
        print(
            f"{work.name:30} {middle[1]:8.1f}"
            + "".join(f" {middle[count]:8.1f} {middle[1] / middle[count]:6.2f}" for count in ranks),
            flush=True,
        )


def _measure(work: Work, ranks: int, cores: int) -> float:
    """Wall-clock time [s] of a command from an empty store."""
    with tempfile.TemporaryDirectory(prefix="headstock-benchmark-") as place:
        scene = Path(place) / "scene.toml"
        scene.write_text(work.scene)
        before, after = work.words
        words = [*before, str(scene), *after, "-o", str(Path(place) / "out")]
        program = [sys.executable, "-P", "-m", "mpi4py", "-m", "headstock.app.command_line", *words]
        variables = {
            **os.environ,
            "HEADSTOCK_STORE": str(Path(place) / "store"),
            "OMP_NUM_THREADS": str(cores if ranks == 1 else 1),
        }
        variables.pop("HEADSTOCK_THREADS", None)
        launcher = [shutil.which("mpirun") or "mpirun", *MPI_OPTIONS, "-n", str(ranks)]
        begin = time.perf_counter()
        done = subprocess.run(
            [*launcher, *program] if ranks > 1 else program,
            env=variables,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise SystemExit(done.stderr)
        return time.perf_counter() - begin


if __name__ == "__main__":
    main()
