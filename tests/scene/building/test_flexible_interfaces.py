"""Flexible interfaces in scenes: what they build, and every way in which one can be wrong."""

from pathlib import Path

import pytest

from cases import cases
from common import approx
from fixture_machines import machine, stored_scene, write_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

SCENE = machine("""
machine = "bar"
names = { bar = "post", tip = "top" }
without = ["points"]
components.post.solid = { tube = { outer = "100 mm", inner = "0 mm", length = "300 mm" } }
components.post.interfaces = { foot = { face = "z-" }, top = "COUPLING" }
analyses.modal = { count = 3 }
""")
FLEXIBLE = "coupling = { flexible = 12 }"


def write(folder: Path, coupling: str) -> Path:
    path = write_scene(folder, SCENE.replace('"COUPLING"', f"{{ {coupling} }}"))
    return path


@pytest.mark.parametrize(
    ("written", "coupling"),
    [("", "rigid"), (', form = "strong"', "rigid"), (', form = "weak"', "average")],
)
def test_the_strong_form_fixes_points_and_the_weak_one_means(
    tmp_path: Path, written: str, coupling: str
) -> None:
    path = write(tmp_path, f'face = "z+", coupling = {{ flexible = 12{written} }}')
    top = load_scene(path).machine.components["post"].interfaces["top"]
    assert (top.coupling, top.flexible) == (coupling, 12)


@cases
def test_a_flexible_interface_that_cannot_be_is_named_with_its_remedy(
    tmp_path: Path, entry: str, key: str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, entry))
    place = ".".join(["components.post.interfaces.top", *filter(None, [key])])
    found = [item for item in caught.value.problems if item.key.startswith(place)]
    assert any(message in item.message for item in found), str(caught.value)


GLUED = stored_scene("flexible_interfaces_glued")
RECT = 'face = "z+", rect = { size = ["100 mm", "80 mm"] }'
LAYER = 'kind = "bolted"\nstiffness_per_area = { normal = "3 N/um/mm^2", shear = "1 N/um/mm^2" }'


def glue(folder: Path, base: str, post: str, joint: str) -> Path:
    path = write_scene(
        folder,
        GLUED.replace('"BASE"', f"{{ {base} }}")
        .replace('"POST"', f"{{ {post} }}")
        .replace('kind = "JOINT"', joint),
        name="glued",
    )
    return path


def test_a_contact_layer_is_read_in_its_units(tmp_path: Path) -> None:
    path = glue(tmp_path, f"{RECT}, {FLEXIBLE}", f'face = "z-", {FLEXIBLE}', LAYER)
    joint = load_scene(path).machine.joints["glue"]
    assert joint.layer is not None and joint.connects and not joint.fixed
    assert (joint.layer.normal, joint.layer.shear) == approx((3e12, 1e12))


WIDE, RIGHT, FOOT = f'face = "z+", {FLEXIBLE}', f"{RECT}, {FLEXIBLE}", f'face = "z-", {FLEXIBLE}'
DISK = f'face = "z+", disk = {{ diameter = "80 mm" }}, {FLEXIBLE}'


@cases
def test_what_does_not_fit_between_two_faces_is_named(
    tmp_path: Path, base: str, post: str, joint: str, key: str, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(glue(tmp_path, base, post, joint))
    found = [item for item in caught.value.problems if item.key == f"joints.glue.{key}"]
    assert any(message in item.message for item in found), str(caught.value)


def test_a_contact_layer_may_lie_on_a_disk(tmp_path: Path) -> None:
    load_scene(glue(tmp_path, DISK, DISK.replace("z+", "z-"), LAYER))


def test_rectangles_of_one_size_pass_however_they_lie(tmp_path: Path) -> None:
    turned = 'face = "z+", rect = { size = ["80 mm", "100 mm"] }'
    load_scene(glue(tmp_path, f"{RECT}, {FLEXIBLE}", f'face = "z-", {FLEXIBLE}', 'kind = "rigid"'))
    # one that is turned by a right angle is for the coupling to judge
    load_scene(
        glue(tmp_path, f"{turned}, {FLEXIBLE}", f'face = "z-", {FLEXIBLE}', 'kind = "rigid"')
    )
