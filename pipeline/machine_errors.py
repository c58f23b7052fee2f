"""Error estimates of the natural frequencies and compliances of a coupled machine, from every source there is."""

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.pipeline.error_estimates import DISCRETISATION, REDUCTION, Estimate, combine_estimates
from headstock.pipeline.run_state import RunState
from headstock.reduction.coupling import CoupledMachine
from headstock.reduction.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.mesh_errors import compliance_mesh_errors, frequency_mesh_errors
from headstock.solvers.modal_analysis import ModalResult


def estimate_mode_errors(state: RunState, coupled: CoupledMachine, modes: ModalResult) -> tuple[Estimate, ...]:
    """An estimate [Hz] per natural frequency, all sources together."""
    unknown = [name_what_is_left_out(state, coupled)] * len(modes.frequencies_hz)
    sources = (_estimate_discretisation(coupled, modes), _estimate_reduction(coupled, modes), unknown)
    return tuple(combine_estimates(parts) for parts in zip(*sources, strict=True))


def estimate_compliance_errors(state: RunState, coupled: CoupledMachine, displacements: FloatArray) -> dict[str, Estimate]:
    """An estimate [m/N] of the compliance in x, y and z at a point; the reduction adds nothing to it.

    Args:
        state: Of the run.
        coupled: The machine.
        displacements: ``(n, 6)`` responses to unit loads at the point.
    """
    found, unknown = compliance_mesh_errors(coupled, displacements), name_what_is_left_out(state, coupled)
    return {
        direction: combine_estimates([_mesh_estimate({name: float(error[i, i]) for name, error in found.items()}), unknown])
        for i, direction in enumerate(DOF_NAMES[:3])
    }


def _estimate_discretisation(coupled: CoupledMachine, modes: ModalResult) -> list[Estimate]:
    """Meshes make frequencies too high."""
    found = frequency_mesh_errors(coupled, modes)
    return [
        _mesh_estimate({name: float(errors[mode]) for name, errors in found.items()}) for mode in range(len(modes.frequencies_hz))
    ]


def _mesh_estimate(parts: dict[str, float]) -> Estimate:
    if not parts:
        return Estimate()
    total = sum(parts.values())
    return Estimate({DISCRETISATION: None}) if np.isnan(total) else Estimate({DISCRETISATION: total}, (), {DISCRETISATION: parts})


def _estimate_reduction(coupled: CoupledMachine, modes: ModalResult) -> list[Estimate]:
    """The modes that components leave out make frequencies too high, never too low."""
    found = bound_frequency_errors(coupled.system, truncated_parts(coupled), modes)
    unknown = tuple(f"the reduction of {name}, which was imported" for name in _silent_imports(coupled))
    return [
        Estimate(
            {REDUCTION: None if np.isnan(bound) else float(bound)},
            unknown,
            {REDUCTION: {name: float(errors[mode]) for name, errors in found.by_component.items()}},
        )
        for mode, bound in enumerate(found.bounds_hz)
    ]


def _silent_imports(coupled: CoupledMachine) -> list[str]:
    """Components with modal dofs that do not say what their reduction left out."""
    return [name for name, part in coupled.layout.superelements.items() if part.modal_count and part.truncation is None]


def name_what_is_left_out(state: RunState, coupled: CoupledMachine) -> Estimate:
    """What no estimate is made of: meshes of imported parts, and bodies that are no finite element model."""
    kinds: dict[str, list[str]] = {}
    for name, part in coupled.layout.superelements.items():
        fidelity = state.plan.components[name].fidelity
        if part.missing_energy is None:
            kinds.setdefault("the mesh of" if fidelity == "elastic" else f"{fidelity} model of", []).append(name)
    return Estimate({}, tuple(f"{kind} {', '.join(names)}" for kind, names in kinds.items()))
