"""Curved faces that elements cut short are in the error of a part, and interfaces whose kind
matters are named with a size.
"""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from common import STEEL, approx, make_box, make_component, make_faced, present
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Material, MeshSettings
from headstock.geometry.parts.solids import StepFile, Tube
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.surface import extract_surface
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.estimates.mesh_errors import (
    compliance_mesh_errors,
    compliance_shape_errors,
    frequency_mesh_errors,
    frequency_shape_errors,
    meshed_parts,
)
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.recovery.discretisation_error import (
    SAFETY,
    SINGLE_SAFETY,
    detects_errors,
    mesh_safety,
)
from lumped_machines import couple_clamped
from reduced_parts import reduce_mesh

OUTER, INNER, LENGTH = 0.1, 0.06, 0.2
LIMP = Material("limp", 200e9, 0.0, 7800.0)  # no lateral contraction: the closed form is exact
RADIUS = 0.5
FACES = {"foot": "average z-", "tip": "average z+"}


@pytest.fixture(scope="module")
def tube() -> tuple[ComponentMesh, CoupledMachine]:
    """A tube whose round faces are meshed with chords, pulled at its tip."""
    chords = MeshSettings(size=0.02, order=1, allow_locking=True)
    part = make_faced("tube", Tube(OUTER, INNER, LENGTH), FACES, material=LIMP, mesh=chords)
    mesh = mesh_component(part)
    element = reduce_mesh(part, mesh, modes=12)
    return mesh, couple_clamped(part, element)


def test_gaps_between_facets_and_faces_add_up_to_the_volume_that_the_mesh_misses(
    tube: tuple[ComponentMesh, CoupledMachine],
) -> None:
    mesh, _ = tube
    missing = mesh.quality.cad_volume - mesh.quality.volume
    assert missing > 1e-3 * mesh.quality.cad_volume
    assert present(mesh.gaps).volumes.sum() == approx(missing, rel=0.02)


def test_an_axial_compliance_is_off_by_the_area_that_chords_cut_away(
    tube: tuple[ComponentMesh, CoupledMachine],
) -> None:
    _, coupled = tube
    budget = point_budget(coupled, "tcp")
    exact = LENGTH / (LIMP.youngs_modulus * np.pi * (OUTER**2 - INNER**2) / 4.0)
    error = budget.compliance[2, 2] - exact
    shape = compliance_shape_errors(coupled, budget.displacements)["tube"][2]
    # uniform tension is in every element: what its mesh misses is nothing beside what the faces
    # change
    assert compliance_mesh_errors(coupled, budget.displacements)["tube"][2, 2] < 0.05 * error
    assert error <= shape <= 2.0 * error


def test_a_part_without_gaps_has_no_error_of_its_faces(
    tube: tuple[ComponentMesh, CoupledMachine],
) -> None:
    _, coupled = tube
    element = coupled.layout.superelements["tube"]
    errors = element.errors
    bare = dataclasses.replace(
        element,
        errors=dataclasses.replace(
            errors,
            shape_stiffness=0.0 * present(errors.shape_stiffness),
            shape_mass=0.0 * present(errors.shape_mass),
        ),
    )
    plain = dataclasses.replace(
        coupled, layout=dataclasses.replace(coupled.layout, superelements={"tube": bare})
    )
    modes = solve_modal(plain.system, count=4)
    assert frequency_shape_errors(coupled, modes)["tube"].min() > 0.0
    assert frequency_shape_errors(plain, modes) == {}


def test_a_bar_of_single_thick_elements_says_that_nothing_is_known() -> None:
    size = (0.08, 0.08, 0.4)
    component = make_component({"foot": "rigid", "tip": "average"}, size=size)
    single, double = (
        make_box(counts, size, {"foot": "z-", "tip": "z+"}, kind="hex27")
        for counts in ((1, 1, 5), (2, 2, 10))
    )
    assert not detects_errors(single)
    assert detects_errors(double)
    sheet = make_box((4, 6, 1), (0.3, 0.4, 0.01), {}, kind="hex27")
    assert detects_errors(sheet)
    # who fills a wall alone needs more to cover what it does not see
    factors = [
        mesh_safety(mesh, extract_surface(mesh.cells, mesh.kind)) for mesh in (double, sheet)
    ]
    assert factors == [SAFETY["hex", 2], SINGLE_SAFETY] and factors[0] < factors[1]
    element = reduce_mesh(component, single, modes=6)
    assert "single elements" in " ".join(element.warnings)
    coupled = couple_clamped(component, element)
    assert meshed_parts(coupled)["body"].reach_hz == 0.0
    assert np.isnan(
        compliance_mesh_errors(coupled, point_budget(coupled, "tcp").displacements)["body"]
    ).any()


@pytest.mark.parametrize("kept", [8, 10])
def test_modes_of_a_ball_above_two_thirds_of_the_cut_off_are_covered_or_unknown(
    tmp_path: Path, kept: int
) -> None:
    sizes = {"radius": 1e3 * RADIUS, "height": 2.2e3 * RADIUS}
    subprocess.run(
        [
            sys.executable,
            "-m",
            "headstock.validation.coverage.curved_samples",
            "ball",
            json.dumps(sizes),
            str(tmp_path / "ball.step"),
        ],
        check=True,
        capture_output=True,
    )
    settings = {"mesh": MeshSettings(size=0.5 * RADIUS), "free": True}
    skin = {"skin": "average face:1"}
    part = make_faced("ball", StepFile(tmp_path / "ball.step"), skin, **settings)
    element = reduce_mesh(part, mesh_component(part), modes=kept)
    coupled = couple({"ball": element}, Machine("ball", {"ball": part}), Pose("reference"))
    modes = solve_modal(coupled.system, count=11)
    assert modes.rigid_count == 6
    twisting = modes.frequencies_hz[6:11]
    # the five lowest modes twist the ball: tan(eta) = eta (12 - eta^2) / (12 - 5 eta^2), whatever
    # Poisson's ratio (Lamb 1881)
    shear_speed = np.sqrt(
        STEEL.youngs_modulus / (2.0 * (1.0 + STEEL.poisson_ratio)) / STEEL.density
    )
    true = twisting - 2.50113262 * shear_speed / (2.0 * np.pi * RADIUS)
    assert (twisting > 2.0 / 3.0 * element.cutoff_hz).all()
    assert (np.abs(true) > 0.1).all()
    bounds = bound_frequency_errors(coupled.system, truncated_parts(coupled), modes).bounds_hz
    total = (
        frequency_mesh_errors(coupled, modes)["ball"]
        + frequency_shape_errors(coupled, modes)["ball"]
        + bounds
    )
    assert (np.isnan(total[6:11]) | (total[6:11] >= np.abs(true))).all()
