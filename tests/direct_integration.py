"""Equations of motion written by hand, followed by an integrator of a library."""

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from headstock.geometry.frames import FloatArray


def integrate_pieces(
    rate: Callable[[float, FloatArray], ArrayLike],
    breaks: Sequence[float],
    start: FloatArray,
    times: FloatArray,
    *,
    method: str = "DOP853",
    rtol: float = 1e-8,
    atol: float,
    kicks: Mapping[float, FloatArray] | None = None,
) -> FloatArray:
    """States ``(len(times), n)`` from one break of the rates to the next, the last of which is the
    end; ``kicks`` are added to the state at their breaks.
    """
    state, found = start, np.zeros((len(times), len(start)))
    for begin, end in itertools.pairwise(breaks):
        state = state + (kicks or {}).get(begin, 0.0)
        here = (times >= begin - 1e-12) & (times <= end + 1e-12)
        late = float(np.nextafter(end, begin))
        solved = solve_ivp(
            lambda time, state, late=late: rate(min(time, late), state),
            (begin, end),
            state,
            method,
            np.append(np.clip(times[here], begin, late), end),
            rtol=rtol,
            atol=atol,
        )
        found[here], state = solved.y[:, :-1].T, solved.y[:, -1]
    return found
