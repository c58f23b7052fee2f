"""Scaling a superelement to another modulus and density gives what reducing it anew gives."""

import dataclasses

import numpy as np
import pytest

from common import make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Load, Patch
from headstock.reduction.scaled_material import scale_material
from headstock.reduction.superelement import Superelement
from reduced_parts import reduce_mesh

SIZE = (0.1, 0.13, 0.4)
LOADS = (
    Load("wind", "body", "traction", (Patch("x-"),), vector=(1.0, 2.0, 3.0)),
    Load("spin", "body", "body", vector=(0.0, 0.0, 1.0)),
)
Factors = tuple[float, float]
Case = tuple[Superelement, Superelement, Factors]


@pytest.fixture(scope="module", params=[(2.0, 0.25), (1.3, 0.8)])
def case(request: pytest.FixtureRequest) -> Case:
    """A part reduced in one material, and in another one."""
    stiffer, heavier = request.param
    mesh = make_box((2, 2, 4), SIZE, {"foot": "z-", "tip": "z+", "load:wind": "x-"})
    first = make_component({"foot": "rigid", "tip": "average"})
    steel = first.material
    other = dataclasses.replace(
        steel,
        youngs_modulus=stiffer * steel.youngs_modulus,
        density=heavier * steel.density,
    )
    made = [
        reduce_mesh(part, mesh, modes=6, gravity=True, loads=LOADS)
        for part in (first, dataclasses.replace(first, material=other))
    ]
    return made[0], made[1], request.param


def gather(element: Superelement, signs: FloatArray) -> dict[str, FloatArray]:
    """Everything that depends on the material, modal dofs with given signs."""
    errors, recovery = element.errors, element.recovery
    assert errors.truncation is not None and errors.missing_energy is not None
    assert recovery is not None
    both = np.outer(signs, signs)
    return {
        "stiffness": element.stiffness * both,
        "mass": element.mass * both,
        "recovery": recovery.basis * signs,
        "frequencies": element.modal_frequencies_hz,
        "cutoff": np.array([element.cutoff_hz]),
        "inertia": element.inertia,
        "mass properties": np.array([element.mass_kg, *element.center_of_mass]),
        "energy": errors.missing_energy * both,
        "first": errors.truncation.first,
        "second": errors.truncation.second,
        "limit": np.array([errors.truncation.limit]),
        **{f"vector {name}": load.vector * signs for name, load in element.loads.items()},
        **{
            f"particular {name}": load.particular
            for name, load in element.loads.items()
            if load.particular is not None
        },
        **{
            f"missing {name}": load.missing * signs
            for name, load in element.loads.items()
            if load.missing is not None
        },
    }


def test_a_scaled_superelement_is_one_reduced_anew(case: Case) -> None:
    first, anew, (stiffer, heavier) = case
    scaled = scale_material(first, stiffer=stiffer, heavier=heavier, body_loads=["spin"])
    assert scaled.recovery is not None and anew.recovery is not None
    # the sign of a mode is free
    signs = np.sign(np.einsum("ij,ij->j", scaled.recovery.basis, anew.recovery.basis))
    ours, theirs = gather(scaled, np.ones(len(signs))), gather(anew, signs)
    assert ours.keys() == theirs.keys() and len(ours) > 20
    for name, value in theirs.items():
        # the smoothing of stresses magnifies rounding
        smoothed = name == "energy" or name.startswith("missing")
        gap = np.abs(ours[name] - value).max() / max(np.abs(value).max(), 1e-300)
        assert gap < (1e-5 if smoothed else 1e-9), name


def test_the_same_material_changes_nothing(case: Case) -> None:
    assert scale_material(case[0], stiffer=1.0, heavier=1.0) is case[0]
