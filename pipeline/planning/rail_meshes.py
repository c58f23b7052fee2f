"""Meshes that do not tell the control points of their rails apart, before anything is meshed."""

import math
from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.carriages import rail_pieces
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.geometry.parts.plane_shapes import patch_width
from headstock.geometry.parts.solids import Box, Imported
from headstock.meshing.components.mesh_request import (
    element_size,
    has_plane_faces_only,
    patch_groups,
)
from headstock.meshing.elements.hex_grid import grid_lines
from headstock.meshing.errors import MeshError
from headstock.reduction.components.rail_fits import (
    CONDITION_LIMIT,
    Spans,
    describe_coarse_rail,
    line_condition,
    longest_elements,
    merge_spans,
)
from headstock.scene.reading.findings import Problem
from headstock.scene.scene import Scene

# Triangles have nodes at more places along a rail than rows straight across it. Measured on whole
# faces of blocks, orders 1 and 2: fits failed with elements from 1.5 times as long as those of rows
# that just do, and all did beyond 4.
PERHAPS_LONGER, SURELY_LONGER = 1.5, 4.5


def find_coarse_rails(scene: Scene) -> tuple[list[Problem], list[str]]:
    """Rails whose control points the mesh of their component cannot tell apart, which its reduction
    would refuse, and warnings of those whose mesh may; where sizes are chosen for an accuracy none.
    """
    problems: list[Problem] = []
    warnings: list[str] = []
    chosen = scene.accuracy is not None
    components = {} if chosen or scene.is_lumped else scene.machine.components
    for name, component in components.items():
        for rail in component.interfaces.values():
            found = _describe_fault(scene, component, rail)
            if found is None:
                continue
            sure, words = found
            if sure:
                key = (
                    ("mesh", "size")
                    if component.mesh.size is not None
                    else ("interfaces", rail.name)
                )
                problems.append(scene.findings.describe(("components", name, *key), words))
            else:
                warnings.append(f"component {name!r}: perhaps {words}")
    return problems, warnings


def _describe_fault(scene: Scene, component: Component, rail: Interface) -> tuple[bool, str] | None:
    """Return whether a rail will be refused for sure, and why; None where it will not, or nobody knows."""
    mesh = component.mesh
    if rail.rail is None or component.fidelity != "elastic" or mesh.sizes is not None:
        return None
    spans = rail_pieces(component.solid, rail)
    if spans is None:
        return None
    pieces, count = merge_spans(spans), rail.rail.control_points
    words = describe_coarse_rail(rail, pieces, order=mesh.order)
    if longest_elements(pieces, count, mesh.order) is None:
        return True, words

    def fails(lines: Sequence[FloatArray]) -> bool:
        return line_condition(lines, count, mesh.order) >= CONDITION_LIMIT

    if mesh.cells == "hex" and isinstance(component.solid, Box):
        lines = _cut_lines(scene, component, component.solid, "xyz".index(rail.rail.along))
        coarse = lines is not None and fails([_within(lines, *span) for span in pieces])
        return (True, words) if coarse else None
    size = _size_along(component, rail)
    if size is None or not fails(_rows(pieces, size / PERHAPS_LONGER)):
        return None
    # curved faces have smaller elements
    plain = not _list_imprints(*component.interfaces.values()) and has_plane_faces_only(component)
    return plain and fails(_rows(pieces, size / SURELY_LONGER)), words


def _list_imprints(*interfaces: Interface) -> list[Patch]:
    return [
        patch for interface in interfaces for patch in interface.patches if patch.shape != "whole"
    ]


def _size_along(component: Component, rail: Interface) -> float | None:
    """Return the size of elements along a rail [m]; None where nobody knows it before meshing."""
    mesh = component.mesh
    size = mesh.size if isinstance(component.solid, Imported) else element_size(component)
    if isinstance(component.solid, Imported) and size is None:
        return None
    for patch in _list_imprints(rail):
        size = min(size or math.inf, patch_width(patch) / mesh.across_patches)
    return size


def _rows(pieces: Spans, size: float) -> list[FloatArray]:
    return [
        np.linspace(low, high, math.ceil((high - low) / size) + 1, dtype=np.float64)
        for low, high in pieces
    ]


def _cut_lines(scene: Scene, component: Component, box: Box, axis: int) -> FloatArray | None:
    """Lines of the grid across an axis [m]; None where it cannot be made, which meshing will say."""
    machine = scene.machine
    groups = patch_groups(
        component, tuple(machine.supports.values()), tuple(machine.loads.values())
    )
    patches = [patch for found in groups.values() for patch in found]
    try:
        return grid_lines(box, patches, element_size(component), component.mesh.across_patches)[
            axis
        ]
    except MeshError:
        return None


def _within(lines: FloatArray, low: float, high: float) -> FloatArray:
    tolerance = 1e-9 * (high - low)
    return lines[(lines >= low - tolerance) & (lines <= high + tolerance)]
