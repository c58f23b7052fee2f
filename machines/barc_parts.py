"""Makes ``barc.step``: box and both legs of the BARC, a box assembly with a removable component.

Run inside Headstock's environment, in this folder: ``../headstock exec python3 barc_parts.py``.
Millimetres, in the frame of the measurement: x along the beam, y up, the middle of the box at x = y =
0. Corners are sharp and holes left out: ``barc.toml`` names the source.
"""

import sys
from pathlib import Path

import gmsh
from step_column_part import write_step

Box = tuple[float, float, float, float, float, float]  # x0 x1 y0 y1 z0 z1
OUTSIDE: Box = (-76.2, 76.2, -76.2, 76.2, 0.0, 76.2)
WALL, SLIT = 6.35, 12.7
SHEET, LEG_FROM, LEG_TO = 3.175, 76.2, 127.0  # thickness of a leg; its feet and top along y
DEPTH = (25.4, 50.8)  # of the legs along z
LEG_LEFT, LEG_RIGHT = (-63.5, -38.1), (38.1, 63.5)  # along x


def add_box(box: Box) -> int:
    """Add a box by its bounds and return its tag."""
    x0, x1, y0, y1, z0, z1 = box
    return int(gmsh.model.occ.addBox(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0))


def cut_out(outside: Box, *holes: Box) -> None:
    """Add a box less some others."""
    gmsh.model.occ.cut([(3, add_box(outside))], [(3, add_box(hole)) for hole in holes])


def build_parts() -> None:
    """Build box, left and right leg in the open gmsh model, in this order."""
    x0, x1, y0, y1, z0, z1 = OUTSIDE
    inside = (x0 + WALL, x1 - WALL, y0 + WALL, y1 - WALL, z0, z1)
    cut_out(OUTSIDE, inside, (-SLIT / 2, SLIT / 2, y1 - WALL, y1, z0, z1))
    between = (LEG_FROM + SHEET, LEG_TO - SHEET)
    cut_out(
        (*LEG_LEFT, LEG_FROM, LEG_TO, *DEPTH), (*LEG_LEFT, *between, DEPTH[0] + SHEET, DEPTH[1])
    )
    cut_out(
        (*LEG_RIGHT, LEG_FROM, LEG_TO, *DEPTH),
        (LEG_RIGHT[0], LEG_RIGHT[1] - SHEET, *between, *DEPTH),
    )
    gmsh.model.occ.synchronize()


if __name__ == "__main__":
    write_step(Path(sys.argv[1] if len(sys.argv) > 1 else "barc.step"), build_parts, "BARC")
