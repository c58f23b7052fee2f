"""Faces of a block and of holes in it, written down by hand."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace, Vector

SIZE = (0.1, 0.2, 0.4)


def as_vector(values: FloatArray) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


def box_faces() -> list[CadFace]:
    """The faces of a block from the origin, in the order x- x+ y- y+ z- z+."""
    faces: list[CadFace] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            low, high, normal = np.zeros(3), np.array(SIZE), np.zeros(3)
            low[axis] = high[axis] = SIZE[axis] if sign > 0 else 0.0
            normal[axis] = sign
            area = float(np.prod([SIZE[i] for i in range(3) if i != axis]))
            faces.append(
                CadFace(
                    *(len(faces) + 1, "plane", area),
                    center=as_vector(0.5 * (low + high)),
                    normal=as_vector(normal),
                    low=as_vector(low),
                    high=as_vector(high),
                )
            )
    return faces


def bore(
    number: int,
    place: tuple[float, float],
    radius: float = 0.005,
    depth: float = 0.02,
    turn: float = 1.0,
) -> CadFace:
    """The wall of a hole along z, or part of its turn."""
    x, y = place
    return CadFace(
        number,
        "cylinder",
        turn * 2 * np.pi * radius * depth,
        (x, y, depth / 2),
        (-1.0, 0.0, 0.0),
        (x - radius, y - radius, 0.0),
        (x + radius, y + radius, depth),
        radius=radius,
        axis=(0.0, 0.0, 1.0),
        axis_point=(x, y, depth / 2),
        span=(0.0, depth),
        hollow=True,
    )
