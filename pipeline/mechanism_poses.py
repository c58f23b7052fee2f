"""Where a closed-loop mechanism stands in a pose, for results."""

from headstock.geometry.exechon_poses import condition_numbers
from headstock.geometry.frames import FloatArray
from headstock.geometry.tool_mechanisms import ToolMechanism
from headstock.pipeline.results import MechanismPose


def describe_state(mechanism: ToolMechanism, state: FloatArray) -> MechanismPose:
    """Coordinates and condition number at a closed state ``(n,)``."""
    known = mechanism.mounted.mechanism
    coordinates = {name: float(state[known.index(name)]) for name in (*known.driven, *known.passive)}
    return MechanismPose(coordinates, float(condition_numbers(known, state)))
