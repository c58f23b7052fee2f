"""The volumetric stage: position error of the tool over a grid of poses, by source and part. Only
rank 0 has anything to do.
"""

from collections.abc import Callable
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
from headstock.geometry.mechanisms.tool_mechanism import TOOL_AXES, TOOL_POINT
from headstock.pipeline.answers.volumetric import VolumetricAnswer
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.mechanism import build_mechanism, place_pose
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.memo import CouplingMemo
from headstock.reduction.motions.tool_deviation import GEOMETRY, ToolDeviation, solve_deviation
from headstock.scene.requests import VolumetricRequest
from headstock.solvers.linear.volumetric import axis_motions, find_squareness, variance_shares

# an error in one pose is that pose's result
POSE_ERRORS = (HeadstockError, ValueError, np.linalg.LinAlgError)


def run_volumetric_stage(state: RunState, stage: Stage) -> Outcome:
    """Couple in every pose of the grid, and solve for the errors at every point."""
    request = state.scene.analyses.volumetric
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
    found: list[dict[str, ToolDeviation] | None] = []
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
) -> Callable[[Pose], dict[str, ToolDeviation]]:
    """What finds the errors at every point in a pose."""
    machine, parts = state.scene.machine, state.parts
    superelements = parts.superelements
    if state.scene.is_lumped:
        model = build_mechanism(parts, superelements)

        def place(pose: Pose) -> dict[str, ToolDeviation]:
            placed = place_pose(parts, pose, model, superelements)
            return {name: placed.deviate(name) for name in request.at}

        return place
    memo = CouplingMemo(set(request.at))

    def join(pose: Pose) -> dict[str, ToolDeviation]:
        coupled = couple(superelements, machine, pose, gravity=state.plan.gravity, memo=memo)
        return {name: solve_deviation(coupled, machine, name) for name in request.at}

    return join


def _known(values: FloatArray) -> FloatArray:
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray(flat[np.isfinite(flat).all(axis=1)])


def _assemble(
    request: VolumetricRequest,
    machine: Machine,
    point: str,
    shape: tuple[int, ...],
    found: list[ToolDeviation | None],
) -> VolumetricAnswer:
    first = next(each for each in found if each is not None)
    nothing = np.full(6, np.nan)
    sources = {
        source: np.array(
            [nothing if each is None else each.sources[source] for each in found]
        ).reshape(*shape, 6)
        for source in first.sources
    }
    total = np.asarray(np.sum(list(sources.values()), axis=0))
    lines = []
    for number, (name, positions) in enumerate(request.axes):
        middle: list[int | slice] = [size // 2 for size in shape]
        middle[number] = slice(None)
        lines.append(
            axis_motions(
                name, positions, total[tuple(middle)], _tool_travel(machine, request, point, name)
            )
        )
    pairs = [find_squareness(one, other) for one, other in combinations(lines, 2)]
    units = position_units(machine)
    return VolumetricAnswer(
        point=point,
        axes=tuple(name for name, _ in request.axes),
        axis_units={name: units[name] for name in (*dict(request.axes), *request.fixed)},
        positions=tuple(positions for _, positions in request.axes),
        fixed=request.fixed,
        sources=sources,
        budget={
            direction: variance_shares(_list_parts(found, dof))
            for dof, direction in enumerate(DIRECTIONS)
        },
        lines=tuple(lines),
        squareness=tuple(pair for pair in pairs if pair is not None),
        failed=sum(each is None for each in found),
    )


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
