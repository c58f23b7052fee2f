"""Checks that every key of a component's mesh has something to act on."""

from collections.abc import Iterator

from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.mass_properties import solid_volume
from headstock.geometry.parts.solids import Box, MeshFile, Solid, StepFile, SuperelementFile
from headstock.meshing.sizing import (
    PATCH_CELLS,
    count_patch_cells,
    default_size,
    dense_patch_message,
    largest_extent,
    thinnest_feature,
)
from headstock.scene.reading.positions import KeyPath
from headstock.scene.schema.components import ComponentTable

# what only our own mesher can follow; the order of a mesh file's elements is raised and its refusals are overruled
OWN_MESH_KEYS = ("size", "cells", "across_patches", "growth", "rim_size", "smallest")


def find_mesh_faults(table: ComponentTable, solid: Solid) -> Iterator[tuple[KeyPath, str]]:
    """What is wrong with how an elastic component is to be meshed: the key below it and what to write."""
    if table.fidelity != "elastic" or table.solid.superelement is not None:
        return
    mesh = table.mesh
    if isinstance(solid, MeshFile):
        for key in OWN_MESH_KEYS:
            if key in mesh.model_fields_set:
                yield ("mesh", key), f"the mesh is that of {solid.path.name}; remove {key}, or mesh a STEP file of the part"
        return
    if mesh.cells == "hex" and table.solid.box is None:
        yield ("mesh", "cells"), f'hexes are made of boxes only, not of a {table.solid.kind}; write cells = "tet"'
    if mesh.cells == "hex" and mesh.growth is not None:
        yield ("mesh", "growth"), 'only tets grow from rims; write cells = "tet", or remove growth'
    if mesh.rim_size is not None and mesh.growth is None:
        yield ("mesh", "rim_size"), "says nothing without a growth from there; write growth = 0.3 beside it"
    if mesh.rim_size is not None and mesh.size is not None and mesh.rim_size >= mesh.size:
        yield ("mesh", "rim_size"), "is not smaller than size; write a smaller one, or remove rim_size and growth"
    if mesh.smallest is not None and (isinstance(solid, Box) or mesh.cells == "hex"):
        yield ("mesh", "smallest"), "a box has no curved faces and no short edges; remove smallest"
    if mesh.smallest is not None and mesh.size is not None and mesh.smallest > mesh.size:
        yield ("mesh", "smallest"), "is larger than size; write a smaller one, or remove it"
    yield from _find_rimless(table)


def find_dense_patch(table: ComponentTable, patch: Patch, solid: Solid) -> str:
    """Why a patch asks for more elements than a mesh should have; empty when it does not, or when only the CAD kernel can say."""
    if table.fidelity != "elastic" or table.mesh.cells == "hex" or table.mesh.growth is not None:
        return ""
    if isinstance(solid, MeshFile | StepFile | SuperelementFile):
        return ""
    across = table.mesh.across_patches
    size = table.mesh.size or default_size(solid_volume(solid), thinnest_feature(solid), largest_extent(solid))
    count = count_patch_cells(patch, solid, across=across, size=size)
    return dense_patch_message(count, min(patch.size), across) if count > PATCH_CELLS else ""


def _find_rimless(table: ComponentTable) -> Iterator[tuple[KeyPath, str]]:
    """Rims that a mesh is to grow from where there are none."""
    mesh, interfaces = table.mesh, table.interfaces.values()
    if mesh.growth is None:
        return
    rigid = any(entry.coupling == "rigid" and entry.rail is None for entry in interfaces)
    imprinted = any(patch.disk or patch.rect or patch.strip for entry in interfaces for patch in entry.patch_tables())
    if mesh.rim_size is not None and not rigid:
        yield ("mesh", "rim_size"), 'no interface has the coupling "rigid"; remove rim_size'
    elif mesh.rim_size is None and not imprinted:
        remedy = 'write rim_size = "2 mm", say, for those of rigid interfaces' if rigid else "remove growth"
        yield ("mesh", "growth"), f"there is no patch from whose rim elements could grow; {remedy}"
