"""Scenes of steel boxes with a face below and one above, without a file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import Component, Interface, Material, Patch
from headstock.geometry.parts.solids import Box
from headstock.scene.scene import Analyses, Scene

STEEL = Material("steel", 210e9, 0.3, 7850.0)
FACES = {
    "foot": Interface("foot", (Patch("z-"),)),
    "tip": Interface("tip", (Patch("z+"),), coupling="average"),
}


def make_block(name: str, size: tuple[float, float, float], **settings: Any) -> Component:
    return Component(name, Box(size), STEEL, **{"interfaces": FACES, **settings})


def scene_of(
    parts: Sequence[Component], joints: Sequence[Joint], analyses: Analyses, **settings: Any
) -> Scene:
    """With the point ``tcp`` at the tip of the last part."""
    machine = Machine(
        "machine",
        {part.name: part for part in parts},
        {joint.name: joint for joint in joints},
        {"tcp": Point("tcp", JointEnd(parts[-1].name, "tip"), JointEnd())},
    )
    poses, path = {"reference": Pose("reference")}, Path("machine.toml")
    return Scene("machine", path, machine, poses, analyses, frozenset(), (), {}, **settings)
