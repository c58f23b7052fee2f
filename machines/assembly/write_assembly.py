"""Writes ``mill.step``: the assembly of a milling machine of three axes, eleven shapes in 39 solids.

Run inside Headstock's environment, in this folder: ``../../headstock exec python3 write_assembly.py``.
Millimetres; the table moves along x on the saddle, the saddle along y on the bed, the headstock along z
on the column. Each axis has two rails, four carriages, and a screw in two bearings, whose nut drives it.
"""

import sys
from pathlib import Path

import numpy as np

from headstock.geometry.frames import Frame
from step_assemblies import (
    Occurrence,
    Product,
    add_box,
    add_cylinder,
    cut_solids,
    fuse_solids,
    write_assembly,
)

LENGTH = 700.0  # of rails and screws
RAIL = (35.0, 30.0)  # width and height
AXIS_HEIGHT, SCREW = 35.0, 16.0  # of a screw above its surface, and its radius
BOLTS = [(x, y) for x in (-230, 230) for y in (420, 630)]
BOLT, BOLT_DEPTH = 8.0, 40.0  # radius, and depth in the bed


def build_bed(mm: float) -> int:
    """A block of 700 x 1200 x 250 with the holes of four screws."""
    holes = [add_cylinder(mm, (x, y, 250 - BOLT_DEPTH), BOLT_DEPTH, BOLT) for x, y in BOLTS]
    return cut_solids(add_box(mm, (-350, -500, 0), (700, 1200, 250)), holes)


def build_column(mm: float) -> int:
    """A closed box with walls of 40 on a wider foot."""
    outside = add_box(mm, (-200, 350, 250), (400, 350, 1000))
    body = fuse_solids(outside, add_box(mm, (-260, 350, 250), (520, 350, 30)))
    holes = [add_cylinder(mm, (x, y, 250), 30, BOLT) for x, y in BOLTS]
    return cut_solids(body, [add_box(mm, (-160, 390, 290), (320, 270, 920)), *holes])


def build_saddle(mm: float) -> int:
    """A plate of 700 x 300 x 90."""
    return add_box(mm, (-350, -250, 310), (700, 300, 90))


def build_table(mm: float) -> int:
    """A plate of 600 x 300 x 60."""
    return add_box(mm, (-300, -250, 460), (600, 300, 60))


def build_headstock(mm: float) -> int:
    """A block of 320 x 440 x 400 with a bore of 80 for the spindle."""
    bore = add_cylinder(mm, (0, -70, 650), 400, 40)
    return cut_solids(add_box(mm, (-160, -150, 650), (320, 440, 400)), [bore])


def build_rail(mm: float) -> int:
    """A rail along x."""
    width, height = RAIL
    return add_box(mm, (0, -width / 2, 0), (LENGTH, width, height))


def build_carriage(mm: float) -> int:
    """A block of 100 x 80 x 55 that embraces a rail on three sides, 5 above its foot."""
    width, height = RAIL
    slot = add_box(mm, (-50, -width / 2, 5), (100, width, height - 5))
    return cut_solids(add_box(mm, (-50, -40, 5), (100, 80, 55)), [slot])


def build_shaft(mm: float) -> int:
    """The shaft of a ball screw along x."""
    return add_cylinder(mm, (0, 0, AXIS_HEIGHT), LENGTH, SCREW, along=0)


def build_nut(mm: float) -> int:
    """A block of 80 x 50 x 50 around the shaft."""
    bore = add_cylinder(mm, (-40, 0, AXIS_HEIGHT), 80, SCREW, along=0)
    return cut_solids(add_box(mm, (-40, -25, 10), (80, 50, 50)), [bore])


def build_bearing(mm: float) -> int:
    """A block of 40 x 60 x 60 around the end of a shaft."""
    bore = add_cylinder(mm, (0, 0, AXIS_HEIGHT), 40, SCREW, along=0)
    return cut_solids(add_box(mm, (0, -30, 0), (40, 60, 60)), [bore])


def build_bolt(mm: float) -> int:
    """A screw M16 x 70 with its head."""
    shank = add_cylinder(mm, (0, 0, -BOLT_DEPTH), BOLT_DEPTH + 30, BOLT)
    return fuse_solids(shank, add_cylinder(mm, (0, 0, 30), 16, 12))


RAILS = Product("rail", build_rail)
CARRIAGE = Product("carriage", build_carriage)
SHAFT = Product("shaft", build_shaft)
NUT = Product("ball screw nut", build_nut)
BEARING = Product("screw bearing", build_bearing)
BOLT_M16 = Product("bolt M16 x 70", build_bolt)


def place(name: str, product: Product, *origin: float) -> Occurrence:
    """Place a product without turning it [mm]."""
    return Occurrence(name, product, Frame(np.array(origin if origin else (0.0, 0.0, 0.0))))


def make_axis(name: str, across: float, along: float) -> Product:
    """Make the guides and the drive of an axis along x, on the plane z = 0.

    Args:
        across: Distance of the rails.
        along: Distance of the carriages on a rail.
    """
    sides = (-across / 2, across / 2)
    rails = [place(f"rail {n}", RAILS, -LENGTH / 2, y, 0) for n, y in enumerate(sides, 1)]
    spots = [(x, y) for y in sides for x in (-along / 2, along / 2)]
    carriages = [place(f"carriage {n}", CARRIAGE, *spot, 0) for n, spot in enumerate(spots, 1)]
    drive = [
        place("shaft", SHAFT, -LENGTH / 2, 0, 0),
        place("ball screw nut", NUT),
        place("screw bearing 1", BEARING, -LENGTH / 2, 0, 0),
        place("screw bearing 2", BEARING, LENGTH / 2 - 40, 0, 0),
    ]
    return Product(name, children=(*rails, *carriages, *drive))


ALONG_Y = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
ALONG_Z = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
MILL = Product(
    "mill",
    children=(
        place("bed", Product("bed", build_bed)),
        place("column", Product("column", build_column)),
        place("saddle", Product("saddle", build_saddle)),
        place("table", Product("table", build_table)),
        place("headstock", Product("headstock", build_headstock)),
        Occurrence(
            "y axis", make_axis("y axis", 400, 200), Frame(np.array([0.0, -100, 250]), ALONG_Y)
        ),
        place("x axis", make_axis("x axis", 200, 300), 0, -100, 400),
        Occurrence(
            "z axis", make_axis("z axis", 240, 250), Frame(np.array([0.0, 350, 850]), ALONG_Z)
        ),
        *(place(f"bolt {n}", BOLT_M16, x, y, 250) for n, (x, y) in enumerate(BOLTS, 1)),
    ),
)


if __name__ == "__main__":
    write_assembly(Path(sys.argv[1] if len(sys.argv) > 1 else "mill.step"), MILL)
