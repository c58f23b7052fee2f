"""Travel of axes and of points per travel along a path."""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.scene.analyses.path import PathRequest


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
