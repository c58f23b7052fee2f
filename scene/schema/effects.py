"""Physical effects a scene can switch on, and what may be written for them."""

from typing import Any

from headstock.geometry.parts.components import RayleighDamping
from headstock.scene.reading.findings import suggest_names
from headstock.scene.reading.units import (
    ACCELERATION,
    RATE,
    RATIO,
    TIME,
    UnitError,
    parse_quantity,
    quote_value,
)
from headstock.scene.schema.types import find_damping_fault

# on or off, without a value
CONTOUR_EFFECTS = ("coriolis", "cutting_force", "regeneration")
DRIVE_EFFECTS = ("drive_control", "friction", "screw_inertia", "torque_ripple")
GRAVITY_STIFFENING = "gravity_stiffening"
GUIDE_ERRORS = "guide_errors"
PLAIN_EFFECTS = (*CONTOUR_EFFECTS, *DRIVE_EFFECTS, GRAVITY_STIFFENING, GUIDE_ERRORS)
EFFECT_NAMES = ("gravity", "damping", *PLAIN_EFFECTS)
STANDARD_GRAVITY = 9.80665


def find_effect_fault(name: str, value: object) -> str:
    """Say why an effect cannot be switched on this way; empty when it can."""
    if name not in EFFECT_NAMES:
        hint = suggest_names(name, EFFECT_NAMES, what="effects of this version")
        return f"effect {name[:80]!r} is not available; {hint}"
    if name in PLAIN_EFFECTS:
        if isinstance(value, bool):
            return ""
        return f"{quote_value(value)} is neither true nor false; write {name} = true"
    if name == "gravity":
        try:
            read_gravity(value)
        except UnitError as error:
            return str(error)
        return ""
    try:
        read_modal_damping(value)
        read_rayleigh_damping(value)
    except UnitError as error:
        return str(error)
    return ""


def read_modal_damping(value: object) -> tuple[float, ...]:
    """Damping ratios of the modes: of ``{ modal = 0.02 }``, or of a list for the first, second, ...
    and all other modes.

    Raises:
        UnitError: It is neither a flag nor a table of damping, or a ratio is none.
    """
    table = _damping_table(value)
    if "modal" not in table:
        return ()
    given = table["modal"] if isinstance(table["modal"], list) else [table["modal"]]
    ratios = [
        parse_quantity(item, RATIO).value if isinstance(item, str) else item for item in given
    ]
    for ratio in ratios:
        if isinstance(ratio, bool) or not isinstance(ratio, int | float):
            raise UnitError(
                f'{quote_value(ratio)} is no damping ratio; write for example 0.02 or "2 %"'
            )
        if fault := find_damping_fault(float(ratio), "damping ratio"):
            raise UnitError(f"modal {fault}")
    if not ratios:
        raise UnitError("holds no damping ratio; write { modal = 0.02 }")
    return tuple(float(ratio) for ratio in ratios)


def read_rayleigh_damping(value: object) -> RayleighDamping:
    """Damping by mass and stiffness of the whole machine: of ``{ rayleigh = { alpha = "2 1/s", beta
    = "1e-5 s" } }``.

    Raises:
        UnitError: It is neither a flag nor a table of damping, or a coefficient is none.
    """
    given = _damping_table(value).get("rayleigh")
    if given is None:
        return RayleighDamping()
    dimensions = {"alpha": RATE, "beta": TIME}
    if not isinstance(given, dict) or not given or not set(given) <= set(dimensions):
        raise UnitError(
            f'{quote_value(given)} is no Rayleigh damping; write rayleigh = {{ alpha = "2 1/s", beta = "1e-5 s" }}, or one of both'
        )
    read = {name: parse_quantity(given[name], dimensions[name]).value for name in given}
    for name, coefficient in read.items():
        if coefficient < 0.0:
            raise UnitError(f"{name} of rayleigh is {coefficient:g} but must not be negative")
    return RayleighDamping(**read)


def _damping_table(value: object) -> dict[str, Any]:
    if isinstance(value, bool):
        return {}
    if not isinstance(value, dict) or not value or not set(value) <= {"modal", "rayleigh"}:
        raise UnitError(
            f"{quote_value(value)} is neither true nor {{ modal = 0.02 }}; true uses the damping of joints, components and materials,"
            ' modal adds a damping ratio to every mode, and rayleigh = { alpha = "2 1/s", beta = "1e-5 s" } shares of mass and stiffness'
        )
    return value


def read_gravity(value: object) -> tuple[float, float, float]:
    """Acceleration of gravity [m/s^2]: true for standard gravity along -z, a magnitude along -z, or
    three components.

    Raises:
        UnitError: None of these.
    """
    if isinstance(value, bool):
        return 0.0, 0.0, -STANDARD_GRAVITY
    if not isinstance(value, list):
        return 0.0, 0.0, -parse_quantity(value, ACCELERATION).value
    if len(value) != 3:
        raise UnitError(
            f'has {len(value)} entries; write "9.81 m/s^2" (along -z) or three accelerations'
        )
    x, y, z = (parse_quantity(component, ACCELERATION).value for component in value)
    return x, y, z
