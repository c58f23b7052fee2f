"""Makes ``step_column.step``: a cast column with ribs, fillets, core holes, rail pads and a bolted
foot.

Run inside Headstock's environment, in this folder: ``../headstock exec python3
step_column_part.py``. The same kernel writes the same file; its time stamp is fixed. Millimetres; z
is up, x points to the rails, the origin is the middle of the foot's sole.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import gmsh

SHAFT = (300.0, 300.0, 860.0)  # x y z
WALL, RIB, CAP = 22.0, 16.0, 24.0
CAVITY_FILLET, EDGE_FILLET, FOOT_FILLET = 14.0, 28.0, 16.0
FOOT = (420.0, 420.0, 36.0)
FLOORS, BAYS = 3, 2  # cavities along z and y
BACK_HOLE, RIB_HOLE, FLOOR_HOLE, BOLT_HOLE = 96.0, 90.0, 64.0, 18.0
RAIL = (12.0, 56.0, 780.0)
RAIL_PLACES = (-90.0, 90.0)
SCREW_PAD = (12.0, 80.0, 90.0)
TIME_STAMP = "2026-01-01T00:00:00"

DimTags = list[tuple[int, int]]


def build_column() -> int:
    """The column in the open gmsh model; returns the tag of its volume."""
    occ = gmsh.model.occ
    body = [(3, occ.addBox(-SHAFT[0] / 2, -SHAFT[1] / 2, 0, *SHAFT))]
    foot = [(3, occ.addBox(-FOOT[0] / 2, -FOOT[1] / 2, 0, *FOOT))]
    outside = round_edges(
        occ.fuse(body, foot)[0], lambda box: is_upright(box) or is_foot_corner(box)
    )
    cavities = [round_edges([(3, cavity)], lambda box: True)[0] for cavity in add_cavities()]
    hollow = occ.cut(outside, cavities)[0]
    solid = occ.cut(occ.fuse(hollow, add_pads())[0], add_holes())[0]
    occ.synchronize()
    (_, volume), *rest = gmsh.model.getEntities(3)
    if rest or len(solid) != 1:
        raise RuntimeError("the column fell into parts")
    return int(volume)


def round_edges(shape: DimTags, wanted) -> DimTags:  # type: ignore[no-untyped-def]
    """Fillet the edges whose bounding box the function wants: foot corners and uprights wide, the
    foot's joint narrower.
    """
    occ = gmsh.model.occ
    occ.synchronize()
    volume = shape[0][1]
    edges = [
        tag
        for _, tag in gmsh.model.getBoundary(
            gmsh.model.getBoundary(shape, oriented=False), combined=False, oriented=False
        )
    ]
    chosen = [edge for edge in sorted(set(edges)) if wanted(gmsh.model.getBoundingBox(1, edge))]
    radii = [
        CAVITY_FILLET if len(set(edges)) == 12 else radius_of(gmsh.model.getBoundingBox(1, edge))
        for edge in chosen
    ]
    return list(occ.fillet([volume], chosen, radii))


def is_upright(box: tuple[float, ...]) -> bool:
    """Whether an edge runs along z, on shaft or foot."""
    return box[5] - box[2] > FOOT[2] / 2


def is_foot_corner(box: tuple[float, ...]) -> bool:
    """Whether an edge is where the shaft meets the foot."""
    level = abs(box[2] - FOOT[2]) < 1e-3 and abs(box[5] - FOOT[2]) < 1e-3
    return (
        level
        and max(abs(value) for value in (box[0], box[1], box[3], box[4])) < SHAFT[0] / 2 + 1e-3
    )


def radius_of(box: tuple[float, ...]) -> float:
    """Fillet radius of an outer edge."""
    return FOOT_FILLET if is_foot_corner(box) else EDGE_FILLET


def spans(count: int, low: float, high: float) -> list[tuple[float, float]]:
    """Clear spans between ribs."""
    clear = (high - low - (count - 1) * RIB) / count
    return [(low + k * (clear + RIB), low + k * (clear + RIB) + clear) for k in range(count)]


def cavity_spans() -> tuple[
    tuple[float, float], list[tuple[float, float]], list[tuple[float, float]]
]:
    """Spans of the cavities along x, y and z."""
    half = SHAFT[0] / 2 - WALL
    return (-half, half), spans(BAYS, -half, half), spans(FLOORS, CAP, SHAFT[2] - CAP)


def add_cavities() -> list[int]:
    """Boxes of the cores."""
    along_x, bays, floors = cavity_spans()
    return [
        gmsh.model.occ.addBox(
            along_x[0], y[0], z[0], along_x[1] - along_x[0], y[1] - y[0], z[1] - z[0]
        )
        for y in bays
        for z in floors
    ]


def add_pads() -> DimTags:
    """Rail pads along z and the pad of the screw's bearing, on the front."""
    occ = gmsh.model.occ
    low = SHAFT[2] - 20.0 - RAIL[2]
    front = SHAFT[0] / 2
    pads = [
        occ.addBox(front - 2.0, y - RAIL[1] / 2, low, RAIL[0] + 2.0, RAIL[1], RAIL[2])
        for y in RAIL_PLACES
    ]
    pads.append(
        occ.addBox(
            front - 2.0, -SCREW_PAD[1] / 2, 660.0, SCREW_PAD[0] + 2.0, SCREW_PAD[1], SCREW_PAD[2]
        )
    )
    return [(3, pad) for pad in pads]


def add_holes() -> DimTags:
    """Core holes in the back wall, the upright rib, the floors and the sole, and the bolt holes of
    the foot.
    """
    occ = gmsh.model.occ
    _, bays, floors = cavity_spans()
    columns = [sum(span) / 2 for span in bays]
    levels = [sum(span) / 2 for span in floors]
    holes = [
        occ.addCylinder(-SHAFT[0] / 2 - 10, y, z, WALL + 20, 0, 0, BACK_HOLE / 2)
        for y in columns
        for z in levels
    ]
    holes += [occ.addCylinder(0, -RIB, z, 0, 2 * RIB, 0, RIB_HOLE / 2) for z in levels]
    holes += [occ.addCylinder(0, y, -10, 0, 0, floors[-1][0] + 20, FLOOR_HOLE / 2) for y in columns]
    reach = FOOT[0] / 2 - 28.0
    places = [
        (x, y) for x in (-reach, 0.0, reach) for y in (-reach, 0.0, reach) if (x, y) != (0.0, 0.0)
    ]
    holes += [occ.addCylinder(x, y, -10, 0, 0, FOOT[2] + 20, BOLT_HOLE / 2) for x, y in places]
    return [(3, hole) for hole in holes]


def write_step(path: Path, build: Callable[[], object], product: str) -> None:
    """Build a part in an open gmsh model and write it as STEP with a fixed time stamp and a product
    name.
    """
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Geometry.OCCParallel", 0)
        build()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    text = re.sub(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", TIME_STAMP, path.read_text())
    text = re.sub(r"'Open CASCADE STEP translator [\d. ]+'", f"'{product}'", text)
    path.write_text(text)


if __name__ == "__main__":
    write_step(
        Path(sys.argv[1] if len(sys.argv) > 1 else "step_column.step"), build_column, "Column"
    )
