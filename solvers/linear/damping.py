"""Damping ratios given per mode, and equivalent viscous damping in place of structural damping
where there is no one frequency.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.second_order import SecondOrderSystem


def add_modal_damping(
    system: SecondOrderSystem, ratios: Sequence[float], modes: ModalResult | None = None
) -> SecondOrderSystem:
    """Return the system with a damping ratio on every elastic mode, on top of what it has;
    rigid-body modes stay free.

    Args:
        system: Symmetric.
        ratios: Of the first, second, ... elastic mode; the last one holds for all that follow.
        modes: All undamped modes, where they are already known.

    Raises:
        ModelError: There is no ratio, or one is negative or not finite.

    Source: Wilson and Penzien (1972): C = M Phi diag(2 zeta omega) Phi^T M.
    """
    given = np.asarray(ratios, dtype=float)
    if not len(given) or not np.isfinite(given).all() or given.min() < 0.0:
        raise ModelError(
            f"modal damping ratios {list(ratios)} must be one or more numbers from zero upwards"
        )
    modes = modes or solve_modal(system)
    count = modes.shapes.shape[1]
    every = np.zeros(count)
    flexible = np.arange(modes.rigid_count, count)
    every[flexible] = given[np.minimum(flexible - modes.rigid_count, len(given) - 1)]
    weighed = system.mass @ modes.shapes
    loss = 4.0 * np.pi * every * modes.frequencies_hz
    return _add_damping(system, (weighed * loss) @ weighed.T)


def equivalent_viscous(
    system: SecondOrderSystem, modes: ModalResult | None = None
) -> SecondOrderSystem:
    """Return the system with a viscous damping in place of its structural one: the same loss per
    cycle in each mode at its own frequency.

    In modal coordinates ``C_ij = H_ij / sqrt(omega_i omega_j)``: a loss factor eta of a mode
    becomes the damping ratio eta / 2, and modes of nearly one frequency stay coupled as they are.
    Between modes far apart the coupling is approximate.

    Args:
        system: Symmetric.
        modes: All undamped modes, where they are already known.

    Source: Crandall (1970), The role of damping in vibration theory; Geradin and Rixen (2015),
    section 3.1.
    """
    if system.hysteretic is None:
        return system
    modes = modes or solve_modal(system)
    flexible = slice(modes.rigid_count, None)
    omega = 2.0 * np.pi * modes.frequencies_hz[flexible]
    shapes = modes.shapes[:, flexible]
    loss = np.zeros((modes.shapes.shape[1],) * 2)
    loss[flexible, flexible] = (shapes.T @ system.hysteretic @ shapes) / np.sqrt(
        np.outer(omega, omega)
    )
    weighed = system.mass @ modes.shapes
    return _add_damping(dataclasses.replace(system, hysteretic=None), weighed @ loss @ weighed.T)


def _add_damping(system: SecondOrderSystem, added: FloatArray) -> SecondOrderSystem:
    added = 0.5 * (added + added.T)
    return dataclasses.replace(
        system, damping=added if system.damping is None else system.damping + added
    )
