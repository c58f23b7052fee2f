"""a part a thousand times longer than thick: right with second-order elements, refused with
first-order ones.
"""

import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from common import STEEL, approx, make_box, make_component
from headstock.geometry.parts.components import Material, Patch, Support
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.validation.parts.component_models import (
    FullModel,
    full_displacement,
    full_model,
    full_modes,
)
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H08")

COMM = MPI.COMM_SELF
LENGTH, WIDTH, THICKNESS = 1.0, 0.02, 1e-3
ELEMENTS = (40, 1, 1)
CLAMP = (Support("clamp", "body", (Patch("x-"),), ("x", "y", "z")),)


def reduce_tip(
    mesh: ComponentMesh, *, clamped: bool = True, allow_locking: bool = False
) -> Superelement:
    component = make_component({"tip": "rigid"})
    settings = dataclasses.replace(component.mesh, allow_locking=allow_locking)
    component = dataclasses.replace(component, mesh=settings)
    supports = CLAMP if clamped else ()
    return reduce_mesh(component, mesh, supports)


def strip(kind: CellKind, poisson: float = 0.0) -> tuple[ComponentMesh, Material, FullModel]:
    """A strip clamped at x = 0; with nu = 0 beam theory is the exact answer."""
    material = dataclasses.replace(STEEL, poisson_ratio=poisson)
    mesh = make_box(
        ELEMENTS, (LENGTH, WIDTH, THICKNESS), {"support:clamp": "x-", "tip": "x+"}, kind=kind
    )
    fixed = np.repeat((mesh.points[:, 0] < 1e-12)[:, None], 3, axis=1)
    return mesh, material, full_model(mesh, material, comm=COMM, fixed=fixed)


def bending_frequency(material: Material, number: int) -> float:
    roots = (1.8751040687, 4.6940911330, 7.8547574382)
    radius = THICKNESS / np.sqrt(12.0)
    return float(
        roots[number] ** 2
        / (2.0 * np.pi * LENGTH**2)
        * radius
        * np.sqrt(material.youngs_modulus / material.density)
    )


@pytest.mark.parametrize("kind", ["tet10", "hex27"])
def test_second_order_elements_do_not_lock(kind: CellKind) -> None:
    mesh, material, model = strip(kind)
    first = full_modes(model, 3).frequencies_hz[0]
    assert first == approx(bending_frequency(material, 0), rel=0.03)
    loads = np.zeros((len(mesh.points), 3))
    tip = np.flatnonzero(mesh.points[:, 0] > LENGTH - 1e-12)
    loads[tip, 2] = 1.0 / len(tip)
    deflection = full_displacement(model, loads)[tip, 2].mean()
    exact = LENGTH**3 / (3.0 * material.youngs_modulus * WIDTH * THICKNESS**3 / 12.0)
    assert deflection == approx(exact, rel=0.03)


@pytest.mark.parametrize("kind", ["tet4", "hex8"])
def test_first_order_elements_lock_and_are_refused_by_order_and_aspect_ratio(
    kind: CellKind,
) -> None:
    mesh, material, model = strip(kind)
    assert full_modes(model, 1).frequencies_hz[0] > 5.0 * bending_frequency(material, 0)
    with pytest.raises(ModelError, match=r"body.*order 1.*\d\d times.*0.001 times.*order = 2"):
        reduce_tip(mesh)


def test_a_scene_may_insist_on_elements_that_lock_and_is_told_what_they_do() -> None:
    mesh, _, _ = strip("hex8")
    element = reduce_tip(mesh, allow_locking=True)
    assert any("many times too stiff" in warning for warning in element.warnings)


@pytest.mark.parametrize("kind", ["tet4", "hex8"])
def test_a_thin_part_of_well_shaped_first_order_elements_is_refused_too(kind: CellKind) -> None:
    mesh = make_box(
        (150, 2, 1), (0.15, 0.002, 0.001), {"support:clamp": "x-", "tip": "x+"}, kind=kind
    )
    with pytest.raises(ModelError, match="order 1"):
        reduce_tip(mesh)


@pytest.mark.parametrize("kind", ["tet4", "hex8"])
def test_compact_first_order_elements_nobody_asked_for_are_spoken_of(kind: CellKind) -> None:
    mesh = make_box((4, 2, 2), (0.4, 0.2, 0.2), {"support:clamp": "x-", "tip": "x+"}, kind=kind)
    warnings = reduce_tip(mesh).warnings
    assert any("order 1" in warning and "lock" in warning for warning in warnings)


@pytest.mark.parametrize("kind", ["tet10", "hex27"])
def test_second_order_elements_need_no_warning_of_locking(kind: CellKind) -> None:
    mesh = make_box((4, 1, 1), (0.4, 0.1, 0.1), {"tip": "x+"}, kind=kind)
    found = reduce_tip(mesh, clamped=False).warnings
    assert [warning for warning in found if "lock" in warning or "order" in warning] == []


@pytest.mark.parametrize(
    "thickness", [0.1, 0.02, 1e-3, 5e-4], ids=["1:10", "1:50", "1:1000", "1:2000"]
)
@pytest.mark.parametrize(
    "ends", [("rigid", "average"), ("rigid", "rigid"), ("average", "average")], ids="-".join
)
def test_mass_and_rigid_motions_of_a_sheet_are_as_good_as_those_of_a_block(
    thickness: float, ends: tuple[str, str]
) -> None:
    mesh = make_box((20, 4, 1), (1.0, 0.2, thickness), {"foot": "x-", "tip": "x+"})
    component = make_component(dict(zip(("foot", "tip"), ends, strict=True)))
    request = ReductionRequest(modes=ModeTarget(count=4), errors=False)
    element = reduce_elastic(component, mesh, comm=COMM, request=request)
    check_superelement(element)
    first = np.eye(len(element.mass))[0]
    grounded = element.stiffness + 1e-6 * np.abs(element.stiffness).max() * np.outer(first, first)
    broken = {
        "its mass is off": {"mass_kg": element.mass_kg * (1.0 + 1e-12)},
        "rigid motion": {"stiffness": grounded},
    }
    for text, change in broken.items():
        with pytest.raises(AccuracyError, match=text):
            check_superelement(dataclasses.replace(element, **change))


@pytest.mark.parametrize("kind", ["tet10", "hex27"])
def test_the_tip_of_a_thin_strip_between_two_interfaces_gives_way_as_beam_theory_says(
    kind: CellKind,
) -> None:
    mesh = make_box((60, 2, 1), (LENGTH, WIDTH, THICKNESS), {"foot": "x-", "tip": "x+"}, kind=kind)
    material = dataclasses.replace(STEEL, poisson_ratio=0.0)
    element = reduce_mesh(
        make_component({"foot": "rigid", "tip": "rigid"}, material=material), mesh
    )
    tip = slice(6 * element.interface_maps["tip"].node, 6 * element.interface_maps["tip"].node + 6)
    compliance = np.linalg.inv(element.stiffness[tip, tip])
    inertia = WIDTH * THICKNESS**3 / 12.0
    young = material.youngs_modulus
    assert compliance[2, 2] == approx(LENGTH**3 / (3.0 * young * inertia), rel=0.01)
    assert compliance[4, 4] == approx(LENGTH / (young * inertia), rel=0.01)
    assert compliance[0, 0] == approx(LENGTH / (young * WIDTH * THICKNESS), rel=1e-6)
