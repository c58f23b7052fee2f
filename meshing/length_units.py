"""Length units of files of parts: what a STEP file names, and where a part's size puts the unit in
doubt, which mesh files do not name.
"""

import math
import re
from pathlib import Path

from headstock.geometry.parts.solids import MeshFile

STEP_UNIT = 1e-3
# one casting is seldom longer or shorter than that
PLAUSIBLE_LENGTHS = (1e-3, 3.0)
# an inch instead of a millimetre, and a metre instead of one, are what goes wrong
UNITS = (("inch", 0.0254), ("m", 1.0), ("mm", 1e-3), ("µm", 1e-6))
SHORTEST, LONGEST = 1e-4, 50.0  # [m]
HEAVIEST = 1e5  # of one part [kg]


def read_length_unit(path: Path) -> str | None:
    """Return the length unit a STEP file names: ``mm``, ``m``, ``inch`` or another; None where
    there is none or several.
    """
    text = path.read_bytes()
    units = {
        name.decode().lower()
        for name in re.findall(rb"CONVERSION_BASED_UNIT\s*\(\s*'(INCH|FOOT)'", text, re.IGNORECASE)
    }
    if not units:  # a unit made from mm names mm too
        prefixes = set(re.findall(rb"SI_UNIT\s*\(\s*(?:\$|\.(\w+)\.)\s*,\s*\.METRE\.\s*\)", text))
        units = {
            {b"": "m", b"MILLI": "mm", b"CENTI": "cm"}.get(prefix, "other") for prefix in prefixes
        }
    return units.pop() if len(units) == 1 else None


def doubt_size(path: Path, extent: float) -> str | None:
    """Return a warning where a STEP part is so long or short [m] that its unit is in doubt; None
    where it is plausible.
    """
    lowest, highest = PLAUSIBLE_LENGTHS
    if lowest <= extent <= highest:
        return None
    unit = read_length_unit(path)
    length = dict(UNITS).get(unit or "")
    others = (
        []
        if length is None
        else [(name, extent * factor / length) for name, factor in UNITS if factor != length]
    )
    fitting = [(name, value) for name, value in others if lowest <= value <= highest]
    if others and not fitting:
        fitting = [min(others, key=lambda other: abs(math.log(other[1] / highest)))]
    likely = ", ".join(f"{value:.4g} m if the numbers are in {name}" for name, value in fitting)
    return (
        f"{path.name} reads as {extent:.4g} m long, in the unit its header names ({unit or 'not understood'})"
        f"{'; it would be ' + likely if likely else ''}: this looks like a slip of units, check the export of the CAD system"
    )


def doubt_mesh_size(solid: MeshFile, extent: float, mass: float) -> str | None:
    """Say why the unit of a mesh file is in doubt; None where its part is plausible.

    Args:
        extent: Longest side of the part [m].
        mass: Of the part [kg].
    """
    if SHORTEST <= extent <= LONGEST and mass <= HEAVIEST:
        return None
    numbers = extent / solid.unit
    low, high = PLAUSIBLE_LENGTHS
    likely = [
        f'unit = "1 {name}" ({numbers * length:.3g} m)'
        for name, length in UNITS
        if low <= numbers * length <= high
    ]
    stated = "read in metres" if solid.unit == 1.0 else f"in units of {solid.unit:g} m"
    remedy = f"write {' or '.join(likely)} in its solid" if likely else "check `unit` of its solid"
    return f"{solid.path.name}, {stated}, is {extent:.3g} m long and weighs {mass:.3g} kg; {remedy}"
