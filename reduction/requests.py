"""What a reduction is asked for, and what a superelement that holds more gives to a request for
less.

A superelement of fewer modes is the leading part of one with more: rows and columns fall away, and
what the modes that go had carried returns to the static responses and to the moments of the modes
left out. So both give the same numbers, up to rounding.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Load
from headstock.reduction.superelement import (
    ProbeLoad,
    ProbeRows,
    Recovery,
    StaticLoad,
    Superelement,
    Truncation,
    lowest_participating,
)
from headstock.solvers.elastic.eigenpairs import ModeTarget, cluster_end
from headstock.solvers.errors import ModelError

GRAVITY = "gravity"  # loads of this name are unit accelerations that no load of the scene asked for


@dataclass(frozen=True)
class ReductionRequest:
    """Results that a reduction has to deliver.

    Attributes:
        modes: Fixed-interface modes to keep; None for a static reduction without mass.
        gravity: Keep the response to unit gravity along each component axis.
        recovery: Keep the recovery basis on rank 0.
        errors: Estimate the discretisation error on rank 0; needs the recovery basis.
        attached: There are residual-attachment modes behind the others, which none are taken from.
    """

    modes: ModeTarget | None = None
    gravity: bool = False
    recovery: bool = True
    errors: bool = True
    attached: bool = False


@dataclass(frozen=True)
class ReductionExtent:
    """Content that a superelement with recovery and error estimate holds.

    Attributes:
        modes: Number of fixed-interface modes; None for a static reduction.
        cutoff_hz: They are complete up to here.
        gravity: The response to unit gravity is there.
        verified: The number of modes was counted.
    """

    modes: int | None
    cutoff_hz: float
    mass: bool
    gravity: bool
    verified: bool

    def serves(self, wanted: ReductionRequest, *, mass: bool, verify: bool) -> bool:
        """Return whether everything that a request wants is there.

        Args:
            wanted: Modes and gravity that the new reduction needs.
            mass: It needs the component's mass.
            verify: It needs the number of modes to be counted.
        """
        target = wanted.modes
        if (mass and not self.mass) or (wanted.gravity and not self.gravity):
            return False
        if target is None:
            return True
        if self.modes is None or (verify and not self.verified):
            return False
        enough = target.count is not None and target.count <= self.modes
        return (
            enough
            or np.isinf(self.cutoff_hz)
            or (target.up_to_hz is not None and target.up_to_hz < self.cutoff_hz)
        )


def mode_target(component: Component) -> ModeTarget:
    """Return the mode target of a component's own reduction settings.

    Raises:
        ModelError: The component leaves the choice open.
    """
    settings = component.reduction
    if settings.modes is not None or settings.modes_to_hz is not None:
        return ModeTarget(settings.modes, settings.modes_to_hz)
    raise ModelError(
        f"component {component.name}: no number of fixed-interface modes was chosen; set reduction.modes or reduction.modes_to"
    )


def needs_mass(component: Component, loads: Sequence[Load], request: ReductionRequest) -> bool:
    """Return whether a reduction assembles the component's mass.

    A body without interfaces has it even then: the means of the motions that its supports leave
    free are weighed by it.

    Args:
        request: Modes and gravity wanted.
    """
    return (
        not component.interfaces
        or request.modes is not None
        or request.gravity
        or any(load.kind == "body" for load in loads)
    )


def trim_superelement(
    element: Superelement, request: ReductionRequest, *, mass: bool
) -> Superelement:
    """Return what reducing for a request would have given, from a superelement that serves it.

    Args:
        element: Of a component's own reduction; see ``ReductionExtent.serves``.

    Source: Craig and Bampton (1968): the fixed-interface modes of a basis do not depend on each
    other.
    """
    count, cutoff = element.modal_count, element.cutoff_hz
    if not request.attached:
        count, cutoff = _kept_modes(element, request.modes)
    kept = element.boundary_size + count
    errors = element.errors
    loads = {
        name: load
        for name, load in element.loads.items()
        if request.gravity or not name.startswith(f"{GRAVITY}:")
    }
    trimmed = dataclasses.replace(
        element,
        labels=element.labels[:kept],
        stiffness=element.stiffness[:kept, :kept],
        mass=element.mass[:kept, :kept],
        recovery=None
        if element.recovery is None
        else Recovery(
            basis=np.ascontiguousarray(element.recovery.basis[:, :kept]),
            points=element.recovery.points,
        ),
        constraints=element.constraints[:, :kept],
        modal_frequencies_hz=element.modal_frequencies_hz[:count],
        cutoff_hz=cutoff,
        loads={name: _trim_load(element, load, kept) for name, load in loads.items()},
        probes={name: _trim_probe(element, probe, kept) for name, probe in element.probes.items()},
        sensors={
            name: dataclasses.replace(rows, motion=rows.motion[:, :kept])
            for name, rows in element.sensors.items()
        },
        rails={
            name: dataclasses.replace(rail, control=rail.control[:, :kept])
            for name, rail in element.rails.items()
        },
        errors=dataclasses.replace(
            errors,
            truncation=None if request.modes is None else _add_to_truncation(element, kept, cutoff),
            missing_energy=None
            if errors.missing_energy is None
            else errors.missing_energy[:kept, :kept],
            shape_stiffness=None
            if errors.shape_stiffness is None
            else errors.shape_stiffness[:kept, :kept],
            shape_mass=None if errors.shape_mass is None else errors.shape_mass[:kept, :kept],
            left_out_stiffness=None
            if errors.left_out_stiffness is None
            else errors.left_out_stiffness[:kept, :kept],
            left_out_mass=None
            if errors.left_out_mass is None
            else errors.left_out_mass[:kept, :kept],
        ),
    )
    if mass:
        return trimmed
    nothing = np.zeros_like(trimmed.mass)
    return dataclasses.replace(
        trimmed, mass=nothing, mass_kg=0.0, center_of_mass=np.zeros(3), inertia=np.zeros((3, 3))
    )


def _kept_modes(element: Superelement, target: ModeTarget | None) -> tuple[int, float]:
    """Return the number of modes that a search for a target would have kept, and the first
    frequency it would have left out [Hz].
    """
    frequencies = element.modal_frequencies_hz
    if not len(frequencies) or target is None or target.count == 0:
        return 0, 0.0 if len(frequencies) else element.cutoff_hz
    count = cluster_end(frequencies, min(target.count_wanted(frequencies), len(frequencies)))
    return count, float(frequencies[count]) if count < len(frequencies) else element.cutoff_hz


def _trim_load(element: Superelement, load: StaticLoad, kept: int) -> StaticLoad:
    """Return a load on the leading dofs; the static response of the modes that go is no longer in
    the reduced model.
    """
    missing = None if load.missing is None else load.missing[:kept]
    if load.particular is None or element.recovery is None:
        return StaticLoad(load.vector[:kept], load.particular, missing)
    amplitudes = _resting_amplitudes(element, load.vector, kept)
    returned = element.recovery.basis[:, kept:] @ amplitudes
    if missing is not None and element.errors.missing_energy is not None:
        missing = missing + element.errors.missing_energy[:kept, kept:] @ amplitudes
    return StaticLoad(
        load.vector[:kept], load.particular + returned.reshape(load.particular.shape), missing
    )


def _resting_amplitudes(element: Superelement, loads: FloatArray, kept: int) -> FloatArray:
    """Return static amplitudes ``(n - kept, ...)`` of modes that go under loads ``(n, ...)``."""
    return (loads[kept:].T / element.stiffness.diagonal()[kept:]).T


def _trim_probe(element: Superelement, probe: ProbeRows, kept: int) -> ProbeRows:
    """Return what is seen with the leading dofs; the modes that go return to the static responses,
    both to loads and of the probe.
    """
    energy = element.errors.missing_energy
    amplitudes = _resting_amplitudes(element, probe.values.T, kept)
    missing = None
    if probe.missing is not None and energy is not None:
        missing = probe.missing[:, :kept] + amplitudes.T @ energy[kept:, :kept]
    return ProbeRows(
        values=probe.values[:, :kept],
        inertia=probe.inertia + amplitudes.T @ element.mass[kept:, : element.boundary_size],
        smoothing=None if probe.smoothing is None else probe.smoothing[..., :kept],
        missing=missing,
        loads={
            name: _trim_probe_load(element, probe, load, element.loads[name], kept)
            for name, load in probe.loads.items()
        },
        strain_reach=probe.strain_reach,
        singular=probe.singular,
    )


def _trim_probe_load(
    element: Superelement, probe: ProbeRows, seen: ProbeLoad, load: StaticLoad, kept: int
) -> ProbeLoad:
    amplitudes = _resting_amplitudes(element, load.vector, kept)
    resting = _resting_amplitudes(element, probe.values.T, kept)
    energy = element.errors.missing_energy
    smoothing, missing = seen.smoothing, None
    if smoothing is not None and probe.smoothing is not None:
        smoothing = smoothing + probe.smoothing[..., kept:] @ amplitudes
    if (
        seen.missing is not None
        and probe.missing is not None
        and load.missing is not None
        and energy is not None
    ):
        # both errors gain that of the modes that go
        missing = (
            seen.missing
            + probe.missing[:, kept:] @ amplitudes
            + resting.T @ (load.missing[kept:] + energy[kept:, kept:] @ amplitudes)
        )
    return ProbeLoad(seen.values + probe.values[:, kept:] @ amplitudes, smoothing, missing)


def _add_to_truncation(element: Superelement, kept: int, cutoff_hz: float) -> Truncation | None:
    """Return the moments of the modes that were left out and of those that go."""
    before = element.errors.truncation
    if before is None:
        return None
    participation: FloatArray = element.mass[: element.boundary_size, kept:]
    eigenvalues = element.stiffness.diagonal()[kept:]
    first = before.first + participation / eigenvalues @ participation.T
    second = before.second + participation / eigenvalues**2 @ participation.T
    limit = (
        (2.0 * np.pi * cutoff_hz) ** 2 if cutoff_hz > 0.0 else lowest_participating(first, second)
    )
    return Truncation(first, second, limit)
