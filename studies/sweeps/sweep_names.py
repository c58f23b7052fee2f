"""Names of the modes that a sweep followed, and what is known of errors: in the pose nearest to the middle that has the mode."""

import dataclasses

import numpy as np
from mpi4py import MPI

from headstock.pipeline.planning.plan import Stage, StageKind
from headstock.pipeline.planning.planner import is_lumped
from headstock.pipeline.runner import HANDLERS, LUMPED_HANDLERS
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.requests import Analyses, ModalRequest
from headstock.scene.sweep_poses import describe_positions, sweep_pose
from headstock.studies.sweeps.results import SampledErrors, SweepResults


def name_tracked_modes(state: RunState, results: SweepResults) -> SweepResults:
    """The results with a name per tracked mode, and the errors of its frequency and of the compliances in the pose it was named in.

    Args:
        state: Of the run that made the superelements.
        results: Of the sweep.
    """
    if results.tracked is None:
        return results
    index = results.tracked.index
    spread = results.sweep.positions - results.sweep.positions.mean(axis=0)
    far = (np.abs(spread) / np.maximum(np.ptp(results.sweep.positions, axis=0), 1e-12)).sum(axis=1)
    names: dict[int, str] = {}
    samples: list[SampledErrors] = []
    for number in np.argsort(far, kind="stable"):
        here = [mode for mode in np.flatnonzero(index[number] >= 0) if int(mode) not in names]
        if here:
            alone = _solve_pose(state, results, int(number), with_static=not samples)
            found = alone.modal[-1]
            names |= {int(mode): found.mode_names[index[number, mode]] for mode in here}
            errors = {int(mode): found.errors[index[number, mode]] for mode in here if index[number, mode] >= found.rigid_count}
            points = {name: point.errors for points in alone.static.values() for name, point in points.items()}
            samples.append(SampledErrors(int(number), errors, points))
        if len(names) == index.shape[1]:
            break
    ordered = tuple(names[mode] for mode in range(index.shape[1]))
    return dataclasses.replace(results, mode_names=ordered, sampled_errors=tuple(samples))


def _solve_pose(state: RunState, results: SweepResults, number: int, *, with_static: bool) -> RunState:
    """All modes of a pose with names and errors, and its compliances where they are wanted and swept, by the stages of a run."""
    pose = dataclasses.replace(sweep_pose(results.sweep, number), name=describe_positions(results.sweep, number))
    count = 0 if results.modes is None else int(np.isfinite(results.modes.frequencies_hz[number]).sum())
    static = state.scene.analyses.static if with_static else None
    scene = dataclasses.replace(state.scene, analyses=Analyses(modal=ModalRequest(count=count), static=static))
    plan = dataclasses.replace(state.plan, poses={pose.name: pose})
    alone = RunState(scene, plan, MPI.COMM_SELF, state.store, reduced=state.reduced)
    lumped = is_lumped(scene)
    handlers = LUMPED_HANDLERS if lumped else HANDLERS
    stages: list[StageKind] = ["place", "modal"] if lumped else ["couple", "modal"]
    if static is not None:
        stages.append("static")
    for kind in stages:
        handlers[kind](alone, Stage(kind, None, "", pose=pose.name))
    return alone
