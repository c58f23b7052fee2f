"""How linear axes move a tool against its work, and where they stand for it to be in a place."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Point

OUT_OF_REACH = 1e-9  # of a place off what axes reach [m]
PARALLEL = 1e-6


@dataclass(frozen=True, eq=False)
class ToolTravel:
    """Axes that move a tool against its work.

    Attributes:
        directions: ``(3, a)`` travel of the tool against the work per travel of each axis.
    """

    axes: tuple[str, ...]
    directions: FloatArray

    def axis_positions(self, places: FloatArray) -> FloatArray:
        """Return the positions ``(n, a)`` of the axes [m] for places ``(n, 3)`` of the tool against
        the work, counted from where it is with all axes at zero; also of speeds and accelerations.

        Raises:
            ValueError: No axis moves the tool that way.
        """
        positions = places @ np.linalg.pinv(self.directions).T
        off = np.abs(positions @ self.directions.T - places).max(axis=0, initial=0.0)
        if (off > OUT_OF_REACH).any():
            raise ValueError(
                f"no axis moves the tool along {'xyz'[int(np.argmax(off))]}, by {1e3 * off.max():.4g} mm from where it stands with axes at zero"
            )
        return np.asarray(positions)


def find_tool_travel(machine: Machine, point: Point) -> ToolTravel:
    """Find the linear axes that move the tool of a point against its work, rotary ones at zero.

    Raises:
        ValueError: None does, or two move it the same way.
    """
    axis_directions = {}
    for name, axis in machine.axes.items():
        share = (point.tool.component in axis.moves) - (point.work.component in axis.moves)
        if axis.kind == "linear" and share:
            axis_directions[name] = share * axis.direction
    if not axis_directions:
        raise ValueError(f"no linear axis moves the tool of {point.name} against its work")
    directions = np.stack(list(axis_directions.values()), axis=1)
    if np.linalg.svd(directions, compute_uv=False)[-1] < PARALLEL or len(axis_directions) > 3:
        raise ValueError(
            f"axes {', '.join(axis_directions)} move the tool of {point.name} the same way twice; leave one out"
        )
    return ToolTravel(tuple(axis_directions), directions)
