"""A system in its lowest modes, with residual modes for the static flexibility that is cut off: few
dofs whose receptance at some channels is that of all dofs up to a frequency.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest, solve_modal
from headstock.solvers.linear.modal_coordinates import elastic_displacements
from headstock.solvers.second_order import (
    Channel,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

NEGLIGIBLE = 1e-10  # of the largest residual flexibility
FASTEST = 4.0  # times the limit: residual modes are no faster, so that time steps need not be finer


def reduce_to_modes(
    system: SecondOrderSystem,
    channels: Sequence[Channel],
    up_to_hz: float,
    modes: ModalResult | None = None,
) -> SecondOrderSystem:
    """The modes up to a frequency, and a residual mode for each independent static flexibility of the
    channels that they lack.

    Static answers are exact. A residual mode has the mass of its own shape; one that would be faster
    than ``FASTEST`` times the limit gets the mass that makes it so fast.

    Args:
        system: Symmetric, with collocated channels.
        channels: Where it is pushed and seen.
        up_to_hz: Modes up to here are kept.
        modes: All undamped modes, where they are already known.

    Source: MacNeal (1971), A hybrid method of component mode synthesis; Rubin (1975), Improved
    component-mode representation for structural dynamic analysis (residual mass).
    """
    modes = modes or solve_modal(system)
    loads, rows = input_columns(system, channels), output_rows(system, channels)
    kept = keep_lowest(modes, up_to_hz=up_to_hz)
    flexible = slice(kept.rigid_count, None)
    squares = (2.0 * np.pi * kept.frequencies_hz[flexible]) ** 2
    own = kept.shapes[:, flexible]
    rest = elastic_displacements(system, modes, loads) - (own / squares) @ (own.T @ loads)
    # independent shapes among them, by the flexibility they carry
    flexibility = loads.T @ rest
    level, turn = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    whole = float(np.abs(loads.T @ elastic_displacements(system, modes, loads)).max(initial=0.0))
    carried = level > NEGLIGIBLE * whole
    shapes = np.zeros((len(system.mass), 0))
    squares_of_rest = np.zeros(0)
    if carried.any():
        # unit stiffness: rest^T K rest is the flexibility itself
        shapes = rest @ (turn[:, carried] / np.sqrt(level[carried]))
        mass = shapes.T @ system.mass @ shapes
        lightest = 1.0 / (2.0 * np.pi * FASTEST * up_to_hz) ** 2
        inertia, axes = np.linalg.eigh(0.5 * (mass + mass.T))
        squares_of_rest = 1.0 / np.maximum(inertia, lightest)
        shapes = shapes @ axes * np.sqrt(squares_of_rest)
    basis = np.concatenate([kept.shapes, shapes], axis=1)
    rigid = np.zeros(kept.rigid_count)
    count = basis.shape[1]

    def project(matrix: np.ndarray | None) -> np.ndarray | None:  # type: ignore[type-arg]
        return None if matrix is None else basis.T @ matrix @ basis

    return dataclasses.replace(
        system,
        mass=np.eye(count),
        stiffness=np.diag(np.concatenate([rigid, squares, squares_of_rest])),
        damping=project(system.damping),
        hysteretic=project(system.hysteretic),
        inputs={channel: basis.T @ loads[:, place] for place, channel in enumerate(channels)},
        outputs={channel: rows[place] @ basis for place, channel in enumerate(channels)},
        labels=tuple(f"mode.{number}" for number in range(count)),
    )
