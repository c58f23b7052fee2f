"""Shapes cut out of a curved CAD face, and the area of the face under them."""

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.curved_patches import STEEPEST, CurvedPatch, lay_patch
from headstock.meshing.cad.shapes import add_prism, add_swept, face_curves, total_area
from headstock.meshing.errors import PartFileError

SAMPLES = 12  # along each parameter of a face, to see how it bends
RIM_SAMPLES = 9
NEARLY = 1e-6  # of the extent: places of a face as near to a point as others
PROBE = 1e-3  # of the extent: how far a point is moved to find other places as near to it
POLE, POLE_STEP = 1e-6, 1e-4  # area over sides of parameters at a pole; how far beside it to look
AREA_TOLERANCE = 0.02  # between an imprint's area and that of the face under its outline
START, DEEPEST = 16, 9  # cells along each parameter at first, and how often these are halved
UNDECIDED = 0.1  # of the area: what cells on the outline may hold, of which half is right
WHOLE_CELLS = (
    4  # how often cells are halved whose corners are looked at; of smaller ones the middle
)
SLACK = 1.2  # of half a cell's sides: how far from its middle an outline may cross a bent one


def cut_curved_face(face: int, patch: Patch, extent: float, unit: float) -> list[int]:
    """Cut the part of a curved face that a patch takes.

    Args:
        patch: A part of the face; its size is in the unit of the model.
        extent: Longest side of the solid.
        unit: Length of the model's unit [m], for messages.

    Returns:
        Tags of trimmed copies of the face, none where the patch does not touch it.

    Raises:
        PartFileError: It is not clear where the patch lies, it wraps around the face, or what is cut
            out has another area than the face under the outline.
        ValueError: A strip runs along no axis in the face, a band goes around none.
    """
    seats = _find_seats(face, np.array(patch.center), extent)
    points, normals = _sample_face(face, face)
    laid = _lay_at_one(seats, patch, points, normals)
    origins = np.array([origin for origin, _ in seats])
    # where a band lies its axis alone says
    several = len(seats) > 1 and patch.shape != "band"
    if several and (laid.depths(origins) < 0.0).any():
        raise PartFileError(
            f"the {patch.shape} on face {patch.face!r} may lie at {len(seats)} places and more, which are all as near to its centre; write a "
            "centre on the face"
        )
    occ = gmsh.model.occ
    tool = _add_tool(laid, extent)
    try:
        pieces, _ = occ.intersect([(2, face)], [(3, tool)], removeObject=False, removeTool=False)
    except Exception as error:  # gmsh raises the bare class
        raise PartFileError(_refuse(laid, unit, "the CAD kernel cannot cut it out")) from error
    occ.synchronize()
    occ.remove([(3, tool)], recursive=True)
    faces = [int(tag) for dim, tag in pieces if dim == 2]
    if not faces:
        return []
    cut = total_area(faces)
    asked = _measure_under(face, laid)
    if abs(cut - asked) > AREA_TOLERANCE * asked:
        raise PartFileError(
            _refuse(
                laid,
                unit,
                f"an area of {asked * unit**2:.4g} m^2 lies under it, but the CAD kernel cuts out {cut * unit**2:.4g} m^2",
            )
        )
    kept = _choose_pieces(faces, laid)
    occ.remove([(2, tag) for tag in faces if tag not in kept], recursive=True)
    occ.synchronize()
    for tag in kept:
        if float(laid.gentleness(*_sample_face(tag, face)).min()) < STEEPEST:
            raise PartFileError(_refuse(laid, unit, "it wraps around the face"))
    return kept


def _refuse(laid: CurvedPatch, unit: float, why: str) -> str:
    sizes = " x ".join(f"{1e3 * size * unit:.6g}" for size in laid.patch.size)
    what = f"{laid.patch.shape} of {sizes} mm" if sizes else laid.patch.shape
    return f"the {what} on face {laid.patch.face!r}: {why}; make it smaller, move it, or name the whole face"


def _find_seats(
    face: int, center: FloatArray, extent: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Find the places of a face that are nearest to a point, with their normals: one, but for the
    centre of its curvature.
    """
    seats: list[tuple[float, FloatArray]] = []
    for shift in np.vstack([np.zeros(3), np.eye(3), -np.eye(3)]):
        closest, _ = gmsh.model.getClosestPoint(2, face, list(center + PROBE * extent * shift))
        seat = np.array(closest)
        distance = float(np.linalg.norm(seat - center))
        if all(np.linalg.norm(seat - other) > 2.0 * PROBE * extent for _, other in seats):
            seats.append((distance, seat))
    nearest = min(distance for distance, _ in seats)
    return [
        (seat, _normals(face, gmsh.model.getParametrization(2, face, list(seat)))[0])
        for distance, seat in seats
        if distance - nearest <= NEARLY * extent
    ]


def _lay_at_one(
    seats: list[tuple[FloatArray, FloatArray]],
    patch: Patch,
    points: FloatArray,
    normals: FloatArray,
) -> CurvedPatch:
    """Lay a patch at the first of equally near places where it can lie."""
    for origin, normal in seats[:-1]:
        try:
            return lay_patch(patch, origin, normal, points, normals)
        except ValueError:
            continue
    return lay_patch(patch, *seats[-1], points, normals)


def _normals(face: int, parameters: FloatArray) -> FloatArray:
    """Return unit normals ``(n, 3)``; at a pole, where parameters give none, one nearby."""
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, face))
    pairs = np.array(parameters, dtype=float).reshape(-1, 2)
    sides = np.array(gmsh.model.getDerivative(2, face, pairs.ravel())).reshape(-1, 2, 3)
    sides *= (high - low)[:, None]
    spans = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    pole = spans <= POLE * np.einsum("nij,nij->n", sides, sides)
    pairs[pole] += POLE_STEP * (0.5 * (low + high) - pairs[pole])
    return np.array(gmsh.model.getNormal(face, pairs.ravel())).reshape(-1, 3)


def _sample_face(piece: int, face: int) -> tuple[FloatArray, FloatArray]:
    """Return points ``(n, 3)`` in and around a piece of a face, and its normals there."""
    low, high = gmsh.model.getParametrizationBounds(2, piece)
    shares = (np.arange(SAMPLES) + 0.5) / SAMPLES
    u, v = (start + (stop - start) * shares for start, stop in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    inside = [gmsh.model.isInside(2, piece, list(pair), True) > 0 for pair in grid]
    places = [grid[inside]]
    for _, curve in gmsh.model.getBoundary([(2, piece)], oriented=False):
        start, stop = gmsh.model.getParametrizationBounds(1, abs(curve))
        along = np.linspace(start[0], stop[0], RIM_SAMPLES)
        rim = gmsh.model.reparametrizeOnSurface(1, abs(curve), along, piece)
        places.append(np.array(rim).reshape(-1, 2))
    flat = np.concatenate(places).ravel()
    points = np.array(gmsh.model.getValue(2, face, flat)).reshape(-1, 3)
    return points, _normals(face, flat)


def _add_tool(laid: CurvedPatch, extent: float) -> int:
    """Return a volume that holds all the space under a patch's outline, on both sides of the face."""
    reach = 2.0 * extent + max(laid.patch.size, default=0.0)
    if laid.shape is not None:
        base, sweep = laid.origin - reach * laid.normal, 2.0 * reach * laid.normal
        return add_swept(laid.shape, base, laid.axes, sweep)
    half, axes = laid.half_width * laid.across, np.linalg.svd(laid.across[None])[2][1:]
    corners = reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
    return add_prism(laid.origin - half + corners @ axes, 2.0 * half)


def _choose_pieces(pieces: list[int], laid: CurvedPatch) -> list[int]:
    """Return the pieces that face the way of the patch's middle; of a strip also that in the middle
    and what is joined to it, however far it goes around.
    """
    facing = {tag: bool((laid.facing(*_sample_face(tag, tag)) > 0.0).all()) for tag in pieces}
    if laid.shape is not None:
        return [tag for tag in pieces if facing[tag]] or pieces
    occ = gmsh.model.occ
    middle = occ.addPoint(*laid.origin)
    gaps = {tag: float(occ.getDistance(0, middle, 2, tag)[0]) for tag in pieces}
    occ.remove([(0, middle)])
    joined = [min(pieces, key=lambda tag: gaps[tag])]
    rims = {tag: face_curves(tag) for tag in pieces}
    for tag in joined:
        joined += [other for other in pieces if other not in joined and rims[other] & rims[tag]]
    return [tag for tag in pieces if facing[tag] or tag in joined]


def _measure_under(face: int, laid: CurvedPatch) -> float:
    """Return the area of a face under a patch's outline, without the kernel's Boolean operations:
    cells of its parameters are halved along the outline and along the face's own rim.
    """
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, face))
    widths = (high - low) / START
    grid = np.stack(np.meshgrid(*[np.arange(START) + 0.5] * 2, indexing="ij"), axis=-1)
    cells = low + grid.reshape(-1, 2) * widths
    done = 0.0
    for level in range(DEEPEST + 1):
        points = np.array(gmsh.model.getValue(2, face, cells.ravel())).reshape(-1, 3)
        sides = np.array(gmsh.model.getDerivative(2, face, cells.ravel())).reshape(-1, 2, 3)
        sides *= widths[:, None]
        depths, reach = laid.depths(points), 0.5 * np.linalg.norm(sides, axis=2).sum(axis=1)
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        areas *= np.clip(0.5 + 0.5 * depths / reach, 0.0, 1.0)
        inside, mixed = depths >= SLACK * reach, np.abs(depths) < SLACK * reach
        covered = _share_inside(face, cells[inside], widths, corners=level < WHOLE_CELLS)
        mixed[inside] = (covered > 0.0) & (covered < 1.0)
        done += float((areas[inside] * covered)[~mixed[inside]].sum())
        last = level == DEEPEST or 0.0 < areas[mixed].sum() <= UNDECIDED * done
        if last or not mixed.any():
            break
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 4.0
        cells = (cells[mixed][:, None] + corners * widths).reshape(-1, 2)
        widths = widths / 2.0
    return done + float(areas[mixed] @ _share_inside(face, cells[mixed], widths, corners=False))


def _share_inside(face: int, cells: FloatArray, widths: FloatArray, *, corners: bool) -> FloatArray:
    """Return how much of cells ``(n, 2)`` of a face's parameters its rim leaves, ``(n,)``, from
    their middles, and their corners where asked for.
    """
    places = np.array([[0, 0], [-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.49 * widths
    places = places if corners else places[:1]
    samples = (cells[:, None] + places).reshape(-1, 2)
    inside = [gmsh.model.isInside(2, face, list(pair), True) > 0 for pair in samples]
    return np.array(inside, dtype=float).reshape(-1, len(places)).mean(axis=1)
