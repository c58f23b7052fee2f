"""Two nodes of a real Slurm on this machine: commands in allocations of both, and a node that fails
under a job.
"""

import contextlib
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from common import Done, run_process
from faults.resume import SCENE as SWEPT_SCENE
from faults.runs import SCENE, FaultError
from faults.slurm_daemons import Slurm, run_slurm
from headstock.pipeline.storage.provenance import PROJECT

NODES = ("a", "b")
SIZES_MM = (14.0, 13.0, 12.0, 11.0, 10.0, 9.5, 9.0, 8.5)
STUDY = """
[studies.meshes]
watch = ["modal.frequencies_hz[0]"]
[studies.meshes.families.sizes]
vary = {{ "components.column.mesh.size" = [{sizes}] }}
"""
TIME_LIMIT, POLL_SECONDS = 400.0, 0.05
# both nodes of this Slurm have this machine's address, which Open MPI leaves out by itself
LOOPBACK = {"OMPI_MCA_btl_tcp_if_include": "lo"}


@dataclass(frozen=True)
class Point:
    """A finished point of a study, as its file of records has it."""

    key: str
    frequencies_hz: tuple[float, ...]


@dataclass(frozen=True)
class TwoNodes:
    """A Slurm of two nodes and a folder for scenes, stores and results."""

    root: Path
    slurm: Slurm

    @property
    def scene(self) -> Path:
        """The scene file, with a study."""
        return self.root / "scene.toml"

    def words(self, command: str, output: str) -> list[str]:
        """A command line of the program, without ranks."""
        subject = ["meshes"] if command == "study" else ["--variant", "steel", "--no-figures"]
        program = [str(PROJECT / "headstock"), command, str(self.scene), *subject]
        return [*program, "-o", str(self.root / output)]

    def run(
        self,
        words: list[str],
        *,
        nodes: int,
        store: str,
        folder: str | Path = ".",
        **variables: str,
    ) -> Done:
        """Run a command to its end, in an allocation where there are several nodes."""
        allocation = ["salloc", f"--nodes={nodes}", "--ntasks=4", "--quiet"] if nodes > 1 else []
        environment = self.environment(store) | variables
        return run_process([*allocation, *words], cwd=folder, env=environment, timeout=TIME_LIMIT)

    def environment(self, store: str) -> dict[str, str]:
        """Variables of every command; the transports are left to its launcher."""
        own = {**os.environ, **self.slurm.variables, **LOOPBACK}
        own |= {"HEADSTOCK_STORE": str(self.root / store), "HEADSTOCK_THREADS": "1"}
        return {key: value for key, value in own.items() if key != "OMPI_MCA_btl"}

    def submit(self, words: list[str], *, store: str) -> str:
        """Submit a command as a job of both nodes; the number of the job."""
        sbatch = ["sbatch", "--parsable", "--requeue", "--nodes=2", "--ntasks=2"]
        sbatch += ["--open-mode=append", f"--output={self.root}/%j.log", "--export=ALL"]
        command = [*sbatch, "--wrap", f"exec {' '.join(words)}"]
        return run_process(command, env=self.environment(store), check=True).stdout.strip()

    def job_state(self, job: str) -> str:
        """State of a job as Slurm names it."""
        command = ["squeue", "--noheader", "--states=all", f"--jobs={job}", "--format=%T"]
        return run_process(command, env=self.environment("")).stdout.strip()

    def launches(self) -> tuple[int, ...]:
        """How many job steps each node has begun."""
        logs = [(self.slurm.folder / f"slurmd-{node}.out").read_text() for node in NODES]
        return tuple(log.count("launch task") for log in logs)

    def points(self, output: str) -> list[Point]:
        """Points of a study in the order in which they were finished."""
        path = self.root / output / "points.jsonl"
        lines = path.read_text().splitlines() if path.exists() else []
        records = [json.loads(line) for line in lines if line.endswith("}")]
        return [
            Point(record["key"], tuple(record["summary"]["modal"][0]["frequencies_hz"]))
            for record in records
        ]


@contextlib.contextmanager
def run_two_nodes() -> Iterator[TwoNodes]:
    """Start a Slurm of two nodes, and stop it at the end."""
    # munged wants every folder above its socket open to all
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        root.chmod(0o755)
        sizes = ", ".join(f'"{size} mm"' for size in SIZES_MM)
        (root / "scene.toml").write_text(SCENE + STUDY.format(sizes=sizes))
        (root / "swept.toml").write_text(SWEPT_SCENE)
        with run_slurm(root / "slurm", cpus=4, nodes=NODES) as slurm:
            yield TwoNodes(root, slurm)


def fail_node_under_study(two: TwoNodes, output: str) -> list[Point]:
    """Submit a study over both nodes, let a node fail when a point is finished, start the node again
    and wait until the job, which Slurm puts back into the queue, has ended."""
    job = two.submit([*two.words("study", output), "--ranks", "2"], store=f"store-{output}")
    _wait(two, job, "finished no point", lambda: bool(two.points(output)))
    two.slurm.fail_node(NODES[1])
    before = two.points(output)
    _wait(two, job, "went on", lambda: two.job_state(job) == "PENDING")
    two.slurm.start_node(NODES[1])
    unfinished = ("PENDING", "RUNNING", "COMPLETING")
    _wait(two, job, "did not end", lambda: two.job_state(job) not in unfinished)
    if two.job_state(job) != "COMPLETED":
        raise FaultError(f"the job ended as {two.job_state(job)}: {_log(two, job)}")
    return before


def _wait(two: TwoNodes, job: str, what: str, is_done: Callable[[], bool]) -> None:
    end = time.monotonic() + TIME_LIMIT
    while not is_done():
        if time.monotonic() > end or two.job_state(job) in ("FAILED", "CANCELLED", "NODE_FAIL"):
            raise FaultError(f"the job ({two.job_state(job)}) {what}: {_log(two, job)}")
        time.sleep(POLL_SECONDS)


def _log(two: TwoNodes, job: str) -> str:
    path = two.root / f"{job}.log"
    return path.read_text(errors="replace")[-1500:] if path.exists() else "no log"
