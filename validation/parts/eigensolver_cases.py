"""The eigensolvers on what is hard for them, repeated modes, thin parts and free bodies, against dense
algebra.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

import numpy as np
import scipy.linalg

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import Component, Eigensolver, MeshSettings
from headstock.geometry.parts.solids import Box
from headstock.solvers.mpi import MPI
from headstock.validation.parts.closed_form_cases import STEEL
from headstock.validation.parts.component_models import (
    FullModes,
    full_model,
    full_modes,
    rigid_face_matrices,
    shared_mesh,
)
from headstock.validation.references.rows import ValidationRow, compare_bound

COUNT = 12
THINNEST = 0.05  # conjugate gradients stall on thinner sheets, and say so


@dataclass(frozen=True)
class _Part:
    """A block of hexahedra, fixed at its lower end or free.

    Attributes:
        name: What is hard about it.
        extent: Sides [m].
        size: Of its elements [m].
        fixed: Whether its face z = 0 is fixed.
        allowed: Largest relative error of a frequency; what rounding of its stiffness allows.
    """

    name: str
    extent: tuple[float, float, float]
    size: float
    fixed: bool
    allowed: float


PARTS = (
    _Part("square column, modes in pairs", (0.1, 0.1, 0.4), 0.05, True, 1e-9),
    _Part("sheet 1:100", (0.4, 0.004, 0.4), 0.05, True, 1e-7),
    _Part("free square column", (0.1, 0.1, 0.4), 0.05, False, 1e-8),
)


def check_eigensolvers(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check the lowest twelve frequencies by each eigensolver against those of dense matrices, one
    for one, so that a lost repeated mode shows.
    """
    for part in PARTS:
        component = Component(
            name="part",
            solid=Box(part.extent),
            material=STEEL,
            mesh=MeshSettings(size=part.size, cells="hex"),
        )
        mesh = shared_mesh(component, comm=comm)
        base = mesh.points[:, 2] < 1e-9
        fixed = np.repeat((base & part.fixed)[:, None], 3, axis=1)
        model = full_model(mesh, STEEL, comm=comm, fixed=fixed, with_corners=True)
        matrices = rigid_face_matrices(mesh, STEEL, {})
        exact = _dense_frequencies(
            matrices.stiffness.toarray(), matrices.mass.toarray(), fixed.ravel()
        )
        found: dict[str, FullModes] = {
            eigensolver: full_modes(model, COUNT, eigensolver=eigensolver)
            for eigensolver in get_args(Eigensolver)
        }
        if min(part.extent) > THINNEST * max(part.extent):
            found["multigrid and LOBPCG"] = full_modes(model, COUNT, method="iterative")
        for method, modes in found.items():
            worst = float(np.abs(modes.frequencies_hz[:COUNT] / exact[:COUNT] - 1.0).max())
            quantity = f"{part.name}, {method}: largest error of {COUNT} frequencies"
            note = f"{model.operators.total_nodes * 3} dofs"
            yield compare_bound(quantity, worst, part.allowed, note)


def _dense_frequencies(stiffness: FloatArray, mass: FloatArray, fixed: BoolArray) -> FloatArray:
    """Elastic frequencies [Hz], rising.

    Of a fixed part as ``M x = mu K x``, which is exact where frequencies are low.
    """
    kept = np.ix_(~fixed, ~fixed)
    if fixed.any():
        values = scipy.linalg.eigh(mass[kept], stiffness[kept], eigvals_only=True)[::-1]
        return 1.0 / (2.0 * np.pi * np.sqrt(values))
    values = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[6:]
    return np.sqrt(values) / (2.0 * np.pi)
