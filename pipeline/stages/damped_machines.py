"""The damping a scene names, and no other, in a coupled machine."""

import dataclasses

from headstock.pipeline.stages.run_state import RunState
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.second_order import SecondOrderSystem

DAMPING = "damping"


def solve_all_modes(state: RunState, system: SecondOrderSystem) -> ModalResult:
    """All undamped modes of a coupled system, once for the analyses of a pose that need them."""
    if state.all_modes is None or state.all_modes[0] is not system:
        state.all_modes = (system, solve_modal(system))
    return state.all_modes[1]


def damp_system(state: RunState, system: SecondOrderSystem, modes: ModalResult | None = None) -> SecondOrderSystem:
    """The system with the damping of the scene: none unless the effect is named; modal ratios on top of joints and materials.

    Args:
        state: Of the run.
        system: As coupled, with what joints and materials bring.
        modes: All undamped modes, where they are already known.
    """
    if DAMPING not in state.scene.effects:
        return dataclasses.replace(system, damping=None, hysteretic=None)
    if state.scene.modal_damping:
        return add_modal_damping(system, state.scene.modal_damping, modes)
    if system.damping is None and system.hysteretic is None:
        state.warn("the effect damping is on, but no joint and no material has any: every damping ratio is zero")
    return system
