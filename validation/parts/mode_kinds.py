"""What kind of motion a mode of a straight beam is: bending along one of two axes, torsion or extension."""

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map

_SLICES = 12


def beam_mode_kinds(points: FloatArray, shapes: FloatArray, axis: int) -> list[str]:
    """The dominating motion of the cross-sections in each mode.

    Sections are slices of the mesh; the rigid motion that fits a slice best tells its displacement and twist, which is made
    comparable by the radius of gyration of the section.

    Args:
        points: ``(n, 3)`` mesh points.
        shapes: ``(3 n, m)`` mode shapes.
        axis: Direction of the beam's axis, 0..2.

    Returns:
        ``x``, ``y`` or ``z`` for motion along that axis (extension along ``axis``) or ``torsion``, for each mode.
    """
    place = points[:, axis]
    low, high = float(place.min()), float(place.max())
    slices = np.minimum(((place - low) / (high - low) * _SLICES).astype(int), _SLICES - 1)
    sizes = np.zeros((4, shapes.shape[1]))
    for number in range(_SLICES):
        rows = np.flatnonzero(slices == number)
        center = points[rows].mean(axis=0)
        motions = rigid_map(points[rows], center)
        fit = np.linalg.lstsq(motions, shapes.reshape(len(points), 3, -1)[rows].reshape(3 * len(rows), -1), rcond=None)[0]
        arms = np.delete(points[rows] - center, axis, axis=1)
        sizes[:3] += fit[:3] ** 2
        sizes[3] += (arms**2).sum(axis=1).mean() * fit[3 + axis] ** 2
    names = ["x", "y", "z", "torsion"]
    return [names[k] for k in np.argmax(sizes, axis=0)]
