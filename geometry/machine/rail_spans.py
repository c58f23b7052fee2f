"""Where a rail begins and ends, as far as its solid tells without a mesh."""

from headstock.geometry.parts.components import Interface, Patch
from headstock.geometry.parts.patches import FACE_DIRECTIONS, Span, in_plane_axes, named_planar_face, patch_rects
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, Tube


def rail_span(solid: Solid, interface: Interface) -> Span | None:
    """Lowest and highest place of a rail along its axis, component frame [m]; None where only a mesh knows.

    Raises:
        ValueError: The interface is no rail.
    """
    if interface.rail is None:
        raise ValueError(f"interface {interface.name!r} is no rail")
    axis = "xyz".index(interface.rail.along)
    spans = [_patch_span(solid, patch, axis) for patch in interface.patches]
    known = [span for span in spans if span is not None]
    if len(known) < len(spans):
        return None
    return min(low for low, _ in known), max(high for _, high in known)


def _patch_span(solid: Solid, patch: Patch, axis: int) -> Span | None:
    if isinstance(solid, Tube) and patch.face in ("outer", "inner"):
        return (0.0, solid.length) if axis == 2 else None
    normal = FACE_DIRECTIONS.get(patch.face, (-1, 0.0))[0]
    if normal == axis:
        return None
    if isinstance(solid, Box | Plate | HollowColumn) and normal >= 0:
        face = named_planar_face(solid, patch.face)
        rects = None if face is None else patch_rects(face, patch)
        if rects:
            first = 0 if in_plane_axes(normal)[0] == axis else 2
            return min(rect[first] for rect in rects), max(rect[first + 1] for rect in rects)
    if patch.shape == "rect" and normal >= 0:
        half = 0.5 * patch.size[in_plane_axes(normal).index(axis)]
        return patch.center[axis] - half, patch.center[axis] + half
    return None
