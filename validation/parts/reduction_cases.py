"""Craig-Bampton superelements of the column of Kono et al. against the whole model."""

from collections.abc import Iterator

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.mpi import MPI
from headstock.validation.parts.closed_form_cases import (
    COLUMN_SIZE,
    STEEL,
    column,
    face_interface,
    mesh_settings,
)
from headstock.validation.parts.component_models import (
    all_frequencies,
    fixed_compliance,
    full_model,
    full_modes,
    guyan_matrices,
    lowest_frequencies,
    rigid_face_matrices,
    shared_mesh,
)
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
)

COUPLINGS = ("rigid", "average")
RIGID = 6
WATCHED = 10
COARSE, FINE = 0.05, 0.025
MODE_COUNTS = (0, 5, 20)
EVERY_MODE = 1_000_000
MOST_MODES = 240
RANGE_TOLERANCE = {2: 1.5e-2, 3: 6e-3}
FROM_ABOVE = 1e-7
SHARP = 1e-3


def check_all_modes(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """With every fixed-interface mode kept the superelement has the frequencies of the whole model;
    with none it is Guyan's.
    """
    for coupling in COUPLINGS:
        component, mesh = _column(coupling, COARSE, comm)
        element = _reduce(component, mesh, EVERY_MODE, comm)
        found = _frequencies(element.stiffness, element.mass)
        centers = {"foot": element.frames[0].origin, "head": element.frames[1].origin}
        matrices = rigid_face_matrices(mesh, STEEL, centers if coupling == "rigid" else {})
        whole = all_frequencies(matrices)
        yield compare_bound(
            f"{coupling}: dofs more or fewer than the whole model", len(found) - len(whole), 0.0
        )
        if len(found) == len(whole):
            worst = float(np.abs(found[RIGID:] / whole[RIGID:] - 1.0).max())
            yield compare_bound(
                f"{coupling}: largest error of {len(whole) - RIGID} frequencies", worst, 1e-9
            )
        if coupling == "rigid":
            condensed = _reduce(component, mesh, 0, comm)
            names = ("stiffness", "mass")
            for name, left, right in zip(
                names, (condensed.stiffness, condensed.mass), guyan_matrices(matrices), strict=True
            ):
                yield compare_bound(
                    f"no modes: {name} against Guyan's",
                    np.abs(left - right).max() / np.abs(right).max(),
                    1e-10,
                )


def check_static_exactness(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check that interface loads give the whole model's response, whatever the number of modes."""
    component, mesh = _column("rigid", FINE, comm)
    exact: FloatArray = np.zeros((6, 6))
    for count in MODE_COUNTS:
        element = _reduce(component, mesh, count, comm)
        if not exact.any():
            centers = {
                name: element.frames[element.interface_maps[name].node].origin
                for name in ("foot", "head")
            }
            exact = fixed_compliance(rigid_face_matrices(mesh, STEEL, centers))
        found = np.linalg.inv(element.stiffness[6:, 6:])[:6, :6]
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        worst = float(np.abs((found - exact) / scale).max())
        yield compare_bound(
            f"{element.modal_count} modes: compliance of the head, foot fixed", worst, 1e-8
        )


def check_mode_truncation(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check the first ten elastic frequencies of the free column with rigid faces, by how far up
    fixed-interface modes are kept.
    """
    component, mesh = _column("rigid", FINE, comm)
    element = _reduce(component, mesh, MOST_MODES, comm)
    centers = {
        name: element.frames[element.interface_maps[name].node].origin for name in ("foot", "head")
    }
    whole = lowest_frequencies(rigid_face_matrices(mesh, STEEL, centers), RIGID + WATCHED)[RIGID:]
    # fewer than four modes leave fewer than ten elastic frequencies: an endless error
    errors = np.full((element.modal_count + 1, WATCHED), np.inf)
    for count in range(WATCHED - RIGID, element.modal_count + 1):
        size = element.boundary_size + count
        left = _frequencies(element.stiffness[:size, :size], element.mass[:size, :size])
        errors[count] = left[RIGID : RIGID + WATCHED] / whole - 1.0
    yield show("frequency of the tenth elastic mode", whole[-1], "Hz")
    for factor, allowed in RANGE_TOLERANCE.items():
        count = int(np.searchsorted(element.modal_frequencies_hz, factor * whole[-1], side="right"))
        quantity = f"modes up to {factor} x the range ({count}): largest error of ten frequencies"
        yield compare_bound(quantity, errors[count].max(), allowed)
    yield compare_bound(
        "deepest fall below the whole model",
        min(float(errors.min()), 0.0),
        FROM_ABOVE,
        "frequencies come from above",
    )
    rise = max(float(np.diff(errors[WATCHED - RIGID :], axis=0).max()), 0.0)
    yield compare_bound(
        "largest rise of a frequency when a mode is added",
        rise,
        FROM_ABOVE,
        "monotone in the number of modes",
    )
    yield from _sharp_rows(errors, element, float(whole[-1]))


def check_rigid_body_content(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Rigid-body frequencies, mass, centre of mass and inertia of the superelement."""
    mass = STEEL.density * float(np.prod(COLUMN_SIZE))
    x, y, z = COLUMN_SIZE
    inertia = mass / 12.0 * np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    for coupling in COUPLINGS:
        component, mesh = _column(coupling, FINE, comm)
        element = _reduce(component, mesh, 20, comm)
        found = _frequencies(element.stiffness, element.mass)
        yield compare_bound(
            f"{coupling}: largest rigid-body frequency over the first elastic one",
            found[RIGID - 1] / found[RIGID],
            1e-5,
        )
        motions = rigid_motions(element, np.array([0.0, 0.0, z / 2.0]))
        content = motions.T @ element.mass @ motions
        yield compare_value(
            f"{coupling}: mass", content[0, 0], Target(mass, "kg", 1e-9, "closed form")
        )
        offset = float(np.abs(content[:3, 3:]).max() / (mass * z))
        yield compare_bound(
            f"{coupling}: offset of the centre of mass over the length", offset, 1e-9
        )
        for axis, value, right in zip("xyz", np.diag(content)[3:], inertia, strict=True):
            yield compare_value(
                f"{coupling}: inertia about {axis}",
                value,
                Target(float(right), "kg m^2", 1e-9, "closed form"),
            )
        strain = float(
            np.linalg.norm(element.stiffness @ motions)
            / (np.linalg.norm(element.stiffness) * np.linalg.norm(motions))
        )
        yield compare_bound(f"{coupling}: forces caused by rigid motions", strain, 1e-9)


def check_mean_truncation(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check the free column with averaging interfaces, which stiffen nothing, against its whole."""
    component, mesh = _column("average", FINE, comm)
    element = _reduce(component, mesh, MOST_MODES // 2, comm)
    found = _frequencies(element.stiffness, element.mass)[RIGID : RIGID + WATCHED]
    whole = full_modes(full_model(mesh, STEEL, comm=comm), WATCHED).frequencies_hz[:WATCHED]
    worst = float((found / whole - 1.0).max())
    yield compare_bound(
        f"{element.modal_count} modes: largest error of ten frequencies", worst, SHARP
    )
    lowest = min(float((found / whole - 1.0).min()), 0.0)
    yield compare_bound(
        "deepest fall below the whole model", lowest, FROM_ABOVE, "frequencies come from above"
    )


def _sharp_rows(errors: FloatArray, element: Superelement, top_hz: float) -> list[ValidationRow]:
    sharp = np.flatnonzero(errors.max(axis=1) <= SHARP)
    if not len(sharp):
        return [show("modes needed for 0.1 %", np.nan, "-", f"more than {element.modal_count}")]
    count = int(sharp[0])
    reach = float(element.modal_frequencies_hz[count - 1]) / top_hz
    return [
        show(
            "modes needed for 0.1 % of ten frequencies",
            count,
            "-",
            f"they reach {reach:.1f} x the range",
        )
    ]


def _column(coupling: str, size: float, comm: MPI.Comm) -> tuple[Component, ComponentMesh]:
    interfaces = {
        name: face_interface(name, face, coupling)
        for name, face in (("foot", "z-"), ("head", "z+"))
    }
    component = column(mesh_settings("hex27", size), interfaces)
    return component, shared_mesh(component, comm=comm)


def _reduce(component: Component, mesh: ComponentMesh, count: int, comm: MPI.Comm) -> Superelement:
    request = ReductionRequest(modes=ModeTarget(count=count), recovery=False)
    return reduce_elastic(component, mesh, comm=comm, request=request)


def _frequencies(stiffness: FloatArray, mass: FloatArray) -> FloatArray:
    return np.sqrt(np.abs(scipy.linalg.eigh(stiffness, mass, eigvals_only=True))) / (2.0 * np.pi)
