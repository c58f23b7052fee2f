"""Faces of a mesh's surface: a box has six, a tube four, whatever the elements."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.parts.cad_faces import find_holes
from headstock.geometry.parts.solids import Box, Plate, Tube
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.regions import describe_faces, split_surface
from headstock.meshing.elements.surface import extract_surface
from meshed_parts import make_part, mesh_part

pytestmark = pytest.mark.process


@pytest.mark.parametrize("cells", ["tet", "hex"])
def test_a_box_has_six_planes_with_their_areas(cells: str) -> None:
    mesh = mesh_part(Box((0.3, 0.2, 0.5)), size=0.06, cells=cells)
    surface = extract_surface(mesh.cells, mesh.kind)
    faces = describe_faces(mesh.points, surface, split_surface(mesh.points, surface))
    assert [face.number for face in faces] == [1, 2, 3, 4, 5, 6]
    assert {face.kind for face in faces} == {"plane"}
    areas = sorted(face.area for face in faces)
    assert areas == approx([0.06, 0.06, 0.1, 0.1, 0.15, 0.15], rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_a_tube_has_two_rings_a_mantle_and_a_hole(order: int) -> None:
    tube = make_part(Tube(0.04, 0.02, 0.03), size=0.006, order=order)
    mesh = mesh_component(tube)
    surface = extract_surface(mesh.cells, mesh.kind)
    faces = describe_faces(mesh.points, surface, split_surface(mesh.points, surface))
    assert sorted(face.kind for face in faces) == ["cylinder", "cylinder", "plane", "plane"]
    radii = {face.hollow: face.radius for face in faces if face.kind == "cylinder"}
    assert radii == {False: approx(0.02, rel=1e-6), True: approx(0.01, rel=1e-6)}
    (hole,) = find_holes(faces)
    assert np.abs(hole.axis[2]) == approx(1.0, rel=1e-9)
    assert hole.place == approx((0.0, 0.0, 0.015), abs=1e-9)


def test_a_ribbed_plate_has_a_face_for_each_side_of_a_rib() -> None:
    plate = Plate((0.3, 0.2, 0.02), rib_height=0.05, rib_thickness=0.01, ribs_x=1)
    mesh = mesh_part(plate, size=0.03)
    surface = extract_surface(mesh.cells, mesh.kind)
    owners = split_surface(mesh.points, surface)
    # below, two above, two sides, the rib's two sides and top, and two ends that plate and rib share
    assert owners.max() == 10
