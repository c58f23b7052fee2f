"""Tets that grow from the rims of patches and of rigid interfaces: small where asked, few
elsewhere, areas and volume kept.
"""

import dataclasses

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import _estimate_cells, mesh_component
from headstock.meshing.elements.quality import integrate_mesh, scaled_jacobians
from headstock.meshing.errors import MeshError
from meshed_parts import make_part, mesh_part

pytestmark = pytest.mark.process

BLOCK = Box((0.03, 0.4, 0.2))
PAD, BACK = (Patch(face, "rect", (0.0, 0.0, 0.1), (0.01, 0.01)) for face in ("x+", "x-"))


def edges_near(mesh: ComponentMesh, place: FloatArray, reach: float) -> FloatArray:
    """Lengths of the edges of the cells whose centres lie within a reach of a place."""
    corners = mesh.points[mesh.cells[:, :4]]
    near = corners[np.linalg.norm(corners.mean(axis=1) - place, axis=1) < reach]
    return np.concatenate(
        [np.linalg.norm(near[:, a] - near[:, b], axis=1) for a in range(4) for b in range(a)]
    )


def test_elements_grow_from_a_patch_with_the_distance() -> None:
    component = make_part(BLOCK, {"pad": PAD, "back": BACK}, size=0.03, across_patches=16)
    even = mesh_component(component)
    graded_component = dataclasses.replace(
        component, mesh=dataclasses.replace(component.mesh, growth=0.5)
    )
    graded = mesh_component(graded_component)
    # a tenth of the elements with the same at the rim
    assert len(graded.cells) < 0.2 * len(even.cells)
    corner = np.array([0.015, 0.005, 0.105])
    assert np.quantile(edges_near(graded, corner, 0.0012), 0.1) == approx(
        0.01 / 16, rel=0.4, abs=0.0
    )
    assert 0.5 < _estimate_cells(graded_component) / len(graded.cells) < 2.0
    far = edges_near(graded, np.array([0.0, 0.15, 0.1]), 0.04)
    assert np.median(far) > 0.02
    assert integrate_mesh(graded.points, graded.cells, graded.kind)[0] == approx(
        0.03 * 0.4 * 0.2, rel=1e-12
    )
    assert scaled_jacobians(graded.points, graded.cells, graded.kind).min() > 0.02


def test_elements_are_small_at_the_rim_of_a_rigid_face_and_nowhere_else() -> None:
    component = make_part(
        BLOCK, {"foot": Patch("y-"), "tip": Patch("y+")}, size=0.03, growth=0.5, rim_size=0.003
    )
    averaging = dataclasses.replace(component.interfaces["tip"], coupling="average")
    mesh = mesh_component(
        dataclasses.replace(component, interfaces=component.interfaces | {"tip": averaging})
    )
    assert np.median(edges_near(mesh, np.array([0.015, -0.2, 0.1]), 0.006)) < 0.006
    assert np.median(edges_near(mesh, np.array([0.015, 0.2, 0.1]), 0.02)) > 0.015


def test_a_strip_that_would_fill_a_mesh_is_refused_with_its_name_and_the_width_that_works() -> None:
    strip = Patch("x+", "strip", (0.0, 0.0, 0.25), (0.00006,), "z")
    with pytest.raises(MeshError, match=r"line: .*0.06 mm.*0\.29 mm wide"):
        mesh_part(Box((0.038, 0.1, 0.5)), {"foot": Patch("z-"), "line": strip}, size=0.025)
