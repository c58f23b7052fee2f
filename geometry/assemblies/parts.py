"""An assembly: solids where the file has them, parts of one shape each, and the tree of products."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from headstock.geometry.parts.cad_faces import Vector

type Matrix = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class PlacedSolid:
    """One solid of an assembly file, where the assembly has it.

    Attributes:
        number: Counted from 1, as ``solid = N`` of a STEP part counts.
        names: From the root of the tree to this occurrence; empty without a tree.
        product: Name of its product in the file; empty where it has none.
        volume: [m^3].
        area: [m^2].
        center: Of mass [m].
        low: Lower corner of its bounding box [m].
        high: Upper corner of its bounding box [m].
        colour: Red, green and blue, 0 to 1.
    """

    number: int
    names: tuple[str, ...]
    product: str
    volume: float
    area: float
    center: Vector
    low: Vector
    high: Vector
    colour: Vector | None


@dataclass(frozen=True)
class Placement:
    """Rigid motion from the first solid of a part to another: ``x' = rotation @ x + shift``.

    Attributes:
        solid: Number of the solid there.
        rotation: Rows of the rotation matrix.
        shift: In the coordinates of the file [m].
        residual: Largest distance of labelled points after it [m].
    """

    solid: int
    rotation: Matrix
    shift: Vector
    residual: float


@dataclass(frozen=True)
class Part:
    """Solids of one shape, meshed once.

    Attributes:
        name: Usable as a component's name in a scene, unique in the assembly.
        placements: The first is the identity.
        fault: Why it cannot be meshed, with its face; None where nothing is known against it.
    """

    name: str
    placements: tuple[Placement, ...]
    fault: str | None = None


@dataclass(frozen=True)
class TreeNode:
    """An occurrence of a product, with those that it is made of.

    Attributes:
        name: Of the occurrence; of the file's product at the root.
        solids: Numbers of the solids that belong to it and to none of its children.
    """

    name: str
    product: str
    solids: tuple[int, ...]
    children: tuple["TreeNode", ...] = ()

    def walk(self) -> Iterator["TreeNode"]:
        """Yield this node and all below, parents first."""
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass(frozen=True)
class Assembly:
    """The solids of an assembly file, in metres.

    Attributes:
        unit: Length unit the file names, as far as it was understood.
        solids: In the order of their numbers.
        tree: One node of all solids where the file has no tree.
        remarks: Where tree and geometry disagree, and what else the reader should know.
    """

    path: Path
    unit: str | None
    solids: tuple[PlacedSolid, ...]
    parts: tuple[Part, ...]
    tree: TreeNode
    remarks: tuple[str, ...] = ()
