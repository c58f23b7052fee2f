"""Where a tool is fed to, on a machine of superelements."""

from collections.abc import Mapping, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.feed import Feed, find_feed
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.superelement import Superelement


def trace_feed(
    machine: Machine, superelements: Mapping[str, Superelement], at: str, poses: Sequence[Pose]
) -> Feed:
    """Return where the tool at a point is fed to, in poses one after the other."""
    point = machine.points[at]
    end = point.tool
    tip: FloatArray = np.zeros(3)
    if end.component is not None and end.interface is not None:
        tip = superelements[end.component].interface_position(end.interface)
        tip = tip + np.asarray(point.offset)
    return find_feed(machine, point, tip, poses)
