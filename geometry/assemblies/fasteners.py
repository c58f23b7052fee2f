"""Screws, nuts, washers and pins of an assembly: small solids that are no bodies of a machine's model."""

import re
from collections.abc import Mapping, Sequence

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.pair_motions import PairMotion
from headstock.geometry.assemblies.parts import Assembly, PlacedSolid
from headstock.geometry.machine.joints import connected_groups

SMALL = 0.05  # volume of a fastener over that of the largest solid
WORDS = re.compile(
    r"bolt|screw|nut\b|washer|\bpin\b|dowel|rivet|schraube|mutter|scheibe|stift|\b(?:iso|din)[ _-]?\d{3,}"
)
MOVING = ("guide", "bearing", "screw")


def find_fasteners(
    assembly: Assembly, contacts: Sequence[Contact], motions: Sequence[PairMotion]
) -> dict[int, int]:
    """Find the fasteners without which everything still hangs together.

    A fastener is small, belongs to no guide, bearing or drive, and is called like one; where the file
    names nothing, it sits in a bore and touches two others or more.

    Returns:
        Number of each to that of the largest solid that it touches and that is none.
    """
    solids = {solid.number: solid for solid in assembly.solids}
    largest = max(solid.volume for solid in solids.values())
    nameless = not any(solid.names or solid.product for solid in solids.values())
    touching: dict[int, set[int]] = {number: set() for number in solids}
    for contact in contacts:
        first, second = contact.solids
        touching[first].add(second)
        touching[second].add(first)
    moving = {number for one in motions if one.likely in MOVING for number in one.solids}
    inside = {
        min(contact.solids, key=lambda number: solids[number].volume)
        for contact in contacts
        if contact.kind == "cylinder"
    }
    found = {
        number
        for number, solid in solids.items()
        if solid.volume <= SMALL * largest
        and number not in moving
        and (number in inside and len(touching[number]) > 1 if nameless else _is_called_one(solid))
    }
    found -= _find_links(found, touching)
    hosts = {number: _find_host(number, found, touching, solids) for number in sorted(found)}
    return {number: host for number, host in hosts.items() if host is not None}


def _is_called_one(solid: PlacedSolid) -> bool:
    name = " ".join((solid.product, *solid.names[-1:])).lower().replace("_", " ")
    return WORDS.search(name) is not None


def _find_links(found: set[int], touching: Mapping[int, set[int]]) -> set[int]:
    """Return the fasteners that alone hold others: what they hold comes apart without any."""
    others = [number for number in touching if number not in found]
    edges = [(str(one), str(other)) for one in others for other in touching[one] - found]
    group_of = {
        int(name): index
        for index, group in enumerate(connected_groups(map(str, others), edges))
        for name in group
    }
    return {
        number
        for number in found
        if len({group_of[other] for other in touching[number] if other in group_of}) > 1
    }


def _find_host(
    number: int,
    found: set[int],
    touching: Mapping[int, set[int]],
    solids: Mapping[int, PlacedSolid],
) -> int | None:
    """Return the largest solid that a fastener touches, directly or by way of other fasteners."""
    reached, waiting = {number}, [number]
    while waiting:
        new = touching[waiting.pop()] - reached
        reached |= new
        waiting += new & found
    hosts = reached - found
    return max(hosts, key=lambda host: solids[host].volume) if hosts else None
