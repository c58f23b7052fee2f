"""Rigid joints over areas that are large beside the bodies that they bond: with six motions they leave the
bodies no bending there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.pipeline.planning.interfaces import find_glued_joints
from headstock.scene.scene import Scene

LEAST_SHARE = 0.1  # of a body's compliance in bending that is doubted: 5 % of its frequencies

type Parts = Mapping[str, SolidProperties]


@dataclass(frozen=True)
class _Bond:
    """A rigid joint as one of its bodies has it.

    Attributes:
        interface: Of this body.
        far: Component and interface of the other.
    """

    joint: str
    interface: str
    far: tuple[str, str]


def doubt_rigid_areas(scene: Scene, parts: Parts) -> list[str]:
    """Return a warning for each body that rigid joints stiffen much; none where an accuracy or
    ``interface_errors`` finds it out.

    Args:
        parts: What is known of the bodies, by name.
    """
    if scene.accuracy is not None or scene.interface_errors:
        return []
    bonds: dict[str, list[_Bond]] = {}
    for joint in find_glued_joints(scene.machine, scene.machine.components):
        for near, far in (joint.ends, joint.ends[::-1]):
            entry = scene.machine.components[near[0]].interfaces[near[1]]
            if (
                entry.coupling == "rigid"
                and not entry.flexible
                and {near[0], far[0]} <= parts.keys()
            ):
                bonds.setdefault(near[0], []).append(_Bond(joint.name, near[1], far))
    lost = {name: _find_lost_share(parts, name, bonded) for name, bonded in bonds.items()}
    # a body that lies on another with a whole side bends as that one lets it, which says what is lost
    worst: dict[str, set[str]] = {}
    for name, bonded in bonds.items():
        for bond in bonded:
            bodies = [name, bond.far[0]] if bond.far[0] in lost else [name]
            worst.setdefault(min(bodies, key=lost.__getitem__), set()).add(bond.joint)
    return [
        f"component {name}: rigid interfaces at {' and '.join(sorted(joints))} take about {lost[name]:.0%} of its compliance in bending away; "
        'coupling = { flexible = "auto" } in both interfaces of each joint lets them deform'
        for name, joints in worst.items()
        if lost[name] > LEAST_SHARE
    ]


def _find_lost_share(parts: Parts, name: str, bonds: Sequence[_Bond]) -> float:
    """Return which share of a body's compliance in bending lies where other bodies are bonded to it,
    as that of a bar along its longest side that is thicker there.
    """
    sides = np.ptp(parts[name].box, axis=0)
    along, length = int(np.argmax(sides)), float(sides.max())
    bonded: dict[int, list[tuple[float, float]]] = {}
    for bond in bonds:
        normal, thickness = _measure_thickness(parts[name], bond.interface)
        if normal != along and thickness < length:
            _, added = _measure_thickness(parts[bond.far[0]], bond.far[1])
            covered = float(np.ptp(parts[name].patch_boxes[bond.interface], axis=0)[along])
            bonded.setdefault(normal, []).append((covered, thickness / (thickness + added)))
    shares = [0.0]
    for areas in bonded.values():
        inside = sum(covered * ratio**3 for covered, ratio in areas)
        rest = max(length - sum(covered for covered, _ in areas), 0.0)
        shares.append(inside / (inside + rest))
    return max(shares)


def _measure_thickness(part: SolidProperties, interface: str) -> tuple[int, float]:
    """Return the axis of a body across one of its interfaces, and its thickness along that as its
    volume has it, which counts walls and ribs in part [m].
    """
    normal = int(np.argmin(np.ptp(part.patch_boxes[interface], axis=0)))
    sides = np.delete(np.ptp(part.box, axis=0), normal)
    return normal, part.volume / float(sides.prod())
