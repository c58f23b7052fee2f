"""The pole that shows most in what a model leaves of responses: where models of all orders miss a weak or
close mode, it is the next candidate.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.modal_fitting.modal_model import WeightedResponses
from headstock.solvers.modal_fitting.stabilisation import PoleCluster
from headstock.solvers.second_order import ComplexArray

HALF_WIDTHS = 0.6 * 2.0 ** np.arange(8)  # of trial poles, in spacings of lines
WIDEST = 0.1  # damping ratio of trial poles
OUTSIDE = (0.3, 2.0)  # of the lowest and of the highest line: how far outside poles are tried
OUTER_COUNT = 25  # frequencies that are tried outside, on each side
DISTINCT = 0.01  # of a function that residual terms do not stand for as well
SKETCH = 32  # combinations of responses that the search looks at


def strongest_pole(data: WeightedResponses) -> PoleCluster:
    """Return the pole on a grid of frequencies and widths, within the lines and around them, that takes
    most of the sum of squares away.
    """
    hz = data.frequencies_hz
    spacing = np.gradient(hz)
    low, high = float(hz[0]), float(hz[-1])
    outer = np.concatenate(
        [
            np.geomspace(OUTSIDE[0] * low, low, OUTER_COUNT, endpoint=False),
            np.geomspace(OUTSIDE[1] * high, high, OUTER_COUNT, endpoint=False),
        ]
    )
    responses = data.weighted.reshape(len(hz), -1)
    sketch = _mix(responses)
    trials = [(0.02 * outer, outer)]
    for width in HALF_WIDTHS:
        some = slice(None, None, max(1, int(width)))
        trials.append((np.minimum(width * spacing, WIDEST * hz)[some], hz[some]))
    best, best_gain = 1j, -1.0
    for rates, places in trials:
        poles = 2.0 * np.pi * (-rates + 1j * places)
        gains = np.sum(np.abs(_unit_functions(data, poles).conj().T @ sketch) ** 2, axis=1)
        top = int(np.argmax(gains))
        if gains[top] > best_gain:
            best, best_gain = complex(poles[top]), float(gains[top])
    residues = _unit_functions(data, np.array([best])).conj().T @ responses
    weighted = residues.reshape(data.values.shape[1:]) / data.forces
    participation = np.linalg.svd(weighted)[2][0]
    return PoleCluster(best, participation, np.zeros(0, dtype=np.int64))


def _unit_functions(data: WeightedResponses, poles: ComplexArray) -> ComplexArray:
    """Return weighted ``1 / (s - p)`` without their share of residual terms, as columns ``(l, p)`` of
    length one; zero where little else is left.
    """
    functions = data.lines[:, None] / (2j * np.pi * data.frequencies_hz[:, None] - poles)
    terms = data.residual_terms
    rest = functions - terms @ (terms.T @ functions)
    sizes, whole = np.linalg.norm(rest, axis=0), np.linalg.norm(functions, axis=0)
    return np.asarray(np.where(sizes > DISTINCT * whole, rest / sizes, 0.0))


def _mix(responses: ComplexArray) -> ComplexArray:
    """Return a few random combinations of responses ``(l, n)``, whose squares are those of all on
    average.
    """
    count = responses.shape[1]
    if count <= SKETCH:
        return responses
    factors: FloatArray = np.random.default_rng(0).standard_normal((count, SKETCH))
    return np.asarray(responses @ factors) / np.sqrt(SKETCH)
