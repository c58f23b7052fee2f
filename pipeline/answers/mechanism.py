"""Positions of a closed-loop mechanism in a pose, as a result."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, TypedDict

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import LENGTHS, ToolMechanism, condition_numbers
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.numbers.numbers import Number, make_key


class MechanismSummary(TypedDict):
    """The entry of a pose in ``mechanism``."""

    coordinates: dict[str, float]
    condition_number: float


@dataclass(frozen=True)
class MechanismPose(Answer):
    """A closed-loop mechanism in a pose.

    Attributes:
        coordinates: Of driven and passive joints [m, rad].
        condition_number: How well its drives command the wrist centre.
    """

    pose: str
    coordinates: dict[str, float]
    condition_number: float
    entry: ClassVar[str] = "mechanism"

    def list_numbers(self) -> Iterator[Number]:
        """Yield the coordinates and the condition number."""
        for name, value in self.coordinates.items():
            key = make_key("joint_coordinate", pose=self.pose, joint=name)
            yield Number(key, value, "m" if name in LENGTHS else "rad")
        yield Number(make_key("condition_number", pose=self.pose), self.condition_number, "1")

    def summarise(self) -> MechanismSummary:
        """As it stands in ``summary.json``."""
        return {"coordinates": self.coordinates, "condition_number": self.condition_number}


def describe_state(mechanism: ToolMechanism, pose: str, state: FloatArray) -> MechanismPose:
    """Coordinates and condition number of a mechanism in a pose.

    Args:
        state: ``(n,)`` closed state in it.
    """
    known = mechanism.mounted.mechanism
    coordinates = {
        name: float(state[known.index(name)]) for name in (*known.driven, *known.passive)
    }
    return MechanismPose(pose, coordinates, float(condition_numbers(known, state)))
