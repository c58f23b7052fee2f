"""The cut along a path as loads of the machine."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.pipeline.paths.path_model import travel_of_channel
from headstock.pipeline.planning.budgets import PATH_STEPS_PER_TURN
from headstock.scene.analyses.path import PathCut
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import cutting_forces, part_sign
from headstock.solvers.paths.loads import PathLoads


def path_loads(
    machine: Machine, directions: Mapping[str, FloatArray], cut: PathCut | None
) -> PathLoads | None:
    """The cut as loads on the tool; None without one."""
    if cut is None:
        return None
    step = 2.0 * math.pi / cut.cut.spindle / PATH_STEPS_PER_TURN
    channels = tuple((cut.at, dof) for dof in DIRECTIONS)
    return PathLoads(channels, cutting_loads(cut, _tool_travel(machine, directions, cut.at)), step)


def cutting_loads(
    request: PathCut, travel: FloatArray
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Forces on the tool ``(n, 3)`` in machine axes, at instants and speeds along the path.

    Args:
        travel: ``(3,)`` of the tool against the work per travel along the path.

    Raises:
        ModelError: The tool does not move across its axis.
    """
    (frame,), (size,) = orient_cut(request, travel[None], np.array([request.up]))
    return lambda times, speeds: cutting_forces(request.cut, times, size * speeds) @ frame


def orient_cut(
    request: PathCut, travels: FloatArray, ups: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Axes ``(n, 3, 3)`` of the forces of a cut, along the travel, away from the part and along the
    tool, in machine axes; and how far the tool moves across itself ``(n,)`` per travel along the path.

    Args:
        travels: ``(n, 3)`` of the tool against the work per travel along the path.
        ups: ``(n, 3)`` along the tool.

    Raises:
        ModelError: The tool does not move across its axis.
    """
    along = travels - (travels * ups).sum(axis=1, keepdims=True) * ups
    sizes = np.linalg.norm(along, axis=1)
    if sizes.min() < 1e-9:
        raise ModelError(
            f"the path does not move {request.at} across the tool, so nothing is milled; write another path or `up`"
        )
    along = along / sizes[:, None]
    return np.stack([along, part_sign(request.part) * np.cross(ups, along), ups], axis=1), sizes


def _tool_travel(machine: Machine, directions: Mapping[str, FloatArray], point: str) -> FloatArray:
    return np.array(
        [travel_of_channel(machine, directions, name=point, dof=dof) for dof in DIRECTIONS]
    )
