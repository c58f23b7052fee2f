"""Volume, centre and inertia of solids, and area and centroid of their interfaces, in closed
form.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.geometry.parts.patches import (
    FACE_DIRECTIONS,
    PlanarFace,
    PlanarSolid,
    SignedBox,
    band_span,
    imprint_window,
    in_plane_axes,
    named_planar_face,
    patch_rects,
    planar_boxes,
    rect_union,
)
from headstock.geometry.parts.plane_shapes import flatten_patch
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, PointMass, Tube

AreaMoment = tuple[float, FloatArray]


class VolumeMoments(NamedTuple):
    """Volume [m^3], its centre ``(3,)`` [m], and the inertia ``(3, 3)`` about that for unit density
    [m^5].
    """

    volume: float
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class SolidProperties:
    """Mass properties of a solid for a rigid body, in the component frame and for unit density.

    Attributes:
        volume: [m^3].
        center: ``(3,)`` centre of volume [m].
        inertia: ``(3, 3)`` about the centre for unit density [m^5].
        patch_areas: Area of each interface [m^2].
        patch_centroids: Centroid ``(3,)`` of each interface [m].
        box: ``(2, 3)`` lowest and highest coordinates of the solid [m].
        remarks: What the user should know of the file it is from.
    """

    volume: float
    center: FloatArray
    inertia: FloatArray
    patch_areas: dict[str, float] = field(default_factory=dict)
    patch_centroids: dict[str, FloatArray] = field(default_factory=dict)
    box: FloatArray = field(default_factory=lambda: np.zeros((2, 3)))
    patch_boxes: dict[str, FloatArray] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def closed_form_properties(component: Component) -> SolidProperties | None:
    """Return the properties of a component whose solid and interfaces have a closed form; None
    where a CAD kernel is needed.
    """
    solid = component.solid
    if isinstance(solid, PointMass):
        centers: dict[str, FloatArray] = {name: np.zeros(3) for name in component.interfaces}
        inertia = np.diag(solid.inertia) / solid.mass
        boxes: dict[str, FloatArray] = {name: np.zeros((2, 3)) for name in centers}
        areas = dict.fromkeys(centers, 1.0)
        return SolidProperties(1.0, np.zeros(3), inertia, areas, centers, patch_boxes=boxes)
    if isinstance(solid, Tube):
        whole = _tube_properties(solid)
    elif isinstance(solid, Box | Plate) or (
        isinstance(solid, HollowColumn) and solid.core_hole == 0.0
    ):
        whole = _box_sum_properties(planar_boxes(solid))
    else:
        return None
    areas = {}
    centroids: dict[str, FloatArray] = {}
    for name, interface in component.interfaces.items():
        moment = interface_moment(solid, interface)
        if moment is None:
            return None
        areas[name], centroids[name] = moment
    return SolidProperties(
        whole.volume,
        whole.center,
        whole.inertia,
        areas,
        centroids,
        solid_box(solid),
        {
            name: _join_boxes([_patch_box(solid, patch) for patch in interface.patches])
            for name, interface in component.interfaces.items()
        },
    )


def solid_box(solid: PlanarSolid | Tube) -> FloatArray:
    """Return the lowest and the highest corner ``(2, 3)`` of a parametric solid [m]."""
    if isinstance(solid, Tube):
        radius = solid.outer_diameter / 2
        return np.array([[-radius, -radius, 0.0], [radius, radius, solid.length]])
    return _join_boxes([np.array(ends) for sign, *ends in planar_boxes(solid) if sign > 0.0])


def _patch_box(solid: PlanarSolid | Tube, patch: Patch) -> FloatArray:
    """Return the box ``(2, 3)`` around a patch that has a closed form."""
    box = solid_box(solid)
    if patch.face not in FACE_DIRECTIONS:
        return box  # curved faces of a tube go all around it
    axis, sign = FACE_DIRECTIONS[patch.face]
    box[:, axis] = box[1 if sign > 0.0 else 0, axis]
    if isinstance(solid, Tube) or (face := named_planar_face(solid, patch.face)) is None:
        return box
    first, second = in_plane_axes(axis)
    window = [] if patch.is_grid_aligned else [imprint_window(axis, patch)]
    rects = np.array(window or patch_rects(face, patch) or face.rects)
    box[:, first] = rects[:, 0].min(), rects[:, 1].max()
    box[:, second] = rects[:, 2].min(), rects[:, 3].max()
    return box


def _join_boxes(boxes: list[FloatArray]) -> FloatArray:
    ends = np.array(boxes)
    return np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def solid_volume(solid: PlanarSolid | Tube) -> float:
    """Return the volume of a parametric solid [m^3]; core holes are not taken off."""
    if isinstance(solid, Tube):
        return _tube_properties(solid).volume
    return sum(
        sign * math.prod(float(top - bottom) for bottom, top in zip(low, high, strict=True))
        for sign, low, high in planar_boxes(solid)
    )


def _box_sum_properties(boxes: list[SignedBox]) -> VolumeMoments:
    """Return the properties of a signed sum of boxes."""
    signs = np.array([sign for sign, _, _ in boxes])
    low = np.array([low for _, low, _ in boxes])
    high = np.array([high for _, _, high in boxes])
    volumes = signs * np.prod(high - low, axis=1)
    centers = (low + high) / 2
    volume = float(volumes.sum())
    center = volumes @ centers / volume
    arms = centers - center
    moments = np.einsum("n,ni,nj->ij", volumes, arms, arms) + np.diag(
        volumes @ (high - low) ** 2 / 12
    )
    return VolumeMoments(volume, center, np.trace(moments) * np.eye(3) - moments)


def _tube_properties(tube: Tube) -> VolumeMoments:
    """Return the properties of a hollow cylinder."""
    outer, inner, length = tube.outer_diameter / 2, tube.inner_diameter / 2, tube.length
    volume = np.pi * (outer**2 - inner**2) * length
    polar = volume * (outer**2 + inner**2) / 2
    across = polar / 2 + volume * length**2 / 12
    return VolumeMoments(
        float(volume), np.array([0.0, 0.0, length / 2]), np.diag([across, across, polar])
    )


def interface_moment(solid: PlanarSolid | Tube, interface: Interface) -> AreaMoment | None:
    """Return the area [m^2] and centroid ``(3,)`` [m] of an interface; None where there is no
    closed form.
    """
    parts = (
        _tube_parts(solid, interface.patches)
        if isinstance(solid, Tube)
        else _planar_parts(solid, interface.patches)
    )
    if not parts:
        return None
    area = sum(part for part, _ in parts)
    return area, np.asarray(sum(part * centroid for part, centroid in parts) / area)


def _tube_parts(tube: Tube, patches: tuple[Patch, ...]) -> list[AreaMoment] | None:
    if any(patch.shape not in ("whole", "band") for patch in patches):
        return None
    ring = np.pi * (tube.outer_diameter**2 - tube.inner_diameter**2) / 4
    moments: dict[str, AreaMoment] = {
        "z-": (ring, np.zeros(3)),
        "z+": (ring, np.array([0.0, 0.0, tube.length])),
    }
    around = {"outer": np.pi * tube.outer_diameter, "inner": np.pi * tube.inner_diameter}
    parts = []
    for face in dict.fromkeys(patch.face for patch in patches):  # a face named twice counts once
        if face in moments:
            parts.append(moments[face])
        elif around.get(face):
            spans = [band_span(each, 0.0, tube.length) for each in patches if each.face == face]
            for low, high, *_ in rect_union([(*span, 0.0, 1.0) for span in spans]):
                middle = np.array([0.0, 0.0, 0.5 * (low + high)])
                parts.append((around[face] * (high - low), middle))
        else:
            return None
    return parts


def _planar_parts(solid: PlanarSolid, patches: tuple[Patch, ...]) -> list[AreaMoment] | None:
    parts: list[AreaMoment] = []
    for name in dict.fromkeys(patch.face for patch in patches):
        face = named_planar_face(solid, name)
        if face is None or name not in FACE_DIRECTIONS:
            return None
        part = _face_part(face, [patch for patch in patches if patch.face == name])
        if part is None:
            return None
        parts.append(part)
    return parts


def _face_part(face: PlanarFace, patches: list[Patch]) -> AreaMoment | None:
    """Return the area and centroid of the union of patches on one face."""
    first, second = in_plane_axes(face.axis)
    if len(patches) == 1 and not patches[0].is_grid_aligned:
        return _shape_part(face, patches[0])
    rects = [patch_rects(face, patch) for patch in patches]
    if any(r is None for r in rects):
        return None  # such among others: their overlap is left to the CAD kernel
    pieces = np.array(rect_union([rect for group in rects if group is not None for rect in group]))
    if not len(pieces):
        return None
    areas = (pieces[:, 1] - pieces[:, 0]) * (pieces[:, 3] - pieces[:, 2])
    centroid = np.zeros(3)
    centroid[face.axis] = face.position
    centroid[first] = areas @ (pieces[:, 0] + pieces[:, 1]) / (2 * areas.sum())
    centroid[second] = areas @ (pieces[:, 2] + pieces[:, 3]) / (2 * areas.sum())
    return float(areas.sum()), centroid


def _shape_part(face: PlanarFace, patch: Patch) -> AreaMoment | None:
    left, right, bottom, top = imprint_window(face.axis, patch)
    if not any(
        rect[0] <= left and right <= rect[1] and rect[2] <= bottom and top <= rect[3]
        for rect in face.rects
    ):
        return None
    axes = list(in_plane_axes(face.axis))
    shape = flatten_patch(patch, np.eye(3)[axes])
    centroid = np.array(patch.center, dtype=float)
    centroid[face.axis] = face.position
    centroid[axes] += shape.centroid
    return shape.area, centroid
