"""How far limit depths of cut may be off: what finer meshes, true faces and the modes left out change
of the machine where it cuts, and with it of the border of stability.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.reduction.estimates.response_errors import ResponseSpace, SystemChange

GROUPS = 0.1  # logarithm of the frequency of chatter within which modes left out are the same


@dataclass(frozen=True, eq=False)
class Border:
    """Limit of chatter of a machine over the speeds, or the distance between two.

    Attributes:
        depth: ``(n,)`` limits, or their distance, over those of the machine as it is.
        chatter: ``(n,)`` angular frequency [rad/s].
    """

    depth: FloatArray
    chatter: FloatArray

    def distance(self, other: "Border") -> "Border":
        """Return the sizes of both differences."""
        return Border(np.abs(self.depth - other.depth), np.abs(self.chatter - other.chatter))


# of the machine with a change, at some of the speeds
FindBorder = Callable[[SystemChange | None, BoolArray], Border]


@dataclass(frozen=True, eq=False)
class BorderChanges:
    """Changes of a border by source, None where there is no such source.

    Attributes:
        mesh: By finer meshes; NaN where modes without an estimate take part.
        faces: What true faces may add.
        modes: By the modes left out; NaN where there is no bound.
    """

    mesh: Border | None
    faces: Border | None
    modes: Border | None


def find_border_changes(
    space: ResponseSpace, find: FindBorder, chatter: FloatArray
) -> BorderChanges:
    """Find how far limits may be off.

    Args:
        find: Its border with a change; NaN at other speeds than those asked for.
        chatter: ``(n,)`` angular frequency of chatter; NaN where there is no limit.
    """
    limited = np.isfinite(chatter)
    plain = find(None, limited)
    mesh = faces = modes = None
    if space.sources.meshed:
        changes = [find(change, limited).distance(plain) for change in (space.finer, *space.faces)]
        reach = 2.0 * np.pi * min(part.reach_hz for part in space.sources.meshed.values())
        reached, change = chatter < reach, changes[0]
        mesh = Border(
            np.where(reached, change.depth, np.nan), np.where(reached, change.chatter, np.nan)
        )
        if changes[1:]:
            faces = Border(
                np.maximum(
                    0.0, np.max([border.depth - mesh.depth for border in changes[1:]], axis=0)
                ),
                np.maximum(
                    0.0, np.max([border.chatter - mesh.chatter for border in changes[1:]], axis=0)
                ),
            )
    if space.sources.truncated:
        modes = _add_modes(space, find, chatter, plain)
    return BorderChanges(mesh, faces, modes)


def _add_modes(
    space: ResponseSpace, find: FindBorder, chatter: FloatArray, plain: Border
) -> Border:
    """Return the changes by the least and the most that modes left out add at the frequencies of
    chatter.
    """
    unknown = np.full(len(chatter), np.nan)
    bounds = Border(unknown.copy(), unknown.copy())
    with np.errstate(invalid="ignore"):
        bounded = chatter**2 < space.limit
    group = np.round(np.log(np.where(bounded, chatter, 1.0)) / GROUPS)
    for number in np.unique(group[bounded]):
        some = bounded & (group == number)
        square = float(np.median(chatter[some])) ** 2
        least, most = (find(line, some) for line in space.linearise_modes(square))
        first, second, apart = least.distance(plain), most.distance(plain), least.distance(most)
        bounds.depth[some] = (np.maximum(first.depth, second.depth) + apart.depth)[some]
        bounds.chatter[some] = (np.maximum(first.chatter, second.chatter) + apart.chatter)[some]
    return bounds
