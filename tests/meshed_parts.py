"""Parts of one solid, by the patches of their interfaces and the settings of their meshes."""

from collections.abc import Mapping
from typing import Any

from common import STEEL
from headstock.geometry.parts.components import Component, Interface, MeshSettings, Patch
from headstock.geometry.parts.solids import Solid
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component


def make_part(
    solid: Solid,
    patches: Mapping[str, Patch | tuple[Patch, ...]] | None = None,
    *,
    allow_singular: bool = False,
    **mesh: Any,
) -> Component:
    interfaces = {
        name: Interface(
            name, patch if isinstance(patch, tuple) else (patch,), allow_singular=allow_singular
        )
        for name, patch in (patches or {}).items()
    }
    return Component("part", solid, STEEL, interfaces=interfaces, mesh=MeshSettings(**mesh))


def mesh_part(
    solid: Solid, patches: Mapping[str, Patch | tuple[Patch, ...]] | None = None, **settings: Any
) -> ComponentMesh:
    return mesh_component(make_part(solid, patches, **settings))
