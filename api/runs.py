"""A run and its results: ``run`` and ``open``.

All of it is collective under MPI: every rank calls it with the same arguments and gets the same
answer. An error on one rank leaves the others waiting: start with ``mpirun python -m mpi4py``.
"""

import contextlib
import dataclasses
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from headstock.arguments import (
    check_call,
    read_names,
    read_path_argument,
)
from headstock.loading import Source, take_machine
from headstock.machine import Machine
from headstock.pipeline.numbers.folders import RESULTS_FILE, SUMMARY_FILE
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.files import (
    FIGURES_FOLDER,
    REPORT_FILE,
    TABLES_FOLDER,
    open_results,
)
from headstock.pipeline.results.mode_files import MODES_FOLDER, VOLUME_FOLDER, write_mode_files
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.outputs import claim_output, remove_outputs, replace_outputs
from headstock.pipeline.storage.provenance import Provenance, SceneChoice, trace_content
from headstock.scene.expansion.includes import scene_content
from headstock.scene.reading.files import write_toml
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.scene import Scene, keep_analyses, list_analyses
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import share_from_root

# what a run writes into its folder or removes there
RUN_FILES = (RESULTS_FILE, SUMMARY_FILE, REPORT_FILE)
RUN_PARTS = (MODES_FOLDER, VOLUME_FOLDER, TABLES_FOLDER, FIGURES_FOLDER)


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
            ``headstock report`` makes a page of; pages of an earlier run are removed. None for no
            files.
        analyses: Names of those to run; empty for all but those on request.
        volume: Write the volume meshes with modes and stresses, too.
        progress: Called with each stage that has ended, on rank 0.
        comm: Ranks that compute together; all that were started where None.

    Raises:
        SceneError: The machine has problems.
        HeadstockError: A computation or a file failed; earlier files are untouched.
    """
    check_call(progress, "run")
    comm = comm or MPI.COMM_WORLD
    made, analyses = take_machine(machine, "run"), read_names(analyses, "run", "analyses")
    scene = _with_analyses(made.scene, analyses)
    origin = _trace(made, analyses, comm.size) if comm.rank == 0 else None
    with claim_folder("run", output, comm, RUN_FILES, RUN_PARTS) as folder:
        results = run_scene(
            scene, folder, comm=comm, observer=progress, volume=volume, provenance=origin
        )
        if output is not None and comm.rank == 0:
            write_mode_files(folder, results.modal, results.view)
            # of an earlier run: pages and pictures are made by `headstock report`
            remove_outputs(folder, [REPORT_FILE])
            for part in (TABLES_FOLDER, FIGURES_FOLDER):
                replace_outputs(folder, part, {})
    if comm.size == 1:
        return results
    # meshes stay on rank 0: other ranks have the surfaces
    shared = dataclasses.replace(results, volumes=None)
    found = share_from_root(comm, shared if comm.rank == 0 else None)
    return results if comm.rank == 0 else found


def open(folder: str | Path) -> Results:
    """Open the results of a run from its folder, of the same type as those of ``run``.

    Raises:
        OutputError: There are none, or they are damaged or of another version.
    """
    return open_results(read_path_argument(folder, "open", "folder"))


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
def claim_folder(
    function: str,
    output: str | Path | None,
    comm: MPI.Comm,
    names: Iterable[str] = (),
    parts: Iterable[str] = (),
) -> Iterator[Path]:
    """Claim an output folder that no other run writes into, with files and folders in it that will
    be written; a temporary one where none is wanted. Not public.
    """
    with contextlib.ExitStack() as stack:
        folder = Path() if output is None else read_path_argument(output, function, "output")
        if comm.rank == 0 and output is None:
            scratch = tempfile.TemporaryDirectory(prefix="headstock-results-")
            folder = Path(stack.enter_context(scratch))
        elif comm.rank == 0:
            stack.enter_context(claim_output(folder, names, parts))
        yield share_from_root(comm, folder)


def _trace(machine: Machine, analyses: Sequence[str], ranks: int) -> Provenance:
    choice, path = machine.choice, machine.scene.path
    if choice is None or not path.is_file():
        content = write_toml(machine.table).encode()
        choice = SceneChoice(path, machine.scene.variant)
    else:
        content = scene_content(path)
    named = dataclasses.replace(choice, analyses=tuple(analyses))
    return trace_content(named, content, ranks=ranks, accepted=machine.scene.questions)
