"""Channels of responses: built from what analyses name, and what may be wrong with an output."""

from collections.abc import Sequence

from headstock.geometry.frames import DIRECTIONS
from headstock.scene.building.draft import Draft
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.solvers.second_order import Channel


def build_channels(channels: Sequence[tuple[str, str]]) -> tuple[Channel, ...]:
    """Every channel once, with its direction."""
    found = [(name, dof) for name, given in channels for dof in ([given] if given else DIRECTIONS)]
    return tuple(dict.fromkeys(found))


def check_probe_output(
    key: KeyPath, name: str, direction: str, draft: Draft, findings: Findings
) -> None:
    """Report a probe as an output that is a point as well, or has a direction."""
    if name in draft.table.points:
        findings.add(key, f"{name} is a point and a probe; rename one of them")
    elif direction:
        findings.add(
            key, f'a probe shows displacement and stress in all directions; write "{name}" alone'
        )
