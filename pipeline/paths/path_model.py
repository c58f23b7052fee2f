"""A path as its solvers take it: poses of the machine, its model and the instants looked at."""

from headstock.geometry.frames import FloatArray
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
