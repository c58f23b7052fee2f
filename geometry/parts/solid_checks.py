"""Checks of the dimensions of parametric solids: every fault in words, with what to write."""

import math
from collections.abc import Iterator
from dataclasses import astuple

import numpy as np

from headstock.geometry.parts.patches import column_cells
from headstock.geometry.parts.solids import HollowColumn, ParametricSolid, Plate, Solid, Tube


def find_solid_faults(solid: Solid) -> list[str]:
    """Find everything that keeps a parametric solid from being built; empty for a sound solid and
    for files.
    """
    if not isinstance(solid, ParametricSolid):
        return []
    numbers = np.hstack(astuple(solid))
    if not all(math.isfinite(value) and value >= 0.0 for value in numbers):
        return ["every dimension must be a finite number, not below zero"]
    if isinstance(solid, Tube):
        return list(_tube_faults(solid))
    if min(solid.size) == 0.0:
        return ["every side must be longer than zero"]
    if isinstance(solid, Plate):
        return list(_plate_faults(solid))
    return list(_column_faults(solid)) if isinstance(solid, HollowColumn) else []


def _tube_faults(tube: Tube) -> Iterator[str]:
    if tube.length == 0.0 or tube.outer_diameter == 0.0:
        yield "length and outer diameter must be above zero"
    elif tube.inner_diameter >= tube.outer_diameter:
        yield f"the inner diameter {_show(tube.inner_diameter)} must be smaller than the outer {_show(tube.outer_diameter)}"


def _plate_faults(plate: Plate) -> Iterator[str]:
    if plate.ribs_x + plate.ribs_y == 0:
        if plate.rib_height > 0.0:
            yield "ribs have a height, but there are none: set ribs_x or ribs_y, or remove rib_height"
    elif plate.rib_height == 0.0 or plate.rib_thickness == 0.0:
        yield 'ribs need a height and a thickness; write rib_height = "40 mm" and rib = "10 mm"'
    for axis, count, side in zip(
        "yx", (plate.ribs_x, plate.ribs_y), plate.size[1::-1], strict=True
    ):
        if count * plate.rib_thickness >= side:
            yield f"{count} ribs of {_show(plate.rib_thickness)} do not fit the {_show(side)} along {axis}; take fewer or thinner ribs"


def _column_faults(column: HollowColumn) -> Iterator[str]:
    ribs = column.ribs_x + column.ribs_y
    if column.wall == 0.0 or column.cap == 0.0:
        yield "wall and cap must be thicker than zero"
    if column.rib == 0.0 and ribs + column.ribs_z > 0:
        yield 'ribs need a thickness above zero; write rib = "10 mm"'
    cells = [np.diff(spans) for spans in column_cells(column)]
    full = [axis for axis, lengths in zip("xyz", cells, strict=True) if lengths.min() <= 0.0]
    for axis in full:
        yield f"walls and ribs fill the whole {axis} side of {_show(column.size['xyz'.index(axis)])}; take thinner ones"
    narrowest = min(lengths.min() for lengths in cells[: 3 if ribs else 2])
    if not full and 0.0 < column.core_hole >= narrowest:
        yield f"the core hole of {_show(column.core_hole)} must be smaller than the narrowest cell, {_show(narrowest)}"


def _show(length: float) -> str:
    return f"{1e3 * length:.6g} mm"
