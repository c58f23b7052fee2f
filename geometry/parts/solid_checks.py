"""Checks of the dimensions of parametric solids: every fault in words."""

import math
from dataclasses import fields

from headstock.geometry.parts.patches import column_cells
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, Tube


def find_solid_faults(solid: Solid) -> list[str]:
    """Find everything that keeps a parametric solid from being built; empty for a sound solid and
    for files.
    """
    if not isinstance(solid, Box | Tube | Plate | HollowColumn):
        return []
    numbers = [value for field in fields(solid) for value in _flat(getattr(solid, field.name))]
    if not all(math.isfinite(value) and value >= 0.0 for value in numbers):
        return ["every dimension must be a finite number, not below zero"]
    if isinstance(solid, Tube):
        return _tube_faults(solid)
    faults = [] if min(solid.size) > 0.0 else ["every side must be longer than zero"]
    if isinstance(solid, Plate):
        return faults + _plate_faults(solid)
    if isinstance(solid, HollowColumn) and not faults:
        return _column_faults(solid)
    return faults


def _flat(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _tube_faults(tube: Tube) -> list[str]:
    faults = (
        []
        if tube.length > 0.0 and tube.outer_diameter > 0.0
        else ["length and outer diameter must be above zero"]
    )
    if tube.inner_diameter >= tube.outer_diameter > 0.0:
        faults.append(
            f"the inner diameter {1e3 * tube.inner_diameter:.6g} mm must be smaller than the outer {1e3 * tube.outer_diameter:.6g} mm"
        )
    return faults


def _plate_faults(plate: Plate) -> list[str]:
    if plate.ribs_x + plate.ribs_y == 0:
        return (
            ["ribs have a height, but there are none: set ribs_x or ribs_y"]
            if plate.rib_height > 0.0
            else []
        )
    if plate.rib_height == 0.0 or plate.rib_thickness == 0.0:
        return ["ribs need a height and a thickness above zero"]
    crowded = [
        f"{count} ribs of {1e3 * plate.rib_thickness:.6g} mm do not fit the {1e3 * side:.6g} mm along {axis}"
        for axis, count, side in (
            ("y", plate.ribs_x, plate.size[1]),
            ("x", plate.ribs_y, plate.size[0]),
        )
        if count * plate.rib_thickness >= side
    ]
    return crowded


def _column_faults(column: HollowColumn) -> list[str]:
    if column.wall == 0.0 or column.cap == 0.0:
        return ["wall and cap must be thicker than zero"]
    if column.rib == 0.0 and column.ribs_x + column.ribs_y + column.ribs_z > 0:
        return ["ribs need a thickness above zero"]
    cells = column_cells(column)
    faults = [
        f"walls and ribs fill the whole {axis} side"
        for axis, spans in zip("xyz", cells, strict=True)
        if not all(high > low for low, high in spans)
    ]
    if column.core_hole > 0.0 and not faults:
        narrowest = min(
            high - low
            for spans in cells[: 2 if column.ribs_x + column.ribs_y == 0 else 3]
            for low, high in spans
        )
        if column.core_hole >= narrowest:
            faults.append(
                f"the core hole of {1e3 * column.core_hole:.6g} mm must be smaller than the narrowest cell, {1e3 * narrowest:.6g} mm"
            )
    return faults
