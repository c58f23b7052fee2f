"""A scene on finer and finer meshes, until orders of convergence are seen: which meshes, how far to
go, and the numbers that are watched, modes paired by shape.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.skins import Skin
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.components.meshing import automatic_size
from headstock.pipeline.accuracy.settings import (
    FINE_GRADING,
    RIM_POWER,
    grade_mesh,
    is_chosen,
)
from headstock.pipeline.numbers.numbers import Key, Numbers, make_key
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.views import ShiftArray
from headstock.scene.reading.files import TomlValue
from headstock.scene.reading.keys import write_size
from headstock.scene.scene import Scene
from headstock.scene.studies import Study, StudyFamily
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import ModeSet, pair_modes
from headstock.solvers.ranks import make_on_root
from headstock.studies.parameters.limits import (
    TIME_SLOPE,
    Limit,
    MeshCosts,
    MeshedNumber,
    estimate_cost,
    estimate_dofs,
    find_limit,
)
from headstock.studies.parameters.records import Measured, StudyRecord
from headstock.studies.parameters.runs import StudyJob, StudyProgress, run_study
from headstock.studies.parameters.tables import median_seconds

# Sizes fall by this share: tets by the root of a half (about 2.8 times the dofs), hexes by half, so
# that their grids are nested.
TET_STEP, HEX_STEP = math.sqrt(0.5), 0.5
COARSER_THAN_WRITTEN, COARSER_THAN_RULE = 2.0, 3.0
MOST_MESHES = 9
FEWEST_ACROSS = 2
FEWEST_MESHES = {TET_STEP: 4, HEX_STEP: 3}
MOST_FAILURES = 3
BUDGET = "BudgetError"
CELLS = (
    6  # along each side of a body's bounding box, over which motions of its surface are averaged
)
DIGITS = 4


class ConvergenceError(HeadstockError):
    """No mesh of a series could be computed."""


@dataclass(frozen=True, eq=False)
class MeshSeries:
    """Meshes of a scene that differ in all their sizes by the same factor.

    Attributes:
        parts: Components whose mesh is ours to choose, with an element size each (at factor 1).
    """

    parts: Mapping[str, Component]
    factors: tuple[float, ...]
    step: float

    def settings(self, factor: float) -> dict[str, TomlValue]:
        """Keys of the scene at a factor: every length of a mesh follows, rims faster, where stresses
        are singular, and elements across patches, too.
        """
        keys: dict[str, TomlValue] = {}
        for name, part in self.parts.items():
            mesh = part.mesh
            for key, size, power in (
                ("size", mesh.size, 1.0),
                ("rim_size", mesh.rim_size, RIM_POWER),
                ("smallest", mesh.smallest, 1.0),
                ("details", mesh.details, 1.0),
            ):
                if size is not None:
                    keys[f"components.{name}.mesh.{key}"] = write_size(factor**power * size)
            if mesh.growth is not None:
                keys[f"components.{name}.mesh.growth"] = mesh.growth
            if any(p.shape != "whole" for i in part.interfaces.values() for p in i.patches):
                across = max(FEWEST_ACROSS, math.ceil(mesh.across_patches / factor - 1e-9))
                keys[f"components.{name}.mesh.across_patches"] = across
        return keys

    def sizes(self, factor: float) -> dict[str, str]:
        """Element size of each component at a factor."""
        return {
            name: write_size(factor * part.mesh.size)
            for name, part in self.parts.items()
            if part.mesh.size is not None
        }


@dataclass(frozen=True, eq=False)
class ConvergenceGoal:
    """When to stop.

    Attributes:
        accuracy: Relative; every number is to be known better, on a mesh that is as good.
        most_dofs: Of the finest mesh, about.
        most_seconds: Of all meshes together, about [s].
        watch: Names of the numbers; without, frequencies and compliances of the first pose.
    """

    accuracy: float
    most_dofs: int
    most_seconds: float
    watch: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Convergence:
    """What a series of meshes says; coarse to fine.

    Attributes:
        series: The meshes, of which some were computed.
        end: Why no finer mesh was computed.
        failures: Meshes that could not be computed, with the reason.
    """

    series: MeshSeries
    costs: MeshCosts
    records: tuple[StudyRecord, ...]
    watched: tuple[MeshedNumber, ...]
    limits: tuple[Limit, ...]
    end: str = ""
    failures: tuple[str, ...] = ()


def choose_series(scene: Scene) -> MeshSeries:
    """The meshes of a scene: from a few times the sizes that are written, or that the sizing rule
    chooses.

    Args:
        scene: Without components to mesh it has an empty series.
    """
    parts: dict[str, Component] = {}
    written = False
    for name, part in scene.machine.components.items():
        if is_chosen(part) and not isinstance(part.solid, MeshFile):
            written |= part.mesh.size is not None
            parts[name] = _with_size(part)
    hexes = bool(parts) and all(part.mesh.cells == "hex" for part in parts.values())
    step = HEX_STEP if hexes else TET_STEP
    start = COARSER_THAN_WRITTEN if written or hexes else COARSER_THAN_RULE
    return MeshSeries(parts, tuple(start * step**number for number in range(MOST_MESHES)), step)


def _with_size(part: Component) -> Component:
    """A component with an element size; where none is written elements grow from the rims of
    patches and of rigid interfaces.
    """
    mesh = part.mesh
    if mesh.size is not None:
        return part
    size = automatic_size(part)
    if mesh.cells == "tet" and mesh.growth is None:
        graded = grade_mesh(part, size, FINE_GRADING)
        mesh = dataclasses.replace(mesh, growth=graded.growth, rim_size=graded.rim_size)
    return dataclasses.replace(part, mesh=dataclasses.replace(mesh, size=size))


def run_convergence(
    job: StudyJob,
    series: MeshSeries,
    goal: ConvergenceGoal,
    folder: Path,
    *,
    comm: MPI.Comm,
    observer: Callable[[StudyProgress], None] = lambda progress: None,
) -> Convergence | None:
    """Compute meshes from coarse to fine until the goal is reached or a limit is met; collective.

    Args:
        job: With a study of the analyses to compute; its meshes are set here.
        folder: Holds ``points.jsonl``, from which finished meshes are taken.
        comm: Ranks that compute each mesh together.
        observer: Called with each mesh on rank 0.

    Returns:
        What was found, on rank 0; None elsewhere.

    Raises:
        ConvergenceError: No mesh could be computed.
        StudyError: The scene file changed meanwhile.
        OutputError: A record cannot be written.
    """
    convergence: Convergence | None = None
    for count in range(1, len(series.factors) + 1):
        step = dataclasses.replace(job, study=_extend(job.study, series, count))

        def tell(progress: StudyProgress, newest: int = count - 1) -> None:
            if progress.number == newest:
                observer(dataclasses.replace(progress, total=progress.number + 1))

        records = run_study(step, folder, comm=comm, observer=tell, warm_up=count == 1)
        convergence = make_on_root(comm, functools.partial(_evaluate, series, records, goal))
        if convergence.end:
            break
    if convergence is not None and not convergence.records:
        raise ConvergenceError(f"no mesh could be computed: {convergence.failures[-1]}")
    return convergence if comm.rank == 0 else None


def _extend(study: Study, series: MeshSeries, count: int) -> Study:
    """The study of the first few meshes."""
    settings = [series.settings(factor) for factor in series.factors]
    columns = {key: tuple(one_mesh[key] for one_mesh in settings) for key in settings[0]}
    (family,) = study.families
    family = dataclasses.replace(
        family,
        settings={key: values[0] for key, values in columns.items() if len(set(values)) == 1},
        vary={key: values[:count] for key, values in columns.items() if len(set(values)) > 1},
        pairwise=True,
    )
    return dataclasses.replace(study, families=(family,))


def plan_study(analyses: Sequence[str]) -> Study:
    """The study behind a series of meshes: seconds are those of the whole computation."""
    return Study("converge", (StudyFamily("", "", {}, {}, analyses=tuple(analyses)),), cold=True)


def _evaluate(
    series: MeshSeries, records: Sequence[StudyRecord], goal: ConvergenceGoal
) -> Convergence:
    """Return what the meshes so far say, and whether they are enough."""
    meshes = list(zip(series.factors, records, strict=False))
    done = [(factor, record) for factor, record in meshes if record.status == "done"]
    failed = tuple(
        f"size {', '.join(series.sizes(factor).values())}: {record.error}"
        for factor, record in meshes
        if record.status == "failed"
    )
    costs = _gather_costs(done)
    chosen = tuple(record for _, record in done)
    watched = tuple(watch_numbers(chosen, goal.watch)) if chosen else ()
    limits = tuple(find_limit(costs.factors, number) for number in watched)
    convergence = Convergence(series, costs, chosen, watched, limits, failures=failed)
    return dataclasses.replace(convergence, end=_find_end(convergence, records, goal))


def _find_end(found: Convergence, records: Sequence[StudyRecord], goal: ConvergenceGoal) -> str:
    """Return why no finer mesh is computed; empty where one is."""
    last, number = records[-1], len(records)
    if last.status == "failed" and (found.records or number == MOST_FAILURES):
        fits = "the next mesh does not fit" if last.error.startswith(BUDGET) else "the next mesh"
        return f"{fits}: {last.error}" if found.records else last.error
    if not found.records:
        return ""
    enough = len(found.records) >= FEWEST_MESHES[found.series.step]
    if enough and all(
        limit.order is not None
        and limit.share <= goal.accuracy
        and abs((each.values[-1] or 0.0) / limit.value - 1.0) <= goal.accuracy
        for each, limit in zip(found.watched, found.limits, strict=True)
    ):
        return "every number is known well enough"
    if number == len(found.series.factors):
        return f"{number} meshes are the most that are tried"
    return _exceed_goal(found.costs, found.series.factors[number], goal)


def _exceed_goal(costs: MeshCosts, factor: float, goal: ConvergenceGoal) -> str:
    """Return which limit the mesh of a factor would go beyond; empty where none."""
    most = f"--most-dofs is {goal.most_dofs}"
    if costs.dofs[-1] > goal.most_dofs:
        return f"the last mesh has {costs.dofs[-1]} dofs already; {most}"
    dofs = estimate_dofs(costs, factor)
    if dofs > goal.most_dofs:
        return f"the next mesh would have about {show_count(dofs)} dofs; {most}"
    seconds = estimate_cost(costs.dofs, costs.seconds, dofs, TIME_SLOPE)
    if sum(costs.seconds) + seconds > goal.most_seconds:
        return f"the next mesh would take about {seconds:.2g} s more; --most-seconds is {goal.most_seconds:g}"
    return ""


def show_count(count: float) -> str:
    """About so many, to two digits in groups of three: ``180 000``."""
    return f"{int(float(f'{count:.2g}')):,}".replace(",", " ")


def _gather_costs(done: Sequence[tuple[float, StudyRecord]]) -> MeshCosts:
    records = [record for _, record in done]
    totals = [record.summary["totals"] for record in records if record.summary is not None]
    times = [median_seconds(record) for record in records]
    return MeshCosts(
        tuple(factor for factor, _ in done),
        tuple(int(total["full_dofs"]) for total in totals),
        tuple(0.0 if time is None else time[0] for time in times),
        tuple(
            max((*record.peak_mb, float(total["peak_rss_mb"])))
            for record, total in zip(records, totals, strict=True)
        ),
    )


def watch_numbers(
    records: Sequence[StudyRecord], patterns: Sequence[str] = ()
) -> Iterator[MeshedNumber]:
    """Yield numbers of the finest mesh on every mesh, coarse to fine; modes of the first pose are those
    of the finest mesh, paired by shape.

    Args:
        records: Of meshes that were computed, at least one.
        patterns: Names of numbers; without, natural frequencies and compliances of the first pose.

    Raises:
        NumberNameError: No number has such a name.
    """
    finest, modes = records[-1].numbers, _first_modes(records[-1])
    partners = [_pair_modes(modes, _first_modes(record)) for record in records]
    pose = next((key["pose"] for key in finest if key.kind == "compliance"), "")
    for key in _select_watched(finest, patterns):
        names = _name_watched(key, pose, modes)
        if names is None or (not patterns and names == _name_plainly(key)):
            continue
        paired = modes is not None and _is_of(key, modes)
        others = [_with_mode(key, pairs) if paired else key for pairs in partners]
        numbers = (
            None if other is None else record.numbers.get(other)
            for record, other in zip(records, others, strict=True)
        )
        yield MeshedNumber(name=names[0], title=names[1], numbers=tuple(numbers))


def _select_watched(numbers: Numbers, patterns: Sequence[str]) -> Iterable[Key]:
    """Return keys of numbers that are known and not zero: of patterns, or frequencies and all others."""
    chosen = (
        [number for pattern in patterns for number in numbers.select(pattern).values()]
        if patterns
        else sorted(numbers.values(), key=lambda number: number.key.kind != "frequency")
    )
    return dict.fromkeys(number.key for number in chosen if 0.0 < abs(number.value) < math.inf)


def _name_plainly(key: Key) -> tuple[str, str]:
    return str(key), key.describe(several_poses=True)


def _is_of(key: Key, modes: "_FirstModes") -> bool:
    """Tell whether a number is of one of the modes of the first pose."""
    return "mode" in key.group.roles and key["pose"] == modes.pose


def _name_watched(key: Key, pose: str | int, modes: "_FirstModes | None") -> tuple[str, str] | None:
    """Return name and title of a number; None of a rigid-body mode.

    Args:
        pose: Whose compliances have short names.
        modes: Of the first pose, whose frequencies have.
    """
    if key.kind == "compliance" and key["pose"] == pose and key["direction"] in DIRECTIONS:
        point, direction = key["point"], key["direction"]
        return f"{point} {direction}", f"static compliance at {point} along {direction}"
    if key.kind == "frequency" and modes is not None and _is_of(key, modes):
        index = int(key["mode"]) - modes.first
        name = f"f{index - modes.shapes.rigid_count + 1}"
        return None if index < modes.shapes.rigid_count else (name, f"{name}, {modes.names[index]}")
    return _name_plainly(key)


class _FirstModes(NamedTuple):
    """Modes of the first pose: its name, the number of the first mode, names of modes, motions."""

    pose: str
    first: int
    names: list[str]
    shapes: ModeSet


def _first_modes(record: StudyRecord) -> _FirstModes | None:
    if record.summary is None or not record.summary["modal"]:
        return None
    modes = record.summary["modal"][0]
    field = np.array(record.measured["fields"]).T
    return _FirstModes(
        modes["pose_name"],
        modes.get("modes_below", 0) + 1,
        modes["mode_names"],
        ModeSet(np.array(modes["frequencies_hz"]), field, modes["rigid_count"]),
    )


def _pair_modes(finest: _FirstModes | None, other: _FirstModes | None) -> dict[int, int]:
    """Return number of a mode on the finest mesh to that on another one."""
    if finest is None or other is None:
        return {}
    pairs = pair_modes(finest.shapes, other.shapes)
    return {finest.first + pair.first: other.first + pair.second for pair in pairs}


def _with_mode(key: Key, partners: Mapping[int, int]) -> Key | None:
    """Return the key with the mode's number on another mesh; None where it has no partner."""
    mode = partners.get(int(key["mode"]))
    return None if mode is None else make_key(key.kind, **(dict(key.at) | {"mode": mode}))


def measure_fields(scene: Scene, results: Results) -> Measured:
    """Measure motions of the bodies in each mode of the first pose, at the same places on every mesh.

    Args:
        scene: Not needed; every measure of a study is given it.

    Returns:
        ``fields``: a row per mode, weighted so that scalar products are about kinetic energies.
    """
    if not results.modal:
        return {"fields": []}
    pose = results.view.poses[results.modal[0].pose.name]
    parts = []
    for name, shifts in pose.shifts.items():
        mass = results.components[name].mass_kg
        parts.append(math.sqrt(mass) * _average_cells(results.view.skins[name], shifts))
    field: FloatArray = np.concatenate(parts, axis=1)
    return {"fields": [[float(f"{x:.{DIGITS}g}") for x in mode] for mode in field]}


def _average_cells(skin: Skin, shifts: ShiftArray) -> FloatArray:
    """Mean motion of a surface in each cell of its bounding box, times the root of the cell's share
    of its area: it hardly depends on the triangles, where nearest points would.

    Args:
        shifts: ``(modes, points, 3)``.

    Returns:
        ``(modes, 3 cells)``.
    """
    corners = skin.points[skin.triangles]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    low, high = skin.points.min(axis=0), skin.points.max(axis=0)
    along = (corners.mean(axis=1) - low) / np.maximum(high - low, np.finfo(float).tiny)
    places = np.clip((CELLS * along).astype(int), 0, CELLS - 1) @ [CELLS**2, CELLS, 1]
    total = np.bincount(places, areas, minlength=CELLS**3)
    # triangles to cells; mean motion times the root of the share: sum / area * sqrt(area / whole)
    weights = areas / np.sqrt(total[places] * total.sum())
    gather = csr_array((weights, (places, np.arange(len(areas)))), shape=(CELLS**3, len(areas)))
    moved = shifts[:, skin.triangles].astype(float).mean(axis=2)
    return np.stack([(gather @ mode).ravel() for mode in moved])
