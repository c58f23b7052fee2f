"""Fillets, holes, pins, pockets and pads of STEP parts that are left out of a mesh."""

from pathlib import Path

import gmsh
import numpy as np
import pytest

from built_parts import built_part
from common import approx, make_faced
from headstock.geometry.parts.components import Component, MeshSettings
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.cad.features import GONE
from headstock.meshing.cad.insets import close_planes
from headstock.meshing.cad.shapes import boundary_faces
from headstock.meshing.components.finishing import patch_moments
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.components.survey import survey_step
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

pytestmark = pytest.mark.process
SUPPORT = Path(__file__).resolve().parents[2] / "data" / "support.toml"


def load_part(*settings: str) -> Component:
    return load_scene(SUPPORT, overrides=settings).machine.components["support"]


@pytest.mark.trials
def test_a_mesh_without_small_radii_is_smaller_keeps_its_interfaces_and_says_what_it_lacks() -> (
    None
):
    whole = mesh_component(load_part())
    plain = mesh_component(load_part("components.support.mesh.leave_out=2 mm"))
    assert len(plain.points) < 0.7 * len(whole.points)
    # faces that interfaces name by number are still those, whatever the kernel calls them now
    areas, centroids = patch_moments(plain.points, plain.patches)
    known_areas, known_centroids = patch_moments(whole.points, whole.patches)
    assert areas["bore"] == approx(known_areas["bore"], rel=0.01)
    assert centroids["bore"] == approx(known_centroids["bore"], abs=1e-4)
    assert whole.quality.volume == approx(1.741e-5, rel=2e-3)
    # fillets at inner edges are material, rounded outer edges and holes lack it
    assert 1e-3 < abs(plain.quality.volume / whole.quality.volume - 1.0) < 0.02
    (remark,) = [text for text in plain.quality.remarks if "mesh.leave_out" in text]
    assert "2 mm" in remark and "mesh.leave_out" in remark


def test_radii_that_no_face_has_leave_the_part_as_it_is() -> None:
    part = mesh_component(load_part("components.support.mesh.leave_out=0.5 mm"))
    assert any("mesh.leave_out" in text for text in part.quality.remarks)
    assert part.quality.volume == approx(1.741e-5, rel=2e-3)


def test_only_step_parts_have_features_to_leave_out() -> None:
    box = 'components.support.solid={ box = ["10 mm", "10 mm", "10 mm"] }'
    with pytest.raises(SceneError, match="STEP parts only; remove leave_out"):
        load_part(box, "components.support.mesh.leave_out=2 mm")
    assert MeshSettings().leave_out is None


BLOCK, PAD, POCKET = 60 * 40 * 20.0, 8 * 6 * 2.0, 6 * 5 * 3.0
BORE, COUNTERBORE = np.pi * 2.0**2 * 16.0, np.pi * 4.0**2 * 4.0
WIDE = np.pi * 6.0**2 * 20.0


def build_block() -> int:
    """A block of 60 x 40 x 20 with a counterbored hole, a wide one, a pad, a pocket, and a notch
    across an edge.
    """
    occ = gmsh.model.occ
    block = occ.fuse([(3, occ.addBox(0, 0, 0, 60, 40, 20))], [(3, occ.addBox(5, 5, 19, 8, 6, 3))])
    tools = [
        occ.addCylinder(25, 10, 0, 0, 0, 20, 2.0),
        occ.addCylinder(25, 10, 16, 0, 0, 9, 4.0),
        occ.addCylinder(45, 20, -1, 0, 0, 22, 6.0),
        occ.addBox(10, 25, -1, 6, 5, 4),
        occ.addBox(57, 37, 15, 9, 9, 9),
    ]
    found = occ.cut(block[0], [(3, tool) for tool in tools])[0]
    occ.synchronize()
    return int(found[0][1])


@pytest.fixture
def block(tmp_path: Path) -> Path:
    with built_part(tmp_path / "block.step"):
        build_block()
    return tmp_path / "block.step"


def test_planes_close_over_what_lies_within_them_and_the_volumes_are_known(kernel: None) -> None:
    volume = build_block()
    before = boundary_faces(volume)
    whole = float(gmsh.model.occ.getMass(3, volume))
    shape = close_planes(volume, width=9.0, named=(), ends=(), unit=1e-3)
    assert shape is not None and shape.left_out is not None
    expected = sorted(float(change) for change in (-BORE - COUNTERBORE, -POCKET, PAD))
    assert sorted(float(part) for part in shape.left_out.volumes) == approx(expected, rel=1e-9)
    left = float(gmsh.model.occ.getMass(3, shape.volume))
    assert left == approx(whole + BORE + COUNTERBORE + POCKET - PAD, rel=1e-9)
    # bore, counterbore and its floor; the pad's five faces; the pocket's five
    assert shape.faces.count(GONE) == 13
    assert len(shape.faces) == len(before)
    assert set(shape.numbers) == set(boundary_faces(shape.volume))
    # middles of the features: through the bore, above the block, in the pocket
    middles = shape.left_out.places[:, 1][np.argsort(shape.left_out.volumes)]
    assert middles[0][:2] == approx([25.0, 10.0])
    assert middles[1] == approx([13.0, 27.5, 1.5])
    assert middles[2] == approx([9.0, 8.0, 21.0])
    # a round hole right through takes three times the energy of its volume, the pad its own
    strengths = shape.left_out.strengths[np.argsort(shape.left_out.volumes)]
    assert strengths[0] == approx(3.0, rel=1e-6)
    assert 1.0 < strengths[1] < 3.0
    assert strengths[2] == 1.0
    assert "3 holes, recesses and pads of 13 of" in shape.remarks[0]


def test_faces_that_something_refers_to_stay(kernel: None) -> None:
    volume = build_block()
    faces = boundary_faces(volume)
    top = max(float(gmsh.model.occ.getBoundingBox(2, face)[5]) for face in faces)
    bore = next(
        number
        for number, face in enumerate(faces, 1)
        if gmsh.model.occ.getMass(2, face) == approx(np.pi * 4.0 * 16.0, rel=1e-6)
    )
    shape = close_planes(volume, width=9.0, named=(bore,), ends=((2, top),), unit=1e-3)
    assert shape is not None and shape.left_out is not None
    assert shape.left_out.volumes == approx([-POCKET])
    assert shape.faces[bore - 1] != GONE


def test_a_cavity_behind_a_small_opening_is_no_detail(kernel: None) -> None:
    occ = gmsh.model.occ
    found = occ.cut(
        [(3, occ.addBox(0, 0, 0, 60, 60, 60))],
        [(3, occ.addBox(10, 10, 10, 40, 40, 40)), (3, occ.addCylinder(30, 30, 45, 0, 0, 20, 3.0))],
    )[0]
    occ.synchronize()
    shape = close_planes(int(found[0][1]), width=10.0, named=(), ends=(), unit=1e-3)
    assert shape is not None
    assert shape.left_out is None and not shape.remarks


def test_meshes_lack_what_is_narrower_than_half_an_element_unless_told(block: Path) -> None:
    def mesh(details: float | None = None) -> tuple[float, tuple[str, ...], dict[str, float]]:
        settings = MeshSettings(size=0.018, details=details)
        part = make_faced("part", StepFile(block), {"foot": f"face:{foot}"}, mesh=settings)
        found = mesh_component(part)
        areas, _ = patch_moments(found.points, found.patches)
        return found.quality.volume, found.quality.remarks, areas

    faces = survey_step(StepFile(block)).faces
    foot = next(face.number for face in faces if face.center[2] == approx(0.0, abs=1e-9))
    plain, remarks, areas = mesh()
    assert plain == approx((BLOCK - WIDE - 3 * 3 * 5.0) * 1e-9, rel=1e-3)
    assert any("mesh.details" in text for text in remarks)
    # of the foot only the wide hole is cut out, and it is still the face with that number
    assert areas["foot"] == approx((60 * 40 - np.pi * 36.0) * 1e-6, rel=1e-3)
    whole, remarks, _ = mesh(details=0.0)
    lost = BORE + COUNTERBORE + POCKET - PAD
    assert whole == approx(plain - lost * 1e-9, rel=1e-3)
    assert not any("mesh.details" in text for text in remarks)


def test_only_step_parts_have_details_to_close() -> None:
    box = 'components.support.solid={ box = ["10 mm", "10 mm", "10 mm"] }'
    with pytest.raises(SceneError, match="STEP parts only; remove details"):
        load_scene(SUPPORT, overrides=(box, "components.support.mesh.details=2 mm"))
