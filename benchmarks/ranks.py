"""What a second and a fourth rank bring: seconds of commands from an empty store on one rank and on
several, medians of alternating runs.

    ./headstock exec python3 benchmarks/ranks.py [REPEATS] [--ranks 2,4] [--only WORD] [--busy] [--one-thread] [--threads]

Default of REPEATS: 5; WORD is in the names of the work to measure; with --busy another program
keeps one core at work all the time. With --threads one rank with one BLAS thread is compared with
two, and the ratio of more is computed from the share of the time that the second one halves (Amdahl
1967). One rank has as many BLAS threads as there are free cores; several ranks have the threads
that the program gives them; with --one-thread one rank has one. The start of the processes is counted.
"""

import argparse
import contextlib
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
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
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")  # the second one counts where both are set
MACHINES = Path(__file__).resolve().parents[1] / "machines"
SHORT_CONTOUR = ("--analysis", "contouring", "--set", 'analyses.contouring.side="80 mm"')
MODELS = "rigid,segmented,elastic"
# several ranks may take so many times as long as one, and so many seconds more
MOST_TIMES, MOST_SECONDS = 1.1, 1.0
MPI_OPTIONS = ("--oversubscribe", "--bind-to", "none")


@dataclass(frozen=True)
class Work:
    """A command on a scene.

    Attributes:
        name: For the table.
        scene: Its text, or the file.
        words: Of the command line before and after the scene.
    """

    name: str
    scene: str | Path
    words: tuple[tuple[str, ...], tuple[str, ...]]


def list_work(sizes: tuple[str, ...] = ("45 mm", "25 mm")) -> list[Work]:
    """One part of several sizes, two parts of about 100k dofs, 16 meshes of a part, starts of a fit,
    trials of effects, variants of a comparison, and the shipped scenes.
    """
    run: tuple[tuple[str, ...], tuple[str, ...]] = (("run",), ("--no-figures",))
    two = HEAD.format(tool="b.tip", size="25 mm") + SECOND.format(size="22 mm")
    study = f"{HEAD.format(tool='a.tip', size='40 mm')}{STUDY.format(sizes=SIZES)}"
    axes, targets = MACHINES / "three_axis.toml", str(MACHINES / "three_axis_targets.toml")
    return [
        *(
            Work(f"one part, cells of {size}", HEAD.format(tool="a.tip", size=size), run)
            for size in sizes
        ),
        Work("two parts of about 100k dofs", two, run),
        Work("16 meshes of one part", study, (("study",), ("meshes",))),
        Work("identify: 8 starts", axes, (("identify",), (targets, "--starts", "8"))),
        Work("effects of a contour", MACHINES / "tripteor.toml", (("effects",), SHORT_CONTOUR)),
        Work(
            "compare: 3 models", axes, (("compare",), ("--variants", "YCE", "--fidelity", MODELS))
        ),
        *(
            Work(f"machines/{path.name}", path, run)
            for path in sorted(MACHINES.glob("*.toml"))
            if not path.stem.endswith("_targets")
        ),
    ]


def main() -> None:
    """Print a table of work and ranks."""
    parser = argparse.ArgumentParser()
    parser.add_argument("repeats", nargs="?", type=int, default=5)
    parser.add_argument("--ranks", default="2")
    parser.add_argument("--only", default="")
    parser.add_argument("--busy", action="store_true")
    parser.add_argument("--one-thread", action="store_true")
    parser.add_argument("--threads", action="store_true")
    options = parser.parse_args()
    repeats, ranks = options.repeats, [int(count) for count in options.ranks.split(",")]
    cores = len(os.sched_getaffinity(0))
    print(
        f"{cores} cores, {'one of them busy, ' if options.busy else ''}"
        f"load {os.getloadavg()[0]:.1f}, medians of {repeats} alternating runs"
    )
    if options.threads:
        print(
            f"{'':30} {'1 thread':>9} {'2 threads':>9} {'ratio':>6}  computed for 4, 8, 16 threads"
        )
        for work in list_work(("45 mm", "25 mm", "16.5 mm"))[:3]:
            _compare_threads(work, repeats)
        return
    print(
        f"{'':30} {'1 rank':>8}"
        + "".join(f" {f'{count} ranks':>8} {'ratio':>6}" for count in ranks)
    )
    threads = 1 if options.one_thread else max(1, cores - options.busy)
    with _busy_core() if options.busy else contextlib.nullcontext():
        for work in (work for work in list_work() if options.only in work.name):
            _compare(work, ranks, repeats, threads)


def _compare(work: Work, ranks: list[int], repeats: int, cores: int) -> None:
    """Print the row of a kind of work."""
    _measure(work, 1, cores)  # loads libraries and compiles kernels
    seconds: dict[int, list[float]] = {count: [] for count in (1, *ranks)}
    for _ in range(repeats):
        for count, found in seconds.items():
            found.append(_measure(work, count, cores))
    middle = {count: statistics.median(found) for count, found in seconds.items()}
    slow = max(middle.values()) > MOST_TIMES * middle[1] + MOST_SECONDS
    print(
        f"{work.name:30} {middle[1]:8.1f}"
        + "".join(f" {middle[count]:8.1f} {middle[1] / middle[count]:6.2f}" for count in ranks)
        + (f"  more than {MOST_TIMES} x one rank + {MOST_SECONDS:.0f} s" if slow else ""),
        flush=True,
    )


@contextlib.contextmanager
def _busy_core() -> Iterator[None]:
    """Another program works all the time."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        time.sleep(60.0)  # until the load of the last minute knows it
        yield
    finally:
        process.kill()
        process.wait()


def _compare_threads(work: Work, repeats: int) -> None:
    """Print what a second BLAS thread brings, and more would."""
    _measure(work, 1, 1)
    found = [[_measure(work, 1, threads) for threads in (1, 2)] for _ in range(repeats)]
    one, two = (statistics.median(times) for times in zip(*found, strict=True))
    share = 2.0 * (1.0 - two / one)
    more = (1.0 / (1.0 - share + share / threads) for threads in (4, 8, 16))
    print(
        f"{work.name:30} {one:9.1f} {two:9.1f} {one / two:6.2f}  "
        + ", ".join(f"{ratio:.2f}" for ratio in more),
        flush=True,
    )


def _measure(work: Work, ranks: int, threads: int) -> float:
    """Wall-clock time [s] of a command from an empty store."""
    with tempfile.TemporaryDirectory(prefix="headstock-benchmark-") as place:
        scene = work.scene if isinstance(work.scene, Path) else Path(place) / "scene.toml"
        if isinstance(work.scene, str):
            scene.write_text(work.scene)
        before, after = work.words
        folder = () if before == ("effects",) else ("-o", str(Path(place) / "out"))
        words = [*before, str(scene), *after, *folder]
        program = [sys.executable, "-P", "-m", "mpi4py", "-m", "headstock.app.command_line", *words]
        variables = {
            **os.environ,
            "HEADSTOCK_STORE": str(Path(place) / "store"),
            **dict.fromkeys(THREADS, str(threads if ranks == 1 else 1)),
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
