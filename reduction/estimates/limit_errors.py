"""How far the lowest limit depth of cut may be off: what finer meshes, true faces and the modes left
out change of the machine's response, carried through the lobes of the changed response.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.reduction.estimates.response_errors import ResponseSpace, SystemChange
from headstock.solvers.linear.frequency_response import FrfModel


@dataclass(frozen=True)
class LowestLimit:
    """The lowest limit over the speeds, or a distance of two.

    Attributes:
        depth: [m].
        chatter: Its angular frequency [rad/s]; NaN where nothing chatters.
    """

    depth: float
    chatter: float

    def distance(self, other: "LowestLimit") -> "LowestLimit":
        """Sizes of both differences."""
        return LowestLimit(abs(self.depth - other.depth), abs(self.chatter - other.chatter))


FindLowest = Callable[[FrfModel], LowestLimit]
Respond = Callable[[SystemChange | None], FrfModel]


@dataclass(frozen=True, eq=False)
class FinerModels:
    """A machine in a trial space, and what finer meshes and true faces make of its response.

    Attributes:
        space: The machine.
        respond: Its response with a change, damped as the scene says.
        plain: Without a change.
        finer: With finer meshes, then with true faces too; none without a mesh.
    """

    space: ResponseSpace
    respond: Respond
    plain: FrfModel
    finer: tuple[FrfModel, ...]


def change_models(space: ResponseSpace, respond: Respond) -> FinerModels:
    """Responses that all directions of travel share."""
    changes = (space.finer, *space.faces) if space.sources.meshed else ()
    return FinerModels(space, respond, respond(None), tuple(map(respond, changes)))


@dataclass(frozen=True)
class LimitChanges:
    """Changes of a lowest limit by source, None where there is no such source.

    Attributes:
        plain: The limit in the trial space.
        mesh: By finer meshes; NaN where modes without an estimate take part.
        faces: What true faces may add.
        modes: By the modes left out; NaN where there is no bound.
    """

    plain: LowestLimit
    mesh: LowestLimit | None
    faces: LowestLimit | None
    modes: LowestLimit | None


NO_BOUND = LowestLimit(np.nan, np.nan)


def find_limit_changes(models: FinerModels, find: FindLowest) -> LimitChanges:
    """How far the lowest limit of a direction of travel may be off.

    Args:
        models: Of the machine.
        find: The lowest limit with a response.
    """
    plain, space = find(models.plain), models.space
    mesh = faces = modes = None
    if models.finer:
        changes = [find(model).distance(plain) for model in models.finer]
        reach = min(part.reach_hz for part in space.sources.meshed.values())
        mesh = changes[0] if plain.chatter < 2.0 * np.pi * reach else NO_BOUND
        if changes[1:]:
            faces = LowestLimit(
                max(0.0, *(each.depth - changes[0].depth for each in changes[1:])),
                max(0.0, *(each.chatter - changes[0].chatter for each in changes[1:])),
            )
    if space.sources.truncated:
        modes = _add_modes(models, find, plain)
    return LimitChanges(plain, mesh, faces, modes)


def _add_modes(models: FinerModels, find: FindLowest, plain: LowestLimit) -> LowestLimit:
    """By the least and the most that modes left out add at the frequency of chatter."""
    square = plain.chatter**2
    if not square < models.space.limit:
        return NO_BOUND
    least, most = (find(models.respond(each)) for each in models.space.linearise_modes(square))
    first, second, apart = least.distance(plain), most.distance(plain), least.distance(most)
    return LowestLimit(
        max(first.depth, second.depth) + apart.depth,
        max(first.chatter, second.chatter) + apart.chatter,
    )
