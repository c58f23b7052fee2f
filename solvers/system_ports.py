"""Inputs and outputs of a system by name."""

from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import Port, SecondOrderSystem


def input_columns(system: SecondOrderSystem, inputs: Sequence[Port]) -> FloatArray:
    """Generalised loads ``(n, n_inputs)`` of unit loads.

    Raises:
        ModelError: There is no such input.
    """
    return np.array([_find(system.inputs, port, "input") for port in inputs]).reshape(len(inputs), len(system.mass)).T


def output_rows(system: SecondOrderSystem, outputs: Sequence[Port]) -> FloatArray:
    """Rows ``(n_outputs, n)`` that give the motions.

    Raises:
        ModelError: There is no such output.
    """
    return np.array([_find(system.outputs, port, "output") for port in outputs]).reshape(len(outputs), len(system.mass))


def name_port(port: Port) -> str:
    """``tcp x``."""
    return f"{port[0]} {port[1]}"


def _find(ports: dict[Port, FloatArray], port: Port, what: str) -> FloatArray:
    if port not in ports:
        known = sorted({name for name, _ in ports})
        raise ModelError(f"there is no {what} {name_port(port)!r}; points and interfaces: {known}, directions x y z rx ry rz")
    return ports[port]
