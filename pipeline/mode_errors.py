"""Error estimates of the natural frequencies of a coupled machine, from every source there is."""

import numpy as np

from headstock.pipeline.error_estimates import REDUCTION, Estimate, combine_estimates
from headstock.pipeline.run_state import RunState
from headstock.reduction.coupling import CoupledMachine
from headstock.reduction.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.solvers.modal_analysis import ModalResult


def estimate_mode_errors(state: RunState, coupled: CoupledMachine, modes: ModalResult) -> tuple[Estimate, ...]:
    """An estimate [Hz] per natural frequency, all sources together."""
    sources = (_estimate_reduction(coupled, modes), _name_what_is_left_out(state, coupled, modes))
    return tuple(combine_estimates(parts) for parts in zip(*sources, strict=True))


def _estimate_reduction(coupled: CoupledMachine, modes: ModalResult) -> list[Estimate]:
    """The modes that components leave out make frequencies too high, never too low."""
    found = bound_frequency_errors(coupled.system, truncated_parts(coupled), modes)
    unknown = tuple(f"the reduction of {name}, which was imported" for name in _silent_imports(coupled))
    return [Estimate({REDUCTION: None if np.isnan(bound) else float(bound)}, unknown) for bound in found.bounds_hz]


def _silent_imports(coupled: CoupledMachine) -> list[str]:
    """Components with modal dofs that do not say what their reduction left out."""
    return [name for name, part in coupled.layout.superelements.items() if part.modal_count and part.truncation is None]


def _name_what_is_left_out(state: RunState, coupled: CoupledMachine, modes: ModalResult) -> list[Estimate]:
    """What no estimate is made of: the mesh, and bodies that are no finite element model."""
    kinds: dict[str, list[str]] = {}
    for name in coupled.layout.superelements:
        fidelity = state.plan.components[name].fidelity
        kinds.setdefault("the mesh of" if fidelity == "elastic" else f"{fidelity} model of", []).append(name)
    words = tuple(f"{kind} {', '.join(names)}" for kind, names in kinds.items())
    return [Estimate({}, words)] * len(modes.frequencies_hz)
