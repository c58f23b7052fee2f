"""Cases that measure how fast errors fall on smooth problems."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind
from headstock.solvers.mpi import MPI
from headstock.validation.parts.closed_form_cases import ROD, STEEL
from headstock.validation.parts.component_models import (
    FullModel,
    FullModes,
    full_displacement,
    full_model,
    full_modes,
)
from headstock.validation.parts.structured_meshes import field_error, lattice_mesh, straight_lattice
from headstock.validation.references.beam_theory import axial_frequencies
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_order,
    compare_value,
    compare_values,
    named_after,
    reference_case,
)

KINDS: tuple[CellKind, ...] = ("tet4", "hex8", "tet10", "hex27")
SECOND_ORDER_KINDS: tuple[CellKind, ...] = ("tet10", "hex27")
ORDER = {"tet4": 1, "hex8": 1, "tet10": 2, "hex27": 2}
ROD_ELEMENTS = (8, 16, 32)
ROD_MODES = 24
CUBE_ELEMENTS = (4, 8, 12)
CUBE_TOLERANCE = {1: 6e-2, 2: 1e-3}
DIRECTIONS = np.array([1.0, -2.0, 0.5])


def check_rod_orders(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Axial frequencies of the rod with nu = 0: of order 2 p, as the solution is smooth.

    Sideways motion is fixed, which with nu = 0 takes nothing from an axial mode but sorts out
    bending and torsion.
    """
    exact = axial_frequencies(ROD, "clamped-free", 3)[2]
    for kind in KINDS:
        errors = [
            _rod_frequencies(kind, count, comm, sideways="fixed")[2] / exact - 1.0
            for count in ROD_ELEMENTS
        ]
        quantity = f"{kind} axial f3, {ROD_ELEMENTS[-2]} to {ROD_ELEMENTS[-1]} elements"
        yield compare_order(quantity, errors, 2.0 * ORDER[kind])


def check_rod_frequencies(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Axial frequencies of the rod whose end face is fixed along the axis only, among its bending
    and torsional ones.
    """
    for kind in SECOND_ORDER_KINDS:
        found = _rod_frequencies(kind, ROD_ELEMENTS[-1], comm, sideways="free")
        yield from named_after(kind, compare_values(reference_case("rod"), found))


def check_displacement_orders(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Displacement under a manufactured body force in a clamped cube: of order p + 1 in the mean
    square.
    """
    for kind in KINDS:
        errors = [_cube_error(kind, count, comm) for count in CUBE_ELEMENTS]
        finer = CUBE_ELEMENTS[-1] / CUBE_ELEMENTS[-2]
        quantity = f"{kind} displacement, {CUBE_ELEMENTS[-2]} to {CUBE_ELEMENTS[-1]} elements"
        yield compare_order(quantity, errors, ORDER[kind] + 1.0, finer=finer)
        bound = Target(0.0, "-", CUBE_TOLERANCE[ORDER[kind]], "closed form")
        yield compare_value(
            f"{kind} relative error, {CUBE_ELEMENTS[-1]} elements", errors[-1], bound
        )


def _rod_frequencies(
    kind: CellKind, elements: int, comm: MPI.Comm, *, sideways: Literal["free", "fixed"]
) -> FloatArray:
    """Return the first three axial frequencies ``(3,)`` [Hz] of the rod, distinguished from bending
    and torsion by their shapes.

    Args:
        elements: Along the rod; one across.
        sideways: Whether nodes may move across the rod.
    """
    mesh = lattice_mesh(
        straight_lattice((elements, 1, 1), (ROD.length, ROD.width, ROD.depth)), kind, straight=True
    )
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[mesh.points[:, 0] < 1e-9, 0] = True
    fixed[:, 1:] = sideways == "fixed"
    model = full_model(mesh, ROD.material, comm=comm, fixed=fixed)
    modes = full_modes(model, ROD_MODES)
    return np.array(
        [modes.frequencies_hz[_closest_shape(model, modes, number)] for number in (1, 2, 3)]
    )


def _cube_error(kind: CellKind, elements: int, comm: MPI.Comm) -> float:
    """Relative mean-square error [-] of the displacement in a clamped unit cube under a
    manufactured body force.
    """
    mesh = lattice_mesh(straight_lattice((elements,) * 3, (1.0, 1.0, 1.0)), kind, straight=True)
    fixed = np.any((mesh.points < 1e-9) | (mesh.points > 1.0 - 1e-9), axis=1)
    material = Material("cube", STEEL.youngs_modulus, STEEL.poisson_ratio, 1.0)
    model = full_model(mesh, material, comm=comm, fixed=np.repeat(fixed[:, None], 3, axis=1))
    # with unit density the mass matrix turns nodal forces per volume into consistent loads
    forces = model.owned(_cube_force(mesh.points, material)[:, :, None])
    loads = model.everywhere(model.operators.apply_mass(forces))[:, :, 0]
    return field_error(
        mesh.points, mesh.cells, kind, full_displacement(model, loads), _cube_displacement
    )


def _closest_shape(model: FullModel, modes: FullModes, number: int) -> int:
    wave = np.zeros((len(model.mesh.points), 3, 1))
    wave[:, 0, 0] = np.sin((number - 0.5) * np.pi * model.mesh.points[:, 0] / ROD.length)
    images = model.operators.apply_mass(model.owned(wave))
    return int(np.argmax(np.abs(model.operators.comm.allreduce(modes.shapes.T @ images)[:, 0])))


def _cube_displacement(places: FloatArray) -> FloatArray:
    return np.prod(np.sin(np.pi * places), axis=1)[:, None] * DIRECTIONS


def _cube_force(places: FloatArray, material: Material) -> FloatArray:
    """Body force ``(n, 3)`` [N/m^3] that belongs to the displacement: ``-(lambda + mu) grad div u -
    mu lap u``.
    """
    young, poisson = material.youngs_modulus, material.poisson_ratio
    shear = young / (2.0 * (1.0 + poisson))
    lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    sines, cosines = np.sin(np.pi * places), np.cos(np.pi * places)
    gradient = -_cube_displacement(places)
    for i in range(3):
        for j in set(range(3)) - {i}:
            gradient[:, j] += DIRECTIONS[i] * cosines[:, i] * cosines[:, j] * sines[:, 3 - i - j]
    return np.pi**2 * (3.0 * shear * _cube_displacement(places) - (lame + shear) * gradient)
