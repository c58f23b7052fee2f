"""The length unit of mesh files, which do not name one: where a part's size puts it in doubt."""

from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.step_units import PLAUSIBLE_LENGTHS, UNITS

SHORTEST, LONGEST = 1e-4, 50.0  # [m]
HEAVIEST = 1e5  # of one part [kg]


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
