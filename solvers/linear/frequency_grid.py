"""Frequencies at which a response is worth knowing: an even grid, finer around every resonance."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

# distances from a resonance in half-power half-widths; doubled further out until they meet the even grid
OFFSETS = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
GROWTH = 1.5
UNDAMPED = 1e-9  # half-width over frequency below which a peak has no top
NEAREST = 1e-6  # how near the grid comes to an undamped resonance


def refine_grid(base_hz: FloatArray, poles: ComplexArray) -> FloatArray:
    """A grid with every pole's damped frequency in it and points from its half-power width outwards.

    Args:
        base_hz: ``(n,)`` rising [Hz]; its ends are the ends of the result.
        poles: At positive frequencies [rad/s]; real ones have no peak and are left out.

    Returns:
        ``(m,)`` rising, the base grid among them. An undamped resonance itself is left out.
    """
    base = np.asarray(base_hz, dtype=float)
    low, high = base[0], base[-1]
    found = [base]
    for pole in np.asarray(poles)[np.asarray(poles).imag > 0.0]:
        center, width = pole.imag / (2.0 * np.pi), abs(pole.real) / (2.0 * np.pi)
        step = _local_step(base, center)
        if not low - step <= center <= high + step:
            continue
        bare = width < UNDAMPED * center
        offsets = _offsets(NEAREST * center if bare else width, step)
        offsets = offsets[offsets > 0.0] if bare else offsets
        found.append(np.concatenate([center - offsets, center + offsets]))
    grid = np.unique(np.concatenate(found))
    return np.asarray(grid[(grid >= low) & (grid <= high)])


def _local_step(base: FloatArray, center: float) -> float:
    if len(base) < 2:
        return 0.0
    index = int(np.clip(np.searchsorted(base, center), 1, len(base) - 1))
    return float(base[index] - base[index - 1])


def _offsets(width: float, step: float) -> FloatArray:
    """Distances from a resonance, out to the step of the even grid."""
    largest = OFFSETS[-1] * width
    count = max(0, int(np.ceil(np.log(max(step / largest, 1.0)) / np.log(GROWTH)))) if largest > 0.0 else 0
    outer = largest * GROWTH ** np.arange(1, count + 1)
    offsets = np.concatenate([width * np.array(OFFSETS), outer])
    return np.asarray(offsets[offsets <= max(step, width)])
