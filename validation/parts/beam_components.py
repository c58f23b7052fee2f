"""The seed's beams as components, for tetrahedra and hexahedra."""

from headstock.geometry.parts.components import Component, Interface, MeshSettings, Patch, ReductionSettings, Support
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import CellKind
from headstock.validation.parts.closed_form_cases import STEEL

AXES = ("x", "y", "z")
COLUMN_SIZE = (0.038, 0.100, 0.500)
FIXED_SIZE = (0.032, 0.750, 0.250)
PATCH = 0.010
OFFSET = 0.100


def mesh_settings(kind: CellKind, size: float) -> MeshSettings:
    """Settings that give a cell kind."""
    return MeshSettings(size=size, order=2 if kind in ("tet10", "hex27") else 1, cells="tet" if kind.startswith("tet") else "hex")


def column(mesh: MeshSettings, interfaces: dict[str, Interface] | None = None) -> Component:
    """The seed's column, standing on its foot."""
    return Component(
        "column", Box(COLUMN_SIZE), STEEL, interfaces=interfaces or {}, mesh=mesh, reduction=ReductionSettings(modes=6)
    )


def clamp(component: str, *faces: str) -> tuple[Support, ...]:
    """Whole faces held in every direction."""
    return tuple(Support(f"clamp{number}", component, (Patch(face),), AXES) for number, face in enumerate(faces))


def face_interface(name: str, face: str, coupling: str) -> Interface:
    """A whole face as an interface."""
    return Interface(name, (Patch(face),), "average" if coupling == "average" else "rigid")


def fixed_beam(mesh: MeshSettings, height: float | None = None) -> Component:
    """The seed's fixed beam, lying along y; with a loaded patch at a height above mid-height [m], and one behind it.

    The patches are squares of 10 mm on the two faces normal to x.
    """
    interfaces = {}
    if height is not None:
        center = (0.0, 0.0, FIXED_SIZE[2] / 2.0 + height)
        for name, face in (("front", "x+"), ("back", "x-")):
            patch = Patch(face, "rect", center, (PATCH, PATCH))
            interfaces[name] = Interface(name, (patch,), "average")
    return Component("beam", Box(FIXED_SIZE), STEEL, interfaces=interfaces, mesh=mesh, reduction=ReductionSettings(modes=6))
