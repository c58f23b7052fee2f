"""What a direct frequency response says about cutting: the chatter limit and the softest frequency."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.frequency_response import FrequencyResponse, FrfModel
from headstock.solvers.second_order import ComplexArray, Port

REFINEMENT = 1e-9  # of the frequency


@dataclass(frozen=True)
class StabilityFigures:
    """Of the response at one port to a load at the same port.

    Attributes:
        port: Where.
        worst_real: Most negative real part [m/N]; None where it is never negative.
        worst_real_hz: Its frequency [Hz].
        chatter_stiffness: ``-1 / (2 Re)`` [N/m]: over the cutting stiffness per width it is the width of cut below which no
            regenerative chatter occurs at any speed; None where the real part is never negative.
        softest: Smallest dynamic stiffness ``1 / |H|`` [N/m].
        softest_hz: Its frequency [Hz].
    """

    port: Port
    worst_real: float | None
    worst_real_hz: float | None
    chatter_stiffness: float | None
    softest: float
    softest_hz: float


def find_stability_figures(model: FrfModel, response: FrequencyResponse) -> tuple[StabilityFigures, ...]:
    """Figures of every port that is both input and output, refined between the points of the grid.

    Args:
        model: What the response was computed from.
        response: On a grid that shows every peak; entries without a value are left out.

    Source: Tlusty and Polacek (1963); Altintas (2012), Manufacturing Automation, section 4.3: a_lim = -1 / (2 K_s Re G).
    """
    return tuple(
        _judge(model, response, port, response.outputs.index(port), response.inputs.index(port))
        for port in response.inputs
        if port in response.outputs and not np.isnan(_entry(response, port)).all()
    )


def _judge(model: FrfModel, response: FrequencyResponse, port: Port, row: int, column: int) -> StabilityFigures:
    values = response.receptance[:, row, column]
    real_parts, sizes = np.array(values.real, dtype=float), np.array(np.abs(values), dtype=float)

    def value_at(hz: float) -> complex:
        return complex(model.form.evaluate(np.array([2.0 * np.pi * hz]))[0, row, column])

    real_hz, real = _lowest(response.frequencies_hz, real_parts, lambda hz: value_at(hz).real)
    soft_hz, soft = _lowest(response.frequencies_hz, -sizes, lambda hz: -abs(value_at(hz)))
    negative = real < 0.0
    return StabilityFigures(
        port=port,
        worst_real=real if negative else None,
        worst_real_hz=real_hz if negative else None,
        chatter_stiffness=-0.5 / real if negative else None,
        softest=-1.0 / soft,
        softest_hz=soft_hz,
    )


def _lowest(frequencies_hz: FloatArray, values: FloatArray, function: Callable[[float], float]) -> tuple[float, float]:
    """Frequency and value of the lowest point, by Brent's method between the neighbours of the lowest grid point."""
    index = int(np.nanargmin(values))
    low, high = frequencies_hz[max(0, index - 1)], frequencies_hz[min(len(values) - 1, index + 1)]
    best = float(frequencies_hz[index]), float(values[index])
    if low == high:
        return best
    found = minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": REFINEMENT * high})
    return (float(found.x), float(found.fun)) if found.fun < best[1] else best


def _entry(response: FrequencyResponse, port: Port) -> ComplexArray:
    return response.receptance[:, response.outputs.index(port), response.inputs.index(port)]
