"""Error estimates of the natural frequencies and compliances of a coupled machine, from every
source there is.
"""

from collections.abc import Callable, Mapping

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.parts.components import Material
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.numbers.estimates import (
    CURVED_FACES,
    DISCRETISATION,
    LEFT_OUT,
    REDUCTION,
    Estimate,
    combine_estimates,
)
from headstock.pipeline.planning.interfaces import has_choice
from headstock.pipeline.stages.run_state import MachineParts
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.estimates.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.estimates.mesh_errors import (
    compliance_feature_errors,
    compliance_mesh_errors,
    compliance_shape_errors,
    frequency_feature_errors,
    frequency_mesh_errors,
    frequency_shape_errors,
    interface_kind_energies,
)
from headstock.scene.analyses.modal import ModalRequest
from headstock.solvers.linear.modal_analysis import ModalResult

NAMED_DOUBT = (
    5e-3  # share of a number that the kinds of interfaces must change together to be named
)
NAMED_PART = 0.1  # of what the one that matters most changes: less is not worth a name
NAMED_INTERFACES = 8


def estimate_mode_errors(
    parts: MachineParts, coupled: CoupledMachine, modes: ModalResult
) -> tuple[Estimate, ...]:
    """An estimate [Hz] per natural frequency, all sources together; it covers 95 % of true errors.

    None is given where no body has an estimate of its mesh: rigid and segmented models leave out
    more than anything that is known.

    Args:
        parts: Superelements with their own error estimates.
        modes: ``m`` natural modes of it.

    Returns:
        ``m`` estimates [Hz], half widths.
    """
    count = len(modes.frequencies_hz)
    effects = frequency_kind_errors(parts, coupled, modes)
    kinds = Estimate({}, _name_kinds(parts, effects, modes.frequencies_hz, unit="Hz", factor=1.0))
    unknown = [combine_estimates([name_what_is_left_out(parts), kinds])] * count
    meshes, faces = frequency_mesh_errors(coupled, modes), frequency_shape_errors(coupled, modes)
    if not meshes:
        return tuple(unknown)
    sources = (
        estimate_parts(DISCRETISATION, meshes, count),
        estimate_parts(CURVED_FACES, faces, count),
        estimate_parts(LEFT_OUT, frequency_feature_errors(coupled, modes), count),
        _estimate_reduction(coupled, modes),
        unknown,
    )
    return tuple(combine_estimates(each) for each in zip(*sources, strict=True))


def estimate_compliance_errors(
    parts: MachineParts, coupled: CoupledMachine, displacements: FloatArray
) -> dict[str, Estimate]:
    """An estimate [m/N] of the compliance in x, y and z at a point; the reduction adds nothing to
    it.

    Args:
        displacements: ``(n, 6)`` responses to unit loads at the point.
    """
    energies = compliance_mesh_errors(coupled, displacements)
    meshes = estimate_parts(
        DISCRETISATION, {name: np.diag(energy) for name, energy in energies.items()}, 6
    )
    faces = estimate_parts(CURVED_FACES, compliance_shape_errors(coupled, displacements), 6)
    features = estimate_parts(LEFT_OUT, compliance_feature_errors(coupled, displacements), 6)
    changes = compliance_kind_errors(parts, coupled, displacements[:, :3])
    soft = np.einsum(
        "im,ij,jm->m", displacements[:, :3], coupled.system.stiffness, displacements[:, :3]
    )
    kinds = Estimate({}, _name_kinds(parts, changes, soft, unit="µm/kN", factor=UM_PER_KN))
    unknown = combine_estimates([name_what_is_left_out(parts), kinds])
    return {
        direction: combine_estimates([meshes[i], faces[i], features[i], unknown])
        for i, direction in enumerate(DIRECTIONS)
    }


def frequency_kind_errors(
    parts: MachineParts, coupled: CoupledMachine, modes: ModalResult
) -> dict[str, FloatArray]:
    """By how much the kind of each interface may change natural frequencies ``(m,)`` [Hz], by
    ``component.interface``; 0 for rigid-body modes.
    """
    elastic = np.arange(len(modes.frequencies_hz)) >= modes.rigid_count
    squares = np.where(elastic, (2.0 * np.pi * modes.frequencies_hz) ** 2, 0.0)
    energies = interface_kind_energies(coupled, modes.shapes, squares, *_coupled_areas(parts))
    return {
        name: np.divide(
            0.5 * modes.frequencies_hz * energy,
            squares,
            out=np.zeros_like(energy),
            where=squares > 0.0,
        )
        for name, energy in energies.items()
    }


def compliance_kind_errors(
    parts: MachineParts, coupled: CoupledMachine, displacements: FloatArray
) -> dict[str, FloatArray]:
    """By how much the kind of each interface may change compliances ``(m,)`` [m/N], by
    ``component.interface``.

    Args:
        displacements: ``(n, m)`` responses to unit loads.
    """
    squares = np.zeros(displacements.shape[1])
    return interface_kind_energies(coupled, displacements, squares, *_coupled_areas(parts))


def estimate_parts(source: str, found: Mapping[str, FloatArray], count: int) -> list[Estimate]:
    """One estimate per number, from ``(count,)`` parts of each component; None where one of them is
    not known.
    """
    estimates = []
    for number in range(count):
        parts = {name: float(errors[number]) for name, errors in found.items()}
        total = sum(parts.values())
        if not parts:
            estimates.append(Estimate())
        elif np.isnan(total):
            estimates.append(Estimate({source: None}))
        else:
            estimates.append(Estimate({source: total}, (), {source: parts}))
    return estimates


type Changes = Mapping[str, Mapping[str, FloatArray]]


def estimate_measures(
    measure: Callable[[FloatArray], FloatArray],
    values: FloatArray,
    changes: Changes,
    left_out: tuple[str, ...],
) -> list[Estimate]:
    """An estimate of each number that is measured of values, from what the values change by.

    Args:
        measure: Values ``(...)`` to numbers ``(m,)``.
        values: As found; NaN where there is none.
        changes: Source of error to component to the change of the values, NaN where nobody knows.
    """
    found = measure(values)
    known = np.isfinite(values)
    sources = [
        estimate_parts(
            source,
            {
                name: np.abs(measure(values + change) - found)
                if np.isfinite(change[known]).all()
                else np.full(len(found), np.nan)
                for name, change in parts.items()
            },
            len(found),
        )
        for source, parts in changes.items()
    ]
    unknown = [Estimate({}, left_out)] * len(found)
    return [combine_estimates(each) for each in zip(*sources, unknown, strict=True)]


def _estimate_reduction(coupled: CoupledMachine, modes: ModalResult) -> list[Estimate]:
    """The modes that components leave out make frequencies too high, never too low."""
    found = bound_frequency_errors(coupled.system, truncated_parts(coupled), modes)
    unknown = tuple(
        f"the reduction of {name}, which was imported"
        for name in [
            name
            for name, part in coupled.layout.superelements.items()
            if part.modal_count and part.errors.truncation is None
        ]
    )
    return [
        Estimate(
            {REDUCTION: None if np.isnan(bound) else float(bound)},
            unknown,
            {REDUCTION: {name: float(errors[mode]) for name, errors in found.by_component.items()}},
        )
        for mode, bound in enumerate(found.bounds_hz)
    ]


def _coupled_areas(parts: MachineParts) -> tuple[dict[tuple[str, str], float], dict[str, Material]]:
    """Areas [m^2] of fixed interfaces of meshed components whose kind is open, and materials."""
    areas, materials = {}, {}
    for name, component in parts.plan.components.items():
        quality = parts.reduced[name].quality
        if quality is not None and has_choice(component):
            materials[name] = component.material
            for interface, settings in component.interfaces.items():
                area = quality.cad_areas.get(interface, np.nan)
                if settings.rail is None and area > 0.0:
                    areas[name, interface] = float(area)
    return areas, materials


def _name_kinds(
    parts: MachineParts,
    effects: Mapping[str, FloatArray],
    values: FloatArray,
    *,
    unit: str,
    factor: float,
) -> tuple[str, ...]:
    """The interfaces whose kind may matter, with the size of that; none where it is small beside
    every number.
    """
    together = np.sum([np.zeros(len(values)), *effects.values()], axis=0)
    # many small ones add up: a long machine of many parts is a little too stiff at each
    doubtful = together > NAMED_DOUBT * values
    if not doubtful.any():
        return ()
    most = NAMED_PART * np.max(list(effects.values()), axis=0)
    large = [name for name, size in effects.items() if (size >= most)[doubtful].any()]
    named = ", ".join(large[:NAMED_INTERFACES]) + (
        f" and {len(large) - NAMED_INTERFACES} more" if len(large) > NAMED_INTERFACES else ""
    )
    size = float(f"{factor * float(together.max()):.1g}")
    modal = parts.scene.analyses.get(ModalRequest)
    remedy = (
        ""
        if modal is not None and modal.spread
        else "; spread = true in [analyses.modal] computes it"
    )
    return (f"rigid or averaging interfaces {named}, about {size:g} {unit} at most{remedy}",)


def name_what_is_left_out(parts: MachineParts) -> Estimate:
    """Name what no estimate is made of: meshes of imported parts and those that show nothing of their
    error, and bodies that are no finite element model.
    """
    kinds: dict[str, list[str]] = {}
    others = []
    for name, part in parts.superelements.items():
        fidelity = parts.plan.components[name].fidelity
        if part.errors.missing_energy is None:
            kinds.setdefault(
                "the mesh of" if fidelity == "elastic" else f"{fidelity} model of", []
            ).append(name)
        elif not part.errors.missing_energy.any():
            others.append(f"the mesh of {name}, which shows no error")
        elif part.errors.shape_stiffness is None:
            others.append(f"the curved faces of {name}{_missed_volume(parts, name)}")
    return Estimate({}, (*(f"{kind} {', '.join(names)}" for kind, names in kinds.items()), *others))


def _missed_volume(parts: MachineParts, name: str) -> str:
    quality = parts.reduced[name].quality
    if quality is None or not quality.cad_volume > 0.0:
        return ", known from its mesh alone"
    return f" ({100.0 * abs(quality.volume / quality.cad_volume - 1.0):.1g} % of its volume)"
