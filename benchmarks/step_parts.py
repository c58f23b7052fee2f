"""STEP parts of kinds that machines are made of, built the same each time.

./headstock exec python3 benchmarks/step_parts.py NAME FILE.step
"""

import sys
from collections.abc import Callable
from pathlib import Path

import gmsh
import numpy as np

Solid = tuple[int, int]
Chosen = Callable[[list[float], list[float]], bool]  # by the corners of a bounding box


def write_part(name: str, path: Path) -> Path:
    """Write a part as a STEP file in mm and return its path."""
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        PARTS[name]()
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def build_angle() -> Solid:
    """A 160 x 100 x 120 angle with a gusset, fillets of 3 to 12 and six bores."""
    foot, wall, gusset = (
        _box(0, 0, 0, 160, 100, 16),
        _box(0, 0, 0, 16, 100, 120),
        _box(0, 42, 0, 110, 16, 80),
    )
    body = _fuse(foot, [wall, gusset])
    bores = [_bore((x, y, -1), (0, 0, 18), 5.5) for x in (60, 140) for y in (20, 80)]
    bores += [_bore((-1, y, 100), (18, 0, 0), 9.0) for y in (25, 75)]
    body = _cut(body, bores)
    body = _round(
        body,
        3.0,
        lambda low, high: (
            high[2] - low[2] < 1e-3 and abs(low[2] - 120) < 1e-3 and high[1] - low[1] > 90
        ),
    )
    return _round(
        body,
        10.0,
        lambda low, high: (
            high[2] - low[2] > 15 and abs(low[0] - 160) < 1e-3 and high[0] - low[0] < 1e-3
        ),
    )


def build_housing() -> Solid:
    """A 400 x 280 x 220 case with walls of 9, inner ribs, a bearing seat on either side and eight
    bosses.
    """
    body = _cut(_box(0, 0, 0, 400, 280, 220), [_box(9, 9, 12, 382, 262, 220)])
    ribs = [_box(x, 9, 12, 8, 262, 60) for x in (100, 196, 292)] + [
        _box(9, y, 12, 382, 8, 40) for y in (90, 182)
    ]
    seats = [_bore((x, 140, 130), (40, 0, 0), 60.0) for x in (-15, 375)]
    bosses = [_bore((x, y, 0), (0, 0, 220), 14.0) for x in (14, 140, 260, 386) for y in (14, 266)]
    body = _fuse(body, [*ribs, *seats, *bosses])
    bores = [_bore((-50, 140, 130), (500, 0, 0), 42.0)]
    bores += [_bore((x, y, 190), (0, 0, 40), 5.0) for x in (14, 140, 260, 386) for y in (14, 266)]
    return _cut(body, bores)


def build_elbow() -> Solid:
    """A cast quarter bend of a pipe, 120 wide inside with walls of 10, between two flanges with six
    bores each.
    """
    occ = gmsh.model.occ
    ring = occ.cut([(2, occ.addDisk(260, 0, 0, 70, 70))], [(2, occ.addDisk(260, 0, 0, 60, 60))])[0]
    bend = next(solid for solid in occ.revolve(ring, 0, 0, 0, 0, 1, 0, np.pi / 2) if solid[0] == 3)
    flanges = [_bore((260, 0, 0), (0, 0, 20), 110.0), _bore((0, 0, -260), (20, 0, 0), 110.0)]
    body = _fuse(bend, flanges)
    # from the end of the bend on: a bore that reaches into it leaves a sliver of 26 µm
    bores = [_bore((260, 0, 0), (0, 0, 30), 60.0), _bore((0, 0, -260), (30, 0, 0), 60.0)]
    for angle in np.pi / 6 + np.arange(6) * np.pi / 3:
        c, s = 90.0 * float(np.cos(angle)), 90.0 * float(np.sin(angle))
        bores += [
            _bore((260 + c, s, -5), (0, 0, 30), 6.5),
            _bore((-5, s, -260 + c), (30, 0, 0), 6.5),
        ]
    return _cut(body, bores)


def build_bolt_plate() -> Solid:
    """A 600 x 400 x 25 plate with 96 bores of 11."""
    bores = [
        _circle(40 + 520 / 11 * i, 30 + 340 / 7 * j, 0, 5.5) for i in range(12) for j in range(8)
    ]
    return _extrude(600, 400, bores, z=0, height=25)


def build_spline_plate() -> Solid:
    """A 600 x 400 x 25 plate with 75 holes of four walls each, which are splines through nine
    points.
    """
    return _extrude(
        600,
        400,
        [_blob(40 + 520 / 14 * i, 50 + 75 * j, 0, 11.0) for i in range(15) for j in range(5)],
        z=0,
        height=25,
    )


def build_bed() -> Solid:
    """A 1280 x 420 x 300 machine bed of 1006 faces with edges of 54 µm, where tools have left steps
    of that depth.
    """
    frame = _cut(
        _box(0, 0, 0, 1280, 420, 275), [_box(40 + 205 * i, 30, 25, 175, 360, 250) for i in range(6)]
    )
    loops = []
    for i in range(30):
        for j in range(9):
            x, y = 25 + 42 * i, 18 + 48 * j
            loops.append(
                _slot(x, y, 275, 9.0, 3.0)
                if (i + j) % 2
                else _circle(x, y, 275, 2.5 + 0.5 * (j % 3))
            )
    body = _fuse(frame, [_extrude(1280, 420, loops, z=275, height=25)])
    keyways = [
        _box(30 + 51 * i, y, 60 + 90 * (i % 2), 24, 13, 14) for i in range(24) for y in (-1, 408)
    ]
    steps = [_box(50 + 100 * i, 419.946, 20, 20, 1, 8) for i in range(12)]
    return _cut(body, keyways + steps)


def build_casting() -> Solid:
    """A 1280 x 420 x 300 casting of about a thousand faces: pockets and ribs with fillets of 1 to 5,
    chamfered edges, counterbored and plain bores, raised pads of 0.5, a step of 54 µm.
    """
    body = _box(0, 0, 0, 1280, 420, 300)
    pockets = [
        _rounded(30 + 205 * i, 25 + 190 * j, -1, (190, 178, 271), 8.0)
        for i in range(6)
        for j in range(2)
    ]
    body = _cut(body, pockets)
    for radius, columns in ((1.0, (0, 1)), (3.0, (2, 3)), (5.0, (4, 5))):
        low, high = 30 + 205 * columns[0], 220 + 205 * columns[1]

        def at_floor(
            corner: list[float], other: list[float], low: float = low, high: float = high
        ) -> bool:
            level = abs(corner[2] - 270) < 1e-3 and abs(other[2] - 270) < 1e-3
            return level and low - 1 < corner[0] and other[0] < high + 1

        body = _round(body, radius, at_floor)
    body = _chamfer(body, 2.0, lambda low, high: low[2] > 299.9 and high[2] < 300.1)
    pads = [
        _box(40 + 60 * i, y, 40 + 60 * j, 30, 5.5, 12)
        for i in range(20)
        for j in range(3)
        for y in (-0.5, 415)
    ]
    body = _fuse(body, pads)
    tools = []
    for i in range(24):
        for j in range(6):
            x, y, radius = 45 + 51 * i, 35 + 70 * j, 2.5 + 0.5 * (i % 4)
            tools.append(_bore((x, y, 260), (0, 0, 41), radius))
            if (i + j) % 2:
                tools.append(_bore((x, y, 292), (0, 0, 9), 1.8 * radius))
    tools += [_box(60 + 110 * i, 419.946, 5, 20, 1, 8) for i in range(11)]
    return _cut(body, tools)


PARTS: dict[str, Callable[[], Solid]] = {
    "angle": build_angle,
    "housing": build_housing,
    "elbow": build_elbow,
    "bolt_plate": build_bolt_plate,
    "spline_plate": build_spline_plate,
    "bed": build_bed,
    "casting": build_casting,
}


def _box(x: float, y: float, z: float, dx: float, dy: float, dz: float) -> Solid:
    return 3, int(gmsh.model.occ.addBox(x, y, z, dx, dy, dz))


def _bore(
    start: tuple[float, float, float], along: tuple[float, float, float], radius: float
) -> Solid:
    return 3, int(gmsh.model.occ.addCylinder(*start, *along, radius))


def _circle(x: float, y: float, z: float, radius: float) -> int:
    occ = gmsh.model.occ
    return int(occ.addCurveLoop([occ.addCircle(x, y, z, radius)]))


def _slot(x: float, y: float, z: float, length: float, radius: float) -> int:
    """A curve loop of two half circles and two lines."""
    occ, half = gmsh.model.occ, length / 2
    points = [
        occ.addPoint(x + a, y + b, z)
        for a, b in ((-half, -radius), (half, -radius), (half, radius), (-half, radius))
    ]
    ends = [occ.addPoint(x + half, y, z), occ.addPoint(x - half, y, z)]
    arcs = [
        occ.addCircleArc(points[1], ends[0], points[2]),
        occ.addCircleArc(points[3], ends[1], points[0]),
    ]
    lines = [occ.addLine(points[0], points[1]), occ.addLine(points[2], points[3])]
    return int(occ.addCurveLoop([lines[0], arcs[0], lines[1], arcs[1]]))


def _blob(x: float, y: float, z: float, radius: float) -> int:
    """A curve loop of four splines around a place, with two waves in each."""
    angles = 2.0 * np.pi * np.arange(32) / 32
    radii = radius * (1.0 + 0.1 * np.cos(8.0 * angles))
    points = [
        gmsh.model.occ.addPoint(x + r * np.cos(a), y + r * np.sin(a), z)
        for r, a in zip(radii, angles, strict=True)
    ]
    quarters = [[points[(8 * k + i) % 32] for i in range(9)] for k in range(4)]
    curves = [gmsh.model.occ.addSpline(quarter) for quarter in quarters]
    return int(gmsh.model.occ.addCurveLoop(curves))


def _extrude(width: float, depth: float, holes: list[int], *, z: float, height: float) -> Solid:
    """A plate from the origin along x and y, with holes right through it: quicker than to cut
    them.
    """
    occ = gmsh.model.occ
    corners = [
        occ.addPoint(*place, z) for place in ((0, 0), (width, 0), (width, depth), (0, depth))
    ]
    loop = occ.addCurveLoop([occ.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)])
    return _only(occ.extrude([(2, occ.addPlaneSurface([loop, *holes]))], 0, 0, height))


def _rounded(
    x: float, y: float, z: float, size: tuple[float, float, float], radius: float
) -> Solid:
    """A block whose edges along z are rounded."""
    face = int(gmsh.model.occ.addRectangle(x, y, z, size[0], size[1], roundedRadius=radius))
    return _only(gmsh.model.occ.extrude([(2, face)], 0, 0, size[2]))


def _fuse(body: Solid, others: list[Solid]) -> Solid:
    return _only(gmsh.model.occ.fuse([body], others)[0])


def _cut(body: Solid, tools: list[Solid]) -> Solid:
    return _only(gmsh.model.occ.cut([body], tools)[0])


def _round(body: Solid, radius: float, chosen: Chosen) -> Solid:
    """Fillets of the edges whose bounding box is chosen."""
    return _only(gmsh.model.occ.fillet([body[1]], _choose_edges(body, chosen), [radius]))


def _chamfer(body: Solid, width: float, chosen: Chosen) -> Solid:
    """Chamfers of the edges whose bounding box is chosen."""
    edges = _choose_edges(body, chosen)
    beside = [int(gmsh.model.getAdjacencies(1, edge)[0][0]) for edge in edges]
    return _only(gmsh.model.occ.chamfer([body[1]], edges, beside, [width]))


def _choose_edges(body: Solid, chosen: Chosen) -> list[int]:
    gmsh.model.occ.synchronize()
    faces = sorted({abs(tag) for _, tag in gmsh.model.getBoundary([body], oriented=False)})
    curves = {
        abs(tag)
        for _, tag in gmsh.model.getBoundary(
            [(2, face) for face in faces], combined=False, oriented=False
        )
    }
    boxes = {curve: list(gmsh.model.occ.getBoundingBox(1, curve)) for curve in sorted(curves)}
    return [curve for curve, box in boxes.items() if chosen(box[:3], box[3:])]


def _only(found: list[Solid]) -> Solid:
    (solid,) = (entry for entry in found if entry[0] == 3)
    return solid


if __name__ == "__main__":
    write_part(sys.argv[1], Path(sys.argv[2]))
