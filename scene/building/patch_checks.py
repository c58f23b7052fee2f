"""Checks that a patch lies on a face the solid has."""

import math

from headstock.geometry.parts.solids import MeshFile, Solid, StepFile, Tube
from headstock.scene.building.components import bounding_box, patch_center
from headstock.scene.schema.components import PatchTable

PLANAR_FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
OVERHANG_TOLERANCE = 1e-9


def face_names(solid: Solid) -> tuple[str, ...]:
    """Face names a solid answers to, besides ``face:N`` and ``set:NAME``."""
    if isinstance(solid, Tube):
        return ("z-", "z+", "outer", "inner") if solid.inner_diameter > 0.0 else ("z-", "z+", "outer")
    return PLANAR_FACES


def find_face_fault(face: str, solid: Solid) -> str:
    """Why a solid has no such face; empty when it has one as far as can be said without meshing."""
    known = list(face_names(solid))
    if face in known:
        return ""
    prefix, colon, rest = face.partition(":")
    if colon and prefix == "face" and not isinstance(solid, MeshFile):
        return "" if rest.isdecimal() and int(rest[:9]) > 0 else f"{face!r}: faces are counted from 1; write face:1"
    if colon and prefix == "set" and isinstance(solid, MeshFile):
        return "" if rest else "names no set; write set:NAME with a surface set of the mesh"
    more = ["set:NAME"] if isinstance(solid, MeshFile) else ["face:N"]
    return f"{face[:80]!r} is not a face of this {kind_of(solid)}; faces: {', '.join(known + more)}"


def find_patch_fault(table: PatchTable, solid: Solid) -> str:
    """Why a patch cannot be laid on a solid; empty when it can as far as can be said without meshing."""
    fault = find_face_fault(table.face, solid)
    shape = table.disk or table.rect or table.strip
    if fault or shape is None:
        return fault
    if table.face not in PLANAR_FACES:
        if isinstance(solid, StepFile | MeshFile) and table.face not in ("outer", "inner"):
            return "" if shape.center is not None and len(shape.center) == 3 else "write the centre with all three coordinates"
        return f"disk, rect and strip need a flat face, {table.face!r} is not one; leave the shape away to take the whole face"
    center = patch_center(table, solid)
    if center is None:
        return "only the file knows the face's middle; write the centre of the patch"
    box = bounding_box(solid)
    if box is None:
        return ""
    normal = "xyz".index(table.face[0])
    axes = [axis for axis in range(3) if axis != normal]
    return _find_overhang(table, center, box, axes) or _find_hole(table, center, solid)


def kind_of(solid: Solid) -> str:
    """Word for a solid in messages."""
    words = {"Box": "box", "Tube": "tube", "Plate": "plate", "HollowColumn": "column", "StepFile": "STEP solid", "MeshFile": "mesh"}
    return words.get(type(solid).__name__, "superelement")


def _find_overhang(
    table: PatchTable, center: tuple[float, float, float], box: tuple[tuple[float, float], ...], axes: list[int]
) -> str:
    if table.strip is not None and table.strip.along not in ["xyz"[axis] for axis in axes]:
        return f"a strip on {table.face} runs along {' or '.join('xyz'[axis] for axis in axes)}, not {table.strip.along}"
    for axis, half in zip(axes, _half_sizes(table, axes), strict=True):
        low, high = box[axis]
        if half is None:
            continue
        slack = OVERHANG_TOLERANCE * (high - low)
        start, stop = center[axis] - half, center[axis] + half
        if start < low - slack or stop > high + slack:
            outside = "outside" if stop <= low or start >= high else "beyond"
            return (
                f"the patch reaches {outside} the face: along {'xyz'[axis]} it spans {_mm(start)} to {_mm(stop)}, "
                f"face {table.face} {_mm(low)} to {_mm(high)}; move it or make it smaller"
            )
    return ""


def _half_sizes(table: PatchTable, axes: list[int]) -> list[float | None]:
    if table.disk is not None:
        return [0.5 * table.disk.diameter] * 2
    if table.rect is not None:
        return [0.5 * size for size in table.rect.size]
    if table.strip is not None:
        return [None if "xyz"[axis] == table.strip.along else 0.5 * table.strip.width for axis in axes]
    return [None, None]


def _find_hole(table: PatchTable, center: tuple[float, float, float], solid: Solid) -> str:
    """A tube's end face is a ring: refuse a disk or rect that leaves it or covers none of it."""
    if not isinstance(solid, Tube) or table.strip is not None:
        return ""
    halves = [half or 0.0 for half in _half_sizes(table, [0, 1])]
    x, y = abs(center[0]), abs(center[1])
    reach = math.hypot(x, y) + halves[0] if table.disk is not None else math.hypot(x + halves[0], y + halves[1])
    if reach <= 0.5 * solid.inner_diameter * (1.0 + OVERHANG_TOLERANCE):
        return f"the patch is empty: it lies in the bore of {_mm(solid.inner_diameter)}; move it onto the ring"
    if reach > 0.5 * solid.outer_diameter * (1.0 + OVERHANG_TOLERANCE):
        return f"the patch reaches beyond the round face of {_mm(solid.outer_diameter)}; move it or make it smaller"
    return ""


def _mm(value: float) -> str:
    return f"{1e3 * value:.6g} mm"
