"""Running the points of a study one after the other, each once, through the same runner as
``headstock run``.
"""

import contextlib
import errno
import hashlib
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.planning.resources import Cost, measure, search_once, watch_memory
from headstock.pipeline.preview.watched_numbers import find_name_fault
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.results.summary_keys import (
    ANY_NUMBER,
    ANYTHING,
    Shape,
    list_summary_keys,
)
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.content_keys import hash_dependencies
from headstock.pipeline.storage.outputs import OutputError
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.includes import scene_content
from headstock.scene.expansion.overrides import VARIANT_JOINER, split_variant
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Problem, SceneError, show_key, suggest_names
from headstock.scene.reading.keys import read_entries
from headstock.scene.reading.names import NAMES, RESULT_KEYS
from headstock.scene.reading.watch_paths import MEASURED_NAMES, POSE_NAME, Step, parse_watch
from headstock.scene.scene import Scene, keep_analyses
from headstock.scene.studies import REFERENCE_RUN, Study, StudyPoint, expand_study, make_point
from headstock.solvers.errors import CompileError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import SharedFailure, make_on_root
from headstock.studies.parameters.records import (
    Measured,
    StudyRecord,
    append_record,
    open_records,
    read_records,
)
from headstock.studies.points import (
    Settle,
    compute_points,
    list_waiting,
    scratch_store,
    try_plan,
)

RENAMED = RESULT_KEYS["summary.json"]
LOST_DISK = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EFBIG, errno.EROFS)
ElementKind = tuple[str, str, int]  # fidelity, cells, order
Measure = Callable[[Scene, Results], Measured]


def _blames_surroundings(error: BaseException) -> bool:
    """Tell whether the same computation may well succeed once there is room on the disk, so that the
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
    """A finished point: its number, of how many, its record, and whether it was finished before."""

    number: int
    total: int
    point: StudyPoint
    record: StudyRecord
    known: bool


def hash_scene(path: Path) -> str:
    """SHA-256 of a scene file, with what it includes."""
    return hashlib.sha256(scene_content(path)).hexdigest()


def check_study(job: StudyJob) -> None:
    """Load the scene with every varied value, one at a time, before anything is computed; pairs are
    loaded together. What is watched must be something that a point finds.

    Raises:
        SceneError: A value or a watched path does not fit; holds the problems of all of them.
    """
    problems: list[Problem] = []
    scenes: list[Scene] = []
    for point in _list_checked(job.study):
        try:
            scenes.append(_load_point(job, point))
        except SceneError as error:
            problems += [problem for problem in error.problems if problem not in problems]
    for number, watch in enumerate(job.study.watch if scenes else ()):
        if fault := _find_watch_fault(watch, scenes):
            key = ("studies", job.study.name, "watch", number)
            problems.append(
                scenes[0].findings.describe(key, fault)
                if job.study.name in scenes[0].studies
                else Problem(str(job.path), show_key(key), "", fault)
            )
    if problems:
        raise SceneError(problems)


def _list_checked(study: Study) -> Iterator[StudyPoint]:
    """Yield points in which every value is varied, one at a time; pairs together."""
    for family in study.families:
        if family.pairwise:
            for values in zip(*family.vary.values(), strict=True):
                yield make_point(family, dict(zip(family.vary, values, strict=True)))
            continue
        first = {key: values[0] for key, values in family.vary.items()}
        for varied in [{**first, key: v} for key, own in family.vary.items() for v in own] or [{}]:
            yield make_point(family, varied)


def _find_watch_fault(text: str, scenes: Sequence[Scene]) -> str:
    """Return why a watched path leads nowhere in any point of a study; empty where it may lead
    somewhere.

    Args:
        text: The path, or the name of numbers.
        scenes: Of the points, with the analyses that they run.
    """
    path = parse_watch(text)
    if path.names_numbers:
        return find_name_fault(text, scenes)
    root = str(path.steps[0])
    if root in MEASURED_NAMES:
        return "" if len(path.steps) == 1 else f"{text}: {root} is a number; write {root}"
    analyses = {name for scene in scenes for name in scene.analyses.names}
    if root in NAMES and root not in analyses:
        return f"{text}: no point runs the analysis {root}; {suggest_names(root, analyses, what='analyses')}"
    poses = {pose for scene in scenes for pose in scene.poses}
    fault = _find_fault(path.steps, list_summary_keys(), "", poses)
    return f"{text}: {fault}" if fault else ""


def _find_fault(steps: Sequence[Step], shape: Shape, label: str, poses: Collection[str]) -> str:
    """Return where steps leave what a value of a summary can hold; empty where they do not."""
    if shape is None:
        return f"{label} is a single value, without {steps[0]!r}" if steps else ""
    if isinstance(shape, dict):
        return _find_key_fault(steps, shape, label, poses)
    mark, item = shape
    if mark == ANYTHING:
        return ""
    if mark == ANY_NUMBER:
        return _find_list_fault(steps, item, label, poses)
    if not steps:
        return f"{label} is a table; name one of its entries"
    if not isinstance(steps[0], str):
        return f"{label} is a table, not a list"
    return _find_fault(steps[1:], item, f"{label}.{steps[0]}", poses)


def _find_key_fault(
    steps: Sequence[Step], table: Mapping[str, Shape], label: str, poses: Collection[str]
) -> str:
    """As ``_find_fault``, of a table whose keys are known."""
    if not steps:
        return f"{label} is a table; name one of {', '.join(table)}"
    step = steps[0]
    if not isinstance(step, str):
        return f"{label} is a table, not a list"
    name = step if step in table else RENAMED.get(step, step)
    if name not in table:
        return (
            f"{label or 'the summary'} has no {step!r}; {suggest_names(step, table, what='keys')}"
        )
    return _find_fault(steps[1:], table[name], f"{label}.{name}" if label else name, poses)


def _find_list_fault(steps: Sequence[Step], item: Shape, label: str, poses: Collection[str]) -> str:
    """As ``_find_fault``, of a list; of an entry per pose by the name of the pose, or the first one's."""
    if not steps:
        return _find_fault(steps, item, f"{label}[0]", poses)
    if not isinstance(steps[0], str):
        return _find_fault(steps[1:], item, f"{label}[{steps[0]}]", poses)
    if isinstance(item, dict) and POSE_NAME in item:
        return _find_fault(steps[1:] if steps[0] in poses else steps, item, label, poses)
    return f"{label} is a list; write {label}[0]"


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
    keys = [_point_key(job, point, ranks=comm.size) for point in points] if comm.rank == 0 else []
    study = _Points(points, keys, observer)
    waiting = make_on_root(comm, lambda: study.resume(read_records(folder), retry=job.retry))
    warm: set[ElementKind] | None = set() if warm_up and job.study.cold else None
    with (
        search_once(),
        open_records(folder) if keys and waiting else contextlib.nullcontext() as journal,
    ):

        def keep(number: int, record: StudyRecord) -> None:
            if journal is not None:
                append_record(journal, study.keep(number, record))

        compute_points(
            waiting,
            lambda number, comm, settle: _compute_point(job, points[number], comm, warm, settle),
            comm=comm,
            folder=folder,
            together=job.study.cold,
            plan=lambda number: try_plan(lambda: _load_point(job, points[number])),
            observer=keep,
        )
    return study.list_records()


@dataclass(frozen=True, eq=False)
class _Points:
    """Points of a study and what is known of them, on rank 0; equal points share a record.

    Attributes:
        keys: Of each point; none on other ranks.
        observer: Called with each point that is finished.
    """

    points: Sequence[StudyPoint]
    keys: Sequence[str]
    observer: Callable[[StudyProgress], None]
    known: dict[str, StudyRecord] = field(default_factory=dict)

    def resume(self, records: Mapping[str, StudyRecord], *, retry: bool) -> list[int]:
        """Take finished points from earlier records; the numbers of those that are to be computed.

        Args:
            retry: Points that failed are computed again.
        """
        waiting = list_waiting(
            self.keys, records, again=lambda record: retry and record.status == "failed"
        )
        self.known.update(records)
        self._report(records.keys() - {self.keys[number] for number in waiting})
        return waiting

    def keep(self, number: int, record: StudyRecord) -> StudyRecord:
        """Take the record of a point, and return it with its key."""
        key = self.keys[number]
        self.known[key] = replace(record, key=key)
        self._report({key}, computed=number)
        return self.known[key]

    def list_records(self) -> list[StudyRecord]:
        """Return a record per point, in order."""
        return [
            replace(self.known[key], family=point.family, varied=dict(point.varied))
            for key, point in zip(self.keys, self.points, strict=False)  # no keys on other ranks
        ]

    def _report(self, finished: Collection[str], *, computed: int | None = None) -> None:
        for number, key in enumerate(self.keys):
            if key in finished:
                point = self.points[number]
                record = replace(self.known[key], family=point.family, varied=dict(point.varied))
                known = number != computed
                self.observer(StudyProgress(number, len(self.points), point, record, known))


def _point_key(job: StudyJob, point: StudyPoint, *, ranks: int) -> str:
    """SHA-256 of everything a point's results depend on: the scene, its files, the settings, and
    this program.

    What is watched is not part of it: a record holds the whole summary.

    Args:
        ranks: MPI ranks: they are part of what seconds mean.
    """
    cold = job.study.cold or job.study.repeats > 1
    variants = read_entries(job.raw, "variants")
    return hash_dependencies(
        job.path.parent,
        job.raw,
        variant=[variants[name] for name in split_variant(point.variant or None)],
        settings=dict(point.settings),
        analyses=sorted(point.analyses),
        timing=(job.study.cold, job.study.repeats, ranks) if cold else None,
        measure=job.measure_name,
    )


def _load_point(job: StudyJob, point: StudyPoint) -> Scene:
    variant = VARIANT_JOINER.join(filter(None, [job.variant, point.variant])) or None
    scene = load_scene(job.path, variant=variant, overrides=job.overrides, values=point.settings)
    return keep_analyses(scene, point.analyses) if point.analyses else scene


def _compute_point(
    job: StudyJob,
    point: StudyPoint,
    comm: MPI.Comm,
    warm: set[ElementKind] | None,
    settle: Settle,
) -> StudyRecord:
    """A record without a key; adds to the kinds of elements that this process has run, if those
    count.

    Args:
        warm: Kinds of elements that this process has run; None where no seconds are measured.
        settle: Called before each stage.
    """
    ranks, threads = int(comm.size), int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1))
    record = StudyRecord("", point.family, dict(point.varied), "done", threads=threads, ranks=ranks)
    try:
        runs = _repeat_point(job, point, comm, warm, settle)
    except (HeadstockError, SceneError, MemoryError, SharedFailure) as error:
        return replace(record, status="failed", error=_describe_failure(error, comm))
    if comm.rank > 0:
        return record
    results = runs[-1].results
    summary = summarise(results)
    summary.pop("files", None)
    return replace(
        record,
        status="failed" if results.failures else "done",
        error="; ".join(results.failures),
        summary=summary,
        numbers=results.numbers,
        measured=job.measure(runs[-1].scene, results) if job.measure else Measured(),
        seconds=tuple(run.cost.seconds for run in runs),
        cpu_seconds=tuple(run.cost.cpu_seconds for run in runs),
        peak_mb=tuple(run.peak_mb for run in runs if run.peak_mb is not None),
        cached_stages=sum(stage.cached for stage in results.stages),
    )


def _describe_failure(error: Exception, comm: MPI.Comm) -> str:
    """Return why a point failed.

    Raises:
        Exception: The error itself, where it is none of this point alone.
    """
    cause = error.__cause__ if isinstance(error, SharedFailure) else error
    # what is no property of this point is computed when the study is started again
    if isinstance(cause, StudyError) or _blames_surroundings(error):
        raise error
    if cause is error and comm.size > 1:
        raise error  # what other ranks do not know of ends them all
    return f"{type(cause).__name__}: {cause}"


class _PointRun(NamedTuple):
    """A run of a point, what it cost, and its most memory [MB] where that is known."""

    scene: Scene
    results: Results
    cost: Cost
    peak_mb: float | None


def _repeat_point(
    job: StudyJob,
    point: StudyPoint,
    comm: MPI.Comm,
    warm: set[ElementKind] | None,
    settle: Settle,
) -> list[_PointRun]:
    """Run a point as often as its study asks."""
    # the first run of a kind of element loads libraries and compiles kernels: not a cost of this point
    is_reference, warm_up = point.family == REFERENCE_RUN, False
    if warm is not None:
        kinds = make_on_root(comm, lambda: _element_kinds(_reload(job, point)))
        warm_up = not is_reference and not kinds <= warm
        warm |= kinds
    runs = []
    for _ in range(warm_up + (1 if is_reference else job.study.repeats)):
        with (
            scratch_store(cold=job.study.cold) as (scratch, store),
            watch_memory() as peak,
            measure() as cost,
        ):
            scene = make_on_root(comm, lambda: _reload(job, point))
            results = run_scene(
                replace(scene, exports={}),
                scratch,
                comm=comm,
                store=store,
                announce=lambda stage: settle(),
            )
        runs.append(_PointRun(scene, results, cost, peak.megabytes))
    return runs[warm_up:]


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
