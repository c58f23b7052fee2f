"""Where a closed-loop mechanism stands in a pose, for results."""

from headstock.geometry.mechanisms.exechon import condition_numbers
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.tool_mechanism import ToolMechanism
from headstock.pipeline.results.results import MechanismPose


def describe_state(mechanism: ToolMechanism, state: FloatArray) -> MechanismPose:
    """Coordinates and condition number at a closed state ``(n,)``."""
    known = mechanism.mounted.mechanism
    coordinates = {name: float(state[known.index(name)]) for name in (*known.driven, *known.passive)}
    return MechanismPose(coordinates, float(condition_numbers(known, state)))
