from collections.abc import Callable, Iterator

import pytest

from built_parts import gmsh_session
from headstock.geometry.parts.components import Component, Interface, Material, MeshSettings, Patch
from headstock.geometry.parts.solids import Solid

STEEL = Material("steel", 210e9, 0.3, 7850.0)
Patches = Patch | tuple[Patch, ...]


@pytest.fixture
def kernel() -> Iterator[None]:
    with gmsh_session():
        yield


@pytest.fixture
def make_component() -> Callable[..., Component]:
    def make(
        solid: Solid,
        patches: dict[str, Patches] | None = None,
        *,
        allow_singular: bool = False,
        **mesh: object,
    ) -> Component:
        interfaces = {
            name: Interface(
                name, patch if isinstance(patch, tuple) else (patch,), allow_singular=allow_singular
            )
            for name, patch in (patches or {}).items()
        }
        return Component("part", solid, STEEL, interfaces=interfaces, mesh=MeshSettings(**mesh))  # type: ignore[arg-type]

    return make
