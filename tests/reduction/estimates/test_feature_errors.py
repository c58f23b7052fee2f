"""Small features that a mesh lacks are in the error of a part, by about what they change."""

from pathlib import Path

import gmsh
import numpy as np
import pytest

from built_parts import built_part
from common import make_faced
from headstock.geometry.parts.components import MeshSettings
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.estimates.mesh_errors import (
    compliance_feature_errors,
    frequency_feature_errors,
)
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import couple_clamped
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.process

LENGTH, WIDTH, HEIGHT, RADIUS = 160.0, 30.0, 10.0, 2.0


@pytest.fixture(scope="module")
def part_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A strip with eight holes through its thickness along the middle."""
    path = tmp_path_factory.mktemp("strip") / "strip.step"
    occ = gmsh.model.occ
    with built_part(path):
        holes = [
            (3, occ.addCylinder(20.0 * i - 10.0, WIDTH / 2, -1, 0, 0, HEIGHT + 2, RADIUS))
            for i in range(1, 9)
        ]
        occ.cut([(3, occ.addBox(0, 0, 0, LENGTH, WIDTH, HEIGHT))], holes)
    return path


def couple_strip(path: Path, settings: MeshSettings) -> CoupledMachine:
    faces = {"foot": "average x-", "tip": "average x+"}
    part = make_faced("strip", StepFile(path), faces, mesh=settings)
    element = reduce_mesh(part, mesh_component(part), modes=8)
    return couple_clamped(part, element)


def test_holes_left_out_stand_behind_compliances_and_frequencies_as_large_as_they_matter(
    part_file: Path,
) -> None:
    closed = couple_strip(part_file, MeshSettings(size=0.01))
    whole = couple_strip(part_file, MeshSettings(size=0.01, details=0.0))
    plain, true = point_budget(closed, "tcp"), point_budget(whole, "tcp")
    found = compliance_feature_errors(closed, plain.displacements)["strip"]
    changes = np.diag(true.compliance) - np.diag(plain.compliance)
    # tension and bending across the thickness: Kirsch's holes, three times the energy of their
    # volume, and a safety of one half on top
    for axis in (0, 2):
        share = changes[axis] / plain.compliance[axis, axis]
        assert 0.01 < share < 0.1
        assert 1.0 <= found[axis] / changes[axis] <= 2.0
    assert found[1] > changes[1] > 0.0  # bending in the plane: holes lie where little is strained
    before, after = (solve_modal(one.system, count=3).frequencies_hz for one in (closed, whole))
    errors = frequency_feature_errors(closed, solve_modal(closed.system, count=3))["strip"]
    assert (np.abs(after - before) <= errors).all()
    assert (errors <= 0.05 * before).all()
    assert compliance_feature_errors(whole, true.displacements) == {}
