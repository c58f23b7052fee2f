"""Components that carry measured points: the nearest one, and where parts touch the one that moves like the
point.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.nearest_places import find_nearest_place
from headstock.scene.test_data.records import MeasuredModes
from headstock.solvers.pairing.shape_agreement import fit_scale
from headstock.studies.correlation.correlation import pair_shapes
from headstock.studies.correlation.model import ObservedMachine, PreparedMachine

# surfaces that are farther by less than this, or by this share, are as near [m]
TOUCHING, AS_NEAR = 1e-3, 0.2
CLEARLY = 0.5  # of the misfit of the nearest part: another part is taken below that


@dataclass(frozen=True, eq=False)
class Carrier:
    """A component that may carry a point.

    Attributes:
        position: ``(3,)`` nearest place of its surface in its frame [m].
        distance: From the point [m].
    """

    component: str
    position: FloatArray
    distance: float


def find_carriers(prepared: PreparedMachine, point: FloatArray) -> list[Carrier]:
    """Return the components whose surfaces are nearest to a point ``(3,)`` in the machine frame, the
    nearest first; several where they touch there.
    """
    found = []
    for name, skin in prepared.skins.items():
        frame = prepared.machine.placements[name]
        local = frame.rotation.T @ (point - frame.origin)
        found.append(Carrier(name, *find_nearest_place(skin, local)))
    found.sort(key=lambda carrier: carrier.distance)
    least = found[0].distance
    return [one for one in found if one.distance <= least + max(TOUCHING, AS_NEAR * least)]


def choose_carriers(
    model: ObservedMachine, measured: MeasuredModes, candidates: Mapping[str, Sequence[Sensor]]
) -> tuple[ObservedMachine, tuple[str, ...]]:
    """Return the machine with each point on the part that moves like it, and what is to be said of it.

    Modes are paired by the points that one part alone may carry; a point where parts touch is on the
    nearest one unless another moves much more like it.

    Args:
        model: Each point on its nearest part.
        candidates: Point to the sensors on each of the parts that may carry it.
    """
    open_points = sorted(point for point, sensors in candidates.items() if len(sensors) > 1)
    channels = measured.channels
    points = np.array([channel.point for channel in channels])
    sure = ~np.isin(points, open_points)
    if not open_points or not sure.any():
        return model, ()
    shapes = model.observe(channels) @ model.modes.shapes
    known = dataclasses.replace(measured, shapes=measured.shapes[sure])
    pairs = pair_shapes(known, model.modes, shapes[sure])
    first, second = [pair.first for pair in pairs], [pair.second for pair in pairs]
    factors = fit_scale(shapes[sure][:, second], measured.shapes[sure][:, first])
    # each shape of length one
    sizes = np.linalg.norm(measured.shapes[:, first], axis=0)
    wanted, partners = measured.shapes[:, first] / sizes, model.modes.shapes[:, second]
    chosen, moved = dict(model.sensors), dict[str, list[str]]()
    for point in open_points if pairs else ():
        rows = np.flatnonzero(points == point)
        asked, misfits = [channels[row] for row in rows], []
        for sensor in candidates[point]:
            seen = dataclasses.replace(model, sensors={point: sensor}).observe(asked) @ partners
            misfits.append(np.sum(np.abs(wanted[rows] - seen * factors / sizes) ** 2))
        best = int(np.argmin(misfits))
        if misfits[best] < CLEARLY * misfits[0]:
            chosen[point] = candidates[point][best]
            moved.setdefault(chosen[point].component, []).append(point)
    remarks = tuple(
        f"where parts touch, measured shapes say which one carries a point; {name}: {', '.join(points)}"
        for name, points in moved.items()
    )
    return dataclasses.replace(model, sensors=chosen), remarks
