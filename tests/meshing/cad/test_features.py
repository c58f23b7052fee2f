"""Fillets, holes and pins of STEP parts that are left out of a mesh."""

from pathlib import Path

import pytest

from common import approx
from headstock.geometry.parts.components import Component, MeshSettings
from headstock.meshing.components.finishing import patch_moments
from headstock.meshing.components.meshing import mesh_component
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
