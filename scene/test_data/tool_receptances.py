"""Receptances of a tool in its holder, from any file of test data."""

from pathlib import Path

import numpy as np

from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import ComplexArray, MeasuredResponses
from headstock.scene.test_data.responses import label_channel
from headstock.solvers.milling.tool_dynamics import MeasuredAssembly, across_axis


def read_tool(path: Path, axis: tuple[float, float, float]) -> MeasuredAssembly:
    """Receptances between the points ``tip`` and ``base`` of a tool, or two numbers, of which the lower
    one is the tip. One receptance alone is that of the tip of the mounted tool: the machine is in it.

    Args:
        axis: Of the tool, machine frame.

    Raises:
        MeasurementError: The file cannot be read, or holds other pairs of channels.
    """
    responses = read_test_data(path).responses
    if responses is None:
        raise MeasurementError(f"{path.name}:1: holds no frequency response of a tool")
    hertz, across = responses.frequencies_hz, across_axis(np.array(axis))
    channels = (*responses.motions, *responses.forces)
    points = sorted({channel.point for channel in channels}, key=_tip_first)
    parts = {
        (responses.motions[i].point, responses.forces[j].point): _signed(responses, int(i), int(j))
        for i, j in np.argwhere(~np.isnan(responses.values).any(axis=0))
    }
    if len(points) == 1 and len(parts) == 1:
        nothing = np.zeros(len(hertz), dtype=complex)
        return MeasuredAssembly(hertz, next(iter(parts.values())), nothing, nothing, across)
    axes = {tuple(np.abs(channel.direction)) for channel in channels}
    tip, base = points if len(points) == 2 else ("", "")
    cross = parts.get((base, tip), parts.get((tip, base)))
    ends = parts.get((tip, tip)), parts.get((base, base))
    if len(axes) > 1 or cross is None or ends[0] is None or ends[1] is None:
        pairs = ", ".join(map(label_channel, channels[:6]))
        raise MeasurementError(
            f"{path.name}:1: a tool has receptances at its tip, at its base and between them, all in one direction, or one alone at its"
            f" mounted tip; here are the channels {pairs}: export only these"
        )
    return MeasuredAssembly(hertz, ends[0], cross, ends[1], across)


def _tip_first(point: str) -> tuple[bool, int, str]:
    return (point.lower() != "tip", int(point) if point.isdecimal() else 0, point)


def _signed(responses: MeasuredResponses, motion: int, force: int) -> ComplexArray:
    """A receptance ``(l,)`` with motion and force counted along the same way of their axis."""
    ways = [
        np.sign(np.sum(channel.direction))
        for channel in (responses.motions[motion], responses.forces[force])
    ]
    return ways[0] * ways[1] * responses.values[:, motion, force]
