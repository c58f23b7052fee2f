"""Steps in time between which what is given is a polynomial."""

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.control.friction_steps import GIVEN, LOOKED, LOOKS
from headstock.solvers.control.loop_track import Given

CHUNK = 512  # steps whose works are found together
SAME_STEP = 1e-9
BENT = 1e-4  # what a polynomial through what is given may miss of it, for a step of full length
MOST_CUTS = 20
FEW_STEPS = 8  # of one size along a path: they are made in their own poses


def cut_steps(
    times: FloatArray, breaks: FloatArray | None, given: Given, longest: float
) -> FloatArray:
    """Steps that end at times and breaks, none longer than asked, and shorter where what is given is
    not the polynomial that it is taken for.
    """
    inner = np.zeros(0) if breaks is None else breaks[(breaks > times[0]) & (breaks < times[-1])]
    nearest = np.abs(inner[:, None] - times).min(axis=1, initial=np.inf)
    inner = inner[nearest > SAME_STEP * (times[-1] - times[0])]
    stops = np.unique(np.concatenate([times, inner]))
    parts = np.maximum(1, np.ceil(np.diff(stops) / longest - SAME_STEP)).astype(np.intp)
    begins, offsets = np.repeat(np.arange(len(parts)), parts), np.cumsum(parts) - parts
    within = (np.arange(parts.sum()) - np.repeat(offsets, parts)) / np.repeat(parts, parts)
    grid = np.append(stops[begins] + within * np.diff(stops)[begins], stops[-1])
    sizes = np.zeros(1)
    added, looked = [grid], np.column_stack([grid[:-1], np.diff(grid)])
    for halving in range(MOST_CUTS):
        missed = np.zeros(len(looked))
        for start in range(0, len(looked), CHUNK):
            begin, size = looked[start : start + CHUNK].T[:, :, None]
            places = np.concatenate([GIVEN, LOOKED])
            values = given((begin + size * places).ravel()).reshape(len(begin), len(places), -1)
            sizes = np.maximum(sizes, np.abs(values).max(axis=(0, 1)))
            off = values[:, len(GIVEN) :] - LOOKS @ values[:, : len(GIVEN)]
            share = np.abs(off) / np.where(sizes > 0.0, sizes, 1.0)
            missed[start : start + CHUNK] = share.max(axis=(1, 2), initial=0.0)
        # what is off acts while the step lasts
        halves = looked[0.5**halving * missed > BENT] * np.array([1.0, 0.5])
        if not len(halves):
            break
        looked = np.concatenate([halves, halves @ np.array([[1.0, 0.0], [1.0, 1.0]])])
        added.append(halves.sum(axis=1))
    return np.sort(np.concatenate(added))


def find_rare_sizes(steps: FloatArray) -> BoolArray:
    """Which steps have a size that hardly any other has."""
    _, which, counts = np.unique(
        np.round(steps / steps.max(), 9), return_inverse=True, return_counts=True
    )
    return np.asarray(counts[which] < FEW_STEPS)
