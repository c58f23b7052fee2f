"""Physical effects a scene can switch on, and what may be written for them."""

from headstock.pipeline.scene_errors import suggest_names
from headstock.pipeline.units import ACCELERATION, UnitError, parse_quantity, show_value

EFFECT_NAMES = ("gravity", "damping")
STANDARD_GRAVITY = 9.80665


def find_effect_fault(name: str, value: object) -> str:
    """Why an effect cannot be switched on this way; empty when it can."""
    if name not in EFFECT_NAMES:
        hint = suggest_names(name, EFFECT_NAMES, what="effects of this version")
        return f"effect {name[:80]!r} is not available; {hint}"
    if name == "gravity":
        try:
            read_gravity(value)
        except UnitError as error:
            return str(error)
        return ""
    return "" if isinstance(value, bool) else f"{show_value(value)} is neither true nor false; true uses the joints' damping"


def read_gravity(value: object) -> tuple[float, float, float]:
    """Acceleration of gravity [m/s^2]: true for standard gravity along -z, a magnitude along -z, or three components.

    Raises:
        UnitError: None of these.
    """
    if isinstance(value, bool):
        return 0.0, 0.0, -STANDARD_GRAVITY
    if not isinstance(value, list):
        return 0.0, 0.0, -parse_quantity(value, ACCELERATION).value
    if len(value) != 3:
        raise UnitError(f'has {len(value)} entries; write "9.81 m/s^2" (along -z) or three accelerations')
    x, y, z = (parse_quantity(component, ACCELERATION).value for component in value)
    return x, y, z
