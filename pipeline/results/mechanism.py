"""Where a closed-loop mechanism stands in a pose, as a result."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import condition_numbers
from headstock.geometry.mechanisms.tool_mechanism import ToolMechanism
from headstock.pipeline.results.answers import Answer
from headstock.pipeline.storage.json_texts import Json


@dataclass(frozen=True)
class MechanismPose(Answer):
    """A closed-loop mechanism in a pose.

    Attributes:
        pose: Its name.
        coordinates: Of driven and passive joints [m, rad].
        condition_number: How well its drives command the wrist centre.
    """

    pose: str
    coordinates: dict[str, float]
    condition_number: float

    @classmethod
    def summarise(cls, found: Sequence[Self]) -> Json:
        """``mechanism`` by pose."""
        return {
            "mechanism": {
                answer.pose: {"coordinates": answer.coordinates, "condition_number": answer.condition_number} for answer in found
            }
        }


def describe_state(mechanism: ToolMechanism, pose: str, state: FloatArray) -> MechanismPose:
    """Coordinates and condition number of a mechanism in a pose.

    Args:
        mechanism: Of the scene.
        pose: Its name.
        state: ``(n,)`` closed state in it.
    """
    known = mechanism.mounted.mechanism
    coordinates = {name: float(state[known.index(name)]) for name in (*known.driven, *known.passive)}
    return MechanismPose(pose, coordinates, float(condition_numbers(known, state)))
