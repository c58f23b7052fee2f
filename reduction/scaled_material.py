"""A superelement of the same shape in another modulus or density, without another reduction."""

import dataclasses
from collections.abc import Collection
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.requests import GRAVITY
from headstock.reduction.superelement import (
    ErrorEstimates,
    Recovery,
    StaticLoad,
    Superelement,
    Truncation,
)


def scale_material(
    element: Superelement, *, stiffer: float, heavier: float, body_loads: Collection[str] = ()
) -> Superelement:
    """Return what a reduction of the same mesh gives with another modulus or density, at the same
    Poisson's ratio; exact.

    Static shapes do not depend on either. Fixed-interface shapes keep their form and are normalised
    by the new mass; their frequencies change by ``sqrt(stiffer / heavier)``.

    Args:
        element: Of finite elements, without probes, point masses and damping of its own.
        stiffer: Young's modulus over the former one.
        heavier: Density, or mass, over the former one.
        body_loads: Names of loads that are accelerations, unit gravity aside.
    """
    if stiffer == 1.0 and heavier == 1.0:
        return element
    if element.probes or element.damping is not None:
        raise ValueError(f"{element.name} has probes or damping of its own, which are not scaled")
    norm = np.ones(len(element.stiffness))
    norm[element.boundary_size :] = heavier**-0.5

    def scale_load(name: str, load: StaticLoad) -> StaticLoad:
        start = name.partition(":")[0]
        factor = heavier if start == GRAVITY or start in body_loads else 1.0
        particular, missing = load.particular, load.missing
        return StaticLoad(
            vector=factor * norm * load.vector,
            particular=None if particular is None else factor / stiffer * particular,
            missing=None if missing is None else factor * norm * missing,
        )

    faster = float(np.sqrt(stiffer / heavier))
    recovery = element.recovery
    return dataclasses.replace(
        element,
        stiffness=_scale_matrix(element.stiffness, stiffer, norm),
        mass=_scale_matrix(element.mass, heavier, norm),
        recovery=None if recovery is None else Recovery(recovery.basis * norm, recovery.points),
        constraints=element.constraints * norm,
        modal_frequencies_hz=faster * element.modal_frequencies_hz,
        cutoff_hz=faster * element.cutoff_hz,
        mass_kg=heavier * element.mass_kg,
        inertia=heavier * element.inertia,
        loads={name: scale_load(name, load) for name, load in element.loads.items()},
        sensors={
            name: dataclasses.replace(rows, motion=rows.motion * norm)
            for name, rows in element.sensors.items()
        },
        rails={
            name: dataclasses.replace(rail, control=rail.control * norm)
            for name, rail in element.rails.items()
        },
        errors=_scale_errors(element.errors, norm, stiffer, heavier),
    )


def _scale_matrix(values: FloatArray, factor: float, norm: FloatArray) -> FloatArray:
    return factor * norm[:, None] * values * norm


def _scale_errors(
    errors: ErrorEstimates, norm: FloatArray, stiffer: float, heavier: float
) -> ErrorEstimates:
    """Return the estimates with energies that grow with the modulus, masses with the density, and
    participations ``p_k`` of modes left out with the root of the density.
    """
    factors = {
        "missing_energy": stiffer,
        "shape_stiffness": stiffer,
        "left_out_stiffness": stiffer,
        "shape_mass": heavier,
        "left_out_mass": heavier,
    }
    matrices: dict[str, Any] = {
        name: _scale_matrix(values, factor, norm)
        for name, factor in factors.items()
        if (values := getattr(errors, name)) is not None
    }
    truncation = errors.truncation
    if truncation is not None:
        square = stiffer / heavier  # of the frequencies
        truncation = Truncation(
            truncation.first * (heavier / square),
            truncation.second * (heavier / square**2),
            truncation.limit * square,
        )
    return dataclasses.replace(errors, truncation=truncation, **matrices)
