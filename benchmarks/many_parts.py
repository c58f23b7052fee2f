"""A tower of equal blocks, each joined rigidly to the next: processor seconds and peak memory of a
run with all parts stored.

    ./headstock exec python3 benchmarks/many_parts.py [PARTS ...]

Default of PARTS: 50 100 200.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

COMMAND = (
    "import sys; from headstock.app.command_line import main; sys.argv[0] = 'headstock'; main()"
)
HEIGHT = 200  # of a block [mm]


def main() -> None:
    """Print a table of parts, seconds and megabytes."""
    counts = [int(text) for text in sys.argv[1:]] or [50, 100, 200]
    print(f"{'parts':>5} {'CPU s':>7} {'peak MB':>8}")
    with tempfile.TemporaryDirectory() as folder:
        # reduces the block; peaks are largest so far, so that counts must rise
        _measure(Path(folder), 2)
        for count in sorted(counts):
            seconds, megabytes = _measure(Path(folder), count)
            print(f"{count:5d} {seconds:7.1f} {megabytes:8.0f}", flush=True)


def write_tower(count: int) -> str:
    """A scene of equal blocks on each other."""
    lines = [
        'name = "tower"',
        "[materials.steel]",
        'E = "210 GPa"',
        "nu = 0.3",
        'rho = "7850 kg/m^3"',
    ]
    below = "ground"
    for part in range(count):
        lines += [
            f"[components.p{part}]",
            f'solid = {{ box = ["100 mm", "100 mm", "{HEIGHT} mm"] }}',
            'material = "steel"',
            'mesh = { size = "50 mm" }',
            f'at = ["0 mm", "0 mm", "{HEIGHT * part} mm"]',
            f"[components.p{part}.interfaces]",
            'foot = { face = "z-" }',
            'top = { face = "z+" }',
            f"[joints.j{part}]",
            f'between = ["{below}", "p{part}.foot"]',
            'kind = "rigid"',
        ]
        below = f"p{part}.top"
    lines += [
        "[points]",
        f'tcp = {{ tool = "{below}", work = "ground" }}',
        "[analyses.static]",
        'at = "tcp"',
    ]
    return "\n".join([*lines, "[analyses.modal]", "count = 6", ""])


def _measure(folder: Path, count: int) -> tuple[float, float]:
    """Processor time of a run [s], and the largest memory of any run so far [MB]."""
    scene = folder / f"tower_{count}.toml"
    scene.write_text(write_tower(count))
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "HEADSTOCK_STORE": str(folder / "store")}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [
            sys.executable,
            "-P",
            "-c",
            COMMAND,
            "run",
            str(scene),
            "-o",
            str(folder / f"out_{count}"),
        ],
        env=environment,
        check=True,
        capture_output=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, after.ru_maxrss / 1024.0


if __name__ == "__main__":
    main()
