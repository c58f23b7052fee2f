"""What is asked of a component's mesh: its patches by group, the size of its elements. Nothing is meshed or read."""

from collections.abc import Sequence

from headstock.geometry.parts.components import Component, Load, Patch, Support
from headstock.geometry.parts.mass_properties import solid_volume
from headstock.geometry.parts.solid_checks import find_solid_faults
from headstock.geometry.parts.solids import HollowColumn, Imported, StepFile, Tube
from headstock.meshing.errors import MeshError
from headstock.meshing.sizing import default_size, largest_extent, round_length, thinnest_feature

Groups = dict[str, tuple[Patch, ...]]


def patch_groups(
    component: Component, supports: Sequence[Support], loads: Sequence[Load]
) -> Groups:
    """Return the patches of every group of a component, by group name.

    Args:
        supports: Of the machine; those on other components are left out.
        loads: Of the machine; those on other components are left out.
    """
    groups: Groups = {name: interface.patches for name, interface in component.interfaces.items()}
    for support in supports:
        groups |= support.groups if support.component == component.name else {}
    groups |= {
        f"load:{load.name}": load.patches
        for load in loads
        if load.component == component.name and load.patches
    }
    return groups


def element_size(component: Component) -> float:
    """Return a parametric solid's element size [m]: as requested or by rule, to 12 digits."""
    solid = component.solid
    if isinstance(solid, Imported):
        raise ValueError("only parametric solids have a size rule of their own")
    if component.mesh.size is not None:
        return round_length(component.mesh.size)
    return round_length(
        default_size(solid_volume(solid), thinnest_feature(solid), largest_extent(solid))
    )


def has_plane_faces_only(component: Component) -> bool:
    """Return whether a solid surely has no curved face, so that its mesh has no curved edge."""
    solid = component.solid
    return not isinstance(solid, StepFile | Tube) and not (
        isinstance(solid, HollowColumn) and solid.core_hole > 0.0
    )


def require_sound(component: Component) -> None:
    """Refuse a solid whose sizes make none.

    Raises:
        MeshError: They do not; says why.
    """
    faults = find_solid_faults(component.solid)
    if faults:
        raise MeshError(f"component {component.name!r}: {'; '.join(faults)}")
