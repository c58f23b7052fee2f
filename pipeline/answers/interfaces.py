"""What the interfaces of rigid joints leave out, as a result."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, TypedDict

from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.numbers.numbers import Key


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
        parts: Joint to its part of how far numbers may be off, over the number.
        lines: Joint to the same of the line of each frequency response that changes most, over the
            largest entry of that line.
        left_out: Joints of which nothing is known, with the reason.
    """

    joints: dict[str, JointShapes]
    parts: Mapping[Key, Mapping[str, float]]
    lines: Mapping[Key, Mapping[str, float]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    entry: ClassVar[str] = "interface_errors"

    def largest(self, joint: str) -> tuple[Key | None, float]:
        """Return the number that a joint puts off most, and by how much of it; a line of a response only
        where there is nothing else, since next to a peak little moves it much.
        """
        found = {
            number: parts.get(joint, 0.0) for number, parts in (self.parts or self.lines).items()
        }
        number = max(found, key=lambda key: found[key], default=None)
        return number, found.get(number, 0.0) if number is not None else 0.0

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
                "number": "" if number is None else str(number),
            }
        return {
            "joints": joints,
            "numbers": {str(key): dict(parts) for key, parts in self.parts.items()},
            "lines": {str(key): dict(parts) for key, parts in self.lines.items()},
            "left_out": dict(self.left_out),
        }
