"""The volumetric stage: position error of the tool over a grid of poses, by source and part. Only
rank 0 has anything to do.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import (
    Machine,
    MachinePath,
    Pose,
    position_units,
    travel_directions,
)
from headstock.geometry.mechanisms.exechon import TOOL_AXES, TOOL_POINT
from headstock.pipeline.answers.volumetric import (
    SYMBOLS,
    TOTAL,
    VolumetricAnswer,
    largest_key,
    line_key,
    range_key,
    squareness_key,
)
from headstock.pipeline.numbers.estimates import (
    CURVED_FACES,
    DISCRETISATION,
    LEFT_OUT,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.estimates import (
    Changes,
    estimate_measures,
    name_what_is_left_out,
)
from headstock.pipeline.stages.mechanism import LUMPED, build_lumped_model, place_pose
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.estimates.static_errors import DeviationChanges, estimate_deviation
from headstock.reduction.motions.tool_deviation import GEOMETRY, ToolDeviation, solve_deviation
from headstock.scene.analyses.volumetric import VolumetricRequest
from headstock.solvers.linear.volumetric import (
    AxisMotions,
    Squareness,
    axis_motions,
    find_squareness,
    measure_range,
    variance_shares,
)

# an error in one pose is that pose's result
POSE_ERRORS = (HeadstockError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class _Judged:
    """Deviation of a point in a pose, and what is known of its errors.

    Attributes:
        changes: Source to what meshes change in it; empty where no component has a mesh.
        left_out: What no estimate is made of.
    """

    deviation: ToolDeviation
    changes: dict[str, DeviationChanges] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def run_volumetric_stage(state: RunState, stage: Stage) -> Outcome:
    """Couple in every pose of the grid, and solve for the errors at every point."""
    request = state.scene.analyses.get(VolumetricRequest)
    if not state.is_root:
        return Outcome()
    if request is None:
        raise ValueError("a volumetric stage needs a volumetric analysis in the scene")
    shape = tuple(len(values) for _, values in request.axes)
    grid = np.stack(
        np.meshgrid(*(values for _, values in request.axes), indexing="ij"), axis=-1
    ).reshape(-1, len(shape))
    deviate = _place_deviations(state, request)
    names = [name for name, _ in request.axes]
    found: list[dict[str, _Judged] | None] = []
    faults: list[str] = []
    for row in grid:
        pose = Pose("", {**request.fixed, **dict(zip(names, map(float, row), strict=True))})
        try:
            found.append(deviate(pose))
        except POSE_ERRORS as error:
            found.append(None)
            faults.append(str(error))
    failures = (
        (f"volumetric analysis: {len(faults)} of {len(grid)} poses failed: {faults[0]}",)
        if faults
        else ()
    )
    if len(faults) == len(grid):
        return Outcome(detail="refused: see below", failures=failures)
    answers = tuple(
        _assemble(
            request,
            state.scene.machine,
            name,
            shape,
            [None if each is None else each[name] for each in found],
        )
        for name in request.at
    )
    ranges = [np.ptp(_known(answer.total)[:, :3], axis=0).max() for answer in answers]
    return Outcome(
        detail=f"{len(grid)} poses, errors within {1e6 * max(ranges):.3g} µm along an axis",
        answers=answers,
        failures=failures,
    )


def _place_deviations(
    state: RunState, request: VolumetricRequest
) -> Callable[[Pose], dict[str, _Judged]]:
    """What finds the errors at every point in a pose."""
    machine, parts = state.scene.machine, state.parts
    superelements = parts.superelements
    if state.scene.is_lumped:
        model = build_lumped_model(parts, superelements)

        def place(pose: Pose) -> dict[str, _Judged]:
            placed = place_pose(parts, pose, model, superelements)
            return {
                name: _Judged(placed.deviate(name), left_out=LUMPED.left_out) for name in request.at
            }

        return place
    memo = CouplingMemo(set(request.at))

    def join(pose: Pose) -> dict[str, _Judged]:
        gravity = state.plan.gravity
        coupled = couple(superelements, machine, pose, gravity=gravity, memo=memo)
        left_out, judged = name_what_is_left_out(parts).left_out, {}
        for name in request.at:
            own = solve_deviation(coupled, machine, name)
            changes = estimate_deviation(coupled, machine, gravity, own)
            judged[name] = _Judged(ToolDeviation(own.sources, own.parts), changes, left_out)
        return judged

    return join


def _known(values: FloatArray) -> FloatArray:
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray(flat[np.isfinite(flat).all(axis=1)])


def _assemble(
    request: VolumetricRequest,
    machine: Machine,
    point: str,
    shape: tuple[int, ...],
    found: list[_Judged | None],
) -> VolumetricAnswer:
    deviations = [None if each is None else each.deviation for each in found]
    first = next(each for each in found if each is not None)
    sources = {
        source: _stack(
            shape, [None if each is None else each.sources[source] for each in deviations]
        )
        for source in first.deviation.sources
    }
    total = np.asarray(np.sum(list(sources.values()), axis=0))
    travels = [_tool_travel(machine, request, point, name) for name, _ in request.axes]

    def read_lines(values: FloatArray) -> list[AxisMotions]:
        lines = []
        for number, (name, positions) in enumerate(request.axes):
            middle: list[int | slice] = [size // 2 for size in shape]
            middle[number] = slice(None)
            lines.append(axis_motions(name, positions, values[tuple(middle)], travels[number]))
        return lines

    def measure_line(values: FloatArray, number: int) -> FloatArray:
        return read_lines(values)[number].deviations

    def read_squareness(values: FloatArray) -> list[Squareness]:
        pairs = [find_squareness(one, other) for one, other in combinations(read_lines(values), 2)]
        return [pair for pair in pairs if pair is not None]

    changes = {source: _stack_changes(shape, found, source) for source in sources}
    every = _add_changes(changes.values())
    judge = partial(estimate_measures, values=total, changes=every, left_out=first.left_out)
    units, lines = position_units(machine), read_lines(total)
    squareness = read_squareness(total)
    ranges = {TOTAL: judge(measure_range)} | {
        source: estimate_measures(measure_range, sources[source], changes[source], first.left_out)
        for source in sources
    }
    errors = {
        range_key(point, source, symbol): error
        for source, estimates in ranges.items()
        for symbol, error in zip(SYMBOLS, estimates, strict=True)
    }
    errors[largest_key(point)] = judge(_measure_largest)[0]
    for number, line in enumerate(lines):
        along = judge(partial(measure_line, number=number))
        errors |= {
            line_key(point, line.axis, symbol): error
            for symbol, error in zip(SYMBOLS, along, strict=True)
        }
    angles = judge(lambda values: np.array([pair.angle for pair in read_squareness(values)]))
    errors |= {
        squareness_key(point, pair): error for pair, error in zip(squareness, angles, strict=True)
    }
    return VolumetricAnswer(
        point=point,
        axes=tuple(name for name, _ in request.axes),
        axis_units={name: units[name] for name in (*dict(request.axes), *request.fixed)},
        positions=tuple(positions for _, positions in request.axes),
        fixed=request.fixed,
        sources=sources,
        budget={
            direction: variance_shares(_list_parts(deviations, dof))
            for dof, direction in enumerate(DIRECTIONS)
        },
        lines=tuple(lines),
        squareness=tuple(squareness),
        grid_errors=_size(every, total),
        errors=errors,
        failed=sum(each is None for each in found),
    )


def _stack(shape: tuple[int, ...], values: Sequence[FloatArray | None]) -> FloatArray:
    """Values ``(6,)`` of every pose as a grid; NaN where there is none."""
    nothing = np.full(6, np.nan)
    return np.array([nothing if each is None else each for each in values]).reshape(*shape, 6)


def _stack_changes(
    shape: tuple[int, ...], found: Sequence[_Judged | None], source: str
) -> dict[str, dict[str, FloatArray]]:
    """Source of error to component to the change of a source of deviation over the grid."""
    changes = [None if each is None else each.changes.get(source) for each in found]
    known: dict[str, list[Mapping[str, FloatArray] | None]] = {
        DISCRETISATION: [None if each is None else each.meshes for each in changes],
        CURVED_FACES: [None if each is None else each.faces for each in changes],
        LEFT_OUT: [None if each is None else each.left_out for each in changes],
    }
    stacked: dict[str, dict[str, FloatArray]] = {}
    for error, rows in known.items():
        for name in dict.fromkeys(name for row in rows for name in row or ()):
            stacked.setdefault(error, {})[name] = _stack(
                shape, [None if row is None else row[name] for row in rows]
            )
    return stacked


def _add_changes(changes: Iterable[Changes]) -> Changes:
    """Those of all sources of deviation together."""
    total: dict[str, dict[str, FloatArray]] = {}
    for own in changes:
        for error, parts in own.items():
            known = total.setdefault(error, {})
            for name, change in parts.items():
                known[name] = known.get(name, 0.0) + change
    return total


def _size(changes: Changes, values: FloatArray) -> FloatArray:
    """How far each value may be off, of all components together; NaN where nobody knows."""
    sizes = [np.abs(change) for parts in changes.values() for change in parts.values()]
    return np.asarray(np.sum(sizes, axis=0)) if sizes else np.full(values.shape, np.nan)


def _measure_largest(values: FloatArray) -> FloatArray:
    return np.array([np.nanmax(np.linalg.norm(values[..., :3], axis=-1))])


def _list_parts(found: list[ToolDeviation | None], dof: int) -> dict[str, FloatArray]:
    """Contribution ``(n,)`` of each part along a direction, by what it is and what makes it."""
    first = next(each for each in found if each is not None)
    return {
        f"{'errors of' if source == GEOMETRY else f'{source} on'} {part}": np.array(
            [np.nan if each is None else each.parts[source][part][dof] for each in found]
        )
        for source, parts in first.parts.items()
        for part in parts
    }


def _tool_travel(machine: Machine, request: VolumetricRequest, point: str, axis: str) -> FloatArray:
    """Travel ``(3,)`` of the tool against the work per travel of a linear axis in the middle of the
    map; zero for a rotary one.
    """
    if axis in TOOL_AXES and axis not in machine.axes:
        return np.eye(3)[TOOL_POINT.index(axis)] if axis in TOOL_POINT else np.zeros(3)
    if machine.axes[axis].kind != "linear":
        return np.zeros(3)
    middle = {**request.fixed, **{name: float(each[len(each) // 2]) for name, each in request.axes}}
    positions = dict(request.axes)[axis]
    ends = [Pose("", {**middle, axis: float(place)}) for place in (positions[0], positions[-1])]
    moved = travel_directions(machine, MachinePath(ends[0], ends[1]))
    tool, work = (
        moved.get(end.component or "", np.zeros(3))
        for end in (machine.points[point].tool, machine.points[point].work)
    )
    return np.asarray(tool - work)
