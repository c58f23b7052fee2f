"""What a reader of the results should be warned of."""

import numpy as np

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.component_mesh import POOR_QUALITY, MeshQuality
from headstock.meshing.step_units import doubt_size
from headstock.pipeline.results.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.pipeline.stages.warnings import warn_of_cutoff, warn_of_locking, warn_of_mesh

LARGE_ERROR = 0.5  # of a number
# a thousandth of the volume in elements that are wrong by all of their energy moves no frequency by more than 0.05 %
POOR_SHARE = 1e-3
BAD_QUALITY = 2e-3  # below a thousandth elements are refused
REPAIRED_SHARE = 1e-3  # per dof; there are about six dofs per element


def find_warnings(state: RunState) -> list[str]:
    """Warnings about the superelements and about frequencies beyond their reach."""
    highest = max((float(modes.frequencies_hz.max(initial=0.0)) for modes in state.modal), default=0.0)
    frf = state.scene.analyses.frf
    highest = max(highest, frf.to_hz if frf is not None else 0.0)
    found: list[str] = []
    for name, reduced in state.reduced.items():
        found += _component_warnings(name, reduced) + _size_warnings(state.plan.components[name], reduced)
        found += warn_of_cutoff(name, reduced, highest)
        component = state.plan.components[name]
        found += warn_of_locking(component, reduced, highest, _mesh_share(state, name)) or warn_of_mesh(component, reduced, highest)
    return found + _warn_of_large_errors(state)


def _mesh_share(state: RunState, component: str) -> float | None:
    """Largest share of a number that a component's mesh may be off by; None where nobody knows."""
    shares = [
        error.parts.get(DISCRETISATION, {}).get(component, 0.0) / abs(value)
        for _, value, error in _stated_errors(state)
        if error.total is not None and value
    ]
    return max(shares, default=None)


def _stated_errors(state: RunState) -> list[tuple[str, float, Estimate]]:
    """Frequencies and compliances with their names and what is behind ±."""
    rows = [
        (f"frequency {index + 1} ({hz:.4g} Hz)", float(hz), modes.errors[index])
        for modes in state.modal
        for index, hz in enumerate(modes.frequencies_hz)
        if index >= modes.rigid_count
    ]
    rows += [
        (f"the {direction} compliance at {name}", float(point.compliance[axis, axis]), error)
        for points in state.static.values()
        for name, point in points.items()
        for axis, (direction, error) in enumerate(point.errors.items())
    ]
    return rows


def _warn_of_large_errors(state: RunState) -> list[str]:
    """A warning per component that makes what stands behind ± as large as the numbers, with the worst of them and a remedy."""
    worst: dict[tuple[str, str], tuple[float, str]] = {}
    for what, value, error in _stated_errors(state):
        parts = {(name, source): size for source, sizes in error.parts.items() for name, size in sizes.items()}
        if error.total is not None and parts and error.total > LARGE_ERROR * abs(value) > 0.0:
            owner = max(parts, key=lambda key: parts[key])
            worst[owner] = max(worst.get(owner, (0.0, "")), (error.total / abs(value), what))
    return [
        f"component {name!r}: {what} is no more than a rough guess, its ± is {share:.2g} times its value, most of it {source}; write"
        f" {'a higher reduction.modes_to' if source == REDUCTION else 'a smaller mesh size'}"
        for (name, source), (share, what) in worst.items()
    ]


def _size_warnings(component: Component, reduced: ReducedComponent) -> list[str]:
    """What makes the unit of a STEP file doubtful."""
    if not isinstance(component.solid, StepFile) or reduced.skin is None:
        return []
    doubt = doubt_size(component.solid.path, float(np.ptp(reduced.skin.points, axis=0).max()))
    return [] if doubt is None else [f"component {component.name!r}: {doubt}"]


def _component_warnings(name: str, reduced: ReducedComponent) -> list[str]:
    found = [f"component {name!r}: {message}" for message in reduced.superelement.warnings]
    if reduced.superelement.free_dofs:
        found.append(f"component {name!r}: nothing holds the interface dofs {', '.join(reduced.superelement.free_dofs)}")
    if reduced.quality is not None:
        found += [f"component {name!r}: {message}" for message in mesh_warnings(reduced.quality, reduced.superelement.full_dofs)]
    return found


def mesh_warnings(quality: MeshQuality, dofs: int) -> list[str]:
    """What is said of a mesh; a few poor or straightened elements among thousands move no result."""
    found = list(quality.remarks)
    if quality.repaired > REPAIRED_SHARE * dofs:
        found.append(f"{quality.repaired} curved elements were inverted as meshed and were repaired")
    if quality.poor_share > POOR_SHARE or quality.minimum_scaled_jacobian < BAD_QUALITY:
        place = ", ".join(f"{value:.4g}" for value in quality.worst_place)
        face = f", {quality.worst_face}" if quality.worst_face else ""
        found.append(
            f"elements with {quality.poor_share:.2g} of the volume have a scaled Jacobian below {POOR_QUALITY:g} (1 is ideal), the"
            f" worst {quality.minimum_scaled_jacobian:.2g} at ({place}) m{face}; a smaller mesh size may help"
        )
    return found
