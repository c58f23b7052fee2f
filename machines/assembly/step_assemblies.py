"""Writes STEP files of assemblies: solids built with gmsh, with a tree of products in the text of the file or
without.
"""

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import gmsh
import numpy as np
from scipy.spatial.transform import Rotation

from headstock.geometry.frames import Frame, compose_frames

TIME_STAMP = "2026-01-01T00:00:00"  # every writing gives the same file
# millimetres in a length unit, and how STEP names it
UNITS = {
    "mm": (1.0, "SI_UNIT(.MILLI.,.METRE.)"),
    "m": (1e3, "SI_UNIT($,.METRE.)"),
    "inch": (25.4, "CONVERSION_BASED_UNIT('INCH',#{length})"),
}
# builds a solid and returns its volume; takes the length of a millimetre in the file's unit
type Build = Callable[[float], int]


@dataclass(frozen=True, eq=False)
class Product:
    """A solid, or an assembly of occurrences."""

    name: str
    build: Build | None = None
    children: tuple["Occurrence", ...] = ()

    def leaves(self, frame: Frame = Frame()) -> Iterator[tuple["Product", Frame]]:  # noqa: B008
        """Yield the products with a solid, and where they are [mm]."""
        if self.build is not None:
            yield self, frame
        for child in self.children:
            yield from child.product.leaves(compose_frames(frame, child.frame))


@dataclass(frozen=True, eq=False)
class Occurrence:
    """A product in an assembly, with its frame there [mm]."""

    name: str
    product: Product
    frame: Frame


def add_box(mm: float, low: tuple[float, ...], size: tuple[float, ...]) -> int:
    """Add a box by its lower corner and sides [mm]."""
    return int(gmsh.model.occ.addBox(*(mm * value for value in (*low, *size))))


def add_cylinder(
    mm: float, base: tuple[float, ...], height: float, radius: float, along: int = 2
) -> int:
    """Add a cylinder by the centre of its base [mm], along an axis: 0, 1 or 2 for x, y or z."""
    axis = [height if one == along else 0.0 for one in range(3)]
    return int(gmsh.model.occ.addCylinder(*(mm * value for value in (*base, *axis, radius))))


def fuse_solids(body: int, other: int) -> int:
    """Make two solids one."""
    return int(gmsh.model.occ.fuse([(3, body)], [(3, other)])[0][0][1])


def cut_solids(body: int, tools: list[int]) -> int:
    """Cut solids out of another."""
    return int(gmsh.model.occ.cut([(3, body)], [(3, tool) for tool in tools])[0][0][1])


@contextlib.contextmanager
def gmsh_session() -> Iterator[None]:
    """Provide an empty model of gmsh that prints nothing."""
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    try:
        yield
    finally:
        gmsh.finalize()


def write_nameless(path: Path, root: Product, unit: str = "mm") -> Path:
    """Write the solids as gmsh does, without products."""
    mm = 1.0 / UNITS[unit][0]
    with gmsh_session():
        for product, frame in root.leaves():
            assert product.build is not None
            solid = [(3, product.build(mm))]
            vector = Rotation.from_matrix(frame.rotation).as_rotvec()
            if angle := float(np.linalg.norm(vector)):
                gmsh.model.occ.rotate(solid, 0, 0, 0, *vector, angle)
            gmsh.model.occ.translate(solid, *(mm * frame.origin))
        path.write_text(_written_text(path, unit))
    return path


def write_assembly(path: Path, root: Product, unit: str = "mm") -> Path:
    """Write products and occurrences round the solids, each solid once."""
    writer = _TreeWriter(unit)
    with gmsh_session():
        writer.add(root, path)
    header = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    schema = "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
    lines = "\n".join(writer.lines)
    path.write_text(f"{header}{schema}{lines}\nENDSEC;\nEND-ISO-10303-21;\n")
    return path


def _written_text(path: Path, unit: str) -> str:
    """Text of the open model's STEP file, in a unit."""
    _, name = UNITS[unit]
    gmsh.model.occ.synchronize()
    gmsh.write(str(path))
    text = re.sub(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", TIME_STAMP, path.read_text())
    if unit != "inch":
        return text.replace(UNITS["mm"][1], name)
    entity = max(map(int, re.findall(r"^#(\d+) ?=", text, re.MULTILINE))) + 1
    inch = (
        f"#{entity} = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{entity + 1});\n"
        f"#{entity + 1} = ( LENGTH_UNIT() NAMED_UNIT(*) {UNITS['mm'][1]} );\n"
        f"#{entity + 2} = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\nENDSEC;\nEND"
    )
    text = text.replace(
        f"LENGTH_UNIT() NAMED_UNIT(*) {UNITS['mm'][1]}",
        f"{name.format(length=entity)} LENGTH_UNIT() NAMED_UNIT(#{entity + 2})",
    )
    return text.replace("ENDSEC;\nEND", inch)


class _TreeWriter:
    """Entities of a STEP file that is written; each product's are written once."""

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self.lines: list[str] = []
        self.next = 1
        self.context = 0
        # of each product: its definition, its representation
        self.done: dict[Product, tuple[int, int]] = {}

    def entity(self, text: str) -> int:
        """Write an entity and return its number."""
        self.lines.append(f"#{self.next} = {text};")
        self.next += 1
        return self.next - 1

    def add(self, product: Product, path: Path) -> tuple[int, int]:
        """Write a product with all below."""
        if product not in self.done:
            below = [self.add(child.product, path) for child in product.children]
            self.done[product] = (
                self._add_solid(product, path) if product.build else self._add_node(product, below)
            )
        return self.done[product]

    def _add_solid(self, product: Product, path: Path) -> tuple[int, int]:
        assert product.build is not None
        gmsh.clear()
        product.build(1.0 / UNITS[self.unit][0])
        _, _, data = _written_text(path, self.unit).partition("DATA;\n")
        data = data.partition("ENDSEC;")[0]
        name, first = _quote(product.name), self.next
        data = re.sub(r"\bPRODUCT\('[^']*',\s*'[^']*'", lambda _: f"PRODUCT({name},{name}", data)
        self.lines.append(re.sub(r"#(\d+)", lambda m: f"#{int(m[1]) + first - 1}", data).strip())
        self.next += max(map(int, re.findall(r"#(\d+)", data)))
        # the numbers that gmsh gives the definition, the representation and its context
        self.context = first - 1 + int(re.findall(r"#10 = .*,#(\d+)\);", data)[0])
        return first + 4, first + 9

    def _add_node(self, product: Product, below: list[tuple[int, int]]) -> tuple[int, int]:
        name, entity = _quote(product.name), self.entity
        application = entity("APPLICATION_CONTEXT('')")
        context = entity(f"PRODUCT_CONTEXT('',#{application},'mechanical')")
        formation = entity(f"PRODUCT({name},{name},'',(#{context}))")
        formation = entity(f"PRODUCT_DEFINITION_FORMATION('','',#{formation})")
        context = entity(f"PRODUCT_DEFINITION_CONTEXT('part definition',#{application},'design')")
        definition = entity(f"PRODUCT_DEFINITION('design','',#{formation},#{context})")
        origin, *axes = [self._axis(f) for f in (Frame(), *(c.frame for c in product.children))]
        items = ",".join(f"#{axis}" for axis in (origin, *axes))
        shape = entity(f"SHAPE_REPRESENTATION('',({items}),#{self.context})")
        define = entity(f"PRODUCT_DEFINITION_SHAPE('','',#{definition})")
        entity(f"SHAPE_DEFINITION_REPRESENTATION(#{define},#{shape})")
        for child, axis, (part, part_shape) in zip(product.children, axes, below, strict=True):
            moved = entity(f"ITEM_DEFINED_TRANSFORMATION('','',#{origin},#{axis})")
            relation = entity(
                f"(REPRESENTATION_RELATIONSHIP('','',#{part_shape},#{shape})"
                f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{moved})SHAPE_REPRESENTATION_RELATIONSHIP())"
            )
            used = entity(
                f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{self.next}',{_quote(child.name)},'',#{definition},#{part},$)"
            )
            used = entity(f"PRODUCT_DEFINITION_SHAPE('','',#{used})")
            entity(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relation},#{used})")
        return definition, shape

    def _axis(self, frame: Frame) -> int:
        length, _ = UNITS[self.unit]
        numbers = (frame.origin / length, frame.rotation[:, 2], frame.rotation[:, 0])
        origin, z, x = (",".join(f"{value:.17E}" for value in row) for row in numbers)
        point = self.entity(f"CARTESIAN_POINT('',({origin}))")
        along, first = (self.entity(f"DIRECTION('',({row}))") for row in (z, x))
        return self.entity(f"AXIS2_PLACEMENT_3D('',#{point},#{along},#{first})")


def _quote(name: str) -> str:
    """A string of STEP; other letters than ASCII are coded."""
    coded = re.sub(r"[^\x00-\x7f]", lambda m: f"\\X2\\{ord(m[0]):04X}\\X0\\", name)
    return "'" + coded.replace("'", "''") + "'"
