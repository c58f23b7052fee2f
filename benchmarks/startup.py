"""CPU seconds that commands take before and after they compute, beside those of a base commit.

    ./headstock exec python3 benchmarks/startup.py --base COMMIT [--pairs 7] [--only PATTERN] [--keep DIR]

Both trees run each command in turn, the launcher included, with one BLAS thread and a store of
their own; a first run that is not counted fills stores and caches of compiled code. What the
machine does besides lengthens both, so only the medians of the ratios mean something. The table has
a row per command: medians of both [CPU s, user and system], and the median, lowest and highest
ratio of the pairs.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from fnmatch import fnmatchcase
from pathlib import Path

from same_numbers import PROJECT, check_out

LOAD = "import headstock as hs; hs.load('machines/three_axis.toml')"
COMMANDS = {
    "--version": ("--version",),
    "--help": ("--help",),
    "check": ("check", "machines/three_axis.toml"),
    "warm run": ("run", "machines/three_axis.toml", "-o", "RESULTS"),
    "hs.load": ("exec", "python3", "-P", "-c", LOAD),
}
DROPPED = ("PYTHONPATH", "HEADSTOCK_COMMAND", "PETSC_OPTIONS")  # the launcher's of this process


def measure(tree: Path, words: tuple[str, ...], scratch: Path) -> float:
    """Return the CPU seconds of one command, user and system, of all its processes."""
    own = {name: text for name, text in os.environ.items() if name not in DROPPED}
    own |= {"HEADSTOCK_THREADS": "1", "HEADSTOCK_STORE": str(scratch / "store")}
    results = str(scratch / "results")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [tree / "headstock", *(word.replace("RESULTS", results) for word in words)],
        cwd=tree,
        env=own,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Measure pairs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--base", required=True, metavar="COMMIT")
    parser.add_argument("--pairs", type=int, default=7, metavar="N", help="of each command [7]")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="these commands [all]")
    parser.add_argument("--keep", metavar="DIR", help="keep the base and both stores here")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="headstock-startup-") as temporary:
        place = Path(arguments.keep or temporary).resolve()
        place.mkdir(parents=True, exist_ok=True)
        trees = (check_out(arguments.base, place), PROJECT)
        scratches = (place / "base", place / "now")
        print(f"{'':12s}{'base':>8s}{'now':>8s}{'ratio':>8s}   of {arguments.pairs} pairs")
        for name, words in COMMANDS.items():
            if not fnmatchcase(name, arguments.only):
                continue
            pairs = [
                [measure(tree, words, own) for tree, own in zip(trees, scratches, strict=True)]
                for _ in range(arguments.pairs + 1)
            ][1:]
            base, now = (statistics.median(side) for side in zip(*pairs, strict=True))
            ratios = sorted(second / first for first, second in pairs)
            print(
                f"{name:12s}{base:8.2f}{now:8.2f}{statistics.median(ratios):8.2f}"
                f"   {ratios[0]:.2f} to {ratios[-1]:.2f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
