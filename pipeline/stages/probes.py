"""Probes: displacement and stress with their errors, under static loads (a stage of its own) and over
frequency (part of the frequency response). Only rank 0 has anything to do.
"""

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.probes import ProbeAnswer, ProbeCurves, ProbeResponse, probe_keys
from headstock.pipeline.numbers.estimates import (
    CURVED_FACES,
    DISCRETISATION,
    REDUCTION,
    Estimate,
    combine_estimates,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.estimates import estimate_parts, name_what_is_left_out
from headstock.pipeline.stages.machine import DAMPING
from headstock.pipeline.stages.run_state import MachineParts, Outcome, RunState, pose_name
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.probes import PlacedProbe, missing_of_loads, place_probe
from headstock.reduction.estimates.static_errors import (
    MOVED,
    SEEN,
    STRESSED,
    bound_von_mises,
    estimate_at_rest,
    moved_locally,
)
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.scene.scene import LOAD
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.frequency_response import FrequencyResponse
from headstock.solvers.second_order import Channel, ComplexArray
from headstock.solvers.stresses import largest_von_mises, von_mises_change

# What recovery changes in an amplitude of stress is multiplied by, so that with the change of the
# coordinates it covers true errors
CYCLE_SAFETY = 1.8
# what a frequency response is asked for at a probe
WATCHED = ("values", "inertia", "smoothing", "missing")


def run_recover_stage(state: RunState, stage: Stage) -> Outcome:
    """Displacement and stress at every probe under all static loads together; a machine that moves
    freely is refused.
    """
    coupled, pose = state.coupled, pose_name(stage)
    if not state.is_root or coupled is None:
        return Outcome()
    machine, gravity = state.scene.machine, state.plan.gravity
    try:
        total = np.sum(list(coupled.loads.values()), axis=0)
        moved = solve_machine_static(coupled, total).displacements
        placed = {
            name: place_probe(coupled, machine, probe, gravity)
            for name, probe in machine.probes.items()
        }
    except ModelError as error:
        return Outcome(detail="refused: see below", failures=(f"probes in pose {pose}: {error}",))
    inside = missing_of_loads(coupled, machine, gravity)
    responses = {
        name: _respond_at_rest(state.parts, coupled, probe, moved, inside)
        for name, probe in placed.items()
    }
    return Outcome(
        detail=", ".join(responses),
        answers=(
            ProbeAnswer(
                pose,
                {name: response for name, (response, _) in responses.items()},
                errors={
                    key: error
                    for name, (_, errors) in responses.items()
                    for key, error in zip(probe_keys(pose, name), errors, strict=True)
                },
            ),
        ),
        warnings=tuple(warn_of_singular(name, probe.singular) for name, probe in placed.items()),
    )


def warn_of_singular(name: str, singular: str) -> str:
    """Warn of a probe where stresses are singular; empty elsewhere."""
    if not singular:
        return ""
    return (
        f"probe {name!r} lies in elements at {singular}: the stress there grows with every finer mesh, so it has no ±; "
        "place it some elements away, or round the edge in the part"
    )


def _respond_at_rest(
    parts: MachineParts,
    coupled: CoupledMachine,
    probe: PlacedProbe,
    moved: FloatArray,
    inside: Mapping[str, FloatArray],
) -> tuple[ProbeResponse, tuple[Estimate, ...]]:
    """Return displacement and stress at a probe under all static loads, and the ± of both and of the
    equivalent stress.

    Args:
        moved: ``(n,)`` its static response.
        inside: ``missing_of_loads`` of the machine.
    """
    values = probe.values @ moved + probe.offset
    values = values + np.sum(
        [np.zeros(SEEN), *(load.values for load in probe.loads.values())], axis=0
    )
    at_rest = estimate_at_rest(coupled, probe, moved, inside)
    left_out = name_what_is_left_out(parts)
    changes = {name: change for name, change in at_rest.faces.items() if change.any()}
    errors = tuple(
        combine_estimates([mesh, face, left_out])
        for mesh, face in zip(
            estimate_parts(DISCRETISATION, at_rest.meshes, SEEN),
            estimate_parts(CURVED_FACES, changes, SEEN),
            strict=True,
        )
    )
    meshed, faced = bound_von_mises(values[MOVED:], at_rest)
    mises = {DISCRETISATION: None if np.isnan(meshed) else meshed}
    if changes:
        mises[CURVED_FACES] = faced
    response = ProbeResponse(
        component=probe.component,
        displacement=values[:MOVED],
        stress=values[MOVED:],
        singular=probe.singular,
    )
    return response, (*errors, Estimate(mises, left_out.left_out))


def watched_rows(probes: Mapping[str, PlacedProbe]) -> dict[Channel, FloatArray]:
    """Output rows ``(n,)`` of what a frequency response is asked for at probes; none for what nobody
    knows.
    """
    return {
        (name, f"{kind} {number}"): np.asarray(row)
        for name, probe in probes.items()
        for kind in WATCHED
        for number, row in enumerate(_known_rows(probe, kind))
    }


def estimated_channels(probes: Iterable[str]) -> tuple[Channel, ...]:
    """Channels whose errors are sought: what is seen, and what the modes left out add."""
    return tuple(
        (name, f"{kind} {number}")
        for name in probes
        for kind in ("values", "inertia")
        for number in range(SEEN)
    )


def _known_rows(probe: PlacedProbe, kind: str) -> FloatArray:
    """``(m, n)``; of smoothing those of all places, one below the other."""
    rows: FloatArray | None = getattr(probe, kind)
    count = probe.values.shape[1]
    return np.zeros((0, count)) if rows is None else rows.reshape(-1, count)


def trace_probes(
    parts: MachineParts,
    probes: Mapping[str, PlacedProbe],
    response: FrequencyResponse,
    shares: Mapping[str, FloatArray],
) -> tuple[ProbeCurves, ...]:
    """Displacement and stress at probes over frequency, with their errors.

    Args:
        response: At ``watched_rows``.
        shares: Source of error to the sizes ``(n, 18 p, k)`` by which ``estimated_channels`` may be
            off; empty where none was sought.
    """
    return tuple(
        _trace_probe(
            parts,
            name,
            probe,
            response,
            {
                source: size[:, 2 * SEEN * row : 2 * SEEN * (row + 1)]
                for source, size in shares.items()
            },
        )
        for row, (name, probe) in enumerate(probes.items())
    )


def _trace_probe(
    parts: MachineParts,
    name: str,
    probe: PlacedProbe,
    response: FrequencyResponse,
    shares: Mapping[str, FloatArray],
) -> ProbeCurves:
    """Displacement and stress at a probe.

    The modes that its component leaves out follow the acceleration of the boundary dofs, and the
    loads inside, as at rest. Its material multiplies strains by the complex modulus: the stress is
    that which the loads are in balance with.
    """
    omega = 2.0 * np.pi * response.frequencies_hz[:, None, None]
    lossy, squares = material_factors(parts, probe.component, omega)
    plain = _read(response, name, "values")
    late = squares * _read(response, name, "inertia") + _of_loads(response, probe, "values")
    displacement = plain[:, :MOVED] + late[:, :MOVED] / lossy
    stress = lossy * plain[:, MOVED:] + late[:, MOVED:]
    curves = ProbeCurves(
        name=name,
        component=probe.component,
        inputs=response.inputs,
        frequencies_hz=response.frequencies_hz,
        displacement=displacement,
        stress=stress,
        singular=probe.singular,
    )
    if not shares:
        return curves
    # of each mode left out: what it moves beyond its static share, over that
    reach = omega**2 / probe.limit
    beyond = np.where(reach < 1.0, reach / np.where(reach < 1.0, 1.0 - reach, 1.0), np.nan)
    rest = late * beyond
    both = {
        source: np.abs(lossy) * size[:, :SEEN] + np.abs(squares) * size[:, SEEN:]
        for source, size in shares.items()
    }
    moved = {source: size[:, :MOVED] / np.abs(lossy) for source, size in both.items()}
    sizes = {source: size[:, MOVED:].copy() for source, size in both.items()}
    mises = {source: _proportional_mises(size, stress) for source, size in sizes.items()}
    if probe.missing is None or probe.smoothing is None:
        for source in (moved, sizes, mises):
            source[DISCRETISATION][:] = np.nan
    else:
        missing = _read(response, name, "missing") + _of_loads(response, probe, "missing")
        change = lossy * _read(response, name, "smoothing")
        change += _of_loads(response, probe, "smoothing")
        # lines, places, stresses, inputs
        local = change.reshape(len(change), -1, STRESSED, len(response.inputs))
        places = local.transpose(1, 2, 0, 3)
        own_strain = moved_locally(probe.strain_reach, places) / np.abs(lossy[:, 0])
        inside = probe.mesh_safety * np.abs(missing[:, :MOVED])
        moved[DISCRETISATION] += inside + own_strain[:, None]
        # sizes of changes of lines have no sign, with which energy products inside would cancel
        sizes[DISCRETISATION] += CYCLE_SAFETY * np.linalg.norm(local, axis=1)
        cycle = von_mises_change(stress.swapaxes(1, 2), CYCLE_SAFETY * places.transpose(0, 2, 3, 1))
        mises[DISCRETISATION] += np.linalg.norm(cycle, axis=0)
    moved[REDUCTION] += np.abs(rest[:, :MOVED])
    sizes[REDUCTION] += np.abs(rest[:, MOVED:])
    mises[REDUCTION] += largest_von_mises(rest[:, MOVED:].swapaxes(1, 2))
    if probe.singular:
        sizes[DISCRETISATION][:] = mises[DISCRETISATION][:] = np.nan
    return dataclasses.replace(
        curves,
        displacement_error_share=moved,
        stress_error_share=sizes,
        von_mises_error_share=mises,
    )


def material_factors(
    parts: MachineParts, name: str, omega: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Complex modulus over the modulus, and what the inertia of a component counts [rad^2/s^2], at
    angular frequencies [rad/s].
    """
    if DAMPING not in parts.scene.effects:
        return np.ones_like(omega) + 0j, omega**2 + 0j
    alpha, beta = rayleigh_damping(parts, name)
    loss = parts.plan.components[name].material.loss_factor
    lossy = 1.0 + 1j * (omega > 0.0) * loss + 1j * omega * beta
    return lossy, omega**2 - 1j * omega * alpha


def rayleigh_damping(parts: MachineParts, name: str) -> tuple[float, float]:
    """Coefficients of mass and stiffness [1/s, s] of a component; zero without the effect damping."""
    if DAMPING not in parts.scene.effects:
        return 0.0, 0.0
    machine, component = parts.scene.machine, parts.scene.machine.components[name]
    every, single = machine.rayleigh, component.rayleigh
    return every.alpha + single.alpha, every.beta + single.beta


def _read(response: FrequencyResponse, name: str, kind: str) -> ComplexArray:
    """Response ``(n, m, k)`` at the rows of a kind at a probe."""
    rows = [
        number
        for number, (probe, row) in enumerate(response.outputs)
        if probe == name and row.startswith(f"{kind} ")
    ]
    return response.receptance[:, rows]


def _of_loads(response: FrequencyResponse, probe: PlacedProbe, kind: str) -> FloatArray:
    """``(1, m, k)`` of loads inside the component with its reduced dofs at rest, by input."""
    count, columns = len(_known_rows(probe, kind)), []
    for name, direction in response.inputs:
        load = probe.loads.get(name) if direction == LOAD else None
        rows = None if load is None else getattr(load, kind)
        columns.append(np.zeros(count) if rows is None else rows.ravel())
    return np.column_stack(columns)[None]


def _proportional_mises(sizes: FloatArray, stress: ComplexArray) -> FloatArray:
    """Equivalent stress ``(n, k)`` of changes of given sizes ``(n, 6, k)`` that are in proportion to
    the stress.
    """
    whole = np.abs(stress)
    turned = stress / np.where(whole > 0.0, whole, 1.0)
    return largest_von_mises((sizes * turned).swapaxes(1, 2))
