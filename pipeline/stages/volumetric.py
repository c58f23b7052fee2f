"""The volumetric stage: position error of the tool over a grid of poses, by source and part. Only
rank 0 has anything to do.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

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
NO_CHANGES = DeviationChanges({}, {}, {})


@dataclass(frozen=True, eq=False)
class _EvaluatedPose:
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
    solved: dict[int, dict[str, _EvaluatedPose]] = {}
    faults: list[str] = []
    for number, row in enumerate(grid):
        pose = Pose("", {**request.fixed, **dict(zip(names, map(float, row), strict=True))})
        try:
            solved[number] = deviate(pose)
        except POSE_ERRORS as error:
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
            _Grid(
                shape,
                np.array(list(solved)),
                tuple(evaluated[name] for evaluated in solved.values()),
            ),
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
) -> Callable[[Pose], dict[str, _EvaluatedPose]]:
    """What finds the errors at every point in a pose."""
    machine, parts = state.scene.machine, state.parts
    superelements = parts.superelements
    if state.scene.is_lumped:
        model = build_lumped_model(parts, superelements)

        def place(pose: Pose) -> dict[str, _EvaluatedPose]:
            placed = place_pose(parts, pose, model, superelements)
            return {
                name: _EvaluatedPose(placed.deviate(name), left_out=LUMPED.left_out)
                for name in request.at
            }

        return place
    memo = CouplingMemo(set(request.at))

    def join(pose: Pose) -> dict[str, _EvaluatedPose]:
        gravity = state.plan.gravity
        coupled = couple(superelements, machine, pose, gravity=gravity, memo=memo)
        left_out, evaluated = name_what_is_left_out(parts).left_out, {}
        for name in request.at:
            own = solve_deviation(coupled, machine, name)
            changes = estimate_deviation(coupled, machine, gravity, own)
            evaluated[name] = _EvaluatedPose(
                ToolDeviation(own.sources, own.parts), changes, left_out
            )
        return evaluated

    return join


def _known(values: FloatArray) -> FloatArray:
    flat = values.reshape(-1, values.shape[-1])
    return flat[np.isfinite(flat).all(axis=1)]


@dataclass(frozen=True, eq=False)
class _Grid:
    """Deviation of a point in the poses of a grid.

    Attributes:
        poses: ``(n,)`` numbers of its poses in which the machine could be solved for.
        evaluated: ``n`` deviations there.
    """

    shape: tuple[int, ...]
    poses: NDArray[np.intp]
    evaluated: tuple[_EvaluatedPose, ...]

    def spread(self, values: Sequence[FloatArray]) -> FloatArray:
        """Return values ``(6,)`` of these poses as a grid ``(..., 6)``; NaN in the others."""
        flat = np.full((math.prod(self.shape), 6), np.nan)
        flat[self.poses] = values
        return flat.reshape(*self.shape, 6)

    def spread_changes(self, source: str) -> dict[str, dict[str, FloatArray]]:
        """Return source of error to component to the change of a source of deviation over the grid."""
        changes = [each.changes.get(source, NO_CHANGES) for each in self.evaluated]
        kinds = {
            DISCRETISATION: [change.meshes for change in changes],
            CURVED_FACES: [change.faces for change in changes],
            LEFT_OUT: [change.left_out for change in changes],
        }
        unknown = np.full(6, np.nan)
        every = {
            error: {
                name: self.spread([row.get(name, unknown) for row in rows])
                for name in dict.fromkeys(name for row in rows for name in row)
            }
            for error, rows in kinds.items()
        }
        return {error: parts for error, parts in every.items() if parts}

    def list_parts(self, dof: int) -> dict[str, FloatArray]:
        """Return the contribution ``(n,)`` of each part along a direction, by what it is and what makes
        it.
        """
        return {
            f"{'errors of' if source == GEOMETRY else f'{source} on'} {part}": np.array(
                [each.deviation.parts[source][part][dof] for each in self.evaluated]
            )
            for source, parts in self.evaluated[0].deviation.parts.items()
            for part in parts
        }


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines of a grid through its middle, one along each axis.

    Attributes:
        travels: ``(3,)`` of the tool against the work per travel of each.
    """

    axes: Sequence[tuple[str, FloatArray]]
    travels: Sequence[FloatArray]

    def read(self, values: FloatArray) -> list[AxisMotions]:
        """Return the error motions along each axis, of values ``(..., 6)`` over the grid."""
        lines = []
        for number, (name, positions) in enumerate(self.axes):
            middle: list[int | slice] = [size // 2 for size in values.shape[:-1]]
            middle[number] = slice(None)
            lines.append(axis_motions(name, positions, values[tuple(middle)], self.travels[number]))
        return lines

    def measure(self, values: FloatArray, number: int) -> FloatArray:
        """Return the deviations ``(6,)`` along one axis."""
        return self.read(values)[number].deviations

    def read_squareness(self, values: FloatArray) -> list[Squareness]:
        """Return the squareness of each pair of linear axes."""
        pairs = [find_squareness(one, other) for one, other in combinations(self.read(values), 2)]
        return [pair for pair in pairs if pair is not None]

    def measure_squareness(self, values: FloatArray) -> FloatArray:
        """Return its angles [rad]."""
        return np.array([pair.angle for pair in self.read_squareness(values)])


def _assemble(
    request: VolumetricRequest, machine: Machine, point: str, grid: _Grid
) -> VolumetricAnswer:
    first = grid.evaluated[0]
    sources = {
        source: grid.spread([each.deviation.sources[source] for each in grid.evaluated])
        for source in first.deviation.sources
    }
    total = np.asarray(np.sum(list(sources.values()), axis=0))
    travels = [_tool_travel(machine, request, point, name) for name, _ in request.axes]
    lines = _Lines(request.axes, travels)
    changes = {source: grid.spread_changes(source) for source in sources}
    every, units = _add_changes(changes.values()), position_units(machine)
    estimate = partial(estimate_measures, values=total, changes=every, left_out=first.left_out)
    ranges = {TOTAL: estimate(measure_range)} | {
        source: estimate_measures(measure_range, sources[source], changes[source], first.left_out)
        for source in sources
    }
    errors = {
        range_key(point, source, symbol): error
        for source, estimates in ranges.items()
        for symbol, error in zip(SYMBOLS, estimates, strict=True)
    }
    errors[largest_key(point)] = estimate(_measure_largest)[0]
    for number, (axis, _) in enumerate(request.axes):
        along = estimate(partial(lines.measure, number=number))
        errors |= {
            line_key(point, axis, symbol): error
            for symbol, error in zip(SYMBOLS, along, strict=True)
        }
    squareness, angles = lines.read_squareness(total), estimate(lines.measure_squareness)
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
            direction: variance_shares(grid.list_parts(dof))
            for dof, direction in enumerate(DIRECTIONS)
        },
        lines=tuple(lines.read(total)),
        squareness=tuple(squareness),
        grid_errors=_size(every, total),
        errors=errors,
        failed=math.prod(grid.shape) - len(grid.evaluated),
    )


def _add_changes(changes: Iterable[Changes]) -> Changes:
    """Those of all sources of deviation together."""
    total: dict[str, dict[str, FloatArray]] = {}
    for part in changes:
        for error, parts in part.items():
            sums = total.setdefault(error, {})
            for name, change in parts.items():
                sums[name] = sums.get(name, 0.0) + change
    return total


def _size(changes: Changes, values: FloatArray) -> FloatArray:
    """How far each value may be off, of all components together; NaN where nobody knows."""
    sizes = [np.abs(change) for parts in changes.values() for change in parts.values()]
    return np.asarray(np.sum(sizes, axis=0)) if sizes else np.full(values.shape, np.nan)


def _measure_largest(values: FloatArray) -> FloatArray:
    return np.array([np.nanmax(np.linalg.norm(values[..., :3], axis=-1))])


def _tool_travel(machine: Machine, request: VolumetricRequest, point: str, axis: str) -> FloatArray:
    """Travel ``(3,)`` of the tool against the work per travel of a linear axis in the middle of the
    map; zero for a rotary one.
    """
    if axis in TOOL_AXES and axis not in machine.axes:
        return np.eye(3)[TOOL_POINT.index(axis)] if axis in TOOL_POINT else np.zeros(3)
    if machine.axes[axis].kind != "linear":
        return np.zeros(3)
    middle = {**request.fixed, **{name: float(grid[len(grid) // 2]) for name, grid in request.axes}}
    positions = dict(request.axes)[axis]
    ends = [Pose("", {**middle, axis: float(place)}) for place in (positions[0], positions[-1])]
    moved = travel_directions(machine, MachinePath(ends[0], ends[1]))
    tool, work = (
        moved.get(end.component or "", np.zeros(3))
        for end in (machine.points[point].tool, machine.points[point].work)
    )
    return tool - work
