"""Stand-ins for the programs of Slurm."""

import sys
from pathlib import Path

# runs every array task there and then, with no more of the environment than the script asks for
SBATCH = """\
import os, pathlib, subprocess, sys
here = pathlib.Path(__file__).resolve().parent
if "--version" in sys.argv:
    sys.exit(print("slurm 0"))
refusal = here / "refusal"
if refusal.exists():
    sys.exit(refusal.read_text())
words, script = sys.argv[1:-1], pathlib.Path(sys.argv[-1])
with (here / "calls").open("a") as calls:
    calls.write(" ".join(words) + "\\n")
job = len((here / "calls").read_text().splitlines())
(tasks,) = [word.removeprefix("--array=") for word in words if word.startswith("--array=")]
bad = (here / "bad").read_text().split() if (here / "bad").exists() else []
lines = []
for task in tasks.split(","):
    state = "PENDING" if "later" in bad else "CANCELLED" if task in bad else "COMPLETED"
    if state == "COMPLETED":
        # the kernels of a BLAS are a matter of the machine: the launcher would choose the same ones on each; files that
        # are opened are noted in the job, too
        names = ("HOME", "PATH", "OPENBLAS_CORETYPE", "LD_PRELOAD", "OPENED_FILES")
        kept = {name: os.environ[name] for name in names if name in os.environ}
        log = script.parent / "slurm" / f"{job}_{task}.log"
        done = subprocess.run(["sh", str(script)], env={**kept, "SLURM_ARRAY_TASK_ID": task}, stdout=log.open("w"), stderr=subprocess.STDOUT)
        state = "FAILED" if done.returncode else state
    lines.append(f"{task}|{state}|None\\n")
(here / f"states-{job}").write_text("".join(lines))
print(job)
"""
SQUEUE = """\
import pathlib, sys
here = pathlib.Path(__file__).resolve().parent
if "--version" in sys.argv:
    sys.exit(print("slurm 0"))
(job,) = [word.removeprefix("--jobs=") for word in sys.argv if word.startswith("--jobs=")]
path = here / f"states-{job}"
sys.exit(print(path.read_text(), end="") if path.exists() else "slurm_load_jobs error: Invalid job id specified")
"""


def write_stand_ins(folder: Path) -> None:
    """Put them into a new folder, which is to come first on PATH."""
    folder.mkdir()
    for name, text in (("sbatch", SBATCH), ("squeue", SQUEUE)):
        (folder / name).write_text(f"#!{sys.executable}\n{text}")
        (folder / name).chmod(0o755)
