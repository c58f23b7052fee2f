"""The path stage with drives under control: the loop in a pose of the path, judged before any run in time."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.geometry.machine.machine_paths import travel_directions
from headstock.pipeline.stages.control import drive_machine
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.scene.requests import PathCut, PathRequest
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.friction_loop import friction_ports
from headstock.solvers.control.stability import require_stable
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.paths.controlled import ControlledPath, solve_controlled_path, solve_rubbing_path
from headstock.solvers.paths.response import PathDeviation
from headstock.solvers.paths.set_points import SetPoint
from headstock.solvers.second_order import Port

ENERGY_LIMIT = 1e-6
# modes up to so many times the band looked at are states of the loop, the others act at once; fewer where a stiff integrator has them
LINEAR_REACH, FRICTION_REACH = 12.0, 3.0

STEPS_PER_TURN = 96  # of the spindle: forces are straight between them


def close_path(state: RunState, request: PathRequest, coupled: CoupledMachine, slow_hz: float) -> ControlledPath:
    """The closed loop of a scene's drives in a pose of the path.

    Raises:
        UnstableControlError: A pole grows.
    """
    driven = drive_machine(state, coupled)
    require_stable(driven.system, driven.trains)
    ports = friction_ports(driven.trains)
    cut = request.cut
    pushed = () if cut is None else tuple((cut.at, dof) for dof in DOF_NAMES[:3])
    band = 0.5 * request.sampling_hz if request.low_pass is None else request.low_pass.frequency_hz
    reach = (FRICTION_REACH if ports else LINEAR_REACH) * band
    machine = state.scene.machine
    directions = travel_directions(machine, request.path)
    return ControlledPath(
        loop=close_loops(driven.system, driven.trains, inputs=(*pushed, *ports), outputs=request.outputs, up_to_hz=reach),
        shares=axis_shares(request),
        travel=np.array([travel_of_port(machine, directions, port) for port in request.outputs]),
        slow_hz=slow_hz,
        loads=None if cut is None else cutting_loads(cut, _tool_travel(machine, directions, cut.at)),
        load_step=math.inf if cut is None else 2.0 * math.pi / cut.cut.spindle / STEPS_PER_TURN,
    )


def drive_path(state: RunState, path: ControlledPath, move: SetPoint, samples: FloatArray) -> PathDeviation:
    """Deviation over a move, with friction where the scene names it."""
    if not friction_ports(path.loop.trains):
        return solve_controlled_path(path, move, samples)
    deviation, motion = solve_rubbing_path(path, move, samples)
    if motion.energy.error > ENERGY_LIMIT:
        state.warn(
            f"path analysis at {6e4 * move.feed:g} mm/min: the energy balance misses {motion.energy.error:.2g} of the work, more than"
            f" {ENERGY_LIMIT:g}; give friction a larger smoothing"
        )
    state.energy_errors[f"{6e4 * move.feed:g} mm/min"] = motion.energy.error
    return deviation


def cutting_loads(request: PathCut, travel: FloatArray) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Forces on the tool ``(n, 3)`` in machine axes, at instants and speeds along the path.

    Args:
        request: The cut.
        travel: ``(3,)`` of the tool against the work per travel along the path.

    Raises:
        ModelError: The tool does not move across its axis.
    """
    up = np.array(request.up)
    along = travel - (travel @ up) * up
    size = float(np.linalg.norm(along))
    if size < 1e-9:
        raise ModelError(f"the path does not move {request.at} across the tool, so nothing is milled; write another path or `up`")
    along = along / size
    # the part lies on the right of the travel, seen from above
    turn = np.array([along, np.cross(up, along), up])
    return lambda times, speeds: cutting_forces(request.cut, times, size * speeds) @ turn


def _tool_travel(machine: Machine, directions: Mapping[str, FloatArray], point: str) -> FloatArray:
    return np.array([travel_of_port(machine, directions, (point, dof)) for dof in DOF_NAMES[:3]])


def axis_shares(request: PathRequest) -> dict[str, float]:
    """Travel of each axis per travel along the path."""
    start, end = request.path.start.positions, request.path.end.positions
    return {axis: (end.get(axis, 0.0) - start.get(axis, 0.0)) / request.path.length for axis in request.path.axes}


def travel_of_port(machine: Machine, directions: Mapping[str, FloatArray], port: Port) -> float:
    """How the rigid machine moves a port per travel along a path; axes that move do not turn."""
    name, dof = port
    if dof not in DOF_NAMES[:3]:
        return 0.0
    rest = np.zeros(3)
    if name not in machine.points:
        return float(directions.get(name.partition(".")[0], rest)[DOF_NAMES.index(dof)])
    point = machine.points[name]
    tool, work = (directions.get(end.component or "", rest) for end in (point.tool, point.work))
    return float((tool - work)[DOF_NAMES.index(dof)])
