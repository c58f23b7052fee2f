"""basix, which is loaded when something of it is first used."""

from typing import TYPE_CHECKING

from headstock.geometry.loading import Library

if TYPE_CHECKING:
    import basix as basix
    import basix.ufl
else:
    basix = Library("basix")
