"""How good the estimates of meshes are for one machine: two rounds with different meshes say how far its numbers still move."""

from collections.abc import Mapping, Sequence

import numpy as np

from headstock.pipeline.accuracy.quantities import MESH_SAFETY, Factors, Owner, Quantity
from headstock.pipeline.results.estimates import DISCRETISATION

# errors are taken to fall with this power of the mesh size, though most fall faster, and what that leaves counts half as much again
LEVEL_RATE = 1.5
LEVEL_SAFETY = 1.5
# estimates came out up to one and a half times the true error, so no less than this share of them counts
LEAST_FACTOR = 0.7


def weigh_estimates(
    before: Sequence[Quantity], after: Sequence[Quantity], steps: Mapping[str, float], known: Factors
) -> dict[tuple[str, Owner], float]:
    """Factors by which the estimates of meshes are to be counted, from how far numbers moved between two rounds.

    A number that moved by ``d`` while the size fell to the share ``s`` has ``d s^p / (1 - s^p)`` still to go, where errors fall with the
    power ``p``. Components that were not refined keep their factor.

    Args:
        before: Numbers of a round, with estimates as they are.
        after: The same of the next one.
        steps: Refined component to its new size over the old one.
        known: Factors of rounds before.

    Source: Roache (1994), J. Fluids Eng. 116, 405-413, on the grid convergence index.
    """
    factors = dict(known)
    earlier = {quantity.key: quantity for quantity in before}
    for quantity in after:
        moved = {
            owner: part
            for owner, part in quantity.parts.items()
            if owner[1] == DISCRETISATION and owner[0] in steps and part > 0.0 and quantity.key in earlier
        }
        total = sum(moved.values())
        if total > 0.0:
            change = abs(quantity.value / earlier[quantity.key].value - 1.0)
            left = sum(change * part / total * _share_left(steps[owner[0]]) for owner, part in moved.items())
            factor = LEVEL_SAFETY * left / total
            factors |= {(quantity.key, owner): float(np.clip(factor, LEAST_FACTOR, MESH_SAFETY)) for owner in moved}
    return factors


def _share_left(step: float) -> float:
    """What is left of an error, over what a refinement took of it."""
    share = step**LEVEL_RATE
    return float(share / (1.0 - share))
