"""Reads input decks of Abaqus and CalculiX: flat ones, and those of Abaqus/CAE with parts and instances.

Source: Abaqus Analysis User's Guide, "Three-dimensional solid element library".
"""

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.abaqus_deck import Block, Deck, DeckReader, Instance
from headstock.meshing.files.raw_mesh import CORNERS, VTK_EDGES, RawMesh, SolidFamily

# corners of faces S1 .. S6
SOLID_FACES: dict[SolidFamily, tuple[tuple[int, ...], ...]] = {
    "tet": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hex": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}  # fmt: skip
SURFACE_KINDS = ("ELEMENT", "NODE")
COINCIDENT = 1e-6  # of the size of the mesh


def read_abaqus(path: Path) -> RawMesh:
    """Read an ``.inp`` deck; surfaces, node sets and sets of surface elements become named sets.

    Raises:
        MeshError: The deck holds something that this reader does not know; named with its line.
    """
    deck = DeckReader(path).read()
    instances = deck.instances
    if not instances:
        instances = [Instance(name, scope) for name, scope in deck.parts.items()]
    return _Assembly(path, deck, [*instances, Instance("", deck.root)]).mesh()


class _Assembly:
    """Parts in their places, their nodes and elements counted over all of them."""

    def __init__(self, path: Path, deck: Deck, instances: Sequence[Instance]) -> None:
        self.path, self.deck, self.instances = path, deck, instances
        self.by_name = {one.name.upper(): one for one in instances}
        places, start = [], 0
        for one in instances:
            own_part = one.own
            if own_part.nodes or own_part.numbers:
                one.scope = own_part
            elif own_part.node_sets or own_part.element_sets or own_part.surfaces:
                one.scope = replace(
                    one.scope,
                    node_sets=one.scope.node_sets | own_part.node_sets,
                    element_sets=one.scope.element_sets | own_part.element_sets,
                    surfaces=one.scope.surfaces | own_part.surfaces,
                )
            one.rows = {number: start + row for row, number in enumerate(one.scope.nodes)}
            nodes = np.array(list(one.scope.nodes.values())).reshape(-1, 3)
            places.append(nodes @ one.rotation.T + one.shift)
            start += len(nodes)
        self.raw = RawMesh(np.concatenate(places))

    def mesh(self) -> RawMesh:
        """Return the mesh of the deck."""
        self._merge_ties()
        for one in self.instances:
            self._add_cells(one)
        several = sum(bool(one.cells) for one in self.instances) > 1
        for one in self.instances:
            if several:
                self.raw.add_group(one.name, np.array(list(one.cells.values()), dtype=np.int64))
            self._add_sets(one)
            self._add_sections(one)
        self._count_sheets()
        self.raw.left_out.update(self.deck.left_out)
        self.raw.notes += self._list_notes()
        return self.raw

    def _add_cells(self, one: Instance) -> None:
        for kind, elements in one.scope.elements.items():
            if elements.family is None or not elements.nodes:
                continue
            rows = [
                self._rows(one, nodes, f"{kind} {number}")
                for number, nodes in elements.nodes.items()
            ]
            numbers = np.array(list(elements.nodes), dtype=np.int64)
            cells = self.raw.add_solids(
                elements.family, np.array(rows), edges=VTK_EDGES[elements.family], numbers=numbers
            )
            one.cells |= dict(zip(elements.nodes, map(int, cells), strict=True))

    def _list_notes(self) -> Iterator[str]:
        name, deck = self.path.name, self.deck
        if deck.repeated:
            yield f"{name} defines {deck.repeated} elements twice alike"
        used = {id(one.scope.elements) for one in self.instances}
        for part, scope in deck.parts.items():
            solid = any(elements.family for elements in scope.elements.values())
            if solid and id(scope.elements) not in used:
                yield f"{name}: part {part} stands in no instance: left out"

    def _rows(self, one: Instance, nodes: Sequence[int], what: str) -> list[int]:
        try:
            return [self.alias[one.rows[node]] for node in nodes]
        except KeyError as error:
            raise MeshError(
                f"{self.path.name}: element {what}: node {error} is used but not defined"
            ) from error

    def _find(self, one: Instance, text: str) -> tuple[Instance, str]:
        """Return the instance and the name or number that ``INSTANCE.NAME`` stands for."""
        owner, dot, rest = text.partition(".")
        if dot and owner in self.by_name:
            return self.by_name[owner], rest
        return one, text

    def _members(
        self, one: Instance, name: str, kind: str, visited: tuple[str, ...] = ()
    ) -> Iterator[tuple[Instance, int]]:
        """Yield the instance and number of each member of a set; kind is ``node`` or ``element``.

        Raises:
            MeshError: There is no such set, or it holds itself.
        """
        sets = one.scope.node_sets if kind == "node" else one.scope.element_sets
        if name not in sets:
            raise MeshError(f"{self.path.name}: there is no {kind} set {name!r}")
        if name in visited:
            raise MeshError(f"{self.path.name}: {kind} set {name!r} holds itself")
        for members in sets[name]:
            owner = self.by_name.get(members.instance) if members.instance else one
            if owner is None:
                raise MeshError(f"{members.place}: there is no instance {members.instance!r}")
            numbers = owner.rows if kind == "node" else owner.scope.numbers
            for item in members.items:
                if isinstance(item, str):
                    target, rest = self._find(owner, item)
                    if rest.isdigit():
                        yield target, int(rest)
                    else:
                        yield from self._members(target, rest, kind, (*visited, name))
                elif isinstance(item, range):
                    yield from ((owner, number) for number in item if number in numbers)
                else:
                    yield owner, item

    def _cells(self, members: Sequence[tuple[Instance, int]]) -> IntArray:
        """Return the solid cells ``(n,)`` among members of a set of elements."""
        cells = [owner.cells[number] for owner, number in members if number in owner.cells]
        return np.array(cells, dtype=np.int64)

    def _add_sets(self, one: Instance) -> None:
        raw, scope = self.raw, one.scope
        for name in scope.surfaces:
            facets, nodes = self._surface(one, name)
            for corners in (3, 4):
                sides = [facet[:corners] for facet in facets if len(facet) == corners]
                raw.add_facets(self._name(one, name), np.array(sides, dtype=np.int64))
            raw.add_nodes(self._name(one, name), np.array(nodes, dtype=np.int64))
        for name in scope.node_sets:
            rows = self._node_rows(self._members(one, name, "node"))
            if name not in scope.internal:
                raw.add_nodes(self._name(one, name), rows)
        for name in (name for name in scope.element_sets if name not in scope.internal):
            members = list(self._members(one, name, "element"))
            raw.add_group(self._name(one, name), self._cells(members))
            for owner, number in members if name not in scope.surfaces else ():
                if number in owner.scope.numbers and number not in owner.cells:
                    sheet = self._rows(owner, owner.scope.numbers[number], str(number))
                    raw.add_facets(self._name(one, name), np.array([sheet]))

    def _node_rows(self, members: Iterable[tuple[Instance, int]]) -> IntArray:
        """Return the rows ``(n,)`` of nodes of instances, as far as they are defined."""
        rows = [self.alias[owner.rows[number]] for owner, number in members if number in owner.rows]
        return np.array(rows, dtype=np.int64)

    def _name(self, one: Instance, name: str) -> str:
        """Return what a set is called: by its instance where several have one of that name."""
        owners = [
            other for other in self.instances
            if any(name in sets for sets in (other.scope.node_sets, other.scope.element_sets, other.scope.surfaces))
        ]  # fmt: skip
        return f"{one.name}.{name}" if len(owners) > 1 and one.name else name

    def _add_sections(self, one: Instance) -> None:
        for name, materials, line in one.scope.sections:
            try:
                members = list(self._members(one, name, "element"))
            except MeshError as error:
                raise MeshError(f"{line}: *SOLID SECTION: {error}") from error
            cells = self._cells(members)
            if not len(cells):
                # plane elements have a solid section too
                for owner, number in members:
                    owner.sheets.add(number)
            layers = dict(map(self._describe_material, materials))
            if len(layers) > 1 and len(cells):
                raise MeshError(
                    f"{line}: *SOLID SECTION, ELSET={name} is a composite section: materials {', '.join(materials)}; "
                    "a component has one material: give the section one with MATERIAL=, or mesh each layer with "
                    "solids and a section of their own"
                )
            key, text = layers.popitem()
            self.raw.add_section(self._name(one, name), cells, text, key)
        for name in one.scope.shells:
            for owner, number in self._members(one, name, "element") if name else ():
                owner.sheets.add(number)

    def _describe_material(self, name: str) -> tuple[Hashable, str]:
        """Return what is equal for equal materials, and a material with its values for messages."""
        values = self.deck.materials.get(name.upper(), {})
        elastic, density = values.get("ELASTIC", ()), values.get("DENSITY", ())
        shown = [name]
        shown += [f"E = {elastic[0]:g}, nu = {elastic[1]:g}"] if len(elastic) > 1 else []
        shown += [f"density = {density[0]:g}"] if density else []
        return (elastic, density) if elastic else name.upper(), ", ".join(shown)

    def _count_sheets(self) -> None:
        """Count surface elements that are more than faces of solids: those with a section, and those
        with a node that no solid has.
        """
        on_solid = np.zeros(len(self.raw.points), dtype=bool)
        for block in self.raw.solids:
            on_solid[block.nodes] = True
        for one in self.instances:
            for kind, elements in one.scope.elements.items():
                for number, nodes in elements.nodes.items() if elements.family is None else ():
                    rows = [one.rows.get(node) for node in nodes]
                    # SFM3D has no stiffness
                    if number in one.sheets or not (
                        kind.startswith("SFM3D")
                        or all(row is not None and on_solid[self.alias[row]] for row in rows)
                    ):
                        self.deck.left_out[kind] += 1

    def _surface(self, one: Instance, name: str) -> tuple[list[list[int]], list[int]]:
        """Return the nodes of the facets of a surface, those of first order alone, and those of a
        surface of nodes.

        Raises:
            MeshError: It names elements or faces that are not there.
        """
        facets: list[list[int]] = []
        nodes: list[int] = []
        for block in one.scope.surfaces[name]:
            kind = block.options.get("TYPE", "ELEMENT").upper()
            if kind not in SURFACE_KINDS or "COMBINE" in block.options:
                continue  # combined of surfaces, or analytical
            for row in block.rows:
                target, label = ([word.upper() for word in row] + [""])[:2]
                owner, rest = self._find(one, target)
                if rest.isdigit():
                    members = [(owner, int(rest))]
                elif kind == "NODE" or rest in owner.scope.element_sets:
                    members = list(self._members(owner, rest, kind.lower()))
                else:
                    raise MeshError(
                        f"{block.place}: surface {name} names an unknown element set {target!r}"
                    )
                if kind == "NODE":
                    nodes += map(int, self._node_rows(members))
                    continue
                free = self._free_faces(members) if not label else set()
                for a, number in members:
                    facets += self._faces(block, a, number, label, free)
        return facets, nodes

    def _faces(
        self, block: Block, one: Instance, number: int, label: str, free: set[frozenset[int]]
    ) -> list[list[int]]:
        """Return the corners of the faces of an element that a surface names."""
        if number in one.scope.others:
            return []
        if number not in one.scope.numbers:
            raise MeshError(f"{block.place}: there is no element {number}")
        rows = self._rows(one, one.scope.numbers[number], str(number))
        family = next((e.family for e in one.scope.elements.values() if number in e.nodes), None)
        if family is None:
            return [] if label.startswith("E") else [rows]  # E1 is an edge
        faces = SOLID_FACES[family]
        if not label:
            every = [[rows[corner] for corner in face] for face in faces]
            return [face for face in every if frozenset(face) in free]
        side = label.removeprefix("S")
        if not side.isdigit() or not 1 <= int(side) <= len(faces):
            raise MeshError(
                f"{block.place}: face {label!r} of element {number}; write S1 .. S{len(faces)}"
            )
        return [[rows[corner] for corner in faces[int(side) - 1]]]

    def _free_faces(self, members: Sequence[tuple[Instance, int]]) -> set[frozenset[int]]:
        """Return the faces of solids that no other element of their instances has."""
        counts: Counter[frozenset[int]] = Counter()
        for one in {id(one): one for one, _ in members}.values():
            for elements in one.scope.elements.values():
                for number, nodes in elements.nodes.items() if elements.family else ():
                    rows = self._rows(one, nodes, str(number))
                    counts.update(
                        frozenset(rows[corner] for corner in face)
                        for face in SOLID_FACES[elements.family or "tet"]
                    )
        return {face for face, count in counts.items() if count == 1}

    def _merge_ties(self) -> None:
        """Make one of the nodes on both sides of bonded surfaces whose meshes match."""
        self.alias = list(range(len(self.raw.points)))
        for slave, master, line in self.deck.ties:
            sides = []
            for name in (slave, master):
                one, rest = self._find(self.by_name[""], name)
                if rest not in one.scope.surfaces:
                    raise MeshError(f"{line}: *TIE: there is no surface {name!r}")
                sides.append(np.unique(self._surface_nodes(one, rest)))
            near, other = sides
            if not len(near) or not len(other):
                continue
            size = float(np.ptp(self.raw.points, axis=0).max())
            away, nearest = cKDTree(self.raw.points[other]).query(self.raw.points[near])
            if (away > COINCIDENT * size).any():
                self.deck.left_out["*TIE of meshes that do not match"] += 1
                continue
            for row, target in zip(near, other[nearest], strict=True):
                self.alias[int(row)] = self.alias[int(target)]

    def _surface_nodes(self, one: Instance, name: str) -> IntArray:
        """Return the rows of all nodes on a surface, those between corners among them."""
        facets, nodes = self._surface(one, name)
        faces = {frozenset(facet) for facet in facets}
        rows_used = {*nodes, *(row for facet in facets for row in facet)}
        for other in self.instances:
            for kind, elements in other.scope.elements.items():
                family = elements.family
                if family is None:
                    continue
                first = CORNERS[family]
                for number, members in elements.nodes.items():
                    rows = self._rows(other, members, f"{kind} {number}")
                    edges = VTK_EDGES[family] if len(rows) > first else ()
                    for face in SOLID_FACES[family]:
                        if frozenset(rows[corner] for corner in face) in faces:
                            rows_used |= {
                                rows[first + index]
                                for index, edge in enumerate(edges)
                                if set(edge) <= set(face)
                            }
        return np.array(sorted(rows_used), dtype=np.int64)
