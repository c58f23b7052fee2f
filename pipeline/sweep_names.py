"""Names of the modes that a sweep followed: each as it is called in the pose nearest to the middle that has it."""

import dataclasses

import numpy as np
from mpi4py import MPI

from headstock.pipeline.analysis_requests import Analyses, ModalRequest
from headstock.pipeline.planner import is_lumped
from headstock.pipeline.run_state import RunState
from headstock.pipeline.runner import HANDLERS, LUMPED_HANDLERS
from headstock.pipeline.stages import Stage
from headstock.pipeline.sweep_poses import describe_positions, sweep_pose
from headstock.pipeline.sweep_results import SweepResults


def name_tracked_modes(state: RunState, results: SweepResults) -> SweepResults:
    """The results with a name and the pose it was taken in per tracked mode.

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
    for number in np.argsort(far, kind="stable"):
        here = [mode for mode in np.flatnonzero(index[number] >= 0) if int(mode) not in names]
        if here:
            found = _name_pose(state, results, int(number))
            names |= {int(mode): found[index[number, mode]] for mode in here}
        if len(names) == index.shape[1]:
            break
    return dataclasses.replace(results, mode_names=tuple(names[mode] for mode in range(index.shape[1])))


def _name_pose(state: RunState, results: SweepResults, number: int) -> tuple[str, ...]:
    """Names of all modes of a pose, by the stages of a run."""
    pose = dataclasses.replace(sweep_pose(results.sweep, number), name=describe_positions(results.sweep, number))
    count = 0 if results.modes is None else int(np.isfinite(results.modes.frequencies_hz[number]).sum())
    scene = dataclasses.replace(state.scene, analyses=Analyses(modal=ModalRequest(count=count)))
    plan = dataclasses.replace(state.plan, poses={pose.name: pose})
    alone = RunState(scene, plan, MPI.COMM_SELF, state.store, reduced=state.reduced)
    lumped = is_lumped(scene)
    (LUMPED_HANDLERS if lumped else HANDLERS)["place" if lumped else "couple"](
        alone, Stage("place" if lumped else "couple", None, "", pose=pose.name)
    )
    (LUMPED_HANDLERS if lumped else HANDLERS)["modal"](alone, Stage("modal", None, "", pose=pose.name))
    return alone.modal[-1].mode_names
