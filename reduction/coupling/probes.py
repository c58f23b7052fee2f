"""What probes see of a coupled machine: displacement and stress in machine axes, of its free
coordinates and of its loads.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Probe
from headstock.reduction.coupling.channels import gravity_factors, list_fields, load_factors
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement import ProbeLoad, ProbeRows
from headstock.solvers.errors import ModelError
from headstock.solvers.stresses import turn_stress


@dataclass(frozen=True, eq=False)
class PlacedProbe:
    """Outputs of a probe of a machine with ``n`` free coordinates, machine axes.

    Attributes:
        values: ``(9, n)`` displacement x y z [m] and stress xx yy zz xy xz yz [Pa].
        offset: ``(9,)`` the same at zero free coordinates, by what is prescribed.
        inertia: ``(9, n)`` that modes left out add at rest per acceleration, times -1.
        smoothing: ``(s, 6, n)`` what recovery changes in the stresses at the probe and around, the
            root of whose sum of squares counts; None where nobody knows.
        missing: ``(9, n)`` energy products of the errors of unit responses with those of the
            coordinates; None where nobody knows.
        limit: Square of the angular frequency from which on modes are left out [rad^2/s^2].
        strain_reach: What an error of the stress moves across its cells [m/Pa].
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
        mesh_safety: Factor with which the energy products of a displacement cover 95 % of true
            errors.
    """

    component: str
    values: FloatArray
    offset: FloatArray
    inertia: FloatArray
    smoothing: FloatArray | None
    missing: FloatArray | None
    loads: Mapping[str, ProbeLoad] = field(default_factory=dict)
    limit: float = np.inf
    strain_reach: float = 0.0
    singular: str = ""
    mesh_safety: float = 1.0


def place_probe(
    coupled: CoupledMachine, machine: Machine, probe: Probe, gravity: FloatArray | None
) -> PlacedProbe:
    """Return what a probe sees of a coupled machine.

    Args:
        gravity: ``(3,)`` acceleration in machine axes [m/s^2]; None without.

    Raises:
        ModelError: Its component was reduced without it.
    """
    name = probe.component
    superelement = coupled.layout.superelements[name]
    if probe.name not in superelement.probes:
        raise ModelError(f"component {name!r} was reduced without the probe {probe.name!r}")
    rows, placement = superelement.probes[probe.name], coupled.placements[name]
    stacked = turn_dofs(superelement, placement) @ coupled.basis[coupled.offsets[name]]
    fixed = turn_dofs(superelement, placement) @ coupled.offset[coupled.offsets[name]]
    turned = turn_stress(placement.rotation)
    to_machine = scipy.linalg.block_diag(placement.rotation, turned)
    errors = superelement.errors
    return PlacedProbe(
        component=name,
        values=to_machine @ rows.values @ stacked,
        offset=to_machine @ rows.values @ fixed,
        inertia=to_machine @ rows.inertia @ stacked[: superelement.boundary_size],
        smoothing=None if rows.smoothing is None else turned @ (rows.smoothing @ stacked),
        missing=None if rows.missing is None else to_machine @ rows.missing @ stacked,
        loads={
            load: _combine(rows, factors, to_machine)
            for load, factors in component_factors(coupled, machine, name, gravity).items()
        },
        limit=np.inf if errors.truncation is None else errors.truncation.limit,
        strain_reach=rows.strain_reach,
        singular=rows.singular,
        mesh_safety=errors.mesh_safety,
    )


def carry_probe(coupled: CoupledMachine, probe: Probe, moved: FloatArray) -> FloatArray:
    """Return what a probe sees ``(9, ...)`` of motions of the stacked dofs ``(n_all, ...)``,
    machine axes.
    """
    superelement = coupled.layout.superelements[probe.component]
    placement = coupled.placements[probe.component]
    local = turn_dofs(superelement, placement) @ moved[coupled.offsets[probe.component]]
    to_machine = scipy.linalg.block_diag(placement.rotation, turn_stress(placement.rotation))
    return to_machine @ superelement.probes[probe.name].values @ local


def travel_inertia(coupled: CoupledMachine, probe: Probe, direction: FloatArray) -> FloatArray:
    """Return what modes left out add at a probe ``(9,)`` at rest per acceleration of its whole
    component in a direction ``(3,)``, times -1, machine axes.
    """
    return moved_inertia(coupled, probe, coupled.matrices.rigid[probe.component][:, :3] @ direction)


def moved_inertia(coupled: CoupledMachine, probe: Probe, moved: FloatArray) -> FloatArray:
    """Return the same ``(9, ...)`` per acceleration of the dofs of its component
    ``(n_own, ...)``.
    """
    superelement = coupled.layout.superelements[probe.component]
    placement = coupled.placements[probe.component]
    local = (turn_dofs(superelement, placement) @ moved)[: superelement.boundary_size]
    to_machine = scipy.linalg.block_diag(placement.rotation, turn_stress(placement.rotation))
    return to_machine @ superelement.probes[probe.name].inertia @ local


def component_factors(
    coupled: CoupledMachine, machine: Machine, name: str, gravity: FloatArray | None
) -> dict[str, dict[str, float]]:
    """Return how much of each unit load of a component's superelement each load of the machine
    takes.

    Args:
        gravity: ``(3,)`` acceleration in machine axes [m/s^2]; None without.
    """
    unit_loads = coupled.layout.superelements[name].loads
    factors = {
        load.name: load_factors(coupled.placements[load.component], load)
        for load in machine.loads.values()
        if load.component == name
    }
    for source, acceleration in list_fields(machine, gravity).items():
        factors[source] = gravity_factors(coupled.placements[name], acceleration)
    return {
        load: {key: size for key, size in by_key.items() if key in unit_loads}
        for load, by_key in factors.items()
    }


def _combine(rows: ProbeRows, factors: Mapping[str, float], to_machine: FloatArray) -> ProbeLoad:
    """Return what is seen of unit loads that act together, machine axes."""
    values: FloatArray = np.zeros(9)
    smoothing: FloatArray = np.zeros(() if rows.smoothing is None else rows.smoothing.shape[:2])
    missing: FloatArray = np.zeros(9)
    has_errors = rows.smoothing is not None and rows.missing is not None
    for key, factor in factors.items():
        load = rows.loads[key]
        values = values + factor * load.values
        if load.smoothing is not None and load.missing is not None:
            smoothing = smoothing + factor * load.smoothing
            missing = missing + factor * load.missing
    return ProbeLoad(
        to_machine @ values,
        smoothing @ to_machine[3:, 3:].T if has_errors else None,
        to_machine @ missing if has_errors else None,
    )


def missing_of_loads(
    coupled: CoupledMachine,
    machine: Machine,
    gravity: FloatArray | None,
    wanted: Collection[str] | None = None,
) -> dict[str, FloatArray]:
    """Return the energy products ``(n,)`` of the discretisation errors of static responses to loads
    inside bodies with those of the coordinates, together; by component with such loads, as far as
    known.

    Args:
        gravity: ``(3,)`` acceleration in machine axes [m/s^2]; None without.
        wanted: Names of loads; None for all.
    """
    products = {}
    for name, element in coupled.layout.superelements.items():
        total: FloatArray = np.zeros(len(element.labels))
        for load, factors in component_factors(coupled, machine, name, gravity).items():
            for key, factor in factors.items():
                missing = element.loads[key].missing
                if missing is not None and (wanted is None or load in wanted):
                    total = total + factor * missing
        if total.any():
            turn = turn_dofs(element, coupled.placements[name])
            local = turn @ coupled.basis[coupled.offsets[name]]
            products[name] = element.errors.mesh_safety * local.T @ total
    return products
