"""What is done with machines, in the same way as by the command of the same name: ``load``,
``check``, ``plan``, ``run`` and so on.

All of it is collective under MPI: every rank calls it with the same arguments and gets the same
answer. An error on one rank leaves the others waiting: start with ``mpirun python -m mpi4py``.
"""

import contextlib
import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from mpi4py import MPI

from headstock.machine import Machine, write_settings
from headstock.pipeline.accuracy.search import plan_first_round
from headstock.pipeline.planning.plan import Plan, StageRecord
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.files import RESULTS_FILE, SUMMARY_FILE, open_results
from headstock.pipeline.results.mode_files import MODES_FOLDER, VOLUME_FOLDER, write_mode_files
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.part_files import find_missing_patches
from headstock.pipeline.stages.rigid_checks import find_unheld_motions
from headstock.pipeline.storage.outputs import claim_output
from headstock.pipeline.storage.provenance import Provenance, SceneChoice, trace_content
from headstock.scene.reading.findings import Findings, SceneError, suggest_names
from headstock.scene.reading.toml_text import write_toml
from headstock.scene.scene import Scene, keep_analyses, list_analyses
from headstock.solvers.ranks import share_from_root

type Source = Machine | str | Path  # a machine, or the path of a scene file


def load(
    path: str | Path, *, variant: str | None = None, set: Mapping[str, object] | None = None
) -> Machine:
    """A machine from a scene file.

    Args:
        path: A ``.toml`` file.
        variant: One of its variants, or several joined by ``+``.
        set: Dotted key to value, applied after the variant; numbers are in SI units.

    Raises:
        SceneError: Anything is wrong; ``problems`` has every problem with file, line, key and
            remedy.
    """
    return Machine.load(SceneChoice(Path(path), variant, tuple(write_settings(set or {}))))


def check(machine: Source) -> tuple[str, ...]:
    """What is allowed but looks wrong: bodies that move freely, odd numbers, what an analysis on
    request lacks.

    Raises:
        SceneError: Anything is wrong.
    """
    scene = _machine(machine).scene
    problems, remarks = find_missing_patches(scene)
    if problems:
        raise SceneError(problems)
    lacking = [
        f"analysis {name}: {problem.place}: {problem.key}: {problem.message}"
        for name, problems in scene.deferred.items()
        for problem in problems
    ]
    return (*scene.warnings, *lacking, *find_unheld_motions(scene), *remarks)


def plan(machine: Source) -> Plan:
    """The stages that a machine calls for, each with its reason and an estimate of its cost."""
    scene = _machine(machine).scene
    return plan_scene(scene, survey=True) if scene.accuracy is None else plan_first_round(scene)


def run(
    machine: Source,
    *,
    output: str | Path | None = None,
    analyses: Sequence[str] = (),
    volume: bool = False,
    progress: Callable[[StageRecord], None] = lambda record: None,
    comm: MPI.Comm | None = None,
) -> Results:
    """Run the analyses of a machine; meshes and superelements come from the user's store where they
    are there.

    Args:
        machine: Machine or path of a scene file.
        output: Folder for ``results.h5`` and ``summary.json``, which ``open`` reads and
            ``headstock report`` makes a page of; None for no files.
        analyses: Names of those to run; empty for all but those on request.
        volume: Write the volume meshes with modes and stresses, too.
        progress: Called with each stage that has ended, on rank 0.
        comm: Ranks that compute together; all that were started where None.

    Raises:
        SceneError: The machine has problems.
        HeadstockError: A computation or a file failed; earlier files are untouched.
    """
    comm = comm or MPI.COMM_WORLD
    made = _machine(machine)
    scene = _with_analyses(made.scene, analyses)
    origin = _trace(made, analyses, comm.size) if comm.rank == 0 else None
    with _folder(output, comm) as folder:
        results = run_scene(
            scene, folder, comm=comm, observer=progress, volume=volume, provenance=origin
        )
        if output is not None and comm.rank == 0:
            write_mode_files(folder, summarise(results)["modal"], results.view)
    if comm.size == 1:
        return results
    # meshes stay on rank 0: other ranks have the surfaces
    shared = dataclasses.replace(results, volumes=None)
    found = share_from_root(comm, shared if comm.rank == 0 else None)
    return results if comm.rank == 0 else found


def open(folder: str | Path) -> Results:
    """The results of a run from its folder, of the same type as those of ``run``.

    Raises:
        OutputError: There are none, or they are damaged or of another version.
    """
    return open_results(Path(folder))


def _machine(source: Source) -> Machine:
    return source if isinstance(source, Machine) else load(source)


def _with_analyses(scene: Scene, names: Sequence[str]) -> Scene:
    present = list_analyses(scene)
    findings = Findings(str(scene.path))
    for name in names:
        if name not in present:
            findings.add(
                ("analyses", name), suggest_names(name, present, what="analyses of this scene")
            )
    findings.raise_if_any()
    return keep_analyses(scene, names) if names else scene


@contextlib.contextmanager
def _folder(output: str | Path | None, comm: MPI.Comm) -> Iterator[Path]:
    """The folder of a run, which no other writes into; a temporary one where none is wanted."""
    with contextlib.ExitStack() as stack:
        folder = Path() if output is None else Path(output)
        if comm.rank == 0 and output is None:
            scratch = tempfile.TemporaryDirectory(prefix="headstock-run-")
            folder = Path(stack.enter_context(scratch))
        elif comm.rank == 0:
            parts = (MODES_FOLDER, VOLUME_FOLDER)
            stack.enter_context(claim_output(folder, (RESULTS_FILE, SUMMARY_FILE), parts))
        yield share_from_root(comm, folder)


def _trace(machine: Machine, analyses: Sequence[str], ranks: int) -> Provenance:
    choice, path = machine.choice, machine.scene.path
    if choice is None or not path.is_file():
        content = write_toml(machine.table).encode()
        choice = SceneChoice(path, machine.scene.variant)
    else:
        content = path.read_bytes()
    named = dataclasses.replace(choice, analyses=tuple(analyses))
    return trace_content(named, content, ranks=ranks)
