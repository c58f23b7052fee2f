"""State spaces for python-control, where it is installed."""

import importlib
from typing import Any

from headstock.solvers.errors import ModelError
from headstock.solvers.linear.state_space import StateSpace
from headstock.solvers.system_ports import name_port


def to_control(space: StateSpace) -> Any:
    """A ``control.StateSpace`` with the same matrices and names.

    Raises:
        ModelError: python-control is not installed.
    """
    try:
        control = importlib.import_module("control")
    except ImportError as error:
        raise ModelError("python-control is not installed; install it by `pip install control`, or write a .mat file") from error
    return control.StateSpace(
        space.a, space.b, space.c, space.d,
        inputs=[name_port(port) for port in space.inputs],
        outputs=[name_port(port) for port in space.outputs],
        states=list(space.states),
    )  # fmt: skip
