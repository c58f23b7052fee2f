"""What the deformation of a body of revolution is called: by its harmonic around the axis, since it has no X and Y of its own."""

import numpy as np

from headstock.geometry.frames import FloatArray

ROUND = 0.02  # difference of two moments of inertia over them up to which a body is round about the third axis
EVEN = 0.92  # least over largest reach of a round body's points, which a mesh and a sample of it thin out
DIRECTIONS = 24
FEWEST_POINTS = 60
HARMONICS = 4  # waves around the axis that are told apart
BINS = 8
CLEAR = 0.6  # share of a deformation from which one harmonic names it


def round_axis(moments: FloatArray, axes: FloatArray, places: FloatArray) -> FloatArray | None:
    """Axis ``(3,)`` of a body of revolution; None where it has none.

    Args:
        moments: ``(3,)`` principal moments of inertia, rising.
        axes: ``(3, 3)`` their axes, one a column.
        places: ``(n, 3)`` points of the body about its centre of mass: a square bar has the moments of a round one.
    """
    low, middle, high = moments
    first, last = middle - low <= ROUND * middle, high - middle <= ROUND * high
    if first == last:
        return None
    axis, side, other = (axes[:, 2], axes[:, 0], axes[:, 1]) if first else (axes[:, 0], axes[:, 1], axes[:, 2])
    angles = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    return np.asarray(axis) if _is_even(places, np.outer(np.cos(angles), side) + np.outer(np.sin(angles), other)) else None


def is_ball(moments: FloatArray, places: FloatArray) -> bool:
    """Whether a body reaches equally far in every direction from its centre of mass."""
    corners = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], dtype=float)
    even = _is_even(places, corners / np.linalg.norm(corners, axis=1, keepdims=True))
    return bool(moments[2] - moments[0] <= ROUND * moments[2]) and even


def _is_even(places: FloatArray, directions: FloatArray) -> bool:
    """Whether points reach equally far in directions; too few of them tell nothing."""
    reach = (places @ directions.T).max(axis=0) if len(places) >= FEWEST_POINTS else np.array([0.0, 1.0])
    return bool(reach.min() >= EVEN * reach.max())


def name_on_ball(places: FloatArray, field: FloatArray) -> tuple[str, str]:
    """Verb and addition for a deformation ``(n, 3)`` at places ``(n, 3)`` about the middle of a ball."""
    outward = places / np.maximum(np.linalg.norm(places, axis=1, keepdims=True), np.finfo(float).tiny)
    radial, whole = (field * outward).sum(axis=1), float((field**2).sum())
    if radial.sum() ** 2 / len(radial) > CLEAR * whole:
        return "breathe", ""
    return ("twist" if (radial**2).sum() < (1.0 - CLEAR) * 0.25 * whole else "deform"), ""


def name_around(axis: FloatArray, places: FloatArray, field: FloatArray, letter: int, *, slender: bool) -> tuple[str, str] | None:
    """Verb and addition for a deformation of a body of revolution; None for what bends it as any other body or has no clear harmonic.

    Args:
        axis: ``(3,)`` unit.
        places: ``(n, 3)`` about the middle.
        field: ``(n, 3)`` displacements there.
        letter: Index of the machine axis that the axis is nearest to.
        slender: It is longer than wide.
    """
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    flat = np.column_stack([places @ side, places @ np.cross(axis, side)])
    radii, angles = np.linalg.norm(flat, axis=1), np.arctan2(flat[:, 1], flat[:, 0])
    moved = np.column_stack([field @ side, field @ np.cross(axis, side)])
    cosine, sine = np.cos(angles), np.sin(angles)
    parts = np.column_stack([moved[:, 0] * cosine + moved[:, 1] * sine, moved[:, 1] * cosine - moved[:, 0] * sine, field @ axis])
    # rings of like height on a long body, of like radius on a flat one
    order = np.argsort(places @ axis if slender else radii, kind="stable")
    shares = np.zeros((HARMONICS + 1, 3))
    for ring in np.array_split(order, BINS):
        waves = [np.ones(len(ring))] + [wave(n * angles[ring]) for n in range(1, HARMONICS + 1) for wave in (np.cos, np.sin)]
        fitted = np.linalg.lstsq(np.column_stack(waves), parts[ring], rcond=None)[0]
        for number, wave in enumerate(waves):
            shares[(number + 1) // 2] += fitted[number] ** 2 * float(wave @ wave)
    shares /= max(float((parts**2).sum()), np.finfo(float).tiny)
    harmonic = int(np.argmax(shares.sum(axis=1)))
    if shares[harmonic].sum() < CLEAR or harmonic == 1:
        return None
    across = shares[harmonic, 2] > 0.5 * shares[harmonic].sum()
    if harmonic:
        if across:
            return "bend", f"with {harmonic} nodal diameters"
        return ("ovalize", "") if harmonic == 2 else ("deform", f"in {harmonic} lobes")
    if shares[0, 1] > 0.5 * shares[0].sum():
        return "twist", "ABC"[letter]
    if across:
        return ("stretch", "XYZ"[letter]) if slender else ("bend", "like an umbrella")
    return "breathe", ""
