"""Running the points of a study one after the other, each once, through the same runner as
``headstock run``.
"""

import contextlib
import errno
import hashlib
import importlib
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.planning.budgets import BASE_MB
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.resources import (
    Cost,
    measure,
    node_memory_bytes,
    search_once,
    watch_memory,
)
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.components import ELASTIC_MODULE
from headstock.pipeline.stages.run_state import Announcer
from headstock.pipeline.stages.shared_components import expect_job
from headstock.pipeline.storage.content_keys import (
    PACKAGES,
    REDUCTION_LIBRARIES,
    canonical_json,
    code_fingerprint,
    file_digests,
    library_versions,
)
from headstock.pipeline.storage.outputs import OutputError
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.includes import scene_content
from headstock.scene.expansion.overrides import VARIANT_JOINER, split_variant
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Problem, SceneError, show_key
from headstock.scene.reading.keys import read_entries
from headstock.scene.scene import Scene, keep_analyses
from headstock.scene.studies import REFERENCE_RUN, Study, StudyPoint, expand_study, make_point
from headstock.solvers.errors import CompileError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import SharedFailure, make_on_root
from headstock.solvers.shared_work import Job, share_work
from headstock.studies.parameters.records import (
    Measured,
    StudyRecord,
    append_record,
    open_records,
    read_records,
)
from headstock.studies.parameters.watches import find_watch_fault

LOST_DISK = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EFBIG, errno.EROFS)
# of no influence on a point's results
IRRELEVANT_SECTIONS = ("name", "studies", "sweeps", "variants", "compare")
ElementKind = tuple[str, str, int]  # fidelity, cells, order
Measure = Callable[[Scene, Results], Measured]


def blames_surroundings(error: BaseException) -> bool:
    """Whether the same computation may well succeed once there is room on the disk, so that the
    error must not be kept as its result.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OutputError | CompileError) or (
            isinstance(cause, OSError) and cause.errno in LOST_DISK
        ):
            return True
        cause = cause.__cause__ or cause.__context__
    return False


class StudyError(HeadstockError):
    """A study cannot go on."""


@dataclass(frozen=True, eq=False)
class StudyJob:
    """A study of a scene file, as it was when the study was started.

    Attributes:
        raw: Parsed scene after the variant and overrides the study was started with.
        content: SHA-256 of the file.
        overrides: ``key=value`` settings it was started with.
        measure: Makes more of a point's results than its summary holds; None for studies of one's
            own.
        measure_name: Names ``measure`` in the keys of finished points.
        retry: Points that failed before are computed again.
    """

    path: Path
    study: Study
    raw: TomlTable
    content: str
    variant: str | None = None
    overrides: tuple[str, ...] = ()
    measure: Measure | None = None
    measure_name: str = ""
    retry: bool = False


@dataclass(frozen=True, eq=False)
class StudyProgress:
    """A point that is finished: its number, of how many, its record, and whether it was finished
    before.
    """

    number: int
    total: int
    point: StudyPoint
    record: StudyRecord
    known: bool


def hash_scene(path: Path) -> str:
    """SHA-256 of a scene file, with what it includes."""
    return hashlib.sha256(scene_content(path)).hexdigest()


def check_points(job: StudyJob) -> None:
    """Load the scene with every varied value, one at a time, before anything is computed; pairs are
    loaded together. What is watched must be something that a point finds.

    Raises:
        SceneError: A value or a watched path does not fit; holds the problems of all of them.
    """
    problems: list[Problem] = []
    scenes: list[Scene] = []
    for family in job.study.families:
        first = {key: values[0] for key, values in family.vary.items()}
        alone = [{**first, key: value} for key, values in family.vary.items() for value in values]
        pairs = [
            dict(zip(family.vary, values, strict=True))
            for values in zip(*family.vary.values(), strict=family.pairwise)
        ]
        for varied in pairs if family.pairwise else alone or [{}]:
            try:
                scenes.append(_load_point(job, make_point(family, varied)))
            except SceneError as error:
                problems += [problem for problem in error.problems if problem not in problems]
    for number, watch in enumerate(job.study.watch if scenes else ()):
        if fault := find_watch_fault(watch, scenes):
            key = ("studies", job.study.name, "watch", number)
            problems.append(
                scenes[0].findings.describe(key, fault)
                if job.study.name in scenes[0].studies
                else Problem(str(job.path), show_key(key), "", fault)
            )
    if problems:
        raise SceneError(problems)


def run_study(
    job: StudyJob,
    folder: Path,
    *,
    comm: MPI.Comm,
    observer: Callable[[StudyProgress], None] = lambda progress: None,
    warm_up: bool = True,
) -> list[StudyRecord]:
    """Compute every point that is not finished yet and record each as it ends; collective.

    A point whose computation ends with a named error is recorded with it, and the study goes on. A
    disk without room ends it. Several ranks compute a point each; where seconds are measured from
    an empty store they compute one point after the other together.

    Args:
        job: The same on every rank.
        folder: Holds ``points.jsonl``.
        comm: Ranks that share the points, or the components of each.
        observer: Called with each point on rank 0.
        warm_up: Where seconds are measured from an empty store, the first point of each kind of
            element is computed once before.

    Returns:
        One record per point, in order; empty on other ranks.

    Raises:
        StudyError: The scene file changed meanwhile.
        OutputError: A record cannot be written.
        HeadstockError: There is no room on the disk, or no compiler.
    """
    points = expand_study(job.study)
    root = comm.rank == 0
    keys = [_point_key(job, point, ranks=comm.size) for point in points] if root else []
    known: dict[str, StudyRecord] = {}

    def find_waiting() -> list[int]:
        known.update(_finished_points(folder, retry=job.retry))
        return [keys.index(key) for key in dict.fromkeys(keys) if key not in known]

    waiting = make_on_root(comm, find_waiting)
    finished = {key for key in keys if key in known}
    records = open_records(folder) if root and waiting else contextlib.nullcontext()
    with search_once(), records as journal:

        def report(number: int) -> None:
            record = _label_record(known[keys[number]], points[number])
            before = number not in waiting
            observer(StudyProgress(number, len(points), points[number], record, known=before))

        def keep(number: int, record: StudyRecord) -> None:
            if journal is not None:
                known[keys[number]] = replace(record, key=keys[number])
                append_record(journal, known[keys[number]])
                for other, key in enumerate(keys):
                    if key == keys[number]:
                        report(other)

        for number, key in enumerate(keys):
            if key in finished:
                report(number)
        if comm.size > 1 and waiting and not job.study.cold:
            _deal_points(job, comm, {number: points[number] for number in waiting}, folder, keep)
        else:
            warm: set[ElementKind] | None = set() if warm_up and job.study.cold else None
            for number in waiting:
                keep(number, _compute_point(job, points[number], comm, warm))
    return (
        [_label_record(known[key], point) for key, point in zip(keys, points, strict=True)]
        if root
        else []
    )


def _deal_points(
    job: StudyJob,
    comm: MPI.Comm,
    points: Mapping[int, StudyPoint],
    folder: Path,
    keep: Callable[[int, StudyRecord], None],
) -> None:
    """Compute each point on one rank.

    Args:
        comm: Ranks that share the points.
        keep: Called on rank 0 with the number of each finished point and its record.
    """
    numbers = list(points)
    expected = make_on_root(comm, lambda: [_expect_point(job, point) for point in points.values()])
    if any(elastic for _, elastic in expected):
        # PETSc starts on all ranks together
        importlib.import_module(ELASTIC_MODULE)

    def compute(place: int, settle: Callable[[], None]) -> StudyRecord:
        point = points[numbers[place]]
        return _compute_point(job, point, MPI.COMM_SELF, None, announce=lambda stage: settle())

    share_work(
        comm,
        [cost for cost, _ in expected],
        compute,
        folder=folder,
        memory_mb=node_memory_bytes() / 1e6,
        idle_mb=BASE_MB,
        observer=lambda place, record: keep(numbers[place], record),
    )


def _expect_point(job: StudyJob, point: StudyPoint) -> tuple[Job, bool]:
    """What a point will cost, and whether it has elastic components."""
    try:
        stages = plan_scene(_load_point(job, point)).stages
    except (HeadstockError, SceneError):
        return Job(), False  # the point says so itself
    return expect_job(stages), any(stage.kind == "reduce" for stage in stages)


def _point_key(job: StudyJob, point: StudyPoint, *, ranks: int) -> str:
    """SHA-256 of everything a point's results depend on: the scene, its files, the settings, and
    this program.

    What is watched is not part of it: a record holds the whole summary.

    Args:
        ranks: MPI ranks: they are part of what seconds mean.
    """
    content = {
        "scene": {key: value for key, value in job.raw.items() if key not in IRRELEVANT_SECTIONS},
        "files": dict(file_digests(job.path.parent, job.raw)),
        "variant": [
            read_entries(job.raw, "variants")[name] for name in split_variant(point.variant or None)
        ],
        "settings": dict(point.settings),
        "analyses": sorted(point.analyses),
        "timing": (job.study.cold, job.study.repeats, ranks)
        if job.study.cold or job.study.repeats > 1
        else None,
        "measure": job.measure_name,
        "algorithm": [code_fingerprint(package) for package in PACKAGES],
        "libraries": library_versions(REDUCTION_LIBRARIES),
    }
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()


def _finished_points(folder: Path, *, retry: bool) -> dict[str, StudyRecord]:
    records = read_records(folder)
    return {key: record for key, record in records.items() if record.status == "done" or not retry}


def _label_record(record: StudyRecord, point: StudyPoint) -> StudyRecord:
    # equal points of two families share a record
    return replace(record, family=point.family, varied=dict(point.varied))


def _load_point(job: StudyJob, point: StudyPoint) -> Scene:
    variant = VARIANT_JOINER.join(filter(None, [job.variant, point.variant])) or None
    scene = load_scene(job.path, variant=variant, overrides=job.overrides, values=point.settings)
    return keep_analyses(scene, point.analyses) if point.analyses else scene


def _compute_point(
    job: StudyJob,
    point: StudyPoint,
    comm: MPI.Comm,
    warm: set[ElementKind] | None,
    *,
    announce: Announcer = lambda stage: None,
) -> StudyRecord:
    """A record without a key; adds to the kinds of elements that this process has run, if those
    count.

    Args:
        warm: Kinds of elements that this process has run; None where no seconds are measured.
        announce: Called with each stage before it begins.
    """
    costs: list[Cost] = []
    peaks: list[float] = []
    ranks, threads = int(comm.size), int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1))
    record = StudyRecord("", point.family, dict(point.varied), "done", threads=threads, ranks=ranks)
    try:
        # the first run of a kind of element loads libraries and compiles kernels: not a cost of
        # this point
        warm_up = False
        if warm is not None:
            kinds = make_on_root(comm, lambda: _element_kinds(_reload(job, point)))
            warm_up = point.family != REFERENCE_RUN and not kinds <= warm
            warm |= kinds
        for number in range(-warm_up, 1 if point.family == REFERENCE_RUN else job.study.repeats):
            with (
                _scratch_store(cold=job.study.cold) as (scratch, store),
                watch_memory() as peak,
                measure() as cost,
            ):
                scene = make_on_root(comm, lambda: _reload(job, point))
                results = run_scene(scene, scratch, comm=comm, store=store, announce=announce)
            costs += [cost] if number >= 0 else []
            peaks += [peak.megabytes] if number >= 0 and peak.megabytes is not None else []
    except (HeadstockError, SceneError, MemoryError, SharedFailure) as error:
        cause = error.__cause__ if isinstance(error, SharedFailure) else error
        # what is no property of this point is computed when the study is started again; and what
        # other ranks do not know of ends them all
        if (
            isinstance(cause, StudyError)
            or blames_surroundings(error)
            or (cause is error and comm.size > 1)
        ):
            raise
        return replace(record, status="failed", error=f"{type(cause).__name__}: {cause}")
    if comm.rank > 0:
        return record
    summary = summarise(results)
    summary.pop("files", None)
    return replace(
        record,
        status="failed" if results.failures else "done",
        error="; ".join(results.failures),
        summary=summary,
        numbers=results.numbers,
        measured=job.measure(scene, results) if job.measure else Measured(),
        seconds=tuple(cost.seconds for cost in costs),
        cpu_seconds=tuple(cost.cpu_seconds for cost in costs),
        peak_mb=tuple(peaks),
        cached_stages=sum(stage.cached for stage in results.stages),
    )


def _reload(job: StudyJob, point: StudyPoint) -> Scene:
    if hash_scene(job.path) != job.content:
        raise StudyError(
            f"{job.path} changed while the study ran; start the study again, finished points that still hold are kept"
        )
    return _load_point(job, point)


def _element_kinds(scene: Scene) -> set[ElementKind]:
    """What a point's components are made of; of those whose settings are chosen for an accuracy it
    is mostly that.
    """
    parts = scene.machine.components.values()
    if scene.accuracy is not None:
        return {("elastic", "tet", 2)}
    return {
        (part.fidelity, part.mesh.cells, part.mesh.order)
        if part.fidelity == "elastic"
        else (part.fidelity, "", 0)
        for part in parts
    }


@contextlib.contextmanager
def _scratch_store(*, cold: bool) -> Iterator[tuple[Path, Store]]:
    """A folder for a point's files, and the store it uses: the user's, or an empty one that is
    thrown away.
    """
    with tempfile.TemporaryDirectory(prefix="headstock-study-") as folder:
        yield (
            Path(folder) / "out",
            Store(Path(folder) / "store") if cold else Store(default_store_root()),
        )
