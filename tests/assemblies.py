"""Small assemblies: solids built with gmsh, with a tree of products in the text of the file or without."""

import numpy as np

from headstock.geometry.frames import Frame, rotation_about
from step_assemblies import UNITS as UNITS
from step_assemblies import Occurrence as Occurrence
from step_assemblies import Product as Product
from step_assemblies import (
    add_box,
    add_cylinder,
    cut_solids,
    fuse_solids,
)
from step_assemblies import write_assembly as write_assembly
from step_assemblies import write_nameless as write_nameless


def build_plate(mm: float) -> int:
    """A plate of 120 x 80 x 10 with two holes of 8."""
    holes = [add_cylinder(mm, (x, 40, -1), 12, 4) for x in (30, 90)]
    return cut_solids(add_box(mm, (0, 0, 0), (120, 80, 10)), holes)


def build_bracket(mm: float) -> int:
    """A foot of 40 x 40 x 10 with a hole of 8 and a wall of 10 x 40 x 50."""
    foot = add_box(mm, (-20, -20, 0), (40, 40, 10))
    wall = add_box(mm, (-20, -20, 10), (10, 40, 40))
    return cut_solids(fuse_solids(foot, wall), [add_cylinder(mm, (0, 0, -1), 12, 4)])


def build_bolt(mm: float) -> int:
    """A shank of 8 x 20 below a head of 14 x 5."""
    return fuse_solids(add_cylinder(mm, (0, 0, -10), 20, 4), add_cylinder(mm, (0, 0, 10), 5, 7))


HALF_TURN = rotation_about(np.array([0.0, 0.0, 1.0]), np.pi)
BRACKET, BOLT = Product("Bracket 'L'", build_bracket), Product("bolt", build_bolt)
BOLTED = Product(
    "bolted bracket",
    children=(Occurrence("bracket", BRACKET, Frame()), Occurrence("bolt", BOLT, Frame())),
)
# plate, two brackets that stand on it, two bolts through both
SMALL = Product(
    "small",
    children=(
        Occurrence("plate", Product("Grundplatte ø", build_plate), Frame()),
        Occurrence("left", BOLTED, Frame(np.array([30.0, 40.0, 10.0]))),
        Occurrence("right", BOLTED, Frame(np.array([90.0, 40.0, 10.0]), HALF_TURN)),
    ),
)
