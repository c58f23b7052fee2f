"""Windows of a tooth period in which a tooth cuts and the stiffness of the cut is smooth, and how many
nodes they take.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

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


def divide_period(
    cut: MillingCut, depth: float, highest_hz: float, more: int = 0
) -> tuple[float, tuple[Window, ...]]:
    """Start of a tooth period [s], at a corner of the cut, and its windows.

    Corners are where the lower or the upper end of an edge enters or leaves the part: between them
    the stiffness of the cut is smooth.

    Args:
        cut: Tool, speed and engagement; its axial depth has no part in it.
        depth: Axial depth [m].
        highest_hz: Of what moves in the windows [Hz].
    """
    period, spindle = cut.tooth_period, cut.spindle
    low, high = sorted(cut.spin * side for side in engagement_angles(cut.mill, cut.radial_depth))
    twist = 2.0 * depth * math.tan(cut.mill.helix) / cut.mill.diameter
    corners = sorted(
        {(lag - side) / spindle % period for side in (low, high) for lag in (0.0, twist)}
    )
    pitch, start = 2.0 * math.pi / cut.mill.teeth, corners[0]
    windows: list[Window] = []
    for begin, end in itertools.pairwise([*(corner - start for corner in corners), period]):
        # edges of teeth lie at angles from the lower end to the upper one, a pitch apart
        bottom = -spindle * (start + 0.5 * (begin + end))
        first, last = min(bottom, bottom + twist), max(bottom, bottom + twist)
        cuts = math.floor((high - first) / pitch) >= math.ceil((low - last) / pitch)
        if not cuts or end - begin < SHORTEST * period:
            continue
        wanted = math.ceil(NODES_PER_WAVE * highest_hz * (end - begin))
        pieces = 1 + wanted // (MOST_NODES - FEWEST_NODES)
        nodes = -(-wanted // pieces) + FEWEST_NODES + more
        step = (end - begin) / pieces
        sides = [begin + number * step for number in range(pieces)]
        windows += [Window(side, side + step, nodes) for side in sides]
    return start, tuple(windows)


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
