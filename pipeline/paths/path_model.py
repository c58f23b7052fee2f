"""A path as its solvers take it: poses of the machine, its model, the instants looked at, and the travel of
axes and points along it.
"""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.pipeline.planning.analyses import MODE_MARGIN
from headstock.pipeline.stages.machine import CoupledPose
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.path_loads import PATH_INPUT
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.paths.response import PathModel, sample_times
from headstock.solvers.paths.set_points import SetPoint


def choose_model(request: PathRequest) -> PathModel:
    """The quasi-static share and the residual vibration: a mode whose period is longer than a ramp does not follow it."""
    return PathModel(
        PATH_INPUT,
        request.outputs,
        1.0 / request.moves[0].ramp.time_constant,
        MODE_MARGIN * request.band_hz,
    )


def sample_path(request: PathRequest, move: SetPoint) -> FloatArray:
    """Instants of a move [s]."""
    return sample_times(move, request.sampling_hz, request.residual_time)


def couple_at(state: RunState, request: PathRequest, position: float) -> CoupledPose:
    """The machine coupled at a position of the path [m]."""
    pose = request.path.pose_at(position)
    coupled = couple(state.parts.superelements, state.scene.machine, pose)
    return CoupledPose(state.parts, pose, coupled)


def axis_shares(request: PathRequest) -> dict[str, float]:
    """Travel of each axis per travel along the path."""
    start, end = request.path.start.positions, request.path.end.positions
    return {
        axis: (end.get(axis, 0.0) - start.get(axis, 0.0)) / request.path.length
        for axis in request.path.axes
    }


def travel_of_channel(
    machine: Machine, directions: Mapping[str, FloatArray], *, name: str, dof: str
) -> float:
    """How the rigid machine moves a point per travel along a path; axes that move do not turn."""
    if dof not in DIRECTIONS:
        return 0.0
    rest = np.zeros(3)
    if name not in machine.points:
        return float(directions.get(name.partition(".")[0], rest)[DOF_NAMES.index(dof)])
    point = machine.points[name]
    tool, work = (directions.get(end.component or "", rest) for end in (point.tool, point.work))
    return float((tool - work)[DOF_NAMES.index(dof)])
