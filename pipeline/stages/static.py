"""The static stage: compliance and its budget at points. Only rank 0 has anything to do."""

import dataclasses
from collections.abc import Iterable

import numpy as np

from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.run_state import (
    Outcome,
    PoseModel,
    PoseMotions,
    RunState,
    Solved,
    pose_model,
)
from headstock.scene.analyses.static import StaticRequest
from headstock.solvers.errors import ModelError


def run_static_stage(state: RunState, stage: Stage) -> Outcome:
    """Compliance and its budget at every requested point; a machine that moves freely is refused,
    and the run goes on.
    """
    if not state.is_root:
        return Outcome()
    model = pose_model(state)
    solved = solve_points(model, state.scene.analyses[StaticRequest].at)
    answer, pose = solved.answer, model.pose.name
    if not answer.points:
        return Outcome(
            detail="refused: see below", warnings=solved.warnings, failures=solved.failures
        )
    motions = {
        f"{name} {direction}": model.expand(model.push((name, direction)))
        for name, point in answer.points.items()
        for axis, direction in enumerate(DIRECTIONS)
        if not np.isnan(point.compliance[axis, axis])
    }
    state.motions.setdefault(pose, PoseMotions(model.offsets)).motions.update(motions)
    pushes = {
        push: model.shift_skins(state.skins, moved[:, None]) for push, moved in motions.items()
    }
    single = {
        push: {name: shift[0] for name, shift in shifts.items()} for push, shifts in pushes.items()
    }
    state.views[pose] = dataclasses.replace(state.views[pose], pushes=single)
    return Outcome(
        detail=", ".join(answer.points),
        answers=(answer,),
        warnings=solved.warnings,
        failures=solved.failures,
    )


def solve_points(model: PoseModel, at: Iterable[str]) -> Solved[StaticAnswer]:
    """Return compliances at points with their ±; without points where a free motion leaves one of them
    undetermined.
    """
    pose, solved = model.pose.name, dict[str, Solved[PointCompliance]]()
    refused: tuple[str, ...] = ()
    try:
        for name in at:
            solved[name] = model.solve_point(name)
    except ModelError as error:
        refused = (f"static analysis in pose {pose}: {error}",)
    solutions = solved.values()
    return Solved(
        StaticAnswer(
            pose,
            {} if refused else {name: point.answer for name, point in solved.items()},
            errors={key: error for point in solutions for key, error in point.errors.items()},
        ),
        tuple(message for point in solutions for message in point.warnings),
        (*(message for point in solutions for message in point.failures), *refused),
    )
