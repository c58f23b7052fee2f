"""Curved solids made with OpenCASCADE and written as STEP: parts on which error estimates are
tried.

``python3 -m headstock.validation.coverage.curved_samples KIND SIZES_AS_JSON FILE`` (a worker process: gmsh
holds one model at a time).
"""

import json
import sys
from collections.abc import Callable, Mapping

import gmsh

from headstock.meshing.cad.meshing import open_kernel

Sizes = Mapping[str, float]  # [mm]


def _ball(sizes: Sizes) -> None:
    """Build a ball between two parallel flats."""
    occ, radius, height = gmsh.model.occ, sizes["radius"], sizes["height"]
    ball = occ.addSphere(0, 0, 0, radius)
    occ.intersect(
        [(3, ball)],
        [(3, occ.addBox(-radius, -radius, -height / 2, 2 * radius, 2 * radius, height))],
    )


def _cone(sizes: Sizes) -> None:
    """Build a truncated cone with a bore."""
    occ, height = gmsh.model.occ, sizes["height"]
    body = occ.addCone(0, 0, 0, 0, 0, height, sizes["radius"], sizes["top"])
    occ.cut([(3, body)], [(3, occ.addCylinder(0, 0, 0, 0, 0, height, sizes["bore"]))])


def _elbow(sizes: Sizes) -> None:
    """Build a quarter of a ring of pipe."""
    occ, bend = gmsh.model.occ, sizes["bend"]
    outer, inner = (
        occ.addDisk(bend, 0, 0, radius, radius) for radius in (sizes["radius"], sizes["bore"])
    )
    ring, _ = occ.cut([(2, outer)], [(2, inner)])
    occ.revolve(ring, 0, 0, 0, 0, 1, 0, 1.5707963267948966)
    occ.remove(ring, recursive=True)


def _swan(sizes: Sizes) -> None:
    """Build a pipe in the form of an S: two quarters of a ring."""
    occ, bend = gmsh.model.occ, sizes["bend"]
    _elbow(sizes)
    first = occ.getEntities(3)
    second = occ.copy(first)
    occ.rotate(second, 0, 0, -bend, 0, 1, 0, 3.141592653589793)
    occ.fuse(first, second)


def _oval(sizes: Sizes) -> None:
    """Build a ring between two ellipses."""
    occ, wall = gmsh.model.occ, sizes["wall"]
    outer, inner = (
        occ.addDisk(0, 0, 0, sizes["long"] - less, sizes["short"] - less) for less in (0.0, wall)
    )
    ring, _ = occ.cut([(2, outer)], [(2, inner)])
    occ.extrude(ring, 0, 0, sizes["height"])
    occ.remove(ring, recursive=True)


def _bow(sizes: Sizes) -> None:
    """Build a bent bar of rectangular section: a part of a ring."""
    occ, wide, high = gmsh.model.occ, sizes["wide"], sizes["high"]
    section = occ.addRectangle(sizes["bend"] - wide / 2, -high / 2, 0, wide, high)
    occ.rotate([(2, section)], 0, 0, 0, 1, 0, 0, 1.5707963267948966)
    occ.revolve([(2, section)], 0, 0, 0, 0, 0, 1, sizes["bow"] / sizes["bend"])
    occ.remove([(2, section)], recursive=True)


def _hairpin(sizes: Sizes) -> None:
    """Build a bar of rectangular section that is bent by half a turn, with two straight legs."""
    occ, bend, leg = gmsh.model.occ, sizes["bend"], sizes["leg"]
    wide, high = sizes["wide"], sizes["high"]
    places = ((bend, -leg), (bend, 0), (0, 0), (-bend, 0), (-bend, -leg))
    first, second, middle, third, last = (occ.addPoint(x, y, 0) for x, y in places)
    top = occ.addPoint(0, bend, 0)
    line = [
        occ.addLine(first, second),
        occ.addCircleArc(second, middle, top),
        occ.addCircleArc(top, middle, third),
        occ.addLine(third, last),
    ]
    section = occ.addRectangle(bend - wide / 2, -high / 2, 0, wide, high)
    occ.rotate([(2, section)], 0, 0, 0, 1, 0, 0, 1.5707963267948966)
    occ.translate([(2, section)], 0, -leg, 0)
    occ.addPipe([(2, section)], occ.addWire(line))
    occ.remove([(2, section)], recursive=True)
    occ.remove([(0, middle)], recursive=True)


def _block(sizes: Sizes) -> None:
    """Build a block with rounded upright edges and a cross bore."""
    occ, x, y, z = gmsh.model.occ, sizes["x"], sizes["y"], sizes["z"]
    body = occ.addBox(-x / 2, -y / 2, 0, x, y, z)
    occ.cut([(3, body)], [(3, occ.addCylinder(-x, 0, sizes["hole_z"], 2 * x, 0, 0, sizes["bore"]))])
    occ.synchronize()
    upright = []
    for _, edge in gmsh.model.getEntities(1):
        low_x, low_y, low_z, high_x, high_y, high_z = gmsh.model.getBoundingBox(1, edge)
        corner = (
            min(abs(low_x - x / 2), abs(low_x + x / 2)) < 1e-3
            and min(abs(low_y - y / 2), abs(low_y + y / 2)) < 1e-3
        )
        if corner and high_x - low_x < 1e-3 and high_y - low_y < 1e-3 and high_z - low_z > 0.9 * z:
            upright.append(edge)
    occ.fillet([gmsh.model.getEntities(3)[0][1]], upright, [sizes["fillet"]])


def _angle(sizes: Sizes) -> None:
    """Build two legs that meet in a sharp inner edge, the upright one with a bore."""
    occ, x, y, z, thick = gmsh.model.occ, sizes["x"], sizes["y"], sizes["z"], sizes["thick"]
    legs = [(3, occ.addBox(0, -y / 2, 0, *leg)) for leg in ((x, y, thick), (thick, y, z))]
    body, _ = occ.fuse(legs[:1], legs[1:])
    occ.cut(body, [(3, occ.addCylinder(-z, 0, sizes["hole_z"], 3 * z, 0, 0, sizes["bore"]))])


SAMPLES: dict[str, Callable[[Sizes], None]] = {
    "ball": _ball,
    "cone": _cone,
    "elbow": _elbow,
    "swan": _swan,
    "oval": _oval,
    "bow": _bow,
    "hairpin": _hairpin,
    "block": _block,
    "angle": _angle,
}


def _write_sample(kind: str, sizes: Sizes, path: str) -> None:
    """Write one solid as a STEP file.

    Args:
        sizes: Its lengths by name [mm].
    """
    with open_kernel():
        SAMPLES[kind](sizes)
        gmsh.model.occ.synchronize()
        gmsh.write(path)


if __name__ == "__main__":
    _write_sample(sys.argv[1], json.loads(sys.argv[2]), sys.argv[3])
