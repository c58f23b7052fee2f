"""What the interfaces of rigid joints leave out, as a result."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from headstock.pipeline.answers.answer import Answer


class JointShapesSummary(TypedDict):
    """The entry of a joint; without a number that changes ``largest`` is 0 and ``number`` empty."""

    between: str
    shapes: int
    compared_with: int
    largest: float
    number: str


class InterfaceErrorsSummary(TypedDict):
    """The entry ``interface_errors``."""

    joints: dict[str, JointShapesSummary]
    numbers: dict[str, dict[str, float]]
    lines: dict[str, dict[str, float]]
    left_out: dict[str, str]


@dataclass(frozen=True)
class JointShapes:
    """A rigid joint: its interfaces, their deformation shapes, and how many it was compared with."""

    between: str
    shapes: int
    compared_with: int


@dataclass(frozen=True)
class InterfaceErrorsAnswer(Answer):
    """What the interfaces of rigid joints leave out.

    Attributes:
        joints: By name.
        numbers: By what they are, such as ``frequency 3``: joint to its part of how far the number
            may be off, over the number.
        lines: By frequency response: joint to its part of how far the line that changes most may
            be off, over the largest entry of that line.
        left_out: Joints of which nothing is known, with the reason.
    """

    joints: dict[str, JointShapes]
    numbers: dict[str, dict[str, float]]
    lines: dict[str, dict[str, float]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)

    def largest(self, joint: str) -> tuple[str, float]:
        """The number that a joint puts off most, and by how much of it; a line of a response only
        where there is nothing else, since beside a peak little moves it much.
        """
        judged = self.numbers or self.lines
        found = {number: parts.get(joint, 0.0) for number, parts in judged.items()}
        number = max(found, key=lambda name: found[name], default="")
        return number, found.get(number, 0.0)

    def summarise(self) -> InterfaceErrorsSummary:
        """As it stands in ``summary.json``."""
        joints: dict[str, JointShapesSummary] = {}
        for name, joint in self.joints.items():
            number, largest = self.largest(name)
            joints[name] = {
                "between": joint.between,
                "shapes": joint.shapes,
                "compared_with": joint.compared_with,
                "largest": largest,
                "number": number,
            }
        return {
            "joints": joints,
            "numbers": self.numbers,
            "lines": self.lines,
            "left_out": dict(self.left_out),
        }
