"""Windows of a tooth period in which a tooth cuts and the stiffness of the cut is smooth, and how many
nodes they take.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.forces import MillingCut, engagement_angles

NODES_PER_WAVE = 3.5  # of the fastest pole that matters
FEWEST_NODES = 3  # of a window, besides these
MOST_NODES = 28  # of a window: longer ones are divided
SHORTEST = 1e-9  # window, of a period
MOST_ROWS = 640  # of a matrix over a period: a speed that needs more is not evaluated


class Window(NamedTuple):
    """Begin and end since the start of the period [s], and number of nodes."""

    begin: float
    end: float
    nodes: int


def corner_times(cut: MillingCut, depth: float) -> FloatArray:
    """Times within a tooth period at which the lower or the upper end of an edge enters or leaves the
    part, rising: between them the stiffness of the cut is smooth.

    Args:
        cut: Tool, speed and engagement; its axial depth has no part in it.
        depth: Axial depth [m].
    """
    twist = 2.0 * depth * np.tan(cut.mill.helix) / cut.mill.diameter
    sides = engagement_angles(cut.mill, cut.radial_depth)
    turned = np.array([lag - cut.spin * side for side in sides for lag in (0.0, twist)])
    return np.unique(turned / cut.spindle % cut.tooth_period)


def divide_period(
    cut: MillingCut, depth: float, highest_hz: float, more: int = 0
) -> tuple[float, list[Window]]:
    """Start of a tooth period [s], at a corner of the cut, and its windows.

    Args:
        cut: Tool, speed and engagement; its axial depth has no part in it.
        depth: Axial depth [m].
        highest_hz: Of what moves in the windows [Hz].
        more: Nodes more in each.
    """
    period, corners = cut.tooth_period, corner_times(cut, depth)
    start = float(corners[0])
    windows: list[Window] = []
    for begin, end in itertools.pairwise([*map(float, corners - start), period]):
        if end - begin < SHORTEST * period or not _cuts(cut, depth, start + 0.5 * (begin + end)):
            continue
        wanted = int(np.ceil(NODES_PER_WAVE * highest_hz * (end - begin)))
        pieces = 1 + wanted // (MOST_NODES - FEWEST_NODES)
        nodes = -(-wanted // pieces) + FEWEST_NODES + more
        step = (end - begin) / pieces
        sides = [begin + number * step for number in range(pieces)]
        windows += [Window(side, side + step, nodes) for side in sides]
    return start, windows


def _cuts(cut: MillingCut, depth: float, time: float) -> bool:
    """Whether an edge is in the part at a time within a tooth period [s]."""
    low, high = (cut.spin * side for side in engagement_angles(cut.mill, cut.radial_depth))
    low, high = min(low, high), max(low, high)
    twist = 2.0 * depth * math.tan(cut.mill.helix) / cut.mill.diameter
    pitch = 2.0 * math.pi / cut.mill.teeth
    # edges of teeth lie at angles from the lower end to the upper one, a pitch apart
    bottom = -cut.spindle * time
    first, last = min(bottom, bottom + twist), max(bottom, bottom + twist)
    return math.floor((high - first) / pitch) >= math.ceil((low - last) / pitch)


def expected_rows(cut: MillingCut, highest_hz: float) -> float:
    """Rows of the matrix over a tooth period of a thin cut along and away, besides those of its poles.

    Args:
        cut: Tool, radial depth and speed.
        highest_hz: Of the poles that matter [Hz].
    """
    low, high = engagement_angles(cut.mill, cut.radial_depth)
    cutting = min(1.0, cut.mill.teeth * (high - low) / (2.0 * np.pi)) * cut.tooth_period
    corners = 2.0 if cut.mill.helix == 0.0 else 4.0
    return 2.0 * (NODES_PER_WAVE * highest_hz * cutting + corners * FEWEST_NODES)
