"""Which components hang together, which stand on ground, and which an axis moves."""

from collections.abc import Iterable, Mapping

from headstock.geometry.machine.joints import GROUND

Edge = tuple[str, str]


def reachable_from_ground(edges: Iterable[Edge]) -> frozenset[str]:
    """Components with a chain of edges to ground; an edge names two components or ground."""
    neighbours: dict[str, set[str]] = {}
    for first, second in edges:
        neighbours.setdefault(first, set()).add(second)
        neighbours.setdefault(second, set()).add(first)
    reached, frontier = {GROUND}, [GROUND]
    while frontier:
        fresh = neighbours.get(frontier.pop(), set()) - reached
        reached |= fresh
        frontier.extend(fresh)
    return frozenset(reached - {GROUND})


def floating_groups(components: Iterable[str], edges: Iterable[Edge]) -> list[list[str]]:
    """Groups of connected components without a chain to ground, in the order of the scene."""
    edges = list(edges)
    left = [name for name in components if name not in reachable_from_ground(edges)]
    groups: list[list[str]] = []
    while left:
        seeded = [*((first, second) for first, second in edges if GROUND not in (first, second)), (GROUND, left[0])]
        group = reachable_from_ground(seeded)
        groups.append([name for name in left if name in group])
        left = [name for name in left if name not in group]
    return groups


def moved_components(components: Iterable[str], edges: Mapping[str, Edge], joints: Iterable[str]) -> tuple[str, ...]:
    """Components that are cut off from ground when an axis' joints are taken away.

    Args:
        components: Component names in the order of the scene.
        edges: The two sides of every joint (and support) by name.
        joints: Names of the joints of the axis.

    Returns:
        Names in the order of the scene; those that reach ground in no case are left out.
    """
    own = set(joints)
    before = reachable_from_ground(edges.values())
    after = reachable_from_ground(edge for name, edge in edges.items() if name not in own)
    return tuple(name for name in components if name in before and name not in after)
